#include "libscene/burial.h"

#include <algorithm>
#include <array>

namespace lmc {

Lie lieOf(const Tracer& tracer, std::span<const Ray, kLieRays> rays, Purpose purpose) {
  std::array<Hit, kLieRays> hits;
  tracer.closest(rays, hits, purpose);
  if (!std::ranges::all_of(hits, [](const Hit& h) { return bool(h); })) return Lie::Free;
  const auto insides = std::size_t(std::ranges::count_if(hits, [&](const Hit& h) { return tracer.isInsideOfSolid(h); }));
  return 2 * insides >= kLieRays ? Lie::Buried : Lie::Closed;
}

}  // namespace lmc
