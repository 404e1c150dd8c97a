#include "lmc/compare.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "libscene/exr.h"
#include "libscene/float_traps.h"
#include "libscene/image_file.h"

namespace lmc {

namespace {

using Json = nlohmann::ordered_json;

/// Any file as named channels; PNG and JPEG as R G B A in [0, 1].
ExrImage readAny(const std::filesystem::path& file) {
  const std::vector<std::uint8_t> bytes = readFile(file);
  constexpr std::uint8_t kExrMagic[4] = {0x76, 0x2f, 0x31, 0x01};
  if (bytes.size() >= 4 && std::equal(kExrMagic, kExrMagic + 4, bytes.begin())) return readExr(file);
  const Image<glm::u8vec4> picture = pictureOf(file, bytes, LoadLimits{}.maxTexturePixels);
  ExrImage image;
  image.width = picture.width;
  image.height = picture.height;
  const char* names[4] = {"R", "G", "B", "A"};
  for (int c = 0; c < 4; ++c) {
    std::vector<float>& data = image.channels[names[c]];
    for (const glm::u8vec4& p : picture.pixels) data.push_back(float(p[c]) / 255.0f);
  }
  return image;
}

struct Difference {
  double largest = 0.0, mean = 0.0, rms = 0.0, meanA = 0.0;
  std::size_t at = 0;
};

Difference difference(const std::vector<float>& a, const std::vector<float>& b) {
  Difference d;
  for (std::size_t i = 0; i < a.size(); ++i) {
    double x = std::abs(double(a[i]) - double(b[i]));
    if (!std::isfinite(a[i]) || !std::isfinite(b[i])) {
      const bool same = (std::isnan(a[i]) && std::isnan(b[i])) || a[i] == b[i];
      x = same ? 0.0 : std::numeric_limits<double>::infinity();
    }
    if (x > d.largest) {
      d.largest = x;
      d.at = i;
    }
    d.mean += x;
    d.rms += x * x;
    d.meanA += double(a[i]);
  }
  const double n = double(std::max<std::size_t>(1, a.size()));
  d.mean /= n;
  d.rms = std::sqrt(d.rms / n);
  d.meanA /= n;
  return d;
}

}  // namespace

Exit compare(const CompareOptions& options) {
  const ExrImage a = readAny(options.a), b = readAny(options.b);
  Json out;
  double largest = 0.0;
  std::string mismatch;
  if (a.width != b.width || a.height != b.height)
    mismatch = fmt::format("sizes differ: {} x {} and {} x {}", a.width, a.height, b.width, b.height);
  Json channels = Json::array();
  for (const auto& [name, data] : a.channels) {
    const auto other = b.channels.find(name);
    if (other == b.channels.end()) {
      if (mismatch.empty()) mismatch = fmt::format("channel {} is in the first file only", name);
      continue;
    }
    if (data.size() != other->second.size()) continue;
    const Difference d = difference(data, other->second);
    largest = std::max(largest, d.largest);
    channels.push_back({{"channel", name},
                        {"max", d.largest},
                        {"mean", d.mean},
                        {"rms", d.rms},
                        {"mean_of_a", d.meanA},
                        {"x", d.at % std::size_t(a.width)},
                        {"y", d.at / std::size_t(a.width)}});
  }
  for (const auto& [name, data] : b.channels)
    if (!a.channels.contains(name) && mismatch.empty()) mismatch = fmt::format("channel {} is in the second file only", name);
  out["max_diff"] = std::isfinite(largest) ? Json(largest) : Json("inf");
  out["mismatch"] = mismatch;
  out["channels"] = channels;
  if (options.json) {
    fmt::print("{}\n", out.dump(2));
  } else {
    if (!mismatch.empty()) fmt::print("{}\n", mismatch);
    const NoFloatTraps fmtOfNaN;
    fmt::print("{:<12} {:>12} {:>12} {:>12} {:>12}  at\n", "channel", "max", "mean", "rms", "mean of A");
    for (const Json& c : channels)
      fmt::print("{:<12} {:>12.6g} {:>12.6g} {:>12.6g} {:>12.6g}  {},{}\n", c["channel"].get<std::string>(), c["max"].get<double>(),
                 c["mean"].get<double>(), c["rms"].get<double>(), c["mean_of_a"].get<double>(), c["x"].get<std::size_t>(),
                 c["y"].get<std::size_t>());
  }
  if (!mismatch.empty()) return Exit::Differs;
  return options.maxDiff && !(largest <= *options.maxDiff) ? Exit::Differs : Exit::Done;
}

}  // namespace lmc
