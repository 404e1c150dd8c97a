#pragma once
/// Enclosures that are endless in one direction and made of flat strips: the problem of a cross-section, with exact factors.
#include <glm/glm.hpp>
#include <span>
#include <vector>

namespace lmc {

/// A strip as a segment of the cross-section; it faces to the left of the way from `from` to `to`. No strip may hide another.
struct Strip {
  glm::dvec2 from, to;
  double emission = 0.0;  ///< M [lm/m^2]
  double albedo = 0.0;
};

/// Galerkin solution with `panels` pieces of constant radiosity on each strip, finer towards its ends (a share (1 - cos)/2 of the width,
/// for light runs steeply into corners); factors by crossed strings [hottel1954].
class EndlessEnclosure {
 public:
  EndlessEnclosure(std::span<const Strip>, int panels);
  double mean(std::size_t strip) const;              ///< of H over a strip [lx]
  double at(std::size_t strip, double share) const;  ///< H at a share of the width from `from` [lx]; 0 and 1 are inside limits

 private:
  struct Panel {
    glm::dvec2 from, to;
    std::size_t strip;
    double length;
  };
  std::vector<Strip> strips_;
  std::vector<Panel> panels_;
  std::vector<double> radiosity_, illuminance_;
};

}  // namespace lmc
