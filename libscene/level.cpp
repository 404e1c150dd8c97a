#include "libscene/level.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <unordered_set>

#include <fmt/format.h>
#include <glm/gtc/quaternion.hpp>

#include "libscene/gltf_accessor.h"
#include "libscene/gltf_check.h"
#include "libscene/gltf_read.h"
#include "libscene/level_light.h"
#include "libscene/level_material.h"
#include "libscene/level_mesh.h"

namespace lmc {
namespace {

constexpr double kUnitQuaternion = 0.01;      // exporters round to five digits; a hundredth is no rounding
constexpr std::size_t kMaxPathLength = 1024;  // of an object, in bytes; deeper ones are cut in front

glm::dvec3 vec3(const std::vector<double>& v, double fallback) {
  return v.size() == 3 ? glm::dvec3(v[0], v[1], v[2]) : glm::dvec3(fallback);
}

/// What a node hands down to its children.
struct Inherited {
  glm::dmat4 world{1.0};
  bool visible = true, moving = false;  ///< KHR_node_visibility; an animation moves it
  bool isStatic = true, receive = true, cast = true;
  double texelsPerMetre = 0.0;
};

struct Visit {
  std::uint32_t node, parent;
  Inherited state;
};

class Loader {
 public:
  Loader(const std::filesystem::path& level, const LoadLimits& limits, const Run& run, ShadingLevel* shading)
      : limits_(limits), run_(run), shading_(shading), file_(readGltf(level, limits, run)), model_(typedModel(file_)) {
    scene_.file = level;
    checkIndexValues(file_, model_);
  }
  Scene load();

 private:
  void warn(const std::string& where, const std::string& text, const char* code) {
    run_.warn({.file = file_.path.string(), .where = where, .text = text, .code = code});
  }
  void note(const std::string& where, const std::string& text, const char* code) {
    run_.note({.file = file_.path.string(), .where = where, .text = text, .code = code});
  }
  std::vector<std::uint32_t> roots();
  void markMoving();
  void visitNodes();
  Inherited enter(std::uint32_t node, const Inherited& parent);
  glm::dmat4 localMatrix(std::uint32_t node);
  bool deforms(const tinygltf::Node& node) const;
  void chooseMeshNodes();
  void countAhead();
  void addNode(const Visit& visit);
  void addObject(const Visit& visit, std::uint32_t primitive, std::uint32_t instance, const glm::dmat4& world, bool instanced);
  void addVertices(const Part& part, const glm::dmat4& world, const std::string& where);
  void addVerticesForShading(const Part& part);
  bool addTriangles(const Part& part, std::uint32_t firstVertex, bool mirrored);
  void checkTextureSets(const Object& object, const Part& part) const;
  const Part& part(std::uint32_t mesh, std::uint32_t primitive, std::uint32_t mapSet);
  void addLight(const Visit& visit, std::size_t light);
  std::string nodeName(std::uint32_t node) const;
  std::string pathOf(std::uint32_t node) const;
  void addLightsAndCameras();
  void recentre();
  void finishMaterials();
  template <class F>
  void finishLooks(const F& wanted);
  void report();

  LoadLimits limits_;
  const Run& run_;
  ShadingLevel* shading_;  ///< what a renderer wants; may be null
  GltfFile file_;
  tinygltf::Model model_;
  Scene scene_;
  std::vector<Visit> visits_;  ///< nodes of the scene, parents first, in the order of the file
  std::vector<std::uint32_t> parentOf_;
  std::vector<bool> animated_;                          ///< by a channel that targets this very node
  std::vector<std::uint32_t> meshNodes_;                ///< into visits_
  std::vector<bool> lightMoves_;                        ///< its numbers are animated
  bool restPose_ = false;                               ///< nothing but dynamic meshes: they are baked as they stand
  std::vector<glm::dvec3> world_m_;                     ///< of each vertex, not recentred
  std::vector<std::uint32_t> useOf_;                    ///< nodes still to come that show this mesh
  std::map<std::array<std::uint32_t, 3>, Part> parts_;  ///< decoded primitives that are still needed, by mesh, number and map UV set
  std::unordered_set<std::string> objectPaths_, lightPaths_;
  bool secondSetIsTexture_ = false;  ///< a texture samples TEXCOORD_1
  PartReport partReport_;
  std::uint64_t flattened_ = 0, flat_ = 0, defaultMaterial_ = 0, notUnitRotations_ = 0;
};

std::string nodeWhere(std::uint32_t node) { return fmt::format("/nodes/{}", node); }

std::string Loader::nodeName(std::uint32_t node) const {
  const std::string& name = model_.nodes[node].name;
  return name.empty() ? fmt::format("node {}", node) : name;
}

std::string Loader::pathOf(std::uint32_t node) const {
  std::vector<std::string> names;
  std::size_t length = 0;
  for (; node != kNone; node = parentOf_[node]) {
    names.push_back(nodeName(node));
    length += names.back().size() + 1;
    if (length > kMaxPathLength) {
      names.push_back("...");
      break;
    }
  }
  std::string path;
  for (auto name = names.rbegin(); name != names.rend(); ++name) path += "/" + *name;
  return path;
}

/// The path itself, or with the node's number where another has it already.
std::string uniquePath(std::unordered_set<std::string>& taken, const std::string& path, std::uint32_t node) {
  std::string unique = path;
  if (!taken.insert(unique).second) unique = fmt::format("{}[node {}]", path, node);
  for (int n = 2; unique != path && !taken.insert(unique).second; ++n) unique = fmt::format("{}[node {}]#{}", path, node, n);
  return unique;
}

std::vector<std::uint32_t> Loader::roots() {
  const Json* scenes = member(file_.json, "scenes");
  if (scenes && !scenes->empty()) {
    const Json* chosen = member(file_.json, "scene");
    if (!chosen && scenes->size() > 1)
      note("/scenes", fmt::format("no default scene; the first of {} is taken", scenes->size()), "LMC_NO_SCENE");
    const auto index = chosen ? chosen->get<std::size_t>() : 0;
    readSceneExtras((*scenes)[index], scene_);
    const std::vector<int>& nodes = model_.scenes[index].nodes;
    return {nodes.begin(), nodes.end()};
  }
  std::vector<std::uint32_t> out;
  for (std::uint32_t n = 0; n < model_.nodes.size(); ++n)
    if (parentOf_[n] == kNone) out.push_back(n);
  if (!out.empty()) warn("", "the file has no scene; every node is taken", "LMC_NO_SCENE");
  return out;
}

/// Nodes and lights that animation channels change, KHR_animation_pointer included.
void Loader::markMoving() {
  animated_.assign(model_.nodes.size(), false);
  const Json* lights = extension(file_.json, "KHR_lights_punctual");
  lightMoves_.assign(lights && member(*lights, "lights") ? (*lights)["lights"].size() : 0, false);
  const Json* animations = member(file_.json, "animations");
  if (!animations || !animations->is_array()) return;
  const auto mark = [](std::vector<bool>& marks, std::string_view pointer, std::string_view prefix) {
    if (!pointer.starts_with(prefix)) return;
    std::size_t index = 0;
    const auto digits = pointer.substr(prefix.size());
    for (std::size_t i = 0; i < digits.size() && digits[i] >= '0' && digits[i] <= '9' && index < marks.size(); ++i)
      index = index * 10 + std::size_t(digits[i] - '0');
    if (index < marks.size()) marks[index] = true;
  };
  for (const Json& animation : *animations) {
    const Json* channels = member(animation, "channels");
    if (!channels || !channels->is_array()) continue;
    for (const Json& channel : *channels) {
      const Json* target = member(channel, "target");
      if (!target) continue;
      if (const Json* node = member(*target, "node"); node && node->is_number_unsigned() && node->get<std::uint64_t>() < animated_.size())
        animated_[node->get<std::size_t>()] = true;
      const Json* byPointer = extension(*target, "KHR_animation_pointer");
      const Json* pointer = byPointer ? member(*byPointer, "pointer") : nullptr;
      if (!pointer || !pointer->is_string()) continue;
      mark(animated_, pointer->get_ref<const std::string&>(), "/nodes/");
      mark(lightMoves_, pointer->get_ref<const std::string&>(), "/extensions/KHR_lights_punctual/lights/");
    }
  }
}

glm::dmat4 Loader::localMatrix(std::uint32_t node) {
  const tinygltf::Node& from = model_.nodes[node];
  if (from.matrix.size() == 16) {
    glm::dmat4 m;
    for (int i = 0; i < 16; ++i) m[i / 4][i % 4] = from.matrix[std::size_t(i)];
    return m;
  }
  glm::dquat rotation(1.0, 0.0, 0.0, 0.0);
  if (from.rotation.size() == 4) {
    rotation = glm::dquat(from.rotation[3], from.rotation[0], from.rotation[1], from.rotation[2]);
    if (std::abs(glm::length(rotation) - 1.0) > kUnitQuaternion) ++notUnitRotations_;
  }
  return Trs{vec3(from.translation, 0.0), rotation, vec3(from.scale, 1.0)}.matrix();
}

Inherited Loader::enter(std::uint32_t node, const Inherited& parent) {
  Inherited state = parent;
  state.world = parent.world * localMatrix(node);
  // Before anything is multiplied by infinity.
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 4; ++r)
      if (!std::isfinite(state.world[c][r]))
        throw Error(Exit::Broken, file_.path, nodeWhere(node), "its place in the world is beyond all numbers", "LMC_EXTENT_TOO_LARGE");
  state.moving = parent.moving || animated_[node];
  const Json& json = file_.json["nodes"][node];
  if (const Json* visibility = extension(json, "KHR_node_visibility")) state.visible = state.visible && visibility->value("visible", true);
  if (const Json* lmc = lmcExtras(json)) {
    state.isStatic = lmc->value("static", state.isStatic);
    state.receive = lmc->value("receive", state.receive);
    state.cast = lmc->value("cast", state.cast);
    state.texelsPerMetre = lmc->value("texelsPerMetre", state.texelsPerMetre);
  }
  return state;
}

/// Depth first with a stack of our own: a level may nest its nodes as deep as it likes.
void Loader::visitNodes() {
  parentOf_.assign(model_.nodes.size(), kNone);
  for (std::uint32_t n = 0; n < model_.nodes.size(); ++n)
    for (const int child : model_.nodes[n].children) parentOf_[std::size_t(child)] = n;
  struct Pending {
    std::uint32_t node;
    std::size_t parentVisit;
  };
  std::vector<Pending> stack;
  const std::vector<std::uint32_t> first = roots();
  for (auto n = first.rbegin(); n != first.rend(); ++n) stack.push_back({*n, visits_.max_size()});
  while (!stack.empty()) {
    const auto [node, parentVisit] = stack.back();
    stack.pop_back();
    const bool root = parentVisit == visits_.max_size();
    visits_.push_back({node, root ? kNone : visits_[parentVisit].node, enter(node, root ? Inherited{} : visits_[parentVisit].state)});
    const std::vector<int>& children = model_.nodes[node].children;
    for (auto c = children.rbegin(); c != children.rend(); ++c) stack.push_back({std::uint32_t(*c), visits_.size() - 1});
  }
}

bool Loader::deforms(const tinygltf::Node& node) const {
  if (node.skin >= 0) return true;
  const auto& primitives = model_.meshes[std::size_t(node.mesh)].primitives;
  return std::any_of(primitives.begin(), primitives.end(), [](const tinygltf::Primitive& p) { return !p.targets.empty(); });
}

/// Which nodes' meshes are baked: the static ones, or at rest pose all that the level did not call dynamic itself.
void Loader::chooseMeshNodes() {
  std::vector<std::uint32_t> atRest;
  for (std::uint32_t v = 0; v < visits_.size(); ++v) {
    const tinygltf::Node& node = model_.nodes[visits_[v].node];
    const Inherited& state = visits_[v].state;
    if (node.mesh < 0 || !state.visible) continue;
    if (!state.isStatic) {
      ++scene_.dynamicMeshNodes;
    } else if (state.moving || deforms(node)) {
      atRest.push_back(v);
    } else {
      meshNodes_.push_back(v);
    }
  }
  restPose_ = meshNodes_.empty() && !atRest.empty();
  if (restPose_) {
    meshNodes_ = atRest;
    warn("", "every mesh is skinned, morphed or animated; they are baked as they stand at rest", "LMC_DEFORMABLE");
  } else {
    scene_.dynamicMeshNodes += std::uint32_t(atRest.size());
  }
  if (shading_) {
    // All that is to be seen, in the order of the file; which light counts as dynamic still hangs on the choice above.
    meshNodes_.clear();
    for (std::uint32_t v = 0; v < visits_.size(); ++v)
      if (model_.nodes[visits_[v].node].mesh >= 0 && visits_[v].state.visible) meshNodes_.push_back(v);
  } else if (scene_.dynamicMeshNodes > 0) {
    note("", fmt::format("{} mesh nodes are dynamic (skinned, morphed, animated or static: false) and left out", scene_.dynamicMeshNodes),
         "LMC_DYNAMIC");
  }
}

const Part& Loader::part(std::uint32_t mesh, std::uint32_t primitive, std::uint32_t mapSet) {
  const auto [it, isNew] = parts_.try_emplace({mesh, primitive, mapSet});
  if (isNew) it->second = readPart(file_, model_, mesh, primitive, {mapSet, shading_ != nullptr}, partReport_);
  return it->second;
}

void Loader::addVertices(const Part& part, const glm::dmat4& world, const std::string& where) {
  const glm::dmat3 linear(world);
  // Rows of the adjugate: the inverse transpose times the determinant, finite where that is zero. Its sign undoes a mirror.
  const double sign = glm::determinant(linear) < 0.0 ? -1.0 : 1.0;
  const glm::dmat3 cofactor(sign * glm::cross(linear[1], linear[2]), sign * glm::cross(linear[2], linear[0]),
                            sign * glm::cross(linear[0], linear[1]));
  const std::size_t first = world_m_.size(), count = part.positions.size();
  for (const glm::vec3& position : part.positions) {
    const glm::dvec3 p(world * glm::dvec4(glm::dvec3(position), 1.0));
    // Written so that a NaN fails too.
    if (!(std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z)}) <= limits_.maxExtent_m))
      throw Error(Exit::Broken, file_.path, where, fmt::format("a vertex is farther than {:g} m from the origin", limits_.maxExtent_m),
                  "LMC_EXTENT_TOO_LARGE");
    world_m_.push_back(p);
  }
  for (const glm::vec3& normal : part.normals) {
    const glm::dvec3 n = cofactor * glm::dvec3(normal);
    const double length = glm::length(n);
    // A node flattened to a line or a point has no normals, and no triangles either: any unit vector will do.
    scene_.normals.push_back(length > 0.0 && std::isfinite(length) ? glm::vec3(n / length) : glm::vec3(0.0f, 1.0f, 0.0f));
  }
  const auto append = [&](auto& to, const auto& from) {
    to.insert(to.end(), from.begin(), from.end());
    to.resize(first + count);
  };
  append(scene_.uv0, part.uv0);
  if (secondSetIsTexture_) append(scene_.uv1, part.uv1);
  append(scene_.mapUv, part.mapUv);
  if (shading_) addVerticesForShading(part);
  if (part.source.empty())
    for (std::uint32_t v = 0; v < count; ++v) scene_.sourceVertex.push_back(v);
  else
    append(scene_.sourceVertex, part.source);
  if (part.colors.empty() && scene_.colors.empty()) return;
  scene_.colors.resize(first, glm::vec4(1.0f));
  scene_.colors.insert(scene_.colors.end(), part.colors.begin(), part.colors.end());
  scene_.colors.resize(first + count, glm::vec4(1.0f));
}

void Loader::addVerticesForShading(const Part& part) {
  shading_->positions_m.insert(shading_->positions_m.end(), part.positions.begin(), part.positions.end());
  shading_->normals.insert(shading_->normals.end(), part.normals.begin(), part.normals.end());
  shading_->tangents.insert(shading_->tangents.end(), part.tangents.begin(), part.tangents.end());
  shading_->tangents.resize(shading_->positions_m.size(), glm::vec4(0.0f));
}

/// Returns false when no triangle of the part has an area in the world.
bool Loader::addTriangles(const Part& part, std::uint32_t firstVertex, bool mirrored) {
  const std::size_t before = scene_.triangles.size();
  for (glm::uvec3 t : part.triangles) {
    t += firstVertex;
    if (mirrored) std::swap(t.y, t.z);
    const glm::dvec3 a = world_m_[t.x], b = world_m_[t.y], c = world_m_[t.z];
    if (glm::length(glm::cross(b - a, c - a)) >= kMinTwiceArea)
      scene_.triangles.push_back(t);
    else
      ++partReport_.degenerate;
  }
  scene_.triangleObject.resize(scene_.triangles.size(), std::uint32_t(scene_.objects.size()));
  return scene_.triangles.size() > before;
}

void Loader::checkTextureSets(const Object& object, const Part& part) const {
  const Material& material = scene_.materials[object.material];
  const std::string where = fmt::format("/meshes/{}/primitives/{}", object.mesh, object.primitive);
  for (const TextureSlot& slot : kTextureSlots) {
    const Texture& texture = material.*slot.texture;
    if (!texture) continue;
    if (texture.uvSet > 1)
      throw Error(Exit::Unsupported, file_.path, where,
                  fmt::format("/materials/{}{} uses TEXCOORD_{}; only 0 and 1 are supported", object.material, slot.pointer, texture.uvSet),
                  "LMC_TEXCOORD");
    if ((texture.uvSet == 0 ? part.uv0 : part.uv1).empty())
      throw Error(
          Exit::Broken, file_.path, where,
          fmt::format("has no TEXCOORD_{}, which its material wants at /materials/{}{}", texture.uvSet, object.material, slot.pointer),
          "LMC_REFERENCE");
  }
}

/// Where lmc has put an object's light map before: extras.lmc.lightmap of its node.
struct MapMark {
  std::uint32_t texCoord = 1, map = 0;
  bool found = false;
};

MapMark mapMark(const Json& node) {
  constexpr std::uint32_t kMostMaps = 4096;
  MapMark out;
  const Json* lmc = lmcExtras(node);
  const Json* mark = lmc ? member(*lmc, "lightmap") : nullptr;
  if (!mark || !mark->is_object()) return out;
  const auto number = [&](const char* key, std::uint32_t fallback, std::uint32_t most) {
    const Json* n = member(*mark, key);
    return n && n->is_number_unsigned() && n->get<std::uint64_t>() < most ? n->get<std::uint32_t>() : fallback;
  };
  out.found = true;
  out.texCoord = std::max(1u, number("texCoord", 1, 64));
  out.map = number("map", 0, kMostMaps);
  return out;
}

void Loader::addObject(const Visit& visit, std::uint32_t primitive, std::uint32_t instance, const glm::dmat4& world, bool instanced) {
  const auto mesh = std::uint32_t(model_.nodes[visit.node].mesh);
  const tinygltf::Primitive& from = model_.meshes[mesh].primitives[primitive];
  const MapMark mark = mapMark(file_.json["nodes"][visit.node]);
  const Part& geometry = part(mesh, primitive, mark.texCoord);
  Object object;
  object.node = visit.node;
  object.mesh = mesh;
  object.primitive = primitive;
  object.instance = instance;
  object.material = std::uint32_t(from.material >= 0 ? std::size_t(from.material) : scene_.materials.size() - 1);
  checkTextureSets(object, geometry);
  const auto firstVertex = std::uint32_t(world_m_.size());
  const std::string where = nodeWhere(visit.node);
  if (world_m_.size() + geometry.positions.size() >= kNone)
    throw Error(Exit::Broken, file_.path, where, "the level has more than 4 billion vertices", "LMC_MEMORY_LIMIT");
  object.firstTriangle = std::uint32_t(scene_.triangles.size());
  object.firstVertex = firstVertex;
  object.vertexCount = std::uint32_t(geometry.positions.size());
  object.mirrored = glm::determinant(glm::dmat3(world)) < 0.0;
  addVertices(geometry, world, where);
  if (!addTriangles(geometry, firstVertex, object.mirrored)) {
    ++flat_;
    return;
  }
  object.triangleCount = std::uint32_t(scene_.triangles.size()) - object.firstTriangle;
  const std::string& nodesName = model_.nodes[visit.node].name;
  object.name = !nodesName.empty() ? nodesName : !model_.meshes[mesh].name.empty() ? model_.meshes[mesh].name : nodeName(visit.node);
  std::string path = pathOf(visit.node);
  if (instanced) path += fmt::format("[{}]", instance);
  if (model_.meshes[mesh].primitives.size() > 1) path += fmt::format("/primitive {}", primitive);
  object.path = uniquePath(objectPaths_, path, visit.node);
  object.receive = visit.state.receive;
  object.cast = visit.state.cast;
  object.inMap = !geometry.mapUv.empty();
  object.map = mark.map;
  object.texCoord = mark.texCoord;
  object.freeTexCoord = freeTexCoord(file_.json, file_.json["meshes"][mesh]["primitives"][primitive]);
  object.texelsPerMetre = visit.state.texelsPerMetre;
  defaultMaterial_ += from.material < 0;
  if (shading_) {
    shading_->worlds.push_back(world);
    shading_->marked.push_back(mark.found && object.inMap);
  }
  scene_.objects.push_back(std::move(object));
}

void Loader::addNode(const Visit& visit) {
  const auto mesh = std::uint32_t(model_.nodes[visit.node].mesh);
  const auto& primitives = model_.meshes[mesh].primitives;
  const bool instanced = extension(file_.json["nodes"][visit.node], "EXT_mesh_gpu_instancing") != nullptr;
  const std::vector<Trs> all = instanced ? readInstances(file_, model_, visit.node) : std::vector<Trs>(1);
  for (std::uint32_t i = 0; i < all.size(); ++i) {
    const glm::dmat4 world = instanced ? visit.state.world * all[i].matrix() : visit.state.world;
    for (std::uint32_t p = 0; p < primitives.size(); ++p)
      if (hasTriangles(primitives[p])) addObject(visit, p, i, world, instanced);
  }
  const glm::dmat3 linear(visit.state.world);
  const double size = glm::length(linear[0]) * glm::length(linear[1]) * glm::length(linear[2]);
  flattened_ += !(std::abs(glm::determinant(linear)) > 1e-12 * size) || size == 0.0;
  if (--useOf_[mesh] == 0) parts_.erase(parts_.lower_bound({mesh, 0, 0}), parts_.lower_bound({mesh + 1, 0, 0}));
}

void Loader::addLight(const Visit& visit, std::size_t light) {
  const bool dynamic = !visit.state.isStatic || (visit.state.moving && !restPose_) || lightMoves_[light];
  if (dynamic) {
    ++scene_.dynamicLights;
    if (!shading_) return;
  }
  Light out = readLight(file_, light, visit.state.world, nodeWhere(visit.node), run_);
  if (!(std::max({std::abs(out.position_m.x), std::abs(out.position_m.y), std::abs(out.position_m.z)}) <= limits_.maxExtent_m))
    throw Error(Exit::Broken, file_.path, nodeWhere(visit.node),
                fmt::format("the light is farther than {:g} m from the origin", limits_.maxExtent_m), "LMC_EXTENT_TOO_LARGE");
  out.path = uniquePath(lightPaths_, pathOf(visit.node), visit.node);
  out.node = std::uint32_t(visit.node);
  if (shading_) {
    shading_->lights.push_back(readShadedLight(file_, light, out));
    const Json* lmc = lmcExtras(file_.json["nodes"][visit.node]);
    const Json* baked = lmc ? member(*lmc, "baked") : nullptr;
    shading_->lights.back().baked = !dynamic && baked && *baked == true;
  }
  if (!dynamic) scene_.lights.push_back(std::move(out));
}

void Loader::recentre() {
  glm::dvec3 low(std::numeric_limits<double>::infinity()), high(-low);
  for (const glm::uvec3& t : scene_.triangles)
    for (int c = 0; c < 3; ++c) {
      low = glm::min(low, world_m_[t[c]]);
      high = glm::max(high, world_m_[t[c]]);
    }
  if (!scene_.triangles.empty()) scene_.centre_m = 0.5 * (low + high);
  scene_.positions_m.reserve(world_m_.size());
  for (const glm::dvec3& p : world_m_) scene_.positions_m.emplace_back(p - scene_.centre_m);
  world_m_ = {};
  for (const glm::uvec3& t : scene_.triangles)
    for (int c = 0; c < 3; ++c) {
      const glm::vec3 p = glm::abs(scene_.positions_m[t[c]]);
      scene_.extent_m = std::max({scene_.extent_m, p.x, p.y, p.z});
    }
  for (Light& light : scene_.lights) light.position_m -= scene_.centre_m;
  for (Camera& camera : scene_.cameras) camera.position_m -= scene_.centre_m;
  if (!shading_) return;
  for (ShadedLight& light : shading_->lights) light.light.position_m -= scene_.centre_m;
  for (glm::dmat4& world : shading_->worlds) world[3] -= glm::dvec4(scene_.centre_m, 0.0);
}

/// Calls wanted(texture, material) for each texture of a look that can be read.
template <class F>
void Loader::finishLooks(const F& wanted) {
  shading_->looks = readLooks(file_, model_, run_);
  for (std::size_t m = 0; m < shading_->looks.size(); ++m)
    for (const auto slot : kLookTextures) {
      Texture& texture = shading_->looks[m].*slot;
      if (texture && texture.uvSet > 1) {
        note(fmt::format("/materials/{}", m), fmt::format("a texture uses TEXCOORD_{}; it is left out", texture.uvSet), "LMC_TEXCOORD");
        texture = {};
      }
      wanted(texture, m);
    }
}

void Loader::finishMaterials() {
  std::vector<bool> used(scene_.materials.size(), false);
  for (const Object& object : scene_.objects) used[object.material] = true;
  std::vector<Texture*> textures;
  const auto wanted = [&](Texture& texture, std::size_t material) {
    if (used[material])
      textures.push_back(&texture);
    else
      texture = {};
  };
  for (std::size_t m = 0; m < scene_.materials.size(); ++m)
    for (const TextureSlot& slot : kTextureSlots) wanted(scene_.materials[m].*slot.texture, m);
  if (shading_) finishLooks(wanted);
  scene_.images = decodeImages(file_, textures, limits_, run_);
  std::uint32_t clear = 0;
  for (std::size_t m = 0; m < used.size(); ++m) clear += used[m] && !scene_.materials[m].opaqueToLight();
  if (clear > 0)
    note("", fmt::format("{} materials are blended or transmissive: they receive light, cast no shadow and reflect nothing", clear),
         "LMC_TRANSPARENT");
}

void Loader::report() {
  const auto count = [&](std::uint64_t n, const char* text, const char* code, bool isWarning) {
    if (n == 0) return;
    if (isWarning)
      warn("", fmt::format("{} {}", n, text), code);
    else
      note("", fmt::format("{} {}", n, text), code);
  };
  count(partReport_.degenerate, "triangles have no area and are left out", "LMC_DEGENERATE_TRIANGLE", false);
  count(partReport_.normalsNotUnit, "normals are not of length 1 and are normalised", "LMC_NORMAL_NOT_UNIT", false);
  count(partReport_.normalsOpposite, "normals point away from every face at their vertex and are made from the faces",
        "LMC_NORMAL_OPPOSITE", true);
  count(partReport_.normalsRebuilt, "normals are zero or not finite and are made from the faces", "LMC_NORMAL_ZERO", true);
  count(flattened_, "mesh nodes are flattened by a scale of 0 or a singular matrix", "LMC_MATRIX_SINGULAR", true);
  count(notUnitRotations_, "rotations are not of length 1 and are normalised", "LMC_ROTATION", true);
  count(flat_, "primitives have no triangle with an area and are left out", "LMC_DEGENERATE_TRIANGLE", true);
  count(defaultMaterial_, "primitives have no material: glTF's default is a metal, which reflects no diffuse light", "LMC_MATERIAL_DEFAULT",
        false);
  count(scene_.dynamicLights, "lights are dynamic (animated or static: false) and not baked", "LMC_DYNAMIC", false);
  if (scene_.triangles.empty()) {
    warn("", "there is no triangle to bake", "LMC_NOTHING_TO_BAKE");
    return;
  }
  const bool glows = std::any_of(scene_.objects.begin(), scene_.objects.end(),
                                 [&](const Object& o) { return scene_.materials[o.material].emission != Rgb(0.0f); });
  if (scene_.lights.empty() && !glows && scene_.sky == Rgb(0.0f))
    note("", "there is no light, nothing that glows and no sky: the maps will be black", "LMC_NO_LIGHT");
}

void Loader::addLightsAndCameras() {
  for (const Visit& visit : visits_) {
    if (const Json* light = extension(file_.json["nodes"][visit.node], "KHR_lights_punctual"); light && visit.state.visible)
      addLight(visit, (*light)["light"].get<std::size_t>());
    if (const int camera = model_.nodes[visit.node].camera; camera >= 0)
      if (auto c = readCamera(model_.cameras[std::size_t(camera)], visit.state.world)) {
        if (c->name.empty()) c->name = nodeName(visit.node);
        scene_.cameras.push_back(std::move(*c));
      }
  }
}

/// What the level will take, before any of it is taken.
void Loader::countAhead() {
  useOf_.assign(model_.meshes.size(), 0);
  std::uint64_t triangles = 0, objects = 0, skipped = 0, noPosition = 0;
  for (const std::uint32_t v : meshNodes_) {
    const std::uint32_t node = visits_[v].node;
    const std::uint64_t copies = instanceCount(file_.json["nodes"][node], file_.json);
    ++useOf_[std::size_t(model_.nodes[node].mesh)];
    objects += copies;
    for (const tinygltf::Primitive& p : model_.meshes[std::size_t(model_.nodes[node].mesh)].primitives) {
      triangles += copies * triangleCount(model_, p);
      skipped += !hasTriangles(p) && p.attributes.contains("POSITION");
      noPosition += !p.attributes.contains("POSITION");
    }
    if (triangles > limits_.maxTriangles || objects > limits_.maxInstances)
      throw Error(Exit::Broken, file_.path, nodeWhere(node),
                  fmt::format("the level has more than {} triangles or {} instances", limits_.maxTriangles, limits_.maxInstances),
                  "LMC_MEMORY_LIMIT");
  }
  if (skipped > 0) note("", fmt::format("{} primitives of points or lines are left out", skipped), "LMC_MODE_SKIPPED");
  if (noPosition > 0) warn("", fmt::format("{} primitives without POSITION are left out", noPosition), "LMC_NO_POSITION");
}

Scene Loader::load() {
  markMoving();
  visitNodes();
  chooseMeshNodes();
  scene_.materials = readMaterials(file_, model_, run_);
  for (const Material& m : scene_.materials)
    for (const TextureSlot& slot : kTextureSlots) secondSetIsTexture_ |= bool(m.*slot.texture) && (m.*slot.texture).uvSet == 1;
  secondSetIsTexture_ |= shading_ != nullptr;
  countAhead();
  for (std::size_t i = 0; i < meshNodes_.size(); ++i) {
    addNode(visits_[meshNodes_[i]]);
    run_.progress(double(i + 1) / double(meshNodes_.size() + 1));
  }
  addLightsAndCameras();
  recentre();
  finishMaterials();
  report();
  scene_.inputs = file_.inputs;
  scene_.content = contentOf(file_, file_.inputs).value();
  run_.progress(1.0);
  return std::move(scene_);
}

}  // namespace

Scene loadLevel(const std::filesystem::path& level, const LoadLimits& limits, const Run& run) {
  return withJsonErrors(level, [&] { return Loader(level, limits, run, nullptr).load(); });
}

ShadingLevel loadForShading(const std::filesystem::path& level, const LoadLimits& limits, const Run& run) {
  ShadingLevel out;
  out.scene = withJsonErrors(level, [&] { return Loader(level, limits, run, &out).load(); });
  return out;
}

}  // namespace lmc
