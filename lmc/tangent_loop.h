#pragma once
/// libtangent knows no TBB: its loops run here. Its vector loops also compute lanes that nobody takes, and divide by zero there.
#include "libscene/float_traps.h"
#include "libscene/parallel.h"
#include "libtangent/tangent.h"

namespace lmc {

inline tangent::Loop tangentLoop(const Run& run) {
  return {threadCount(run), [run](std::size_t n, const std::function<void(std::size_t)>& body) {
            parallelFor(run, n, 1, [&](std::size_t i) {
              const NoFloatTraps lanes;
              body(i);
            });
          }};
}

inline tangent::Tangents tangentsOf(const tangent::Surface& surface, const Run& run) {
  const NoFloatTraps lanes;
  return tangent::compute(surface, tangentLoop(run));
}
inline tangent::ReferenceTangents referenceTangentsOf(const tangent::Surface& surface, const Run& run) {
  const NoFloatTraps lanes;
  return tangent::computeReference(surface, tangentLoop(run));
}

}  // namespace lmc
