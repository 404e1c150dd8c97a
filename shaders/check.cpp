#include "shaders/check.h"

#include <algorithm>

namespace lmc::shaders {

namespace {

/// The view with only what shows the pass: light that others add would hide its factors.
View viewFor(const View& view, Pass pass) {
  View out = view;
  out.screenAo = pass == Pass::Ssao;
  if (pass == Pass::GBuffers) out.bumpySurfaces = false;
  if (pass == Pass::GBuffersBump) out.plainSurfaces = false;
  if (pass != Pass::LightMap && pass != Pass::Directional && pass != Pass::Point && pass != Pass::Spot) return out;
  out.ambient = false;
  out.lightMapPass = pass == Pass::LightMap;
  out.directional = pass == Pass::Directional;
  out.point = pass == Pass::Point;
  out.spot = pass == Pass::Spot;
  out.volumes = false;
  return out;
}

bool isReplaced(const PassRow& row, const std::filesystem::path& folder) {
  return shaderText(row.vertex, folder).replaced || shaderText(row.fragment, folder).replaced;
}

}  // namespace

double PassCheck::largest() const {
  double out = 0.0;
  for (const std::vector<Difference>& stage : differences)
    for (const Difference& d : stage) out = std::max(out, d.largest);
  return out;
}

ShaderCheck checkShaders(std::span<const Stage> stages, const std::filesystem::path& folder, double maxDiff, const Run& run) {
  ShaderCheck out;
  for (const PassRow& row : kPasses)
    if (isReplaced(row, folder)) out.passes.push_back({row.pass, {}, {}});
  for (const Stage& stage : stages) {
    Reference reference(stage.level, stage.maps);
    for (PassCheck& check : out.passes) {
      const PassRow& row = kPasses[std::size_t(check.pass)];
      const View view = viewFor(stage.view, row.pass);
      ShaderChoice choice{folder, {}};
      choice.own[std::size_t(row.pass)] = true;
      const Frame right = reference.render(view), mine = reference.render(view, choice);
      std::vector<Difference>& differences = check.differences.emplace_back();
      for (const Target t : row.targets) differences.push_back(differenceOf(right, mine, t));
      if (std::ranges::any_of(differences, [&](const Difference& d) { return d.largest > maxDiff; }))
        if (auto finding = diagnose({stage.level, stage.maps, view, right, mine}, row, run)) check.finding = std::move(finding);
    }
    if (&stage != &stages.front()) continue;
    out.reference = reference.render(stage.view);
    View same = stage.view;
    same.exposure = out.reference.exposure;  // a fault must not hide in an exposure of its own
    out.mine = reference.render(same, ShaderChoice::all(folder));
    out.picture = differenceOf(out.reference, out.mine, Target::Picture);
  }
  return out;
}

}  // namespace lmc::shaders
