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
  for (const Difference& d : differences) out = std::max(out, d.largest);
  return out;
}

ShaderCheck checkShaders(std::span<const Stage> stages, const std::filesystem::path& folder, double maxDiff, const Run& run) {
  ShaderCheck out;
  std::vector<const PassRow*> replaced;
  for (const PassRow& row : kPasses)
    if (isReplaced(row, folder)) replaced.push_back(&row);
  for (const PassRow* row : replaced) out.passes.push_back({row->pass, stages.front().name, {}, {}});
  for (const Stage& stage : stages) {
    Reference reference(stage.level, stage.maps);
    for (std::size_t p = 0; p < replaced.size(); ++p) {
      const PassRow& row = *replaced[p];
      const View view = viewFor(stage.view, row.pass);
      ShaderChoice choice{folder, {}};
      choice.own[std::size_t(row.pass)] = true;
      const Frame right = reference.render(view), mine = reference.render(view, choice);
      PassCheck check{row.pass, stage.name, {}, {}};
      for (const Target t : row.targets) check.differences.push_back(differenceOf(right, mine, t));
      if (check.largest() > maxDiff) check.finding = diagnose({stage.level, stage.maps, view, right, mine}, row, run);
      const bool better = out.passes[p].differences.empty() || (check.finding && !out.passes[p].finding) ||
                          (check.finding.has_value() == out.passes[p].finding.has_value() && check.largest() > out.passes[p].largest());
      if (better) out.passes[p] = std::move(check);
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
