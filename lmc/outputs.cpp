#include "lmc/outputs.h"

#include <fmt/format.h>

#include <map>

#include "libscene/exr.h"
#include "libscene/level_out.h"
#include "lmc/dump.h"

namespace lmc {

namespace {

void writeMap(OutputFile& file, const Bake& b) {
  const std::size_t n = b.map.size();
  const float unit = 1.0f / b.scale;
  std::vector<Rgb> total(n), direct(n), indirect(n), error(n);
  std::vector<float> covered(n);
  for (std::size_t i = 0; i < n; ++i) {
    covered[i] = b.map.chart[i] != kNone ? 1.0f : 0.0f;
    direct[i] = unit * b.values.direct[i];
    indirect[i] = unit * b.values.indirect[i];
    total[i] = direct[i] + indirect[i];
    error[i] = unit * b.values.error[i];
  }
  std::vector<ExrChannel> channels{{"A", covered.data(), 1}};
  const auto add = [&](const std::string& layer, const std::vector<Rgb>& v) {
    channels.push_back({layer + "R", &v[0].r, 3});
    channels.push_back({layer + "G", &v[0].g, 3});
    channels.push_back({layer + "B", &v[0].b, 3});
  };
  add("", total);
  add("direct.", direct);
  add("indirect.", indirect);
  add("stderr.", error);
  writeExr(file, b.map.width, b.map.height, channels, {{"lmcScale", b.scale}});
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

void writeOutputs(OutputSet& set, const Bake& b, const nlohmann::ordered_json& report) {
  using Json = nlohmann::ordered_json;
  Json files = Json::array();
  const auto listed = [&](const char* name, OutputFile& file) {
    files.push_back({{"name", name}, {"bytes", file.size()}, {"xxh3", file.hash()}});
  };

  OutputFile& map = set.open("lightmap.exr");
  writeMap(map, b);
  listed("lightmap.exr", map);

  std::vector<NodeMap> marks;
  Json nodes = Json::array();
  std::map<std::uint32_t, const Object*> marked;
  for (const Object& o : b.scene.objects)
    if (o.receive && o.triangleCount > 0) marked.emplace(o.node, &o);
  for (const auto& [node, object] : marked) {
    marks.push_back({node, "lightmap.exr", double(b.scale), 1});
    nodes.push_back({{"node", node}, {"name", object->name}, {"map", 0}, {"texCoord", 1}});
  }
  std::vector<std::uint32_t> bakedLights;
  for (const Light& l : b.scene.lights) bakedLights.push_back(l.node);
  const std::vector<std::uint8_t> level = levelWithMaps(b.options.level, b.options.limits, marks, bakedLights);
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
  sidecar["maps"] = Json::array({{{"file", "lightmap.exr"},
                                  {"width", b.map.width},
                                  {"height", b.map.height},
                                  {"scale", b.scale},
                                  {"texCoord", 1},
                                  {"padding", kPadding}}});
  sidecar["nodes"] = nodes;
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
  for (const char* name : {"lightmap.exr", "level.glb", "report.json", "level.lmc.json", "patches.obj", "patches.png", "seams.png"})
    outputs.push_back(b.options.out / name);
  if (!b.options.depfile.empty()) outputs.push_back(b.options.depfile);
  std::error_code missing;
  for (const auto& input : b.scene.inputs)
    for (const auto& output : outputs)
      if (std::filesystem::equivalent(input, output, missing))
        throw Error(Exit::Usage, output, "", "would be overwritten, and the level reads it: choose another folder with -o");
}

}  // namespace lmc
