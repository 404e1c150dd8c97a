#pragma once
/// The stages of a bake on a scene made in code.
#include <cmath>

#include "lmc/bake_scene.h"

namespace lmc::test {

using lmc::Baked;
using lmc::bakeScene;
using lmc::BakeSceneOptions;

/// RMS difference over texels that both have, relative to the mean of a.
inline double relativeRms(const Baked& a, const Baked& b) {
  double sum = 0.0, n = 0.0;
  for (std::size_t i = 0; i < a.map.size(); ++i) {
    if (a.map.chart[i] == kNone || b.map.chart[i] == kNone) continue;
    const glm::dvec3 d = glm::dvec3(a.values.direct[i] + a.values.indirect[i]) - glm::dvec3(b.values.direct[i] + b.values.indirect[i]);
    sum += glm::dot(d, d) / 3.0;
    n += 1.0;
  }
  return std::sqrt(sum / n) / a.ledger.mean;
}

}  // namespace lmc::test
