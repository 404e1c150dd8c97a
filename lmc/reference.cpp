#include "lmc/reference.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "libradiosity/path_tracer.h"
#include "libscene/constants.h"
#include "libscene/exr.h"
#include "libscene/parallel.h"
#include "lmc/bake.h"
#include "lmc/stages.h"

namespace lmc {

namespace {

using Json = nlohmann::ordered_json;

constexpr std::uint32_t kStreams = 8;                         // independent: their differences are the noise
constexpr std::uint32_t kPilotPaths = 64, kFirstPaths = 128;  // each stream
constexpr double kEven = 0.5;                                 // share of the mean variance in what a texel's own is taken for
constexpr int kReach = 2;                                     // texels: as far from a chart's end as lookups along it read
constexpr std::uint32_t kMostPaths = 1u << 28;

double mean3(const glm::dvec3& v) { return (v.x + v.y + v.z) / 3.0; }

struct Place {
  std::size_t texel = 0;
  double share = 1.0;       // of the paths, against the mean
  std::uint32_t paths = 0;  // each stream
  std::array<glm::dvec3, kStreams> sums{};
  glm::dvec3 mean() const {
    glm::dvec3 all(0.0);
    for (const glm::dvec3& s : sums) all += s;
    return all / (double(kStreams) * double(paths));
  }
  /// Variance of the mean.
  glm::dvec3 variance() const {
    const glm::dvec3 m = mean();
    glm::dvec3 squares(0.0);
    for (const glm::dvec3& s : sums) squares += (s / double(paths) - m) * (s / double(paths) - m);
    return squares / double(kStreams * (kStreams - 1));
  }
};

/// A level ready for paths, without any light map.
class ReferenceMaker {
 public:
  ReferenceMaker(const BakeOptions& options, const std::filesystem::path& folder, const ReferenceWish& wish)
      : b_(options, stoppableRun(options.threads)), folder_(folder), wish_(wish) {
    b_.run.seed = options.seed;
  }

  Exit make() {
    load(b_);
    plan(b_);
    if (wish_.openness) {
      // E of a sky of radiance 1/pi alone is the share of it that is seen.
      b_.scene.lights.clear();
      for (Material& m : b_.scene.materials) m.emission = Rgb(0.0f);
      b_.scene.sky = Rgb(float(1.0 / kPi));
    }
    charts(b_);
    b_.tracer = std::make_unique<Tracer>(b_.scene);
    PathOptions paths = pathsFor(b_);
    if (wish_.openness) paths.bounces = 0;
    const PathTracer tracing(b_.scene, *b_.tracer, paths);
    if (!resume()) begin(tracing);
    while (!enough()) {
      round(tracing);
      keep();
    }
    write();
    return Exit::Done;
  }

 private:
  bool drawable(std::size_t i) const {
    const LightMap& map = b_.map;
    if (map.chart[i] == kNone) return false;
    if (!b_.plan.runs(Effect::Seams)) return true;
    const int side = b_.uv.side, x = int(i % std::size_t(side)), y = int(i / std::size_t(side));
    for (int dy = -kReach; dy <= kReach; ++dy)
      for (int dx = -kReach; dx <= kReach; ++dx) {
        const int px = x + dx, py = y + dy;
        if (px < 0 || px >= side || py / side != y / side || py < 0 || py >= map.height) return false;
        if (map.chart[std::size_t(py) * std::size_t(side) + std::size_t(px)] != map.chart[i]) return false;
      }
    return true;
  }

  /// Even draws over the texels in their order, and how much each varies.
  void begin(const PathTracer& tracing) {
    std::vector<std::size_t> from;
    for (std::size_t i = 0; i < b_.map.size(); ++i)
      if (drawable(i)) from.push_back(i);
    const std::size_t n = std::min<std::size_t>(wish_.texels, from.size());
    for (std::size_t k = 0; k < n; ++k) {
      const double u = double(combine(combine(b_.run.seed, std::uint64_t(Draw::AuditChoice)), 1000 + k) >> 11) * 0x1p-53;
      places_.push_back({from[std::min(from.size() - 1, std::size_t((double(k) + u) * double(from.size()) / double(n)))]});
    }
    cast(tracing, 1, [](const Place&) { return kPilotPaths; });
    // The fewest paths for a given sum of variances: in proportion to each texel's deviation. These paths only say how many there are to
    // be.
    double mean = 0.0;
    for (const Place& p : places_) mean += mean3(p.variance()) / double(n);
    double sum = 0.0;
    for (Place& p : places_) {
      p.share = std::sqrt(kEven * mean + (1.0 - kEven) * mean3(p.variance()));
      sum += p.share / double(n);
    }
    for (Place& p : places_) p = {p.texel, sum > 0.0 ? p.share / sum : 1.0};
    paths_ = 0;
  }

  template <class F>
  void cast(const PathTracer& tracing, std::uint64_t name, F&& upTo) {
    parallelFor(b_.run, places_.size(), 1, [&](std::size_t k) {
      Place& p = places_[k];
      const auto x = p.texel % std::size_t(b_.uv.side), y = p.texel / std::size_t(b_.uv.side);
      const TexelTile tile = b_.texels->texels(y / kTile * std::size_t(b_.texels->tilesX()) + x / kTile);
      const TexelSampler sampler(b_.scene, tile, tile.at(int(x) - tile.x0, int(y) - tile.y0));
      const std::uint32_t end = upTo(p);
      for (std::uint64_t s = 0; s < kStreams; ++s) {
        const std::uint64_t key = combine(combine(b_.run.seed, name << 8 | s), std::uint64_t(x) << 32 | y);
        p.sums[s] += tracing.sum(sampler, combine(key, std::uint64_t(Draw::Audit)), p.paths, end);
      }
      p.paths = std::max(p.paths, end);
    });
  }

  void round(const PathTracer& tracing) {
    paths_ = paths_ == 0 ? kFirstPaths : 2 * paths_;
    const std::uint64_t before = b_.tracer->rays();
    cast(tracing, 2, [&](const Place& p) { return std::max(16u, std::uint32_t(p.share * double(paths_))); });
    lastRays_ = b_.tracer->rays() - before;
    rays_ += lastRays_;
    fmt::print(stderr, "reference: {} paths a texel, noise {:.3f} %\n", kStreams * paths_, 100.0 * noise());
  }

  double mean() const {
    double sum = 0.0;
    for (const Place& p : places_) sum += mean3(p.mean()) / double(places_.size());
    return sum;
  }
  double noise() const {
    double squares = 0.0;
    for (const Place& p : places_) squares += mean3(p.variance()) / double(places_.size());
    const double m = mean();
    return m > 0.0 ? std::sqrt(squares) / m : 0.0;
  }
  bool enough() const {
    if (places_.empty()) return true;
    if (paths_ == 0) return false;
    // The next round would take as many rays again as all before it.
    return noise() <= wish_.error || paths_ >= kMostPaths / 2 || (wish_.rays > 0 && rays_ + 2 * lastRays_ > wish_.rays);
  }

  std::filesystem::path stateFile() const { return folder_ / "reference.state.json"; }
  bool resume() {
    std::error_code missing;
    if (!std::filesystem::exists(stateFile(), missing)) return false;
    const std::vector<std::uint8_t> bytes = readFile(stateFile());
    const Json s = Json::parse(bytes.begin(), bytes.end(), nullptr, false);
    if (s.is_discarded() || s.value("key", "") != wish_.key || !s.contains("places")) return false;
    for (const Json& p : s["places"]) {
      Place place{p[0], p[1], p[2], {}};
      for (std::size_t k = 0; k < kStreams; ++k)
        for (int c = 0; c < 3; ++c) place.sums[k][c] = p[3][3 * k + std::size_t(c)];
      if (place.texel >= b_.map.size()) return false;
      places_.push_back(place);
    }
    paths_ = s["paths"];
    rays_ = s["rays"];
    lastRays_ = s["last_rays"];
    return true;
  }
  void keep() const {
    Json s = {{"key", wish_.key}, {"paths", paths_}, {"rays", rays_}, {"last_rays", lastRays_}, {"places", Json::array()}};
    for (const Place& p : places_) {
      Json sums = Json::array();
      for (const glm::dvec3& v : p.sums)
        for (int c = 0; c < 3; ++c) sums.push_back(v[c]);
      s["places"].push_back(Json::array({p.texel, p.share, p.paths, sums}));
    }
    writeFileWhole(stateFile(), s.dump());
  }

  void write() {
    const auto side = std::size_t(b_.uv.side), n = side * side;
    OutputSet set(folder_);
    const std::vector<std::string> names = namesOfMaps("reference", std::size_t(b_.uv.maps));
    for (std::size_t k = 0; k < names.size(); ++k) {
      std::vector<Rgb> value(n, Rgb(0.0f)), error = value;
      std::vector<float> there(n, 0.0f);
      float scale = 1.0f, most = 0.0f;
      for (const Place& p : places_) most = std::max(most, float(std::max({p.mean().x, p.mean().y, p.mean().z})));
      while (most / scale > 32768.0f) scale *= 2.0f;
      for (const Place& p : places_) {
        if (p.texel / n != k) continue;
        value[p.texel % n] = Rgb(p.mean()) / scale;
        error[p.texel % n] = Rgb(glm::sqrt(p.variance())) / scale;
        there[p.texel % n] = 1.0f;
      }
      std::vector<ExrChannel> channels{{"A", there.data(), 1}};
      if (wish_.openness) {
        channels.push_back({"Y", &value[0].r, 3});
        channels.push_back({"stderr.Y", &error[0].r, 3});
      } else {
        for (const auto& [layer, v] : {std::pair<std::string, std::vector<Rgb>*>{"", &value}, {"stderr.", &error}}) {
          channels.push_back({layer + "R", &(*v)[0].r, 3});
          channels.push_back({layer + "G", &(*v)[0].g, 3});
          channels.push_back({layer + "B", &(*v)[0].b, 3});
        }
      }
      writeExr(set.open(names[k]), b_.uv.side, b_.uv.side, channels, {{"lmcScale", scale}});
    }
    double paths = 0.0;
    for (const Place& p : places_) paths += double(kStreams) * double(p.paths) / double(places_.size());
    const Json about = {{"key", wish_.key}, {"files", names},   {"texels", places_.size()}, {"paths_a_texel", paths},
                        {"rays", rays_},    {"noise", noise()}, {"mean", mean()},           {"wished", wish_.error}};
    set.open("reference.json").write(about.dump(2) + "\n");
    set.commit();
  }

  Bake b_;
  std::filesystem::path folder_;
  ReferenceWish wish_;
  std::vector<Place> places_;
  std::uint32_t paths_ = 0;  // each stream, of a texel of share 1
  std::uint64_t rays_ = 0, lastRays_ = 0;
};

const std::vector<float>& channelOf(const ExrImage& image, const std::filesystem::path& file, const std::string& name) {
  const auto it = image.channels.find(name);
  if (it == image.channels.end()) throw Error(Exit::Broken, file, "", fmt::format("has no channel {}", name));
  return it->second;
}

float scaleOf(const ExrImage& image) {
  const auto it = image.attributes.find("lmcScale");
  return it == image.attributes.end() ? 1.0f : it->second;
}

}  // namespace

Exit makeReference(const BakeOptions& options, const std::filesystem::path& folder, const ReferenceWish& wish) {
  Exit result = Exit::Done;
  withThreads(Run{options.threads}, [&] { result = ReferenceMaker(options, folder, wish).make(); });
  return result;
}

std::vector<std::string> namesOfMaps(const std::string& stem, std::size_t count) {
  if (count == 1) return {stem + ".exr"};
  std::vector<std::string> out;
  for (std::size_t k = 0; k < count; ++k) out.push_back(fmt::format("{}.{:03}.exr", stem, k));
  return out;
}

TrueError trueError(const std::vector<std::filesystem::path>& maps, const std::vector<std::filesystem::path>& references, bool openness) {
  const std::vector<std::string> names = openness ? std::vector<std::string>{"Y"} : std::vector<std::string>{"R", "G", "B"};
  struct Off {
    double off2, noise2;
  };
  std::vector<Off> texels;
  double sum = 0.0, off = 0.0, values = 0.0;
  for (std::size_t k = 0; k < maps.size(); ++k) {
    const ExrImage map = readExr(maps[k]), reference = readExr(references[k]);
    if (map.width != reference.width || map.height != reference.height)
      throw Error(Exit::Broken, references[k], "",
                  fmt::format("is {} x {}, the map {} x {}", reference.width, reference.height, map.width, map.height));
    const float mapScale = scaleOf(map), referenceScale = scaleOf(reference);
    const auto covered = reference.channels.find("A");
    std::vector<const std::vector<float>*> found, right, error;
    for (const std::string& name : names) {
      found.push_back(&channelOf(map, maps[k], name));
      right.push_back(&channelOf(reference, references[k], name));
      const auto it = reference.channels.find("stderr." + name);
      error.push_back(it == reference.channels.end() ? nullptr : &it->second);
    }
    const auto own = map.channels.find("A");
    for (std::size_t i = 0; i < found[0]->size(); ++i) {
      if (covered != reference.channels.end() && !(covered->second[i] > 0.5f)) continue;
      if (own != map.channels.end() && !(own->second[i] > 0.5f)) continue;
      Off t{0.0, 0.0};
      for (std::size_t c = 0; c < names.size(); ++c) {
        const double truth = double((*right[c])[i]) * double(referenceScale), d = double((*found[c])[i]) * double(mapScale) - truth;
        const double e = error[c] ? double((*error[c])[i]) * double(referenceScale) : 0.0;
        t.off2 += d * d / double(names.size());
        t.noise2 += e * e / double(names.size());
        sum += truth;
        off += d;
        values += 1.0;
      }
      texels.push_back(t);
    }
  }
  TrueError out;
  out.texels = texels.size();
  if (texels.empty()) return out;
  const double n = double(texels.size()), mean = sum / values, unit = mean > 0.0 && !openness ? 1.0 / mean : 1.0;
  double off2 = 0.0, noise2 = 0.0, squares = 0.0;
  for (const Off& t : texels) {
    off2 += t.off2 / n;
    noise2 += t.noise2 / n;
    squares += t.off2 * t.off2 / n;
  }
  const double net2 = off2 - noise2, spread = 1.96 * std::sqrt(std::max(0.0, squares - off2 * off2) / n);
  out.mean = mean;
  out.rms = unit * std::sqrt(off2);
  out.net = unit * std::sqrt(std::max(0.0, net2));
  out.low = unit * std::sqrt(std::max(0.0, net2 - spread));
  out.high = unit * std::sqrt(std::max(0.0, net2 + spread));
  out.noise = unit * std::sqrt(noise2);
  out.bias = unit * off / values;
  return out;
}

}  // namespace lmc
