#include "lmc/dump.h"

#include <fmt/format.h>

#include <algorithm>
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
    const TexelPatches places(b.scene, b.patches, *b.texels, Run{b.run.threads, b.run.seed, {}, {}});
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

void dumpPatches(OutputSet& set, const Bake& b) {
  writeObj(set.open("patches.obj"), b);
  writePicture(set.open("patches.png"), b);
}

}  // namespace lmc
