#include "shaders/raster.h"

#include <algorithm>
#include <cmath>

namespace lmc::shaders {

namespace {

/// A triangle as its corners project: columns (X, Y, w), the place on the screen being (X, Y)/w in [-1, 1] upwards, w the view depth.
/// A pixel s = (x, y, 1) sees the point with weights b when sum b_i (X, Y, w)_i = w s, so b/w = inverse(columns) s: without a division
/// by any corner's own w, a triangle needs no clipping [olano1997].
struct Projected {
  glm::dmat3 corners, inverse;
  double determinant;
};

Projected projected(const std::array<glm::dvec3, 3>& corners_m, const View& view) {
  const Camera& c = view.camera;
  const double tangent = std::tan(0.5 * c.verticalFov_rad), aspect = double(view.width) / view.height;
  Projected out;
  for (int k = 0; k < 3; ++k) {
    const glm::dvec3 v = glm::transpose(c.axes) * (corners_m[std::size_t(k)] - c.position_m);
    out.corners[k] = {v.x / (tangent * aspect), v.y / tangent, -v.z};
  }
  out.determinant = glm::determinant(out.corners);
  out.inverse = glm::inverse(out.corners);
  return out;
}

struct Pixels {
  int x0, y0, x1, y1;  ///< the last ones excluded
};

/// Pixels whose centres the triangle may hold.
Pixels boundsOf(const Projected& t, const View& view) {
  if (t.corners[0].z <= 0.0 && t.corners[1].z <= 0.0 && t.corners[2].z <= 0.0) return {0, 0, 0, 0};
  if (t.corners[0].z <= 0.0 || t.corners[1].z <= 0.0 || t.corners[2].z <= 0.0) return {0, 0, view.width, view.height};
  glm::dvec2 low(1e300), high(-1e300);
  for (int k = 0; k < 3; ++k) {
    const glm::dvec2 p = glm::dvec2(t.corners[k]) / t.corners[k].z;
    const glm::dvec2 pixel(0.5 * (p.x + 1.0) * view.width, 0.5 * (1.0 - p.y) * view.height);
    low = glm::min(low, pixel);
    high = glm::max(high, pixel);
  }
  const auto whole = [](double v, int most) { return int(std::clamp(v, 0.0, double(most))); };
  return {whole(std::floor(low.x - 0.5), view.width), whole(std::floor(low.y - 0.5), view.height),
          whole(std::ceil(high.x + 0.5), view.width), whole(std::ceil(high.y + 0.5), view.height)};
}

glm::dvec2 screenOf(const View& view, double x, double y) {
  return {2.0 * (x + 0.5) / view.width - 1.0, 1.0 - 2.0 * (y + 0.5) / view.height};
}

}  // namespace

glm::dvec3 pixelAxis(const View& view, double x, double y) {
  const Camera& c = view.camera;
  const double tangent = std::tan(0.5 * c.verticalFov_rad), aspect = double(view.width) / view.height;
  const glm::dvec2 s = screenOf(view, x, y);
  return s.x * tangent * aspect * c.axes[0] + s.y * tangent * c.axes[1] - c.axes[2];
}

Image<Fragment> rasterise(const ShadingLevel& level, const View& view, const std::function<bool(const Fragment&)>& kept) {
  const Scene& scene = level.scene;
  const double near_m = nearPlane_m(scene, view.camera);
  Image<Fragment> out(view.width, view.height);
  for (std::uint32_t o = 0; o < scene.objects.size(); ++o) {
    const Object& object = scene.objects[o];
    if (!isDrawn(level, view, o)) continue;
    const bool doubleSided = scene.materials[object.material].doubleSided;
    for (std::uint32_t i = object.firstTriangle; i < object.firstTriangle + object.triangleCount; ++i) {
      std::array<glm::dvec3, 3> corners_m;
      for (int k = 0; k < 3; ++k)
        corners_m[std::size_t(k)] = glm::dvec3(level.worlds[o] * glm::dvec4(glm::dvec3(level.positions_m[scene.triangles[i][k]]), 1.0));
      const Projected t = projected(corners_m, view);
      const bool front = t.determinant > 0.0;
      if (t.determinant == 0.0 || (!front && !doubleSided)) continue;
      const Pixels pixels = boundsOf(t, view);
      for (int y = pixels.y0; y < pixels.y1; ++y)
        for (int x = pixels.x0; x < pixels.x1; ++x) {
          const glm::dvec3 share = t.inverse * glm::dvec3(screenOf(view, x, y), 1.0);
          if (share.x < 0.0 || share.y < 0.0 || share.z < 0.0) continue;
          const double depth = 1.0 / (share.x + share.y + share.z);
          Fragment& nearest = out.at(x, y);
          if (!(depth >= near_m) || (nearest.triangle != kNone && depth >= nearest.viewDepth_m)) continue;
          const Fragment fragment{i, depth * share, depth, front};
          if (kept(fragment)) nearest = fragment;
        }
    }
  }
  return out;
}

}  // namespace lmc::shaders
