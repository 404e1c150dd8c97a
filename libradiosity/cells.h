#pragma once
/// Rooms and portals ([teller1991]): convex cells between the level's flat walls, the openings between them, and which cell may see which.
/// Conservative: what is no large flat opaque wall is taken as air, and where bounds of work or number are met, cells stay uncut or see
/// all that they are joined to.
#include <cstdint>
#include <span>
#include <vector>

#include "libradiosity/flat_walls.h"
#include "libradiosity/form_factor.h"

namespace lmc {

/// An opening in the plane between two cells, convex.
struct Portal {
  std::uint32_t front = 0, back = 0;  ///< cells; `normal` points into the front one
  glm::dvec3 normal{0.0};
  double offset_m = 0.0;
  Polygon3 corners;
};

class Cells {
 public:
  Cells() = default;
  /// `rounding_m`: what float vertices and the starts of rays may be off by. Cracks up to twice as wide are closed, wider ones are portals.
  Cells(const Scene&, double rounding_m);

  std::size_t words() const { return (count_ + 63) / 64; }  ///< of a set of cells, a bit each

  /// Adds the cells into which a triangle looks, to the side from which its corners run counter-clockwise.
  void addCellsOf(const std::array<glm::dvec3, 3>& corners, std::span<std::uint64_t> cells) const;
  /// All that may be seen from any of these cells.
  void addSeen(std::span<const std::uint64_t> from, std::span<std::uint64_t> seen) const;

 private:
  struct Node {
    glm::dvec3 normal{0.0};
    double offset_m = 0.0;
    std::array<std::int32_t, 2> child{};  // in front, behind; negative = ~cell
  };
  void cut(const std::vector<FlatWall>&, const glm::dvec3& lo, const glm::dvec3& hi);

  double rounding_m_ = 0.0;
  std::size_t count_ = 0;
  std::vector<Node> nodes_;  // the first is the root; none where nothing is cut
  std::vector<Portal> portals_;
  std::vector<std::uint64_t> sight_;  // rows of words(): a bit for each cell that may be seen, both ways alike
};

}  // namespace lmc
