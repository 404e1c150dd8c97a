#include "shaders/sampling.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace lmc::shaders {

namespace {

const std::array<double, 256>& srgbTable() {
  static const std::array<double, 256> kTable = [] {
    std::array<double, 256> table{};
    for (int i = 0; i < 256; ++i) {
      const double v = i / 255.0;
      table[std::size_t(i)] = v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
    }
    return table;
  }();
  return kTable;
}

int wrapped(double texel, int size, Wrap wrap) {
  if (wrap == Wrap::Clamp) return int(std::clamp(texel, 0.0, size - 1.0));
  const double period = wrap == Wrap::Mirror ? 2.0 * size : double(size);
  const double inPeriod = texel - period * std::floor(texel / period);
  const int i = std::min(int(inPeriod), int(period) - 1);
  return i < size ? i : 2 * size - 1 - i;
}

/// texel(x, y) for the four texels about a place given in texels.
template <class F>
auto bilinear(const glm::dvec2& place, const F& texel) {
  const glm::dvec2 p = place - 0.5, corner = glm::floor(p), w = p - corner;
  return (1.0 - w.y) * ((1.0 - w.x) * texel(corner.x, corner.y) + w.x * texel(corner.x + 1.0, corner.y)) +
         w.y * ((1.0 - w.x) * texel(corner.x, corner.y + 1.0) + w.x * texel(corner.x + 1.0, corner.y + 1.0));
}

}  // namespace

glm::dvec4 linearOfSrgb(glm::u8vec4 stored) {
  const auto& table = srgbTable();
  return {table[stored.r], table[stored.g], table[stored.b], stored.a / 255.0};
}

double encodedSrgb(double linear) { return linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1.0 / 2.4) - 0.055; }

glm::dvec4 sample(const Scene& scene, const Texture& texture, const glm::dvec2& uv, Encoding encoding) {
  if (!texture) return glm::dvec4(1.0);
  const Image<glm::u8vec4>& image = scene.images[texture.image];
  const glm::dvec2 moved(glm::dmat3(texture.transform) * glm::dvec3(uv, 1.0));
  if (!std::isfinite(moved.x) || !std::isfinite(moved.y)) return glm::dvec4(1.0);
  return bilinear(moved * glm::dvec2(image.width, image.height), [&](double x, double y) {
    const glm::u8vec4 stored = image.at(wrapped(x, image.width, texture.wrapU), wrapped(y, image.height, texture.wrapV));
    return encoding == Encoding::Srgb ? linearOfSrgb(stored) : glm::dvec4(stored) / 255.0;
  });
}

glm::dvec3 sample(const Image<Rgb>& map, const glm::dvec2& uv) {
  return bilinear(uv * glm::dvec2(map.width, map.height), [&](double x, double y) {
    return glm::dvec3(map.at(wrapped(x, map.width, Wrap::Clamp), wrapped(y, map.height, Wrap::Clamp)));
  });
}

double sample(const Image<float>& map, const glm::dvec2& uv) {
  return bilinear(uv * glm::dvec2(map.width, map.height), [&](double x, double y) {
    return double(map.at(wrapped(x, map.width, Wrap::Clamp), wrapped(y, map.height, Wrap::Clamp)));
  });
}

}  // namespace lmc::shaders
