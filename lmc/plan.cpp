#include "lmc/plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "libradiosity/light_map.h"
#include "libscene/error.h"

namespace lmc {

namespace {

Step automatic(Effect effect, const Facts& f) {
  const std::uint32_t punctual = f.pointLights + f.spotLights + f.directionalLights;
  const bool faces = f.blockers > 0 && f.shape != Shape::Flat && f.shape != Shape::SeenFromOutside;  // surfaces may see one another
  const auto step = [&](bool run, std::string because) { return Step{effect, run, std::move(because), run}; };
  const auto onlyIfAsked = [&](std::string because) { return Step{effect, false, std::move(because), true}; };
  if (effect == Effect::Tangents)
    return f.tangentMaterials > 0 ? step(true, fmt::format("{} materials have normal maps or the like", f.tangentMaterials))
                                  : step(false, "no material has a normal map");
  if (effect == Effect::Specular) {
    if (punctual + f.dynamicLights == 0) return step(false, "no light of a renderer");
    return f.shinyMaterials > 0 ? step(true, fmt::format("a renderer's: {} materials shine", f.shinyMaterials))
                                : step(false, "no material shines");
  }
  if (effect == Effect::ScreenAo)
    return f.ambient ? onlyIfAsked("a renderer's, not asked for (shade --ao screen)")
                     : step(false, "no ambient light, which is all that it darkens");
  if (f.receivers == 0) return step(false, "no object has a place in the light map");
  switch (effect) {
    case Effect::Direct:
      if (punctual > 0)
        return step(true, fmt::format("{} point, {} spot, {} directional lights", f.pointLights, f.spotLights, f.directionalLights));
      return step(false, f.darkLights > 0 ? "every light has intensity 0" : "no punctual lights");
    case Effect::Shadow:
      if (punctual + f.emissiveTriangles == 0) return step(false, "no light that could be blocked but the sky");
      if (f.blockers == 0) return step(false, "nothing casts a shadow");
      if (!faces) return onlyIfAsked("no surface stands in front of another");
      if (f.shape == Shape::SeenFromInside && f.lampsInFront)
        return onlyIfAsked("the level is convex and all lamps are in it: nothing stands in between");
      return step(true, fmt::format("{} triangles cast shadows", f.blockers));
    case Effect::Area:
      return f.emissiveTriangles > 0 ? step(true, fmt::format("{} emissive triangles", f.emissiveTriangles))
                                     : step(false, "no emissive surfaces");
    case Effect::Sky:
      return f.sky ? step(true, "the sky has a radiance") : step(false, "no sky");
    case Effect::Bounce:
      if (!f.lit()) return step(false, "no light to bounce");
      if (f.largestReflectance <= 0.0f) return step(false, "every surface has albedo 0");
      if (f.blockers == 0) return step(false, "no surface that light could come back from");
      if (!faces) return onlyIfAsked("no surface faces another");
      return step(true, fmt::format("surfaces reflect up to {:.3g}", f.largestReflectance));
    case Effect::Ao:
      if (f.blockers == 0) return step(false, "nothing casts a shadow: all is open");
      if (!faces) return onlyIfAsked("no surface stands in front of another: all is open");
      return f.lit() ? step(true, "the level has light") : onlyIfAsked("no light");
    case Effect::Bent:
      return f.blockers == 0 ? step(false, "nothing casts a shadow: they are the normals") : onlyIfAsked("not asked for (--bent)");
    case Effect::Near:
      return step(true, "what is nearer than a patch is wide is evaluated at the place");
    case Effect::Colour:
      if (!f.lit()) return step(false, "no light");
      return f.grey ? step(false, "lights and surfaces are grey: one channel says all") : step(true, "lights or surfaces have colours");
    case Effect::Alpha:
      if (f.maskedMaterials == 0) return step(false, "no material has holes (MASK)");
      return f.holedMaterials > 0 ? step(true, fmt::format("{} materials have holes", f.holedMaterials))
                                  : onlyIfAsked("no alpha is below its cut-off: nothing has a hole");
    case Effect::Tangents:
    case Effect::Specular:
    case Effect::ScreenAo:
      break;
    case Effect::Seams:
      if (!f.lit()) return step(false, "no light that could show a seam");
      if (!f.smoothSeams) return step(true, "where edges of charts meet on smooth surfaces");
      return *f.smoothSeams > 0 ? step(true, fmt::format("{} chart edges meet on smooth surfaces", *f.smoothSeams))
                                : step(false, "no smooth seam");
    case Effect::Rims:
      if (!f.lit()) return step(false, "no light that could show a rim");
      if (f.blockers == 0 || f.shape != Shape::Any) return step(false, "nothing stands on a surface");
      return onlyIfAsked("not asked for (+rims): texels partly in solids keep their means");
  }
  return step(false, "");
}

std::optional<Effect> effectNamed(std::string_view name) {
  for (std::size_t i = 0; i < kEffects; ++i)
    if (name == kEffectNames[i]) return Effect(i);
  return std::nullopt;
}

/// Manners of what does not run do not run.
void leaveOutManners(Plan& plan, bool countedBounces) {
  const auto without = [&](Effect effect, const char* because) {
    Step& step = plan.steps[std::size_t(effect)];
    if (!step.run) return;
    step.run = step.possible = false;
    step.because = because;
  };
  if (!plan.runs(Effect::Bounce)) without(Effect::Near, "no bounces");
  if (countedBounces) without(Effect::Near, "--passes counts bounces, and it would add one");
  if (!plan.anything()) without(Effect::Alpha, "nothing is simulated");
}

/// The weakest first, as long as all that is left out fits; what is part of the bounces after them.
void leaveOutWeak(Plan& plan, const std::vector<std::optional<bool>>& wish, double goal) {
  std::vector<Step*> weak;
  for (Step& step : plan.steps)
    if (step.run && step.light.known && !wish[std::size_t(step.effect)]) weak.push_back(&step);
  std::ranges::stable_sort(weak, {}, [](const Step* s) { return std::pair(s->effect == Effect::Near, s->light.bound); });
  for (Step* step : weak) {
    if (step->effect == Effect::Near && !plan.runs(Effect::Bounce)) continue;
    const double level = plan.leftOut + step->light.bound, object = plan.leftOutObject + step->light.object;
    if (level > kLeftOutShare * goal || object > kLeftOutShare * kObjectLimit * goal) continue;
    plan.leftOut = level;
    plan.leftOutObject = object;
    step->run = false;
    step->tooWeak = true;
    step->because = fmt::format("at most {:.2g} % of the level's light, {:.2g} % of an object's: too little for a goal of {:.3g} %",
                                100.0 * step->light.bound, 100.0 * step->light.object, 100.0 * goal);
  }
}

}  // namespace

Plan makePlan(const PlanRequest& request, const Facts& facts) {
  const std::string& effects = request.effects;
  Plan plan;
  for (std::size_t i = 0; i < kEffects; ++i) {
    plan.steps.push_back(automatic(Effect(i), facts));
    if (facts.pilot) plan.steps.back().light = facts.pilot->effects[i];
  }
  std::vector<std::optional<bool>> wish(kEffects);
  if (effects != "auto") {
    std::vector<std::string> words;
    for (std::size_t at = 0; at <= effects.size();) {
      const std::size_t comma = std::min(effects.find(',', at), effects.size());
      words.push_back(effects.substr(at, comma - at));
      at = comma + 1;
    }
    const bool changes = !words[0].empty() && (words[0][0] == '+' || words[0][0] == '-');
    for (std::size_t i = 0; !changes && i < kEffects; ++i)
      if (!isManner(Effect(i))) wish[i] = false;
    for (const std::string& word : words) {
      const bool signedWord = !word.empty() && (word[0] == '+' || word[0] == '-');
      const auto effect = effectNamed(std::string_view(word).substr(signedWord ? 1 : 0));
      if (!effect || signedWord != changes)
        throw Error(
            Exit::Usage, "lmc", "",
            fmt::format("--effects: '{}' is not an effect ({}), or mixes a list with changes", word, fmt::join(kEffectNames, ", ")));
      wish[std::size_t(*effect)] = !signedWord || word[0] == '+';
    }
  }
  for (Step& step : plan.steps) {
    const std::optional<bool> w = wish[std::size_t(step.effect)];
    if (!w || *w == step.run) continue;
    // Asked for what the level has not: it would be simulated and give nothing, so the reason stays and the work is not done.
    if (*w && !step.possible) continue;
    step.run = *w;
    step.asked = true;
    step.because = "--effects " + effects;
  }
  leaveOutManners(plan, request.countedBounces);
  leaveOutWeak(plan, wish, request.goal);
  leaveOutManners(plan, request.countedBounces);
  return plan;
}

namespace {

/// Their errors are independent.
Forecast sum(std::initializer_list<Forecast> parts) {
  Forecast out;
  double below2 = 0.0, above2 = 0.0;
  for (const Forecast& p : parts) {
    out.rays += p.rays;
    out.cpu_s += p.cpu_s;
    below2 += (p.cpu_s - p.least_s) * (p.cpu_s - p.least_s);
    above2 += (p.most_s - p.cpu_s) * (p.most_s - p.cpu_s);
  }
  out.least_s = out.cpu_s - std::sqrt(below2);
  out.most_s = out.cpu_s + std::sqrt(above2);
  return out;
}

}  // namespace

Cost costOf(Effect effect, const Plan& plan, const Pilot& pilot) {
  if (!plan.runs(effect)) return {};
  switch (effect) {
    case Effect::Direct:
      return {pilot.direct, {}};
    case Effect::Area:
      return plan.runs(Effect::Direct) ? Cost{{}, Effect::Direct} : Cost{pilot.direct, {}};
    case Effect::Shadow:
      if (plan.runs(Effect::Direct)) return {{}, Effect::Direct};
      return plan.runs(Effect::Area) ? Cost{{}, Effect::Area} : Cost{};
    case Effect::Bounce:
      return {sum({pilot.patches, pilot.solve, pilot.gather}), {}};
    case Effect::Sky:
      return plan.runs(Effect::Bounce) ? Cost{{}, Effect::Bounce} : Cost{pilot.gather, {}};
    case Effect::Ao:
      return {pilot.occlude, {}};
    case Effect::Bent:
      return plan.runs(Effect::Ao) ? Cost{{}, Effect::Ao} : Cost{pilot.occlude, {}};
    case Effect::Seams:
      return {pilot.seams, {}};
    case Effect::Rims:
      return {pilot.rims, {}};
    case Effect::Near:
      return {{}, Effect::Bounce};
    case Effect::Tangents:
    case Effect::Colour:
    case Effect::Alpha:
    case Effect::Specular:
    case Effect::ScreenAo:
      break;
  }
  return {};
}

Forecast forecastOf(const Plan& plan, const Pilot& pilot) {
  Forecast all = sum({pilot.audit, pilot.rest});
  for (std::size_t i = 0; i < kEffects; ++i)
    if (const Cost c = costOf(Effect(i), plan, pilot); c.forecast) all = sum({all, *c.forecast});
  return all;
}

}  // namespace lmc
