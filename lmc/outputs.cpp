#include "lmc/outputs.h"

#include <fmt/format.h>

#include <map>

#include "libscene/exr.h"
#include "libscene/image_file.h"
#include "libscene/level_out.h"
#include "lmc/ao.h"
#include "lmc/dump.h"
#include "lmc/occlusion_texture.h"
#include "lmc/tangents.h"

namespace lmc {

namespace {

/// Map `k` of the stack.
void writeMap(OutputFile& file, const Bake& b, int k) {
  const auto side = std::size_t(b.uv.side);
  const std::size_t first = std::size_t(k) * side * side, n = side * side;
  const float scale = b.scales[std::size_t(k)], unit = float(b.lightUnit / double(scale));
  TexelArray<Rgb> total(n), direct(n), indirect(n), error(n);
  TexelArray<float> covered(n);
  for (std::size_t i = 0; i < n; ++i) {
    covered[i] = b.map.chart[first + i] != kNone ? 1.0f : 0.0f;
    direct[i] = unit * b.values.direct[first + i];
    indirect[i] = unit * b.values.indirect[first + i];
    total[i] = direct[i] + indirect[i];
    error[i] = unit * b.values.error[first + i];
  }
  std::vector<ExrChannel> channels{{"A", covered.data(), 1}};
  const auto add = [&](const std::string& layer, const TexelArray<Rgb>& v) {
    channels.push_back({layer + "R", &v[0].r, 3});
    channels.push_back({layer + "G", &v[0].g, 3});
    channels.push_back({layer + "B", &v[0].b, 3});
  };
  add("", total);
  add("direct.", direct);
  add("indirect.", indirect);
  add("stderr.", error);
  writeExr(file, b.uv.side, b.uv.side, channels, {{"lmcScale", scale}});
}

/// Where each node has its light: the input's node, and the instance where it is drawn more than once.
nlohmann::ordered_json nodesOf(const Bake& b) {
  auto nodes = nlohmann::ordered_json::array();
  std::map<std::pair<std::uint32_t, std::uint32_t>, const Object*> marked;
  for (const Object& o : b.scene.objects)
    if (o.receive && o.triangleCount > 0) marked.emplace(std::pair(o.node, o.instance), &o);
  for (const auto& [key, object] : marked) {
    nodes.push_back({{"node", key.first}, {"name", object->name}, {"map", object->map}, {"texCoord", object->texCoord}});
    if (key.second > 0 || marked.contains({key.first, 1})) nodes.back()["instance"] = key.second;
  }
  return nodes;
}

std::string escapedForMake(const std::string& path) {
  std::string out;
  for (const char c : path) {
    if (c == ' ' || c == '#' || c == '\\') out += '\\';
    if (c == '$') out += '$';
    out += c;
  }
  return out;
}

}  // namespace

std::vector<std::string> mapNames(const Bake& b, const char* stem, const char* ending) {
  if (b.uv.maps == 1) return {fmt::format("{}.{}", stem, ending)};
  std::vector<std::string> out;
  for (int k = 0; k < b.uv.maps; ++k) out.push_back(fmt::format("{}.{:03}.{}", stem, k, ending));
  return out;
}

void writeOutputs(OutputSet& set, const Bake& b, const nlohmann::ordered_json& report) {
  using Json = nlohmann::ordered_json;
  Json files = Json::array(), maps = Json::array();
  const auto listed = [&](const std::string& name, OutputFile& file) {
    files.push_back({{"name", name}, {"bytes", file.size()}, {"xxh3", file.hash()}});
  };

  LevelMarks marks;
  const std::vector<std::string> names = mapNames(b, "lightmap", "exr");
  for (int k = 0; k < b.uv.maps; ++k) {
    const std::string& name = names[std::size_t(k)];
    OutputFile& map = set.open(name);
    writeMap(map, b, k);
    listed(name, map);
    const double scale = b.scales[std::size_t(k)];
    maps.push_back({{"file", name}, {"width", b.uv.side}, {"height", b.uv.side}, {"scale", scale}, {"padding", kPadding}});
    marks.maps.push_back({name, scale});
  }
  const bool occlusion = b.openness.asked > 0;
  const std::vector<std::string> openness = mapNames(b, "ao", "exr"), pictures = mapNames(b, "ao", "png");
  const TexelArray<float> shown = occlusion ? ao::withoutRims(b.openness, b.map.chart, b.uv.side) : TexelArray<float>();
  for (int k = 0; occlusion && k < b.uv.maps; ++k) {
    const std::size_t first = std::size_t(k) * std::size_t(b.uv.side) * std::size_t(b.uv.side);
    OutputFile& map = set.open(openness[std::size_t(k)]);
    writeOpenness(map, b.openness, first, b.uv.side);
    listed(openness[std::size_t(k)], map);
    OutputFile& picture = set.open(pictures[std::size_t(k)]);
    const std::vector<std::uint8_t> png = encodePng(pictureOfOpenness(shown, b.padding, first, b.uv.side), false);
    picture.write(png.data(), png.size());
    listed(pictures[std::size_t(k)], picture);
    maps[std::size_t(k)].update({{"ao", openness[std::size_t(k)]}, {"ao_picture", pictures[std::size_t(k)]}});
  }

  for (const Light& l : b.scene.lights) marks.bakedLightNodes.push_back(l.node);
  marks.newUvs = b.uv.changed();
  marks.side = b.uv.side;
  std::vector<PrimitiveTangents> tangents;
  marks.more = [&](GltfEdit& edit) {
    if (b.plan.runs(Effect::Tangents)) tangents = addTangents(edit, {}, b.run.silent());
    if (!occlusion) return;
    std::vector<GltfEdit::Json> images;
    for (const std::string& name : pictures) images.push_back(GltfEdit::Json::object({{"uri", name}}));
    const std::size_t kept = addOcclusionTextures(edit, images, usesOfLightmaps(edit.json()));
    if (kept > 0)
      b.run.note({{},
                  b.scene.file.string(),
                  "/materials",
                  fmt::format("{} materials keep the occlusionTexture that they have; ao.png is beside", kept),
                  "LMC_AO_KEPT"});
  };
  const std::vector<std::uint8_t> level = levelWithMaps(b.options.level, b.options.limits, b.scene, marks);
  OutputFile& glb = set.open("level.glb");
  glb.write(level.data(), level.size());
  listed("level.glb", glb);

  if (b.options.dumpPatches) dumpPatches(set, b);
  if (b.options.dumpSeams) dumpSeams(set, b);
  set.open("report.json").write(report.dump(2) + "\n");

  Json sidecar;
  sidecar["schema"] = "lmc-sidecar/1";
  sidecar["unit"] = "lx";
  sidecar["space"] = "linear Rec. 709";
  sidecar["maps"] = maps;
  sidecar["tangents"] = summaryOf(tangents);
  if (!b.openness.bent.empty()) sidecar["bent_normals"] = b.options.ao.bentInTangentSpace ? "tangent" : "world";
  sidecar["nodes"] = nodesOf(b);
  sidecar["files"] = files;
  set.open("level.lmc.json").write(sidecar.dump(2) + "\n");
}

std::string depfileText(const Bake& b) {
  std::string text = escapedForMake((b.options.out / "level.lmc.json").string()) + ":";
  for (const auto& input : b.scene.inputs) text += " \\\n  " + escapedForMake(input.string());
  return text + "\n";
}

void refuseToOverwriteInputs(const Bake& b) {
  std::vector<std::filesystem::path> outputs;
  for (const char* name :
       {"lightmap.exr", "ao.exr", "ao.png", "level.glb", "report.json", "level.lmc.json", "patches.obj", "patches.png", "seams.png"})
    outputs.push_back(b.options.out / name);
  for (int k = 0; k < b.options.uv.maxMaps; ++k)
    for (const char* name : {"lightmap.{:03}.exr", "ao.{:03}.exr", "ao.{:03}.png"})
      outputs.push_back(b.options.out / fmt::format(fmt::runtime(name), k));
  if (!b.options.depfile.empty()) outputs.push_back(b.options.depfile);
  std::error_code missing;
  for (const auto& input : b.scene.inputs)
    for (const auto& output : outputs)
      if (std::filesystem::equivalent(input, output, missing))
        throw Error(Exit::Usage, output, "", "would be overwritten, and the level reads it: choose another folder with -o");
}

}  // namespace lmc
