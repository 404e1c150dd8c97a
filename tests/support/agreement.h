#pragma once
/// How two renderings of a level agree, pixel by pixel.
#include <algorithm>
#include <cmath>
#include <string>

#include <fmt/format.h>

#include "libscene/parallel.h"
#include "shaders/oracle.h"

namespace lmc::test {

struct Agreement {
  std::size_t pixels = 0, apart = 0, insideFaces = 0;  ///< apart: by more than the tolerance; of them those with no edge beside them
  double largestInside = 0.0;                          ///< of pixels with no edge beside them
  int x = 0, y = 0;                                    ///< the first pixel that is apart inside a face
  double share() const { return 1.0 - double(apart) / double(std::max<std::size_t>(1, pixels)); }
  std::string text() const {
    return fmt::format("{} of {} pixels apart ({:.4f} % agree), {} of them inside a face (first at {},{}), largest there {:.5f}", apart,
                       pixels, 100.0 * share(), insideFaces, x, y, largestInside);
  }
};

/// Whether the pixel and its eight neighbours see one triangle.
inline bool isInside(const Image<std::uint32_t>& triangles, int x, int y) {
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) {
      const int px = x + dx, py = y + dy;
      if (px < 0 || py < 0 || px >= triangles.width || py >= triangles.height || triangles.at(px, py) != triangles.at(x, y)) return false;
    }
  return true;
}

inline Agreement agreement(const Image<glm::vec4>& a, const Image<glm::vec4>& b, const Image<std::uint32_t>& triangles, double tolerance) {
  Agreement out;
  out.pixels = a.pixels.size();
  for (int y = 0; y < a.height; ++y)
    for (int x = 0; x < a.width; ++x) {
      const glm::vec3 d = glm::abs(glm::vec3(a.at(x, y)) - glm::vec3(b.at(x, y)));
      const double difference = double(std::max({d.x, d.y, d.z}));
      const bool inside = isInside(triangles, x, y);
      if (inside) out.largestInside = std::max(out.largestInside, difference);
      if (difference <= tolerance) continue;
      ++out.apart;
      if (!inside) continue;
      if (out.insideFaces == 0) out.x = x, out.y = y;
      ++out.insideFaces;
    }
  return out;
}

}  // namespace lmc::test
