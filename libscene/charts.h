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

/// Why an object's map UVs cannot hold a light map.
struct UvFault {
  enum class Kind { Missing, OutOfRange, NoArea, Overlap, Stretch, Padding, Density } kind;
  std::uint32_t object;
  std::string where, text;  ///< JSON pointer; what is wrong, with names
};

/// The first fault of each object that receives light: no TEXCOORD_1; a UV outside [0, 1] by more than 1/64 texel; more than 1/1000 of the
/// area without UV area; two triangles that overlap by more than 1/32 texel, or by a strip wider than that (decided by exact predicates,
/// measured after), in the object itself or with another, which then has the same fault.
std::vector<UvFault> uvFaults(const Scene&, int mapSide);
Error uvError(const Scene&, const UvFault&);

/// Charts of the objects that are not left out, whatever their faults.
Charts connectedByUv(const Scene&, const std::vector<bool>& without);

/// Throws what uvFaults() would find. Triangles without UV area that have area in the level are counted in a warning.
Charts findCharts(const Scene&, int mapSide, const Run&);

}  // namespace lmc
