#include "lmc/ao.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "libradiosity/light_map.h"
#include "libscene/exr.h"
#include "libscene/image_file.h"
#include "libscene/parallel.h"
#include "lmc/bake.h"
#include "lmc/jobs.h"
#include "lmc/normal_map.h"
#include "lmc/occlusion_texture.h"

namespace lmc {

namespace {

using Json = nlohmann::ordered_json;

constexpr double kMostlyDark = 0.9;
constexpr int kGutter = 4;  // texels round charts that have a tangent frame, too

}  // namespace

void noteDarkness(const ao::Openness& openness, const ao::Options& options, const std::filesystem::path& level, const Run& run) {
  if (openness.darkShare <= kMostlyDark || std::isfinite(options.distance_m)) return;
  run.note({{},
            level.string(),
            "",
            fmt::format("openness is below 0.01 for {:.0f} % of what was asked: in closed rooms everything is covered sooner or later; "
                        "--ao-distance METRES counts near occluders alone",
                        100.0 * openness.darkShare),
            "LMC_AO_DARK"});
}

Json aoOf(const ao::Openness& o, const ao::Options& options) {
  constexpr const char* kFallOffs[] = {"none", "linear", "quadratic"};
  Json out{{"goal", options.error}, {"error", o.rmsError}, {"asked", o.asked}, {"rays", o.rays}, {"below_0.01", o.darkShare}};
  out["distance_m"] = std::isfinite(options.distance_m) ? Json(options.distance_m) : Json(nullptr);
  out["falloff"] = kFallOffs[std::size_t(options.fallOff)];
  return out;
}

void bentToTangentSpace(ao::Openness& openness, const Scene& scene, std::span<const glm::vec2> place, int width, int height,
                        const Run& run) {
  Image<glm::vec3> world(width, height);
  world.pixels.assign(openness.bent.begin(), openness.bent.end());
  const Image<glm::vec3> turned = toTangentSpace(texelFrames(scene, place, width, height, kGutter, run), world);
  // Where there is no frame the normal itself is shown; where nothing was asked, nothing.
  for (std::size_t i = 0; i < openness.bent.size(); ++i)
    if (openness.bent[i] != glm::vec3(0.0f)) openness.bent[i] = turned.pixels[i];
}

void padOpenness(ao::Openness& openness, const Padding& padding) {
  forRepeated(padding, [&](std::size_t to, std::uint32_t from) {
    openness.cosine[to] = openness.cosine[from];
    openness.uniform[to] = openness.uniform[from];
    openness.error[to] = openness.error[from];
    if (!openness.bent.empty()) openness.bent[to] = openness.bent[from];
  });
}

void writeOpenness(OutputFile& file, const ao::Openness& o, std::size_t first, int side) {
  std::vector<ExrChannel> channels{{"Y", &o.cosine[first], 1}, {"uniform.Y", &o.uniform[first], 1}, {"stderr.Y", &o.error[first], 1}};
  if (!o.bent.empty()) {
    channels.push_back({"bent.R", &o.bent[first].x, 3});
    channels.push_back({"bent.G", &o.bent[first].y, 3});
    channels.push_back({"bent.B", &o.bent[first].z, 3});
  }
  writeExr(file, side, side, channels);
}

Image<glm::u8vec4> pictureOfOpenness(std::span<const float> shown, const Padding& padding, std::size_t first, int side) {
  Image<glm::u8vec4> out(side, side, glm::u8vec4(255));
  for (std::size_t i = 0; i < out.pixels.size(); ++i)
    if (const std::uint32_t from = padding.from[first + i]; from != kNone)
      out.pixels[i] = glm::u8vec4(glm::u8vec3(std::uint8_t(255.0f * shown[from] + 0.5f)), 255);
  return out;
}

namespace {

/// Whether a node of this name is in the path of an object: "/hall/column[2]".
bool isUnder(const std::string& path, const std::string& node) {
  for (std::size_t at = 0; at < path.size();) {
    const std::size_t end = std::min(path.find('/', at + 1), path.size());
    const std::string_view name = std::string_view(path).substr(at + 1, end - at - 1);
    if (name == node || (name.starts_with(node) && name.substr(node.size()).starts_with('['))) return true;
    at = end;
  }
  return false;
}

class Job {
 public:
  explicit Job(const AoJobOptions& o) : o_(o), run_(talkingRun(o.threads)) { run_.seed = o.seed; }

  Json make() {
    scene_ = loadLevel(o_.model, o_.limits, run_);
    refuseSameFile(o_.model, scene_, o_.out);
    choose();
    return o_.perVertex ? vertices() : map();
  }

  bool goalMet() const { return openness_.rmsError <= o_.ao.how.error; }

 private:
  void choose() {
    std::size_t chosen = 0;
    for (Object& o : scene_.objects) {
      o.receive = o.triangleCount > 0 && (o_.node.empty() || isUnder(o.path, o_.node));
      o.cast = o.receive || o_.withLevel;
      o.map = 0;
      chosen += o.receive;
    }
    if (chosen > 0) return;
    if (o_.node.empty()) throw Error(Exit::Broken, o_.model, "", "has no triangles", "LMC_EMPTY");
    throw Error(Exit::Usage, o_.model, "", fmt::format("--node: no static mesh hangs on a node named '{}'", o_.node));
  }

  /// Places the model's own UVs where light maps have theirs. Whole repeats of a texture are taken off.
  void placeByTexCoord() {
    if (o_.texCoord == 0) scene_.mapUv = scene_.uv0;
    std::size_t outside = 0;
    for (Object& o : scene_.objects) {
      if (!o.receive) continue;
      if (o_.texCoord == 0) o.inMap = true;
      const auto first = scene_.mapUv.begin() + o.firstVertex, end = first + o.vertexCount;
      glm::vec2 low(INFINITY);
      for (auto uv = first; uv != end; ++uv) low = glm::min(low, *uv);
      for (auto uv = first; uv != end; ++uv) *uv -= glm::floor(low + 1e-4f);
      outside += std::size_t(
          std::count_if(first, end, [](glm::vec2 uv) { return !(uv.x >= -1e-3f && uv.y >= -1e-3f && uv.x <= 1.001f && uv.y <= 1.001f); }));
    }
    if (outside > 0)
      run_.warn({{},
                 o_.model.string(),
                 "",
                 fmt::format("{} vertices lie outside [0, 1] of TEXCOORD_{}: what repeats a texture gets no place of its own in a map",
                             outside, o_.texCoord),
                 "LMC_UV_RANGE"});
    std::size_t shared = 0;
    for (const UvFault& f : uvFaults(scene_, o_.size)) shared += f.kind == UvFault::Kind::Overlap;
    if (shared > 0)
      run_.note(
          {{},
           o_.model.string(),
           "",
           fmt::format("TEXCOORD_{} of {} objects overlaps: texels that parts share show one of them, or the mean", o_.texCoord, shared),
           "LMC_UV_OVERLAP"});
  }

  Json map() {
    placeByTexCoord();
    std::vector<bool> without;
    for (const Object& o : scene_.objects) without.push_back(!o.receive || !o.inMap);
    const Charts charts = connectedByUv(scene_, without);
    if (charts.count == 0)
      throw Error(
          Exit::Unsupported, o_.model, "",
          fmt::format("nothing of it has an area in TEXCOORD_{}: lmc unwrap makes TEXCOORD_1, and --per-vertex needs none", o_.texCoord),
          "LMC_UV_MISSING");
    const TexelMap texels(scene_, charts, o_.size);
    const Tracer tracer(scene_);
    const TexelArray<std::uint32_t> chart = startMap(scene_, texels, run_).chart;
    openness_ = ao::bakeMap(scene_, texels, chart, tracer, o_.ao.how, run_);
    noteDarkness(openness_, o_.ao.how, o_.model, run_);
    if (o_.ao.how.bent && o_.ao.bentInTangentSpace) bentToTangentSpace(openness_, scene_, scene_.mapUv, o_.size, o_.size, run_);
    const Padding padding = makePadding(scene_, charts, chart, o_.size, run_);
    Json report = aoOf(openness_, o_.ao.how);
    report["size"] = o_.size;
    report["texCoord"] = o_.texCoord;
    if (o_.out.extension() == ".exr") {
      padOpenness(openness_, padding);
      OutputSet set(o_.out.has_parent_path() ? o_.out.parent_path() : ".");
      writeOpenness(set.open(o_.out.filename()), openness_, 0, o_.size);
      set.commit();
      return report;
    }
    const TexelArray<float> shown = o_.uniform ? openness_.uniform : ao::withoutRims(openness_, chart, o_.size);
    const std::vector<std::uint8_t> png = encodePng(pictureOfOpenness(shown, padding, 0, o_.size), false);
    if (o_.out.extension() == ".png") {
      writeBytes(o_.out, png);
      return report;
    }
    GltfEdit edit(o_.model, o_.limits);
    std::map<std::uint32_t, OcclusionUse> uses;
    for (const Object& o : scene_.objects)
      if (o.receive) uses[o.node] = {o.node, 0, std::uint32_t(o_.texCoord)};
    std::vector<OcclusionUse> list;
    for (const auto& [node, use] : uses) list.push_back(use);
    report["materials_with_an_occlusion_texture_of_their_own"] = addOcclusionTextures(edit, {edit.imageOf(png)}, list);
    writeModel(edit);
    return report;
  }

  Json vertices() {
    const Tracer tracer(scene_);
    openness_ = ao::bakeVertices(scene_, tracer, o_.ao.how, run_);
    noteDarkness(openness_, o_.ao.how, o_.model, run_);
    const TexelArray<float>& values = o_.uniform ? openness_.uniform : openness_.cosine;
    GltfEdit edit(o_.model, o_.limits);
    // A mesh that several nodes show gets the mean of theirs.
    struct Sum {
      std::vector<double> value, count;
    };
    std::map<std::pair<std::uint32_t, std::uint32_t>, Sum> primitives;
    for (const Object& o : scene_.objects) {
      if (!o.receive) continue;
      Sum& sum = primitives[{o.mesh, o.primitive}];
      for (std::uint32_t v = o.firstVertex; v < o.firstVertex + o.vertexCount; ++v) {
        const std::size_t source = scene_.sourceVertex[v];
        if (source >= sum.value.size()) {
          sum.value.resize(source + 1, 0.0);
          sum.count.resize(source + 1, 0.0);
        }
        sum.value[source] += double(values[v]);
        sum.count[source] += 1.0;
      }
    }
    for (const auto& [key, sum] : primitives) writeVertices(edit, key.first, key.second, sum.value, sum.count);
    writeModel(edit);
    Json report = aoOf(openness_, o_.ao.how);
    report["attribute"] = o_.attribute;
    return report;
  }

  void writeVertices(GltfEdit& edit, std::uint32_t mesh, std::uint32_t primitive, const std::vector<double>& sum,
                     const std::vector<double>& count) const {
    const std::size_t n = edit.attribute(mesh, primitive, "POSITION", 3).size() / 3;
    const int components = o_.attribute == "COLOR_0" ? 3 : 1;
    // COLOR_0 multiplies the base colour, and so do both: what is there stays.
    const auto wide = std::size_t(components == 3 ? colourComponents(edit, mesh, primitive) : 1);
    std::vector<float> out = wide >= 3 ? edit.attribute(mesh, primitive, "COLOR_0", int(wide)) : std::vector<float>();
    if (out.empty()) out.assign(n * wide, 1.0f);
    for (std::size_t v = 0; v < n; ++v) {
      const float open = v < sum.size() && count[v] > 0.0 ? float(sum[v] / count[v]) : 1.0f;
      for (std::size_t k = 0; k < std::min<std::size_t>(wide, 3); ++k) out[wide * v + k] *= open;
    }
    edit.json()["meshes"][mesh]["primitives"][primitive]["attributes"][o_.attribute] = edit.addFloats(out, int(wide));
  }

  static int colourComponents(GltfEdit& edit, std::uint32_t mesh, std::uint32_t primitive) {
    const auto& json = edit.json();
    const auto& attributes = json["meshes"][mesh]["primitives"][primitive]["attributes"];
    if (!attributes.contains("COLOR_0")) return 3;
    return json["accessors"][attributes["COLOR_0"].get<std::size_t>()]["type"] == "VEC4" ? 4 : 3;
  }

  void writeModel(GltfEdit& edit) const {
    edit.embedImages();
    edit.refuseChanged(scene_);
    edit.dropUnused();
    writeBytes(o_.out, isGltfText(o_.out) ? edit.gltf() : edit.glb());
  }

  const AoJobOptions& o_;
  Run run_;
  Scene scene_;
  ao::Openness openness_;
};

}  // namespace

Exit occlusion(const AoJobOptions& options) {
  Job job(options);
  Json report;
  withThreads(Run{options.threads}, [&] { report = job.make(); });
  if (options.json)
    fmt::print("{}\n", report.dump(2));
  else
    for (const auto& [key, value] : report.items())
      fmt::print("{:<52} {}\n", key, value.is_string() ? value.get<std::string>() : value.dump());
  return options.ao.errorIsExplicit && !job.goalMet() ? Exit::GoalMissed : Exit::Done;
}

}  // namespace lmc
