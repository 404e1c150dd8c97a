#include "lmc/shade_picture.h"

#include <algorithm>
#include <cmath>

#include "libscene/constants.h"
#include "libscene/exr.h"
#include "libscene/image_file.h"
#include "shaders/sampling.h"

namespace lmc {

namespace {

using shaders::Frame;
using shaders::Target;

constexpr float kMostHalf = 65504.0f;
constexpr double kMostPower = 256.0;  // of specular lobes, as the shaders clamp it

/// Light, which is exposed; E as a white surface shows it.
bool isLight(Target t) { return t == Target::Baked || t == Target::Emission || t >= Target::AmbientLight; }

Image<glm::vec4> lightOf(const Frame& frame, Target t) {
  Image<glm::vec4> out = frame[t];
  if (t == Target::Baked)
    for (glm::vec4& p : out.pixels) p *= float(1.0 / kPi);
  return out;
}

}  // namespace

Looked lookedAt(const std::string& view) {
  if (view == "ao") return {Target::Diffuse, true};
  if (view == "power") return {Target::Specular, true};
  const auto name = std::ranges::find(shaders::kTargetNames, view);
  return {Target(name - shaders::kTargetNames.begin())};
}

Image<glm::vec4> rawPicture(const Frame& frame, const Looked& looked, double exposure) {
  Image<glm::vec4> out = isLight(looked.target) ? lightOf(frame, looked.target) : frame[looked.target];
  for (glm::vec4& p : out.pixels) {
    if (looked.alpha)
      p = glm::vec4(p.w);
    else if (looked.target == Target::Depth || looked.target == Target::ScreenAo)
      p = glm::vec4(p.x);
    else if (isLight(looked.target))
      p *= float(exposure);
  }
  return out;
}

Image<glm::vec4> shownPicture(const Frame& frame, const Looked& looked, double wish) {
  const double exposure = !isLight(looked.target) ? 1.0 : wish > 0.0 ? wish : shaders::exposureFor(lightOf(frame, looked.target));
  Image<glm::vec4> out = rawPicture(frame, looked, exposure);
  float nearest = kMostHalf, farthest = 0.0f;
  for (const glm::vec4& p : frame[Target::Depth].pixels)
    if (p.x > 0.0f) nearest = std::min(nearest, p.x), farthest = std::max(farthest, p.x);
  for (glm::vec4& p : out.pixels)
    for (int k = 0; k < 3; ++k) {
      if (looked.target == Target::Depth)
        p[k] = p[k] > 0.0f ? 1.0f - 0.9f * (p[k] - nearest) / std::max(farthest - nearest, 1e-6f) : 0.0f;
      else if (looked.target == Target::Specular && looked.alpha)
        p[k] /= float(kMostPower);
      else if (!looked.alpha && looked.target != Target::Normal && looked.target != Target::ScreenAo)
        p[k] = float(shaders::encodedSrgb(std::clamp(double(p[k]), 0.0, 1.0)));
    }
  return out;
}

Image<glm::u8vec4> quantised(const Image<glm::vec4>& image) {
  Image<glm::u8vec4> out(image.width, image.height);
  for (std::size_t i = 0; i < out.pixels.size(); ++i)
    for (int k = 0; k < 4; ++k) {
      const float v = image.pixels[i][k];
      out.pixels[i][k] = std::isfinite(v) ? std::uint8_t(std::lround(255.0f * std::clamp(v, 0.0f, 1.0f))) : std::uint8_t(255);
    }
  return out;
}

void writePng(const std::filesystem::path& file, const Image<glm::u8vec4>& image) {
  const std::vector<std::uint8_t> png = encodePng(image, false);
  writeFileWhole(file, {reinterpret_cast<const char*>(png.data()), png.size()});
}

void writeLinear(const std::filesystem::path& file, Image<glm::vec4> image) {
  for (glm::vec4& p : image.pixels)
    for (int k = 0; k < 4; ++k) p[k] = std::isfinite(p[k]) ? std::clamp(p[k], -kMostHalf, kMostHalf) : kMostHalf;
  const std::filesystem::path folder = file.parent_path();
  OutputSet set(folder.empty() ? "." : folder);
  const float* data = &image.pixels[0].x;
  writeExr(set.open(file.filename()), image.width, image.height, {{"R", data, 4}, {"G", data + 1, 4}, {"B", data + 2, 4}});
  set.commit();
}

}  // namespace lmc
