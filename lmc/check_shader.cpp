#include "lmc/check_shader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "libscene/files.h"
#include "libscene/image_file.h"
#include "libscene/parallel.h"
#include "lmc/bake.h"
#include "lmc/shade_level.h"
#include "shaders/check.h"

namespace lmc {

namespace {

using Json = nlohmann::ordered_json;
using shaders::ShaderCheck;
using shaders::Target;

std::string_view nameOf(Target t) { return shaders::kTargetNames[std::size_t(t)]; }
std::string_view nameOf(shaders::Pass p) { return shaders::kPasses[std::size_t(p)].name; }

/// Reference, own, and their difference (grey where there is none, brighter or darker where own is), one below the other.
void writeDifference(const std::filesystem::path& file, const ShaderCheck& check) {
  const Image<glm::vec4>&a = check.reference[Target::Picture], &b = check.mine[Target::Picture];
  Image<glm::u8vec4> out(a.width, 3 * a.height);
  const auto put = [&](int x, int y, const glm::vec4& colour) {
    for (int k = 0; k < 3; ++k)
      out.at(x, y)[k] =
          std::isfinite(colour[k]) ? std::uint8_t(std::lround(255.0f * std::clamp(colour[k], 0.0f, 1.0f))) : std::uint8_t(255);
  };
  for (int y = 0; y < a.height; ++y)
    for (int x = 0; x < a.width; ++x) {
      put(x, y, a.at(x, y));
      put(x, y + a.height, b.at(x, y));
      put(x, y + 2 * a.height, 0.5f + 0.5f * (b.at(x, y) - a.at(x, y)));
    }
  const std::vector<std::uint8_t> png = encodePng(out, false);
  writeFileWhole(file, {reinterpret_cast<const char*>(png.data()), png.size()});
}

Json asJson(const ShaderCheck& check, bool same) {
  Json out{{"same", same}, {"picture", {{"largest", check.picture.largest}, {"mean", check.picture.mean}}}, {"passes", Json::array()}};
  for (const shaders::PassCheck& p : check.passes) {
    Json pass{{"pass", nameOf(p.pass)}, {"scene", p.scene}, {"targets", Json::array()}};
    for (const shaders::Difference& d : p.differences)
      pass["targets"].push_back({{"target", nameOf(d.target)}, {"largest", d.largest}, {"mean", d.mean}, {"x", d.x}, {"y", d.y}});
    if (p.finding) pass["fault"] = {{"name", p.finding->name}, {"words", p.finding->words}, {"unexplained", p.finding->unexplained}};
    out["passes"].push_back(std::move(pass));
  }
  return out;
}

void print(const ShaderCheck& check, double maxDiff) {
  fmt::print("{:<14} {:<15} {:>11} {:>11}  at           scene\n", "pass", "target", "largest", "mean");
  for (const shaders::PassCheck& p : check.passes) {
    for (const shaders::Difference& d : p.differences)
      fmt::print("{:<14} {:<15} {:>11.6f} {:>11.6f}  {:<12} {}\n", nameOf(p.pass), nameOf(d.target), d.largest, d.mean,
                 fmt::format("{},{}", d.x, d.y), p.scene);
    if (p.finding)
      fmt::print("  fault: {}: {} ({:.1f} % of the difference unexplained)\n", p.finding->name, p.finding->words,
                 100.0 * p.finding->unexplained);
    else if (p.largest() > maxDiff)
      fmt::print("  fault: no single fault that is known explains the difference\n");
  }
  fmt::print("{:<14} {:<15} {:>11.6f} {:>11.6f}  {:<12} level\n", "all", "final", check.picture.largest, check.picture.mean,
             fmt::format("{},{}", check.picture.x, check.picture.y));
}

}  // namespace

Exit checkShader(const CheckShaderOptions& options) {
  if (!std::filesystem::is_directory(options.shaderDir)) throw Error(Exit::Io, options.shaderDir, "", "is no folder");
  const Run run = stoppableRun(options.threads);
  const LoadedLevel loaded = loadForShader(options.level, options.camera, run);
  shaders::View view;
  view.camera = cameraFor(loaded.level.scene, options.camera);
  view.width = options.width;
  view.height = options.height;
  const shaders::CheckScene small = shaders::checkScene();
  const shaders::Stage stages[] = {{"level", loaded.level, loaded.maps, view}, {"check scene", small.level, small.maps, small.view}};
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
