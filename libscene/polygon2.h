#pragma once
/// A convex polygon in the plane, cut by half planes.
#include <glm/glm.hpp>
#include <vector>

namespace lmc {

class Polygon2 {
 public:
  Polygon2() = default;
  explicit Polygon2(std::vector<glm::dvec2> corners) : corners_(std::move(corners)) {}

  /// Keeps what lies to the left of the line through `origin` along `direction`.
  void clip(glm::dvec2 origin, glm::dvec2 direction) {
    scratch_.clear();
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      const glm::dvec2 a = corners_[i], b = corners_[(i + 1) % corners_.size()];
      const double da = cross(direction, a - origin), db = cross(direction, b - origin);
      if (da >= 0.0) scratch_.push_back(a);
      if ((da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0)) scratch_.push_back(a + (b - a) * (da / (da - db)));
    }
    corners_.swap(scratch_);
  }
  /// Signed, positive counter-clockwise.
  double area() const {
    double sum = 0.0;
    for (std::size_t i = 2; i < corners_.size(); ++i) sum += cross(corners_[i - 1] - corners_[0], corners_[i] - corners_[0]);
    return 0.5 * sum;
  }
  const std::vector<glm::dvec2>& corners() const { return corners_; }
  void assign(std::initializer_list<glm::dvec2> corners) { corners_ = corners; }

  static double cross(glm::dvec2 a, glm::dvec2 b) { return a.x * b.y - a.y * b.x; }

 private:
  std::vector<glm::dvec2> corners_, scratch_;
};

}  // namespace lmc
