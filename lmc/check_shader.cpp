#include "lmc/check_shader.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "libscene/parallel.h"
#include "lmc/bake.h"
#include "lmc/progress.h"
#include "lmc/shade_level.h"
#include "lmc/shade_picture.h"
#include "shaders/check.h"

namespace lmc {

namespace {

using Json = nlohmann::ordered_json;
using shaders::ShaderCheck;
using shaders::Target;

std::string_view nameOf(Target t) { return shaders::kTargetNames[std::size_t(t)]; }
std::string_view nameOf(shaders::Pass p) { return shaders::kPasses[std::size_t(p)].name; }

constexpr const char* kStages[] = {"level", "check scene"};  // on which passes are tried, in this order

/// Reference, own, and their difference (grey where there is none, brighter or darker where own is), one below the other.
void writeDifference(const std::filesystem::path& file, const ShaderCheck& check) {
  const Image<glm::vec4>&a = check.reference[Target::Picture], &b = check.mine[Target::Picture];
  Image<glm::vec4> all(a.width, 3 * a.height);
  for (std::size_t i = 0, n = a.pixels.size(); i < n; ++i) {
    all.pixels[i] = a.pixels[i];
    all.pixels[n + i] = b.pixels[i];
    all.pixels[2 * n + i] = 0.5f + 0.5f * (b.pixels[i] - a.pixels[i]);
  }
  writePng(file, quantised(all));
}

Json asJson(const ShaderCheck& check, bool same) {
  Json out{{"same", same}, {"picture", {{"largest", check.picture.largest}, {"mean", check.picture.mean}}}, {"passes", Json::array()}};
  for (const shaders::PassCheck& p : check.passes) {
    Json pass{{"pass", nameOf(p.pass)}, {"targets", Json::array()}};
    for (std::size_t s = 0; s < p.differences.size(); ++s)
      for (const shaders::Difference& d : p.differences[s])
        pass["targets"].push_back(
            {{"scene", kStages[s]}, {"target", nameOf(d.target)}, {"largest", d.largest}, {"mean", d.mean}, {"x", d.x}, {"y", d.y}});
    if (p.finding) pass["fault"] = {{"name", p.finding->name}, {"words", p.finding->words}, {"unexplained", p.finding->unexplained}};
    out["passes"].push_back(std::move(pass));
  }
  return out;
}

void print(std::string_view pass, std::string_view scene, const shaders::Difference& d) {
  fmt::print("{:<14} {:<12} {:<15} {:>11.6f} {:>11.6f}  {},{}\n", pass, scene, nameOf(d.target), d.largest, d.mean, d.x, d.y);
}

void print(const ShaderCheck& check, double maxDiff) {
  fmt::print("{:<14} {:<12} {:<15} {:>11} {:>11}  at\n", "pass", "scene", "target", "largest", "mean");
  for (const shaders::PassCheck& p : check.passes) {
    for (std::size_t s = 0; s < p.differences.size(); ++s)
      for (const shaders::Difference& d : p.differences[s]) print(nameOf(p.pass), kStages[s], d);
    if (p.finding)
      fmt::print("  fault: {}: {} ({:.1f} % of the difference unexplained)\n", p.finding->name, p.finding->words,
                 100.0 * p.finding->unexplained);
    else if (p.largest() > maxDiff)
      fmt::print("  fault: none that is known explains the difference\n");
  }
  print("all", kStages[0], check.picture);
}

/// Shaders of the folder that take no shader's place: a slip of the pen, most likely.
void warnOfStrangers(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> strangers;
  const std::vector<std::string_view> names = shaders::shaderNames();
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    const std::filesystem::path& file = entry.path();
    if (file.extension() != ".vert" && file.extension() != ".frag") continue;
    const bool known = std::ranges::any_of(
        names, [&](std::string_view n) { return file == folder / n || file == folder / std::filesystem::path(n).filename(); });
    if (!known) strangers.push_back(file);
  }
  std::ranges::sort(strangers);
  for (const auto& file : strangers)
    tell(fmt::format("{}\n",
                     line("warning", file.string(), "", "has the name of none of lmc's shaders; it is not looked at", "LMC_SHADER")));
}

}  // namespace

Exit checkShader(const CheckShaderOptions& options) {
  if (!std::filesystem::is_directory(options.shaderDir)) throw Error(Exit::Io, options.shaderDir, "", "is no folder");
  warnOfStrangers(options.shaderDir);
  const Run run = stoppableRun(options.threads);
  const LoadedLevel loaded = loadForShader(options.level, options.camera, run);
  shaders::View view;
  view.camera = cameraFor(loaded.level.scene, options.camera);
  view.width = options.width;
  view.height = options.height;
  const shaders::CheckScene small = shaders::checkScene();
  const shaders::Stage stages[] = {{loaded.level, loaded.maps, view}, {small.level, small.maps, small.view}};
  ShaderCheck check;
  withThreads(run, [&] { check = shaders::checkShaders(stages, options.shaderDir, options.maxDiff, run); });
  if (check.passes.empty())
    throw Error(Exit::Usage, options.shaderDir, "", "has no file of the name of one of lmc's shaders, such as deferred/point.frag");
  const bool same = !(check.picture.largest > options.maxDiff) &&
                    std::ranges::none_of(check.passes, [&](const shaders::PassCheck& p) { return p.largest() > options.maxDiff; });
  if (options.json)
    fmt::print("{}\n", asJson(check, same).dump(2));
  else
    print(check, options.maxDiff);
  if (same) return Exit::Done;
  writeDifference(options.picture, check);
  return Exit::Differs;
}

}  // namespace lmc
