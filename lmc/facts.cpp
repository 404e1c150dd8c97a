#include "lmc/facts.h"

#include <algorithm>
#include <cmath>

#include "libradiosity/emitters.h"
#include "libscene/constants.h"
#include "libscene/tracer.h"

namespace lmc {

namespace {

constexpr std::uint64_t kMostPlaneTests = 50'000'000;  // a convex level of more is taken as any other
constexpr double kOnPlane = 4e-7;                      // of the level's extent: rounding of float vertices, less than rays are lifted by

constexpr float kAlphaRounding = 1e-5f;  // relative, of interpolated alpha

bool grey(const Rgb& c) { return c.r == c.g && c.g == c.b; }

/// Of all pictures, looked at once.
struct Pictures {
  explicit Pictures(const Scene& scene) : grey(scene.images.size(), true), leastAlpha(scene.images.size(), 1.0f) {
    for (std::size_t i = 0; i < scene.images.size(); ++i) {
      std::uint8_t least = 255;
      bool same = true;
      for (const glm::u8vec4& p : scene.images[i].pixels) {
        least = std::min(least, p.a);
        same = same && p.r == p.g && p.g == p.b;
      }
      grey[i] = same;
      leastAlpha[i] = float(least) / 255.0f;
    }
  }
  bool isGrey(const Texture& t) const { return !t || grey[t.image]; }
  float alpha(const Texture& t) const { return t ? leastAlpha[t.image] : 1.0f; }
  std::vector<bool> grey;
  std::vector<float> leastAlpha;
};

/// All vertices against the planes of what blocks, and of what receives. Most levels show after a few triangles that they are neither.
struct Sides {
  bool inside = true, outside = true, lampsInFront = true;
};
Sides sidesOf(const Scene& scene) {
  Sides out;
  const double near = kOnPlane * double(scene.extent_m);
  std::uint64_t tests = 0;
  for (std::uint32_t t = 0; t < scene.triangles.size() && (out.inside || out.outside); ++t) {
    const Object& o = scene.objectOf(t);
    const bool blocks = o.cast && scene.materials[o.material].opaqueToLight();
    const auto c = scene.corners_m(t);
    if ((!blocks && !o.receive) || isDegenerate(c)) continue;
    if ((tests += scene.positions_m.size()) > kMostPlaneTests) return {false, false, false};
    const glm::dvec3 n = glm::normalize(glm::cross(c[1] - c[0], c[2] - c[0]));
    for (const glm::vec3& v : scene.positions_m) {
      const double above = glm::dot(glm::dvec3(v) - c[0], n);
      out.inside = out.inside && (!blocks || above >= -near);
      out.outside = out.outside && above <= near;
      if (!out.inside && !out.outside) break;
    }
    if (!blocks) continue;
    for (const Light& l : scene.lights) {
      const bool endless = l.kind == Light::Kind::Directional;
      out.lampsInFront =
          out.lampsInFront && (endless ? -glm::dot(l.direction, n) > kOnPlane : glm::dot(l.position_m - c[0], n) > 8.0 * near);
    }
  }
  return out;
}

}  // namespace

Facts factsOf(const Scene& scene) {
  Facts f;
  for (const Light& l : scene.lights) {
    f.grey = f.grey && grey(l.intensity);
    if (strength(l.intensity) <= 0.0f)
      ++f.darkLights;
    else if (l.kind == Light::Kind::Point)
      ++f.pointLights;
    else if (l.kind == Light::Kind::Spot)
      ++f.spotLights;
    else
      ++f.directionalLights;
    f.ambient = f.ambient || l.classic;
    f.rangedLights += l.range_m > 0.0 || (l.classic && l.classic->range > 0.0);
  }
  f.dynamicLights = scene.dynamicLights;
  f.dynamicMeshes = scene.dynamicMeshNodes;
  f.sky = strength(scene.sky) > 0.0f;
  f.grey = f.grey && grey(scene.sky);
  for (const Material& m : scene.materials) f.tangentMaterials += m.wantsTangents;
  f.ambient = f.ambient || f.dynamicLights > 0 || strength(scene.ambient) > 0.0f;
  const Pictures pictures(scene);
  float vertexAlpha = 1.0f;
  for (const glm::vec4& c : scene.colors) {
    vertexAlpha = std::min(vertexAlpha, c.a);
    f.grey = f.grey && grey(Rgb(c));
  }
  std::vector<bool> used(scene.materials.size(), false);
  for (const Object& o : scene.objects) {
    const Material& m = scene.materials[o.material];
    if (o.triangleCount == 0) continue;
    used[o.material] = true;
    f.receivers += o.receive;
    f.mirroredObjects += o.mirrored;
    f.grey =
        f.grey && grey(Rgb(m.baseColor)) && pictures.isGrey(m.baseColorTexture) && grey(m.emission) && pictures.isGrey(m.emissionTexture);
    if (strength(m.emission) > 0.0f) {
      f.emissiveTriangles += o.triangleCount;
      double area = 0.0;
      for (std::uint32_t t = o.firstTriangle; t < o.firstTriangle + o.triangleCount; ++t) area += area_m2(scene.corners_m(t));
      area *= m.doubleSided ? 2.0 : 1.0;
      f.emissiveArea_m2 += area;
      f.emissivePower_lm += kPi * double(strength(m.emission)) * area;
    }
    if (!o.cast || !m.opaqueToLight()) continue;
    f.blockers += o.triangleCount;
    if (m.alpha == Material::Alpha::Mask) f.maskedTriangles += o.triangleCount;
    // COLOR_0 and textures only take away from the factor.
    f.largestReflectance = std::max(f.largestReflectance, strength(Rgb(m.baseColor)) * (m.metallicTexture ? 1.0f : 1.0f - m.metallic));
  }
  for (std::size_t i = 0; i < used.size(); ++i) {
    if (!used[i]) continue;
    const Material& m = scene.materials[i];
    f.shinyMaterials += m.shines;
    if (m.alpha != Material::Alpha::Mask) continue;
    ++f.maskedMaterials;
    f.holedMaterials +=
        m.alphaCutoff > 0.0f && m.baseColor.a * pictures.alpha(m.baseColorTexture) * vertexAlpha < m.alphaCutoff * (1.0f + kAlphaRounding);
  }
  if (f.blockers > 0) {
    const Sides s = sidesOf(scene);
    f.shape = s.inside && s.outside ? Shape::Flat : s.inside ? Shape::SeenFromInside : s.outside ? Shape::SeenFromOutside : Shape::Any;
    f.lampsInFront = s.lampsInFront;
  }
  return f;
}

}  // namespace lmc
