#include "libscene/texture.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace lmc {
namespace {

constexpr int kMaxPointsAcross = 64;  // 64 * 64 = 4096 points a triangle

/// IEC 61966-2-1, for each of the 256 stored values.
const std::array<float, 256>& linearOfSrgb() {
  static const std::array<float, 256> kTable = [] {
    std::array<float, 256> table{};
    for (int i = 0; i < 256; ++i) {
      const double v = i / 255.0;
      table[std::size_t(i)] = float(v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4));
    }
    return table;
  }();
  return kTable;
}

enum class Encoding { Srgb, Linear };

glm::vec4 decoded(glm::u8vec4 stored, Encoding encoding) {
  const auto& table = linearOfSrgb();
  if (encoding == Encoding::Linear) return glm::vec4(stored) / 255.0f;
  return {table[stored.r], table[stored.g], table[stored.b], float(stored.a) / 255.0f};
}

/// Texel number of any integer, as the sampler's wrap mode says.
int wrapped(std::int64_t i, int size, Wrap wrap) {
  switch (wrap) {
    case Wrap::Clamp:
      return int(std::clamp<std::int64_t>(i, 0, size - 1));
    case Wrap::Repeat:
      return int(((i % size) + size) % size);
    case Wrap::Mirror: {
      const std::int64_t period = 2 * std::int64_t(size);
      const std::int64_t m = ((i % period) + period) % period;
      return int(m < size ? m : period - 1 - m);
    }
  }
  return 0;
}

glm::vec4 sample(const Scene& scene, const Texture& texture, glm::vec2 uv, Encoding encoding) {
  const auto& image = scene.images[texture.image];
  const glm::vec3 moved = texture.transform * glm::vec3(uv, 1.0f);
  // In double: at u = 1000 a float would leave a 4096-texel picture 4 bits of place within a texel.
  double x = double(moved.x) * image.width, y = double(moved.y) * image.height;
  constexpr double kFar = 1e15;  // UVs may be made huge by a transform; beyond this a texel has no place anyway
  x = std::isfinite(x) ? std::clamp(x, -kFar, kFar) : 0.0;
  y = std::isfinite(y) ? std::clamp(y, -kFar, kFar) : 0.0;
  const auto texel = [&](std::int64_t ix, std::int64_t iy) {
    return decoded(image.at(wrapped(ix, image.width, texture.wrapU), wrapped(iy, image.height, texture.wrapV)), encoding);
  };
  if (texture.nearest) return texel(std::int64_t(std::floor(x)), std::int64_t(std::floor(y)));
  const double fx = std::floor(x - 0.5), fy = std::floor(y - 0.5);
  const auto ix = std::int64_t(fx), iy = std::int64_t(fy);
  const auto tx = float(x - 0.5 - fx), ty = float(y - 0.5 - fy);
  return glm::mix(glm::mix(texel(ix, iy), texel(ix + 1, iy), tx), glm::mix(texel(ix, iy + 1), texel(ix + 1, iy + 1), tx), ty);
}

template <class T>
T interpolated(const std::vector<T>& values, glm::uvec3 t, glm::vec2 bary) {
  return values[t.x] * (1.0f - bary.x - bary.y) + values[t.y] * bary.x + values[t.z] * bary.y;
}

glm::vec4 sampleAt(const Scene& scene, const Texture& texture, std::uint32_t triangle, glm::vec2 bary, Encoding encoding) {
  const auto& uvs = texture.uvSet == 0 ? scene.uv0 : scene.uv1;
  return sample(scene, texture, interpolated(uvs, scene.triangles[triangle], bary), encoding);
}

glm::vec4 baseColorAt(const Scene& scene, std::uint32_t triangle, glm::vec2 bary) {
  const Material& material = scene.materialOf(triangle);
  glm::vec4 color = material.baseColor;
  if (material.baseColorTexture) color *= sampleAt(scene, material.baseColorTexture, triangle, bary, Encoding::Srgb);
  if (!scene.colors.empty()) color *= interpolated(scene.colors, scene.triangles[triangle], bary);
  return color;
}

/// Twice the area that a triangle covers in a picture [texels].
double twiceTexels(const Scene& scene, const Texture& texture, std::uint32_t triangle) {
  if (!texture) return 0.0;
  const auto& uvs = texture.uvSet == 0 ? scene.uv0 : scene.uv1;
  const auto& image = scene.images[texture.image];
  glm::dvec2 corner[3];
  for (int c = 0; c < 3; ++c) {
    const glm::vec3 uv = texture.transform * glm::vec3(uvs[scene.triangles[triangle][c]], 1.0f);
    corner[c] = glm::dvec2(uv) * glm::dvec2(image.width, image.height);
  }
  const glm::dvec2 a = corner[1] - corner[0], b = corner[2] - corner[0];
  return std::abs(a.x * b.y - a.y * b.x);
}

bool sameColors(const Scene& scene, std::uint32_t triangle) {
  if (scene.colors.empty()) return true;
  const glm::uvec3 t = scene.triangles[triangle];
  return scene.colors[t.x] == scene.colors[t.y] && scene.colors[t.x] == scene.colors[t.z];
}

using Part = std::array<glm::vec2, 3>;  // of a triangle: its corners

/// The mean of f over a part of the triangle by n * n equal parts of that, each at its centroid: halving both ways keeps all parts alike,
/// so the points have equal weights. Through a Mask material's holes nothing is counted.
template <class F>
Rgb meanOver(const Scene& scene, std::uint32_t triangle, const Part& part, int n, F f) {
  const bool holes = scene.materialOf(triangle).alpha == Material::Alpha::Mask;
  const float cutoff = scene.materialOf(triangle).alphaCutoff;
  const glm::vec2 e1 = (part[1] - part[0]) / float(n), e2 = (part[2] - part[0]) / float(n);
  glm::dvec3 sum(0.0);
  std::uint32_t count = 0;
  const auto add = [&](float b1, float b2) {
    const glm::vec2 bary = part[0] + b1 * e1 + b2 * e2;
    if (holes && alphaAt(scene, triangle, bary) < cutoff) return;
    sum += glm::dvec3(f(bary));
    ++count;
  };
  for (int i = 0; i < n; ++i)
    for (int j = 0; i + j < n; ++j) {
      add(float(i) + 1.0f / 3.0f, float(j) + 1.0f / 3.0f);
      if (i + j + 1 < n) add(float(i) + 2.0f / 3.0f, float(j) + 2.0f / 3.0f);
    }
  return count == 0 ? Rgb(0.0f) : Rgb(sum / double(count));
}

int pointsAcross(double twiceTexelArea) {
  // n * n parts of a triangle of `a` texels: one each.
  return std::clamp(int(std::ceil(std::sqrt(std::min(0.5 * twiceTexelArea, 1e6)))), 4, kMaxPointsAcross);
}

Rgb seen(const Scene& scene, const Rgb& c) { return scene.grey ? Rgb(luminance(c)) : c; }

}  // namespace

Rgb reflectanceAt(const Scene& scene, std::uint32_t triangle, glm::vec2 bary) {
  const Material& material = scene.materialOf(triangle);
  float metallic = material.metallic;
  if (material.metallicTexture) metallic *= sampleAt(scene, material.metallicTexture, triangle, bary, Encoding::Linear).b;
  return seen(scene, glm::clamp(Rgb(baseColorAt(scene, triangle, bary)) * (1.0f - metallic), 0.0f, 1.0f));
}

Rgb emissionAt(const Scene& scene, std::uint32_t triangle, glm::vec2 bary) {
  const Material& material = scene.materialOf(triangle);
  if (!material.emissionTexture) return seen(scene, material.emission);
  return seen(scene, material.emission * Rgb(sampleAt(scene, material.emissionTexture, triangle, bary, Encoding::Srgb)));
}

float alphaAt(const Scene& scene, std::uint32_t triangle, glm::vec2 bary) { return baseColorAt(scene, triangle, bary).a; }

Rgb meanReflectance(const Scene& scene, std::uint32_t triangle, const std::array<glm::vec2, 3>& part) {
  const Material& m = scene.materialOf(triangle);
  const bool constant = !m.baseColorTexture && !m.metallicTexture && sameColors(scene, triangle);
  const glm::dvec2 a(part[1] - part[0]), b(part[2] - part[0]);
  const double share = std::abs(a.x * b.y - a.y * b.x);
  const double texels = share * std::max(twiceTexels(scene, m.baseColorTexture, triangle), twiceTexels(scene, m.metallicTexture, triangle));
  return meanOver(scene, triangle, part, constant ? 1 : pointsAcross(texels),
                  [&](glm::vec2 bary) { return reflectanceAt(scene, triangle, bary); });
}

}  // namespace lmc
