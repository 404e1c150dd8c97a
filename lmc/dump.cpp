#include "lmc/dump.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include "libradiosity/slopes.h"
#include "libscene/image_file.h"
#include "libscene/rng.h"

namespace lmc {

namespace {

/// Neighbours in number get unlike hues.
glm::u8vec4 colourOf(std::uint32_t patch, double brightness) {
  const double hue = 6.0 * double(combine(patch, 0) >> 11) * 0x1p-53;
  const auto channel = [&](double at) {
    const double away = std::abs(std::remainder(hue - at, 6.0));  // 0 at the channel's own hue, 3 opposite
    return std::uint8_t(std::lround(255.0 * brightness * (0.3 + 0.7 * std::clamp(2.0 - away, 0.0, 1.0))));
  };
  return {channel(0.0), channel(2.0), channel(4.0), 255};
}

void writeObj(OutputFile& file, const Bake& b) {
  std::string text = "# Faces of radiosity patches in metres; a group is a patch, its name ends in how often the patch size was halved.\n";
  std::size_t vertices = 0;
  for (std::size_t i = 0; i < b.patches.patches.size(); ++i) {
    const Patch& patch = b.patches.patches[i];
    if (patch.back) continue;  // the faces of the patch before it
    fmt::format_to(std::back_inserter(text), "g patch_{}_level_{}\n", i, patch.level);
    for (std::uint32_t k = 0; k < patch.leafCount; ++k) {
      const Leaf& leaf = b.patches.leaves[patch.firstLeaf + k];
      const auto c = b.scene.corners_m(leaf.triangle);
      for (const glm::vec2& w : leaf.bary) {
        const glm::dvec3 p = b.scene.centre_m + c[0] + double(w.x) * (c[1] - c[0]) + double(w.y) * (c[2] - c[0]);
        fmt::format_to(std::back_inserter(text), "v {:.9g} {:.9g} {:.9g}\n", p.x, p.y, p.z);
      }
      fmt::format_to(std::back_inserter(text), "f {} {} {}\n", vertices + 1, vertices + 2, vertices + 3);
      vertices += 3;
    }
    if (text.size() > std::size_t(1) << 20) {
      file.write(text);
      text.clear();
    }
  }
  file.write(text);
}

void writePicture(OutputFile& file, const Bake& b) {
  std::uint8_t finest = 0;
  for (const Patch& p : b.patches.patches) finest = std::max(finest, p.level);
  Image<glm::u8vec4> picture(b.map.width, b.map.height, glm::u8vec4(0, 0, 0, 255));
  if (!b.patches.nodes.empty()) {
    const TexelPatches places(b.scene, b.patches, *b.texels, b.run.silent());
    for (int y = 0; y < picture.height; ++y)
      for (int x = 0; x < picture.width; ++x) {
        const std::uint32_t patch = places.patch[std::size_t(y) * std::size_t(picture.width) + std::size_t(x)];
        if (patch != kNone) picture.at(x, y) = colourOf(patch, std::pow(0.7, finest - b.patches.patches[patch].level));
      }
  }
  const std::vector<std::uint8_t> png = encodePng(picture, false);
  file.write(png.data(), png.size());
}

}  // namespace

namespace {

/// Blue, green, yellow, red at 0, 1, 3 and 10 %.
glm::u8vec4 colourOfJump(double share) {
  constexpr std::array<double, 4> kAt{0.0, 0.01, 0.03, 0.1};
  constexpr std::array<glm::dvec3, 4> kColour{{{40, 80, 255}, {40, 220, 60}, {255, 230, 40}, {255, 30, 30}}};
  std::size_t k = 0;
  while (k < 2 && share > kAt[k + 1]) ++k;
  const glm::dvec3 c = glm::mix(kColour[k], kColour[k + 1], std::clamp((share - kAt[k]) / (kAt[k + 1] - kAt[k]), 0.0, 1.0));
  return {std::uint8_t(c.x), std::uint8_t(c.y), std::uint8_t(c.z), 255};
}

}  // namespace

void dumpSeams(OutputSet& set, const Bake& b) {
  constexpr int kBetween = 8;  // pixels between the two maps
  Image<glm::u8vec4> picture(2 * b.map.width + kBetween, b.map.height, glm::u8vec4(0, 0, 0, 255));
  std::vector<std::array<float, 2>> jump(b.map.size(), {-1.0f, -1.0f});
  for (const SeamSample& s : b.closed.samples)
    for (const std::uint32_t texel : s.texel) jump[texel] = {std::max(jump[texel][0], s.before), std::max(jump[texel][1], s.after)};
  for (int y = 0; y < b.map.height; ++y)
    for (int x = 0; x < b.map.width; ++x) {
      const std::size_t i = std::size_t(y) * std::size_t(b.map.width) + std::size_t(x);
      const Rgb e = b.values.direct[i] + b.values.indirect[i];
      // Half of white at three times the level's mean, so that colours stand out.
      const double grey =
          b.map.chart[i] == kNone ? 0.0 : 128.0 * std::min(1.0, double(e.r + e.g + e.b) / 9.0 / std::max(1e-30, b.ledger.mean));
      for (int side = 0; side < 2; ++side)
        picture.at(x + side * (b.map.width + kBetween), y) =
            jump[i][0] < 0.0f ? glm::u8vec4(glm::u8vec3(std::uint8_t(grey)), 255) : colourOfJump(double(jump[i][std::size_t(side)]));
    }
  const std::vector<std::uint8_t> png = encodePng(picture, false);
  set.open("seams.png").write(png.data(), png.size());
}

void dumpPatches(OutputSet& set, const Bake& b) {
  writeObj(set.open("patches.obj"), b);
  writePicture(set.open("patches.png"), b);
}

}  // namespace lmc
