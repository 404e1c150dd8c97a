#include "lmc/plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "libradiosity/emitters.h"
#include "libscene/error.h"

namespace lmc {

namespace {

Step automatic(Effect effect, const Facts& f) {
  const std::uint32_t punctual = f.pointLights + f.spotLights + f.directionalLights;
  const auto step = [&](bool run, std::string because) { return Step{effect, run, std::move(because), run}; };
  const auto onlyIfAsked = [&](std::string because) { return Step{effect, false, std::move(because), true}; };
  if (effect == Effect::Tangents)
    return f.tangentMaterials > 0 ? step(true, fmt::format("{} materials have normal maps or the like", f.tangentMaterials))
                                  : step(false, "no material has a normal map");
  if (f.receivers == 0) return step(false, "no object has a place in the light map");
  switch (effect) {
    case Effect::Direct:
      if (punctual > 0)
        return step(true, fmt::format("{} point, {} spot, {} directional lights", f.pointLights, f.spotLights, f.directionalLights));
      return step(false, f.darkLights > 0 ? "every light has intensity 0" : "no punctual lights");
    case Effect::Shadow:
      if (punctual + f.emissiveTriangles == 0) return step(false, "no light that could be blocked but the sky");
      return f.blockers > 0 ? step(true, fmt::format("{} triangles cast shadows", f.blockers)) : step(false, "nothing casts a shadow");
    case Effect::Area:
      return f.emissiveTriangles > 0 ? step(true, fmt::format("{} emissive triangles", f.emissiveTriangles))
                                     : step(false, "no emissive surfaces");
    case Effect::Sky:
      return f.sky ? step(true, "the sky has a radiance") : step(false, "no sky");
    case Effect::Bounce:
      if (!f.lit()) return step(false, "no light to bounce");
      if (f.largestReflectance <= 0.0f) return step(false, "every surface has albedo 0");
      if (f.blockers == 0) return step(false, "no surface that light could come back from");
      return step(true, fmt::format("surfaces reflect up to {:.3g}", f.largestReflectance));
    case Effect::Ao:
      if (f.blockers == 0) return step(false, "nothing casts a shadow: all is open");
      return f.lit() ? step(true, "the level has light") : onlyIfAsked("no light");
    case Effect::Bent:
      return f.blockers == 0 ? step(false, "nothing casts a shadow: they are the normals") : onlyIfAsked("not asked for (--bent)");
    case Effect::Tangents:
      break;
    case Effect::Seams:
      if (!f.lit()) return step(false, "no light that could show a seam");
      if (!f.smoothSeams) return step(true, "where edges of charts meet on smooth surfaces");
      return *f.smoothSeams > 0 ? step(true, fmt::format("{} chart edges meet on smooth surfaces", *f.smoothSeams))
                                : step(false, "no smooth seam");
  }
  return step(false, "");
}

std::optional<Effect> effectNamed(std::string_view name) {
  for (std::size_t i = 0; i < std::size(kEffectNames); ++i)
    if (name == kEffectNames[i]) return Effect(i);
  return std::nullopt;
}

}  // namespace

Facts factsOf(const Scene& scene) {
  Facts f;
  for (const Light& l : scene.lights) {
    if (strength(l.intensity) <= 0.0f)
      ++f.darkLights;
    else if (l.kind == Light::Kind::Point)
      ++f.pointLights;
    else if (l.kind == Light::Kind::Spot)
      ++f.spotLights;
    else
      ++f.directionalLights;
  }
  f.sky = strength(scene.sky) > 0.0f;
  for (const Material& m : scene.materials) f.tangentMaterials += m.wantsTangents;
  for (const Object& o : scene.objects) {
    const Material& m = scene.materials[o.material];
    if (o.triangleCount == 0) continue;
    f.receivers += o.receive;
    if (strength(m.emission) > 0.0f) f.emissiveTriangles += o.triangleCount;
    if (!o.cast || !m.opaqueToLight()) continue;
    f.blockers += o.triangleCount;
    // COLOR_0 and textures only take away from the factor.
    f.largestReflectance = std::max(f.largestReflectance, strength(Rgb(m.baseColor)) * (m.metallicTexture ? 1.0f : 1.0f - m.metallic));
  }
  return f;
}

Plan makePlan(const std::string& effects, const Facts& facts) {
  Plan plan;
  for (std::size_t i = 0; i < std::size(kEffectNames); ++i) plan.steps.push_back(automatic(Effect(i), facts));
  if (effects == "auto") return plan;

  std::vector<std::string> words;
  for (std::size_t at = 0; at <= effects.size();) {
    const std::size_t comma = std::min(effects.find(',', at), effects.size());
    words.push_back(effects.substr(at, comma - at));
    at = comma + 1;
  }
  const bool changes = !words[0].empty() && (words[0][0] == '+' || words[0][0] == '-');
  std::vector<std::optional<bool>> wish(std::size(kEffectNames));
  if (!changes) std::ranges::fill(wish, std::optional(false));
  for (const std::string& word : words) {
    const bool signedWord = !word.empty() && (word[0] == '+' || word[0] == '-');
    const auto effect = effectNamed(std::string_view(word).substr(signedWord ? 1 : 0));
    if (!effect || signedWord != changes)
      throw Error(Exit::Usage, "lmc", "",
                  fmt::format("--effects: '{}' is not an effect ({}), or mixes a list with changes", word, fmt::join(kEffectNames, ", ")));
    wish[std::size_t(*effect)] = !signedWord || word[0] == '+';
  }
  for (Step& step : plan.steps) {
    const std::optional<bool> w = wish[std::size_t(step.effect)];
    if (!w || *w == step.run) continue;
    // Asked for what the level has not: it would be simulated and give nothing, so the reason stays and the work is not done.
    if (*w && !step.possible) continue;
    step.run = *w;
    step.because = "--effects " + effects;
  }
  return plan;
}

}  // namespace lmc
