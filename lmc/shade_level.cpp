#include "lmc/shade_level.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>

#include "libscene/constants.h"
#include "libscene/exr.h"
#include "libscene/files.h"
#include "libscene/image_file.h"
#include "libscene/level.h"
#include "lmc/progress.h"
#include "lmc/sidecar.h"
#include "lmc/tangent_loop.h"

namespace lmc {

namespace {

namespace fs = std::filesystem;

const std::vector<float>& channelOf(const ExrImage& image, const std::string& name, const fs::path& file) {
  const auto channel = image.channels.find(name);
  if (channel == image.channels.end()) throw Error(Exit::Broken, file, "", fmt::format("has no channel {}", name));
  return channel->second;
}

void readLightMap(const fs::path& file, shaders::LevelMaps& maps) {
  const ExrImage exr = readExr(file);
  const auto scale = exr.attributes.find("lmcScale");
  const float factor = scale == exr.attributes.end() ? 1.0f : scale->second;
  const auto &r = channelOf(exr, "R", file), &g = channelOf(exr, "G", file), &b = channelOf(exr, "B", file);
  Image<Rgb> out(exr.width, exr.height);
  for (std::size_t i = 0; i < out.pixels.size(); ++i) out.pixels[i] = factor * Rgb(r[i], g[i], b[i]);
  maps.illuminance.push_back(std::move(out));
  maps.scales.push_back(factor);
}

/// Of the picture, for ao.exr is dark where texels lie inside solids, and lookups at the foot of a wall would show that.
Image<float> readOpenness(const fs::path& file) {
  const Image<glm::u8vec4> picture = pictureOf(file, readFile(file), LoadLimits{}.maxTexturePixels);
  Image<float> out(picture.width, picture.height);
  for (std::size_t i = 0; i < out.pixels.size(); ++i) out.pixels[i] = float(picture.pixels[i].r) / 255.0f;
  return out;
}

shaders::LevelMaps readMaps(const fs::path& folder) {
  shaders::LevelMaps out;
  const nlohmann::json sidecar = readSidecar(folder);
  const nlohmann::json maps = sidecar.value("maps", nlohmann::json::array());
  for (std::size_t k = 0; k < maps.size(); ++k) {
    readLightMap(folder / maps[k].value("file", std::string()), out);
    // What the sidecar does not name is of an older bake.
    if (const std::string openness = maps[k].value("ao_picture", std::string()); !openness.empty())
      out.openness.push_back(readOpenness(folder / openness));
  }
  if (out.openness.size() < maps.size()) out.openness.clear();
  return out;
}

/// Vertices `from` once more, at the end, in every array.
void repeatVertices(ShadingLevel& level, const std::vector<std::uint32_t>& from) {
  const auto repeat = [&](auto& array) {
    if (array.empty()) return;
    array.reserve(array.size() + from.size());
    for (const std::uint32_t v : from) array.push_back(array[v]);
  };
  Scene& s = level.scene;
  repeat(s.positions_m);
  repeat(s.normals);
  repeat(s.uv0);
  repeat(s.uv1);
  repeat(s.mapUv);
  repeat(s.sourceVertex);
  repeat(s.colors);
  repeat(level.positions_m);
  repeat(level.normals);
  repeat(level.tangents);
}

/// Tangents of one object, whose triangles get corners of their own: those of a vertex may differ.
void makeTangents(ShadingLevel& level, std::uint32_t index, const Run& run) {
  Scene& s = level.scene;
  Object& object = s.objects[index];
  const Texture& texture = level.looks[object.material].normalTexture;
  std::vector<std::uint32_t> from;
  for (std::uint32_t t = object.firstTriangle; t < object.firstTriangle + object.triangleCount; ++t) {
    glm::uvec3 corners = s.triangles[t];
    if (object.mirrored) std::swap(corners.y, corners.z);  // as in its mesh, where tangents are made
    from.insert(from.end(), {corners.x, corners.y, corners.z});
  }
  object.firstVertex = std::uint32_t(s.positions_m.size());
  object.vertexCount = std::uint32_t(from.size());
  repeatVertices(level, from);
  std::vector<glm::vec3> positions, normals;
  std::vector<glm::vec2> uvs;
  std::vector<std::uint32_t> indices(from.size());
  std::iota(indices.begin(), indices.end(), 0u);
  for (const std::uint32_t v : from) {
    positions.push_back(level.positions_m[v]);
    normals.push_back(level.normals[v]);
    uvs.emplace_back(texture.transform * glm::vec3(texture.uvSet == 0 || s.uv1.empty() ? s.uv0[v] : s.uv1[v], 1.0f));
  }
  const tangent::Tangents made = tangentsOf({positions, normals, uvs, indices, {}}, run);
  for (std::uint32_t c = 0; c < from.size(); ++c)
    level.tangents[object.firstVertex + c] = glm::vec4(made.corners[c].tangent, made.corners[c].determinant);
  for (std::uint32_t t = 0; t < object.triangleCount; ++t) {
    glm::uvec3 corners = object.firstVertex + glm::uvec3(3 * t, 3 * t + 1, 3 * t + 2);
    if (object.mirrored) std::swap(corners.y, corners.z);
    s.triangles[object.firstTriangle + t] = corners;
  }
}

void addMissingTangents(ShadingLevel& level, const Run& run) {
  for (std::uint32_t o = 0; o < level.scene.objects.size(); ++o) {
    const Object& object = level.scene.objects[o];
    const Look& look = level.looks[object.material];
    const auto first = level.tangents.begin() + object.firstVertex;
    const bool missing = std::find(first, first + object.vertexCount, glm::vec4(0.0f)) != first + object.vertexCount;
    if (look.normalTexture && !look.objectSpaceNormals && missing) makeTangents(level, o, run);
  }
}

/// What glows lights nothing by itself in a deferred renderer.
bool hasLight(const LoadedLevel& loaded) {
  return !loaded.maps.illuminance.empty() || !loaded.level.lights.empty() || loaded.level.scene.ambient != Rgb(0.0f);
}

/// From behind the camera's right shoulder, so that surfaces are told apart.
void addHeadlight(ShadingLevel& level, const Camera& camera) {
  constexpr float kAmbient = 0.15f;
  ShadedLight& light = level.lights.emplace_back();
  light.light.kind = Light::Kind::Directional;
  light.light.direction = glm::normalize(camera.axes * glm::dvec3(-0.4, -0.5, -1.0));
  light.light.classic.emplace();
  light.light.intensity = light.specular = Rgb(1.0f);
  light.ambient = Rgb(kAmbient);
}

}  // namespace

Camera cameraFor(const Scene& scene, const std::string& wish) {
  for (const Camera& c : scene.cameras)
    if (wish.empty() || c.name == wish) return c;
  if (wish.empty()) return shaders::automaticCamera(scene);
  double v[7] = {};
  const char *at = wish.c_str(), *const end = at + wish.size();
  int count = 0;
  for (; count < 7; ++count) {
    const auto [next, error] = std::from_chars(at, end, v[count]);
    if (error != std::errc() || !std::isfinite(v[count]) || (count < 6 ? next == end || *next != ',' : next != end)) break;
    at = next + 1;
  }
  const glm::dvec3 eye = glm::dvec3(v[0], v[1], v[2]) - scene.centre_m, target = glm::dvec3(v[3], v[4], v[5]) - scene.centre_m;
  if (count != 7 || !(v[6] > 0.0 && v[6] < 180.0) || !(glm::length(eye - target) > 0.0))
    throw Error(Exit::Usage, "lmc", "", fmt::format("--camera: '{}' is neither a camera of the level nor px,py,pz,tx,ty,tz,fov", wish));
  return shaders::cameraAt(eye, target, v[6] * kPi / 180.0);
}

LoadedLevel loadForShader(const fs::path& levelOrFolder, const std::string& camera, const Run& run) {
  LoadedLevel out;
  const bool baked = fs::is_directory(levelOrFolder);
  if (baked) out.maps = readMaps(levelOrFolder);
  out.level = loadForShading(baked ? levelOrFolder / "level.glb" : levelOrFolder, {}, run);
  const Scene& scene = out.level.scene;
  for (std::size_t o = 0; baked && o < scene.objects.size(); ++o)
    if (out.level.marked[o] && scene.objects[o].map >= out.maps.illuminance.size())
      throw Error(Exit::Broken, levelOrFolder / "level.lmc.json", "/maps", "lacks a map that the level names");
  withThreads(run, [&] { addMissingTangents(out.level, run); });
  if (!hasLight(out)) {
    tell(fmt::format("{}\n",
                     line("note", levelOrFolder.string(), "", "has neither maps nor lights; one is put at the camera", "LMC_NO_LIGHT")));
    addHeadlight(out.level, cameraFor(scene, camera));
  }
  return out;
}

}  // namespace lmc
