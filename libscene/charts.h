#pragma once
/// Light-map UV charts: which triangles hang together in TEXCOORD_1, and whether the layout can hold a light map (CGAL only in charts.cpp).
#include <cstdint>
#include <vector>

#include "libscene/run.h"
#include "libscene/scene.h"

namespace lmc {

/// Triangles of one object that share corners in light-map UV space form a chart.
struct Charts {
  std::vector<std::uint32_t> chartOf;  ///< one a triangle; kNone where the triangle has no place in the map (not receiving, or no UV area)
  std::uint32_t count = 0;
};

/// Texels of the side of the (square) map: `wanted` when it is not 0, else the power of two that gives at least `texelsPerMetre` (the mean
/// over the level's charts).
int mapSide(const Scene&, int wanted, double texelsPerMetre);

/// Throws Error Unsupported when an object that receives light has no TEXCOORD_1, Broken when a UV lies outside [0, 1] by more than 1/64
/// texel or when two triangles overlap by more than 1/32 texel, or by a strip wider than that (decided by exact predicates, measured
/// after). Names object, mesh and triangle. Triangles without UV area that have area in the level are counted in a warning.
Charts findCharts(const Scene&, int mapSide, const Run&);

}  // namespace lmc
