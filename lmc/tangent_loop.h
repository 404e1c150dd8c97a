#pragma once
/// libtangent knows no TBB: its loops run here.
#include "libscene/parallel.h"
#include "libtangent/tangent.h"

namespace lmc {

inline tangent::Loop tangentLoop(const Run& run) {
  return {threadCount(run), [run](std::size_t n, const std::function<void(std::size_t)>& body) { parallelFor(run, n, 1, body); }};
}

}  // namespace lmc
