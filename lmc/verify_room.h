#pragma once
/// Rooms of the reference cases as levels made in memory.
#include <array>

#include "libscene/scene_builder.h"
#include "lmc/bake_scene.h"
#include "lmc/verify_case.h"

namespace lmc {

/// The case's `faces` ("z=0", "x=a", ...) among z=0, z=c, x=0, x=a, y=0, y=b; that order when it names none.
std::vector<std::size_t> facesOf(const Parameters& geometry);

/// Mean of E over objects, weights = their areas [lx]; an object beyond the list or of weight 0 is not looked at.
double meanOver(const Baked&, std::span<const double> areas);

/// A cube of six walls, with a square lamp in one of them or without.
struct Cube {
  Scene scene;
  double side = 1.0;
  int cells = 4;                             ///< of the light map, a side
  std::array<std::vector<double>, 6> areas;  ///< of each object, for the mean over each face of the case
  std::vector<QuadPlace> centres;            ///< middle of each face of the case
};
Cube cubeOf(const Parameters& geometry);

/// A closed room with a box in it, all surfaces unlike.
struct BalanceRoom {
  Scene scene;
  std::vector<double> areas, albedo, emission;  ///< of each object
  double sent = 0.0;                            ///< sum A M
};
BalanceRoom balanceRoom();
double absorbed(const BalanceRoom&, const Baked&);  ///< sum A (1 - rho) H

}  // namespace lmc
