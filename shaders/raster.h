#pragma once
/// Which triangle each pixel's centre sees, in double precision and without clipping.
#include <functional>

#include "shaders/view.h"

namespace lmc::shaders {

/// What a pixel's centre sees.
struct Fragment {
  std::uint32_t triangle = kNone;
  glm::dvec3 bary{0.0};  ///< of the corners, in the world
  double viewDepth_m = 0.0;
  bool front = true;
};

/// The camera's ray through the centre of a pixel: position + depth * (axis to it).
glm::dvec3 pixelAxis(const View&, double x, double y);

/// The nearest fragments; those for which kept(fragment) is false are holes. Triangles of objects that are not drawn, and backs of
/// one-sided ones, are left out. The same on every run.
Image<Fragment> rasterise(const ShadingLevel&, const View&, const std::function<bool(const Fragment&)>& kept);

}  // namespace lmc::shaders
