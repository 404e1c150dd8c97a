#include "shaders/diagnosis.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "libscene/constants.h"
#include "shaders/oracle.h"
#include "shaders/sampling.h"

namespace lmc::shaders {

namespace {

constexpr double kMostUnexplained = 0.1;  // of the mean difference; the rest is edges and rounding
constexpr double kSamePixel = 1e-3;       // of the largest value: where reference and oracle are farther apart, an edge lies between them

bool isUnit(Target t) { return t == Target::Diffuse || t == Target::Normal || t == Target::ScreenAo || t == Target::Picture; }

/// The largest value of the colour channels and of alpha: alpha is another thing in most targets.
struct Scale {
  double colour = 1.0, alpha = 1.0;
  double of(int channel) const { return channel == 3 ? alpha : colour; }
};

Scale scaleOf(const Image<glm::vec4>& image, Target t) {
  if (isUnit(t)) return {};
  Scale out{0.0, 0.0};
  for (const glm::vec4& p : image.pixels) {
    if (std::isfinite(p.x + p.y + p.z))
      out.colour = std::max({out.colour, double(std::abs(p.x)), double(std::abs(p.y)), double(std::abs(p.z))});
    if (std::isfinite(p.w)) out.alpha = std::max(out.alpha, double(std::abs(p.w)));
  }
  if (out.colour == 0.0) out.colour = 1.0;
  if (out.alpha == 0.0) out.alpha = 1.0;
  return out;
}

/// Of one pixel; what is not finite in one alone differs by all there is.
double distance(const glm::dvec4& a, const glm::dvec4& b, const Scale& scale) {
  double most = 0.0;
  for (int k = 0; k < 4; ++k) {
    if (std::isfinite(a[k]) && std::isfinite(b[k]))
      most = std::max(most, std::abs(a[k] - b[k]) / scale.of(k));
    else if (std::isfinite(a[k]) != std::isfinite(b[k]))
      most = std::max(most, 1.0);
  }
  return most;
}

using Pixels = std::vector<glm::dvec4>;
Pixels pixelsOf(const Image<glm::vec4>& image) { return {image.pixels.begin(), image.pixels.end()}; }

/// The pictures of one target that hypotheses are judged on.
class Judge {
 public:
  Judge(const Image<glm::vec4>& reference, const Image<glm::vec4>& mine, const Image<glm::vec4>& right, Target target)
      : width_(reference.width),
        scale_(scaleOf(reference, target)),
        reference_(pixelsOf(reference)),
        mine_(pixelsOf(mine)),
        right_(pixelsOf(right)) {
    for (std::size_t i = 0; i < mine_.size(); ++i)
      if (distance(reference_[i], right_[i], scale_) <= kSamePixel) inside_.push_back(i);
    difference_ = errorOf([&](std::size_t i) { return reference_[i]; });
    differs_.resize(mine_.size(), 0);
    for (const std::size_t i : inside_) differs_[i] = distance(reference_[i], mine_[i], scale_) > kSamePixel;
  }
  double difference() const { return difference_; }

  /// Sum over pixels of what a guess at them leaves of the difference.
  template <class F>
  double errorOf(const F& guess) const {
    double sum = 0.0;
    for (const std::size_t i : inside_) sum += distance(mine_[i], guess(i), scale_);
    return sum;
  }
  /// A guess at the colour alone; alpha stays that of the reference.
  /// The same of a guess at the colour alone, where the pictures differ: a fault may be made for some pixels and not for others, such as
  /// the background. Alpha stays that of the reference.
  template <class F>
  double errorOfColour(const F& guess) const {
    return errorOf([&](std::size_t i) { return differs_[i] ? glm::dvec4(guess(glm::dvec3(reference_[i])), reference_[i].w) : mine_[i]; });
  }
  /// The oracle's change is put on the reference, so that what the two differ by anyway drops out.
  double errorOfSlip(const Image<glm::vec4>& slipped) const {
    return errorOf([&](std::size_t i) { return reference_[i] + glm::dvec4(slipped.pixels[i]) - right_[i]; });
  }
  double errorUpsideDown() const {
    const std::size_t rows = mine_.size() / std::size_t(width_);
    return errorOf([&](std::size_t i) {
      const std::size_t y = i / std::size_t(width_);
      return reference_[(rows - 1 - y) * std::size_t(width_) + i % std::size_t(width_)];
    });
  }
  /// By least squares, of the colour.
  double factor() const {
    double across = 0.0, along = 0.0;
    for (const std::size_t i : inside_) {
      if (!differs_[i] || !std::isfinite(glm::dot(mine_[i], mine_[i]))) continue;
      across += glm::dot(glm::dvec3(mine_[i]), glm::dvec3(reference_[i]));
      along += glm::dot(glm::dvec3(reference_[i]), glm::dvec3(reference_[i]));
    }
    return along > 0.0 ? across / along : 1.0;
  }

 private:
  int width_;
  Scale scale_;
  Pixels reference_, mine_, right_;
  std::vector<std::size_t> inside_;    ///< pixels that no edge touches
  std::vector<std::uint8_t> differs_;  ///< of all pixels
  double difference_ = 0.0;
};

struct NamedFactor {
  double factor;
  const char *name, *words;
};
constexpr double kFactorTolerance = 0.01;
const NamedFactor kFactors[] = {
    {kPi, "pi", "is pi times too bright: 1/pi is missing (a light map holds E, a surface shows E/pi)"},
    {1.0 / kPi, "pi", "is pi times too dark: divided by pi once too often"},
    {kPi * kPi, "pi", "is pi^2 times too bright: multiplied by pi where it should be divided"},
    {1.0 / (kPi * kPi), "pi", "is pi^2 times too dark: divided by pi twice too often"},
    {2.0, "factor-2", "is twice too bright"},
    {0.5, "factor-2", "is half as bright as it should be"},
    {4.0 * kPi, "4pi", "is 4 pi times too bright: candela taken for lumen"},
    {1.0 / (4.0 * kPi), "4pi", "is 4 pi times too dark: candela divided by 4 pi as lumen are"},
    {0.0, "nothing-drawn", "is black: nothing is drawn"},
    {-1.0, "negated", "has the opposite sign"},
};

const NamedFactor* nameOf(double factor) {
  for (const NamedFactor& f : kFactors)
    if (std::abs(factor - f.factor) <= kFactorTolerance * std::max(0.1, std::abs(f.factor))) return &f;
  return nullptr;
}

struct Curve {
  const char *name, *words;
  double (*map)(double);
};
double decodedSrgb(double v) { return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4); }
const Curve kCurves[] = {
    {"gamma", "is gamma-encoded once too often (power 1/2.2)", [](double v) { return std::pow(std::max(v, 0.0), 1.0 / 2.2); }},
    {"gamma", "lacks the gamma encoding (power 2.2)", [](double v) { return std::pow(std::max(v, 0.0), 2.2); }},
    {"gamma", "is sRGB-encoded once too often", [](double v) { return v <= 0.0 ? v : encodedSrgb(v); }},
    {"gamma", "lacks the sRGB encoding", [](double v) { return decodedSrgb(v); }},
    {"gamma", "is decoded (power 2.2) where it should be encoded", [](double v) { return std::pow(decodedSrgb(std::max(v, 0.0)), 2.2); }},
    {"gamma-curve", "is encoded by power 1/2.2 in place of the sRGB curve",
     [](double v) { return std::pow(decodedSrgb(std::max(v, 0.0)), 1.0 / 2.2); }},
};

struct Swap {
  const char *name, *words;
  glm::ivec3 from;
};
const Swap kSwaps[] = {
    {"swapped-red-blue", "has red and blue swapped", {2, 1, 0}},
    {"swapped-red-green", "has red and green swapped", {1, 0, 2}},
    {"swapped-green-blue", "has green and blue swapped", {0, 2, 1}},
    {"rotated-channels", "has green, blue, red for red, green, blue", {1, 2, 0}},
    {"rotated-channels", "has blue, red, green for red, green, blue", {2, 0, 1}},
};

/// Passes without formulas that a slip could be made in have none.
std::optional<SlipPlace> placeOf(Pass pass) {
  switch (pass) {
    case Pass::GBuffers:
    case Pass::GBuffersBump:
      return SlipPlace::GBuffer;
    case Pass::Directional:
    case Pass::Point:
    case Pass::Spot:
      return SlipPlace::Light;
    case Pass::Composite:
      return SlipPlace::Composite;
    case Pass::ToneMap:
      return SlipPlace::ToneMap;
    default:
      return std::nullopt;
  }
}

/// Keeps the guess that leaves least; an earlier one stays where a later one is no better.
class Best {
 public:
  explicit Best(double difference) : difference_(difference) {}
  void offer(double error, const std::function<Finding(double)>& finding) {
    const double unexplained = error / difference_;
    const bool better = !found_ || std::max(unexplained, kRounding) < kClearlyLess * std::max(found_->unexplained, kRounding);
    if (!(unexplained < kMostUnexplained) || !better) return;
    found_ = finding(unexplained);
  }
  const std::optional<Finding>& found() const { return found_; }

 private:
  static constexpr double kClearlyLess = 0.7;
  static constexpr double kRounding = 1e-3;  // float against double, with some room: what is below is explained
  double difference_;
  std::optional<Finding> found_;
};

void offerPictures(Best& best, const Judge& judge, std::string_view target) {
  const auto finding = [&](const char* name, std::string_view words, double left) {
    return Finding{name, fmt::format("{} {}", target, words), left};
  };
  for (const Swap& s : kSwaps)
    best.offer(judge.errorOfColour([&](const glm::dvec3& c) { return glm::dvec3(c[s.from.x], c[s.from.y], c[s.from.z]); }),
               [&](double left) { return finding(s.name, s.words, left); });
  for (const Curve& c : kCurves)
    best.offer(judge.errorOfColour([&](const glm::dvec3& p) { return glm::dvec3(c.map(p.x), c.map(p.y), c.map(p.z)); }),
               [&](double left) { return finding(c.name, c.words, left); });
  best.offer(judge.errorUpsideDown(), [&](double left) { return finding("upside-down", "is upside down", left); });
  const double k = judge.factor();
  best.offer(judge.errorOfColour([&](const glm::dvec3& c) { return k * c; }), [&](double left) {
    const NamedFactor* named = nameOf(k);
    return named ? finding(named->name, named->words, left) : finding("factor", fmt::format("is {:.4g} times what it should be", k), left);
  });
}

}  // namespace

Difference differenceOf(const Frame& reference, const Frame& mine, Target t) {
  Difference out{t};
  const Scale scale = scaleOf(reference[t], t);
  const std::vector<glm::vec4>&a = reference[t].pixels, &b = mine[t].pixels;
  std::size_t at = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double d = distance(glm::dvec4(a[i]), glm::dvec4(b[i]), scale);
    out.mean += d / double(a.size());
    if (d > out.largest) out.largest = d, at = i;
  }
  out.x = int(at % std::size_t(reference.width));
  out.y = int(at / std::size_t(reference.width));
  return out;
}

std::optional<Finding> diagnose(const Comparison& c, const PassRow& pass, const Run& run) {
  const Frame right = renderOracle(c.level, c.maps, c.view, run);
  std::optional<Judge> judge;
  Target target = pass.targets.front();
  for (const Target t : pass.targets) {
    Judge candidate(c.reference[t], c.mine[t], right[t], t);
    if (judge && candidate.difference() <= judge->difference()) continue;
    judge.emplace(std::move(candidate));
    target = t;
  }
  if (!(judge->difference() > 0.0)) return std::nullopt;
  Best best(judge->difference());
  for (const SlipRow& row : kSlips) {
    if (row.place != placeOf(pass.pass)) continue;
    const Frame slipped = renderOracle(c.level, c.maps, c.view, run, row.slip);
    best.offer(judge->errorOfSlip(slipped[target]), [&](double left) {
      return Finding{std::string(row.name), std::string(row.words), left};
    });
  }
  offerPictures(best, *judge, kTargetNames[std::size_t(target)]);
  return best.found();
}

}  // namespace lmc::shaders
