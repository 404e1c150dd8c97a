#include "shaders/view.h"

#include <algorithm>
#include <cmath>

#include "libscene/constants.h"

namespace lmc::shaders {

namespace {

constexpr double kDarkerShare = 0.95;              // this share of the pixels is darker than kWhite
constexpr double kWhite = 0.85;                    // of display white
constexpr double kLeastNear = 1e-3;                // of the level's extent: nearer, 24 bits of depth tell far surfaces no longer apart
constexpr double kScreenAoRadius = 0.1;            // of the level's extent: the size of a thing in a room
constexpr glm::dvec3 kFromAside(0.15, 0.12, 0.3);  // an object with as many faces one way as the other is seen from here
constexpr double kAutomaticFov_rad = 60.0 * kPi / 180.0;

struct Box {
  glm::dvec3 low{1e300}, high{-1e300};
  void add(const glm::dvec3& p) {
    low = glm::min(low, p);
    high = glm::max(high, p);
  }
  double distance(const glm::dvec3& p) const { return glm::length(glm::max(glm::max(low - p, p - high), glm::dvec3(0.0))); }
};

}  // namespace

double exposureFor(const Image<glm::vec4>& radiance) {
  std::vector<double> values;
  for (const glm::vec4& p : radiance.pixels) values.push_back(double(std::max({p.x, p.y, p.z})));
  if (values.empty()) return 1.0;
  const auto nth = values.begin() + std::ptrdiff_t(kDarkerShare * double(values.size() - 1));
  std::nth_element(values.begin(), nth, values.end());
  return *nth > 0.0 ? kWhite / *nth : 1.0;
}

double nearPlane_m(const Scene& scene, const Camera& camera) {
  double nearest = 1e300;
  for (const glm::uvec3& t : scene.triangles) {
    Box box;
    for (int c = 0; c < 3; ++c) box.add(glm::dvec3(scene.positions_m[t[c]]));
    nearest = std::min(nearest, box.distance(camera.position_m));
  }
  // A distance along the axis is at least a quarter of the whole one for pictures of up to 150 degrees across.
  const double extent = std::max(double(scene.extent_m), 1e-6);
  return std::clamp(0.25 * nearest, kLeastNear * extent, extent);
}

double screenAoRadius_m(const Scene& scene) { return kScreenAoRadius * std::max(double(scene.extent_m), 1e-6); }

Camera cameraAt(const glm::dvec3& eye_m, const glm::dvec3& target_m, double verticalFov_rad) {
  Camera out;
  out.position_m = eye_m;
  const glm::dvec3 back = glm::length(eye_m - target_m) > 0.0 ? glm::normalize(eye_m - target_m) : glm::dvec3(0, 0, 1);
  const glm::dvec3 up = std::abs(back.y) > 0.999 ? glm::dvec3(0, 0, 1) : glm::dvec3(0, 1, 0);
  const glm::dvec3 right = glm::normalize(glm::cross(up, back));
  out.axes = glm::dmat3(right, glm::cross(back, right), back);
  out.verticalFov_rad = verticalFov_rad;
  return out;
}

Camera automaticCamera(const Scene& scene) {
  Box box;
  for (const glm::vec3& p : scene.positions_m) box.add(glm::dvec3(p));
  if (scene.triangles.empty()) return cameraAt({0, 0, 1}, {0, 0, 0}, kAutomaticFov_rad);
  const glm::dvec3 centre = 0.5 * (box.low + box.high);
  glm::dvec3 facing(0.0);
  double outwards = 0.0, area = 0.0;
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    const auto c = scene.corners_m(t);
    const glm::dvec3 normal = glm::cross(c[1] - c[0], c[2] - c[0]);
    outwards += glm::dot(normal, (c[0] + c[1] + c[2]) / 3.0 - centre);
    facing += normal;
    area += glm::length(normal);
  }
  // Faces of a room look at one another; those of a panel with knobs on it look inwards too, but one way.
  if (outwards < 0.0 && glm::length(facing) < 0.5 * area)
    return cameraAt(glm::mix(box.low, box.high, glm::dvec3(0.9, 0.6, 0.9)), glm::mix(box.low, box.high, glm::dvec3(0.2, 0.35, 0.2)),
                    kAutomaticFov_rad);
  const glm::dvec3 way = glm::normalize(facing / std::max(area, 1e-300) + kFromAside);
  const double radius = 0.5 * glm::length(box.high - box.low), distance = 0.75 * radius / std::sin(0.5 * kAutomaticFov_rad);
  return cameraAt(centre + distance * way, centre, kAutomaticFov_rad);
}

glm::dmat3 normalMatrix(const glm::dmat4& world) {
  const glm::dmat3 m(world);
  const double sign = glm::determinant(m) < 0.0 ? -1.0 : 1.0;
  return {sign * glm::cross(m[1], m[2]), sign * glm::cross(m[2], m[0]), sign * glm::cross(m[0], m[1])};
}

bool hasAmbient(const ShadingLevel& level) {
  return level.scene.ambient != Rgb(0.0f) || std::ranges::any_of(level.lights, [](const ShadedLight& l) { return l.ambient != Rgb(0.0f); });
}

bool addsNothing(const ShadingLevel& level, const LevelMaps& maps, const View& view, const ShadedLight& light) {
  if (!light.baked) return false;
  const bool shineless = light.specular == Rgb(0.0f) || light.specularIntensity == 0.0;
  for (std::size_t o = 0; o < level.scene.objects.size(); ++o)
    if (isDrawn(level, view, o) &&
        (!hasMap(level, maps, view, o) || !(shineless || !level.scene.materials[level.scene.objects[o].material].shines)))
      return false;
  return true;
}

}  // namespace lmc::shaders
