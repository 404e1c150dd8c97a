#include "lmc/normal_map.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <stdexcept>

#include "libscene/parallel.h"
#include "libscene/texels.h"
#include "lmc/tangent_loop.h"

namespace lmc {

namespace {

int wrapped(int i, int n) { return ((i % n) + n) % n; }

/// Places of a triangle's corners in the map, and which texels may have their middle in it.
struct Footprint {
  glm::dvec2 a, b, c;
  double twiceArea;

  Footprint(std::span<const glm::vec2> place, const glm::uvec3& t, int width, int height) {
    const glm::dvec2 size(width, height);
    a = glm::dvec2(place[t.x]) * size, b = glm::dvec2(place[t.y]) * size, c = glm::dvec2(place[t.z]) * size;
    twiceArea = cross(b - a, c - a);
  }
  static double cross(glm::dvec2 p, glm::dvec2 q) { return p.x * q.y - p.y * q.x; }
  /// Weights of the second and third corner; nothing outside.
  bool weights(glm::dvec2 at, glm::dvec2& out) const {
    out = {cross(at - a, c - a) / twiceArea, cross(b - a, at - a) / twiceArea};
    return out.x >= 0.0 && out.y >= 0.0 && out.x + out.y <= 1.0;
  }
};

/// The tangents of the whole scene, three a triangle.
tangent::Tangents tangentsOf(const Scene& s, const Run& run) {
  static_assert(sizeof(glm::uvec3) == 3 * sizeof(std::uint32_t));
  return tangentsOf({s.positions_m, s.normals, s.uv0, {&s.triangles.data()->x, 3 * s.triangles.size()}, {}}, run);
}

TexelFrame frameAt(const Scene& s, const tangent::Tangents& tangents, std::uint32_t triangle, glm::dvec2 w) {
  const glm::uvec3 t = s.triangles[triangle];
  const glm::vec3 weight(float(1.0 - w.x - w.y), float(w.x), float(w.y));
  TexelFrame out;
  out.position_m = surfacePoint(s, triangle, w).position_m;
  for (int k = 0; k < 3; ++k) {
    out.normal += weight[k] * s.normals[t[k]];
    out.tangent += weight[k] * tangents.corners[3 * std::size_t(triangle) + std::size_t(k)].tangent;
  }
  out.determinant = tangents.corners[3 * std::size_t(triangle)].determinant;
  return out;
}

/// One texel further out.
void grow(Image<TexelFrame>& frames) {
  const Image<TexelFrame> old = frames;
  for (int y = 0; y < frames.height; ++y)
    for (int x = 0; x < frames.width; ++x) {
      if (old.at(x, y).covered()) continue;
      for (const auto& [dx, dy] : {std::pair(-1, 0), {1, 0}, {0, -1}, {0, 1}}) {
        const TexelFrame& beside = old.at(wrapped(x + dx, old.width), wrapped(y + dy, old.height));
        if (!beside.covered()) continue;
        frames.at(x, y) = beside;
        break;
      }
    }
}

glm::vec3 withLength(glm::vec3 v, float length) {
  const float own = glm::length(v);
  return own > 0.0f && std::isfinite(own) ? v * (length / own) : glm::vec3(0.0f, 0.0f, 1.0f);
}

template <class Turn>
Image<glm::vec3> turned(const Image<TexelFrame>& frames, const Image<glm::vec3>& normals, const Turn& turn) {
  Image<glm::vec3> out(normals.width, normals.height, glm::vec3(0.0f, 0.0f, 1.0f));
  for (std::size_t i = 0; i < out.pixels.size(); ++i) {
    if (!frames.pixels[i].covered()) continue;
    const float length = glm::length(normals.pixels[i]);
    if (length > 0.0f) out.pixels[i] = withLength(turn(frames.pixels[i].matrix(), normals.pixels[i]), length);
  }
  return out;
}

template <class Pixel, int kMost>
Image<Pixel> pictureOf(const Image<glm::vec3>& normals, bool greenDown) {
  Image<Pixel> out(normals.width, normals.height);
  for (std::size_t i = 0; i < out.pixels.size(); ++i) {
    glm::vec3 n = normals.pixels[i];
    if (greenDown) n.y = -n.y;
    const glm::vec3 value = glm::clamp(n * 0.5f + 0.5f, 0.0f, 1.0f) * float(kMost) + 0.5f;
    out.pixels[i] = Pixel(glm::uvec4(glm::uvec3(value), unsigned(kMost)));
  }
  return out;
}

}  // namespace

Image<TexelFrame> texelFrames(const Scene& s, std::span<const glm::vec2> place, int width, int height, int gutter, const Run& run) {
  const tangent::Tangents tangents = tangentsOf(s, run);
  Image<TexelFrame> out(width, height);
  for (std::uint32_t t = 0; t < s.triangles.size(); ++t) {
    const Footprint f(place, s.triangles[t], width, height);
    if (f.twiceArea == 0.0 || !std::isfinite(f.twiceArea)) continue;
    const glm::dvec2 low = glm::min(glm::min(f.a, f.b), f.c), high = glm::max(glm::max(f.a, f.b), f.c);
    if (high.x - low.x > 64.0 * width || high.y - low.y > 64.0 * height)
      continue;  // repeats so often that the texels of one pass are all taken
    for (int y = int(std::floor(low.y)); y <= int(std::floor(high.y)); ++y)
      for (int x = int(std::floor(low.x)); x <= int(std::floor(high.x)); ++x) {
        TexelFrame& texel = out.at(wrapped(x, width), wrapped(y, height));
        glm::dvec2 w;
        if (!texel.covered() && f.weights({x + 0.5, y + 0.5}, w)) texel = frameAt(s, tangents, t, w);
      }
  }
  for (int i = 0; i < gutter; ++i) grow(out);
  return out;
}

Image<glm::vec3> toTangentSpace(const Image<TexelFrame>& frames, const Image<glm::vec3>& object) {
  return turned(frames, object, [](const glm::mat3& m, glm::vec3 n) {
    const float volume = glm::determinant(m);
    return volume != 0.0f ? glm::inverse(m) * n : glm::vec3(0.0f, 0.0f, 1.0f);
  });
}

Image<glm::vec3> toObjectSpace(const Image<TexelFrame>& frames, const Image<glm::vec3>& tangent) {
  return turned(frames, tangent, [](const glm::mat3& m, glm::vec3 n) { return m * n; });
}

Image<glm::vec3> normalsOfHeight(const Image<float>& height, const HeightOptions& options) {
  Image<glm::vec3> out(height.width, height.height);
  const float across[3][2] = {{0.0f, 1.0f}, {0.25f, 0.5f}, {3.0f / 16, 10.0f / 16}};  // weights beside and on the line
  const float side = across[int(options.filter)][0], middle = across[int(options.filter)][1];
  const auto at = [&](int x, int y) {
    if (options.repeat) return height.at(wrapped(x, height.width), wrapped(y, height.height));
    return height.at(std::clamp(x, 0, height.width - 1), std::clamp(y, 0, height.height - 1));
  };
  // Heights are in widths, and so are texels: 1/width each.
  const float slope = options.scale * float(height.width);
  for (int y = 0; y < height.height; ++y)
    for (int x = 0; x < height.width; ++x) {
      // Half of a difference over two texels; at a border that does not repeat there is only one.
      const float stepX = !options.repeat && (x == 0 || x == height.width - 1) ? 1.0f : 0.5f;
      const float stepY = !options.repeat && (y == 0 || y == height.height - 1) ? 1.0f : 0.5f;
      const auto alongX = [&](int dy) { return at(x + 1, y + dy) - at(x - 1, y + dy); };
      const auto alongY = [&](int dx) { return at(x + dx, y + 1) - at(x + dx, y - 1); };
      const float du = stepX * slope * (side * (alongX(-1) + alongX(1)) + middle * alongX(0));
      const float dv = stepY * slope * (side * (alongY(-1) + alongY(1)) + middle * alongY(0));
      out.at(x, y) = glm::normalize(glm::vec3(-du, dv, 1.0f));
    }
  return out;
}

Image<float> luminanceOf(const Image<glm::u16vec4>& picture) {
  const auto linear = [](float s) { return s <= 0.04045f ? s / 12.92f : std::pow((s + 0.055f) / 1.055f, 2.4f); };
  Image<float> out(picture.width, picture.height);
  for (std::size_t i = 0; i < out.pixels.size(); ++i) {
    const glm::vec3 c = glm::vec3(picture.pixels[i]) / 65535.0f;
    out.pixels[i] = 0.2126f * linear(c.r) + 0.7152f * linear(c.g) + 0.0722f * linear(c.b);
  }
  return out;
}

ModelNormals normalsOfModel(const Image<TexelFrame>& frames, const glm::dvec3& lowCentre_m, const Scene& high, const Tracer& tracer,
                            double cage_m, const Run& run) {
  ModelNormals out;
  out.normals = Image<glm::vec3>(frames.width, frames.height, glm::vec3(0.0f, 0.0f, 1.0f));
  const glm::dvec3 shift_m = lowCentre_m - high.centre_m;
  std::vector<std::pair<std::size_t, std::size_t>> rows(std::size_t(frames.height));  // rays, misses
  parallelFor(run, std::size_t(frames.height), 1, [&](std::size_t y) {
    for (int x = 0; x < frames.width; ++x) {
      const TexelFrame& f = frames.at(x, int(y));
      if (!f.covered()) continue;
      const glm::dvec3 n = glm::normalize(glm::dvec3(f.normal));
      ++rows[y].first;
      const Ray ray{glm::vec3(f.position_m + shift_m + cage_m * n), glm::vec3(-n), float(2.0 * cage_m)};
      const Hit hit = tracer.closest(ray, Purpose::Camera);
      rows[y].second += !hit;
      const glm::dvec3 normal = hit ? surfacePoint(high, hit.triangle, glm::dvec2(hit.bary)).normal : n;
      // A sheet may be met from behind: what is seen is its other side.
      out.normals.at(x, int(y)) = glm::vec3(glm::dot(normal, n) < 0.0 && hit && !hit.front ? -normal : normal);
    }
  });
  for (const auto& [rays, misses] : rows) out.rays += rays, out.misses += misses;
  return out;
}

Image<glm::vec3> normalsOfPicture(const Image<glm::u16vec4>& picture, bool greenDown) {
  Image<glm::vec3> out(picture.width, picture.height);
  for (std::size_t i = 0; i < out.pixels.size(); ++i) {
    glm::vec3 n = glm::vec3(picture.pixels[i]) * (2.0f / 65535.0f) - 1.0f;
    if (greenDown) n.y = -n.y;
    out.pixels[i] = n;
  }
  return out;
}

Image<glm::u8vec4> pictureOfNormals8(const Image<glm::vec3>& normals, bool greenDown) {
  return pictureOf<glm::u8vec4, 255>(normals, greenDown);
}
Image<glm::u16vec4> pictureOfNormals16(const Image<glm::vec3>& normals, bool greenDown) {
  return pictureOf<glm::u16vec4, 65535>(normals, greenDown);
}

}  // namespace lmc
