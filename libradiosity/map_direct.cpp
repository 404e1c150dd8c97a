#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <unordered_map>

#include "libradiosity/light_map.h"
#include "libscene/constants.h"
#include "libscene/journal.h"
#include "libscene/parallel.h"
#include "libscene/polygon2.h"

namespace lmc {

namespace {

constexpr std::uint32_t kPilotPlaces = 8;  // each half, on every texel that a light may reach

constexpr std::size_t kPilotParts = 64;                   // sums of a pilot
constexpr std::size_t kTimedTiles = 24, kLeastTimed = 2;  // one of so many tiles tells what a ray takes
constexpr double kTimedShare = 0.2;                       // of the pilot's time, about
constexpr std::uint32_t kMostPlaces = 128;
constexpr std::size_t kDrawsAPlace = 2;  // of groups, at first
constexpr std::size_t kPilotDraws = kDrawsAPlace * kPilotPlaces;
constexpr std::size_t kMostDraws = 1024;    // of groups, each half
constexpr double kGroupNoise = 0.5;         // of the goal times a texel's light: what groups may leave in the mean of its halves
constexpr int kPool = 2;                    // texels to each side over which that noise is estimated
constexpr double kSamplingExponent = 0.75;  // error ~ places^-0.75
constexpr double kStep = 0.3;               // of a texel's light: groups that change so much from texel to texel do within one, too
constexpr double kStrong = 0.25;            // share of a texel's light from which a part gets all the places of an edge
constexpr double kDeepShadow = 0.25;        // errors in a shadow count against so much of the light without it

/// Places on the edge texels of shadows, each half: their error falls about as n^-0.75 and they are a few percent of a map.
std::uint32_t edgePlaces(double goal) { return goal <= 0.01 ? kMostPlaces : goal <= 0.04 ? 64 : 32; }

constexpr int kSpan = kTile + 2 * kApron;
constexpr int kCutBlock = 16;  // texels that share a cut: few enough that lights are near or far for all of them

constexpr int kShareBlock = 2;  // texels that share how groups are chosen: their places see about the same

/// Where some texels are and which way they face.
class TexelBounds {
 public:
  void add(const Scene& scene, const TexelTile& tile, const Texel& texel) {
    for (std::uint32_t i = 0; i < texel.fragmentCount; ++i) {
      const Fragment& f = tile.fragments[texel.firstFragment + i];
      const auto c = scene.corners_m(f.triangle);
      for (std::uint32_t k = 0; k < f.cornerCount; ++k) {
        const glm::dvec2 p = tile.corners[f.firstCorner + k];
        const glm::dvec2 b = f.bary0 + p.x * f.baryX + p.y * f.baryY;
        const glm::dvec3 at = c[0] + b.x * (c[1] - c[0]) + b.y * (c[2] - c[0]);
        lo_m_ = glm::min(lo_m_, at);
        hi_m_ = glm::max(hi_m_, at);
      }
      const glm::uvec3 v = scene.triangles[f.triangle];
      for (int k = 0; k < 3; ++k) {
        const glm::dvec3 n(scene.normals[v[k]]);
        if (!directions_.empty() && n == directions_.back()) continue;
        directions_.push_back(n);
        normals_ += n;
      }
    }
  }
  Receivers receivers() const {
    Receivers r{0.5 * (lo_m_ + hi_m_), 0.5 * glm::length(hi_m_ - lo_m_) * (1.0 + 1e-9), glm::dvec3(0.0), 0.0};
    if (glm::length(normals_) > 1e-6) {
      r.normal = glm::normalize(normals_);
      for (const glm::dvec3& n : directions_)
        r.bend_rad = std::max(r.bend_rad, std::atan2(glm::length(glm::cross(r.normal, n)), glm::dot(r.normal, n)));
      if (r.bend_rad > kPi / 2.0) r.normal = glm::dvec3(0.0);
    }
    return r;
  }

 private:
  glm::dvec3 lo_m_{1e300}, hi_m_{-1e300}, normals_{0.0};
  std::vector<glm::dvec3> directions_;
};

/// Which lights each texel of a tile asks: one cut for the texels of a chart in a block. Apron texels go with the block beside them.
class TileCuts {
 public:
  TileCuts(const Scene& scene, const TexelTile& tile, const DirectLight& direct) : of_(std::size_t(kSpan) * kSpan, kNone) {
    struct Block {
      std::uint64_t key;
      TexelBounds bounds;
    };
    std::vector<Block> blocks;
    for (int y = -kApron; y < tile.height + kApron; ++y)
      for (int x = -kApron; x < tile.width + kApron; ++x) {
        const Texel& texel = tile.at(x, y);
        if (texel.fragmentCount == 0) continue;
        const auto bx = std::uint64_t(std::clamp(x, 0, tile.width - 1) / kCutBlock),
                   by = std::uint64_t(std::clamp(y, 0, tile.height - 1) / kCutBlock);
        const std::uint64_t key = (std::uint64_t(texel.chart) << 16) | (by << 8) | bx;
        auto it = std::ranges::find(blocks, key, &Block::key);
        if (it == blocks.end()) {
          blocks.push_back({});
          it = blocks.end() - 1;
          it->key = key;
        }
        of_[cell(x, y)] = std::uint32_t(it - blocks.begin());
        it->bounds.add(scene, tile, texel);
      }
    for (const Block& b : blocks) cuts_.push_back(direct.lightsFor(b.bounds.receivers()));
  }
  const LightCut& of(int x, int y) const { return cuts_[of_[cell(x, y)]]; }
  std::uint32_t numberAt(int x, int y) const { return of_[cell(x, y)]; }
  bool empty() const {
    return std::ranges::all_of(cuts_, [](const LightCut& c) { return c.empty(); });
  }
  static std::size_t cell(int x, int y) { return std::size_t(y + kApron) * kSpan + std::size_t(x + kApron); }

 private:
  std::vector<std::uint32_t> of_;
  std::vector<LightCut> cuts_;
};

/// What one part of a texel's cut gives: one punctual light, all emitters, or all groups.
struct Part {
  enum State : std::uint8_t { Nothing, Hidden, Lit, Mixed };
  std::array<Rgb, 2> half{Rgb(0.0f), Rgb(0.0f)};
  float unshadowed = 0.0f;
  State state = Nothing;
  double light() const { return 0.5 * double(strength(half[0] + half[1])); }
};

/// Direct light of a tile.
class TileDirect {
 public:
  /// `places`: of each half of every texel at first.
  TileDirect(LightMap& map, const Scene& scene, const TexelTile& tile, const DirectLight& direct, const MapOptions& options,
             std::uint32_t places, std::uint64_t seed)
      : map_(map),
        scene_(scene),
        tile_(tile),
        direct_(direct),
        goal_(options.goal),
        places_(places),
        seed_(seed),
        cuts_(scene, tile, direct) {}

  void bake() {
    if (!sample()) return;
    forCovered(0, [&](int x, int y) { finish(x, y); });
  }

  /// The first places alone: what they give goes into the map, and what they tell of the lights into `out`.
  void pilot(DirectPilot& out) {
    const bool any = sample();
    forCovered(0, [&](int x, int y) {
      ObjectLight& object = out.objects[scene_.triangleObject[tile_.fragments[tile_.at(x, y).firstFragment].triangle]];
      object.texels += 1.0;
      if (any) foretell(x, y, out, object);
    });
  }

 private:
  /// False where no light reaches the tile.
  bool sample() {
    if (cuts_.empty()) return false;
    first_.assign(std::size_t(kSpan) * kSpan, 0);
    std::size_t count = 0;
    forCovered(kApron, [&](int x, int y) {
      first_[TileCuts::cell(x, y)] = count;
      count += partsOf(cuts_.of(x, y));
    });
    shareGroups();
    parts_.resize(count);
    forCovered(kApron, [&](int x, int y) {
      Sampling s(*this, x, y);
      for (std::size_t k = 0; k < partsOf(cuts_.of(x, y)); ++k) part(x, y, k) = s.part(k, places_, kDrawsAPlace * places_);
    });
    return true;
  }

  /// One table of shares for the texels of a cut in a block: it would take longer to make than its draws.
  void shareGroups() {
    sharesOf_.assign(std::size_t(kSpan) * kSpan, kNone);
    struct Block {
      const LightCut* cut;
      TexelBounds bounds;
    };
    std::vector<Block> blocks;
    std::unordered_map<std::uint64_t, std::uint32_t> known;
    forCovered(kApron, [&](int x, int y) {
      const LightCut& cut = cuts_.of(x, y);
      if (cut.groups.empty()) return;
      const auto bx = std::uint64_t((x + kApron) / kShareBlock), by = std::uint64_t((y + kApron) / kShareBlock);
      const auto [it, isNew] = known.try_emplace(std::uint64_t(cuts_.numberAt(x, y)) << 32 | by << 16 | bx, std::uint32_t(blocks.size()));
      if (isNew) blocks.push_back({&cut, {}});
      blocks[it->second].bounds.add(scene_, tile_, tile_.at(x, y));
      sharesOf_[TileCuts::cell(x, y)] = it->second;
    });
    for (const Block& b : blocks) shares_.push_back(direct_.groupsAt(*b.cut, b.bounds.receivers()));
  }

  static std::size_t partsOf(const LightCut& c) { return c.punctual.size() + !c.emitters.empty() + !c.groups.empty(); }
  const LightTree::Groups* sharesAt(int x, int y) const {
    const std::uint32_t i = sharesOf_[TileCuts::cell(x, y)];
    return i == kNone ? nullptr : &shares_[i];
  }
  Part& part(int x, int y, std::size_t k) { return parts_[first_[TileCuts::cell(x, y)] + k]; }

  template <class F>
  void forCovered(int apron, F&& f) {
    for (int y = -apron; y < tile_.height + apron; ++y)
      for (int x = -apron; x < tile_.width + apron; ++x)
        if (tile_.at(x, y).fragmentCount > 0) f(x, y);
  }

  /// Places of both halves of a texel, and what parts give there.
  class Sampling {
   public:
    Sampling(const TileDirect& tile, int x, int y)
        : tile_(tile),
          cut_(tile.cuts_.of(x, y)),
          shares_(tile.sharesAt(x, y)),
          texel_(tile.tile_.at(x, y)),
          sampler_(tile.scene_, tile.tile_, tile.tile_.at(x, y)) {
      for (std::uint32_t h = 0; h < 2; ++h)
        numbers_[h] = sequence(tile.seed_, Draw::Direct, 0, 0, std::uint32_t(tile.tile_.x0 + x), std::uint32_t(tile.tile_.y0 + y), h);
    }
    /// `draws`: of groups, each half.
    Part part(std::size_t k, std::uint32_t places, std::size_t draws) {
      need(places);
      const bool nearby = k < cut_.punctual.size() && tile_.direct_.isNearby(cut_.punctual[k], at_[0][0].position_m, diameter_m());
      Part out;
      DirectPart sum;
      bool seen[2];
      for (std::uint32_t h = 0; h < 2; ++h) {
        const std::span<const SurfacePoint> at(at_[h].data(), places);
        DirectPart p;
        if (nearby) {
          p = tile_.direct_.punctualNearby(pieces(), cut_.punctual[k], places, numbers_[h]);
        } else if (k < cut_.punctual.size()) {
          p = tile_.direct_.punctual(at, cut_.punctual[k]);
        } else if (!isGroups(cut_, k)) {
          p = tile_.direct_.emitters(at, cut_.emitters, numbers_[h]);
        } else {
          p = tile_.direct_.groups(at, *shares_, draws, numbers_[h]);
        }
        out.half[h] = Rgb(p.illuminance);
        sum += p;
        seen[h] = p.seen;
      }
      out.unshadowed = 0.5f * strength(Rgb(sum.unshadowed));
      if (out.unshadowed > 0.0f) out.state = sum.mixed || seen[0] != seen[1] ? Part::Mixed : seen[0] ? Part::Lit : Part::Hidden;
      return out;
    }

   private:
    void need(std::uint32_t places) {
      for (; placed_ < places; ++placed_)
        for (std::size_t h = 0; h < 2; ++h) {
          const glm::vec4 u = numbers_[h].point(placed_);
          at_[h][placed_] = sampler_.at({u.z, u.w});
        }
    }
    /// Of the texel's square, on its longest fragment.
    double diameter_m() {
      if (diameter_m_ > 0.0) return diameter_m_;
      for (std::uint32_t i = 0; i < texel_.fragmentCount; ++i) {
        const Fragment& f = tile_.tile_.fragments[texel_.firstFragment + i];
        const auto c = tile_.scene_.corners_m(f.triangle);
        const glm::dvec3 x = f.baryX.x * (c[1] - c[0]) + f.baryX.y * (c[2] - c[0]),
                         y = f.baryY.x * (c[1] - c[0]) + f.baryY.y * (c[2] - c[0]);
        diameter_m_ = std::max(diameter_m_, glm::length(x) + glm::length(y));
      }
      return diameter_m_;
    }
    const std::vector<TexelPiece>& pieces() {
      if (!pieces_.empty()) return pieces_;
      for (std::uint32_t i = 0; i < texel_.fragmentCount; ++i) {
        const Fragment& f = tile_.tile_.fragments[texel_.firstFragment + i];
        const glm::dvec2* p = tile_.tile_.corners.data() + f.firstCorner;
        const auto bary = [&](const glm::dvec2& at) { return f.bary0 + at.x * f.baryX + at.y * f.baryY; };
        for (std::uint32_t k = 2; k < f.cornerCount; ++k)
          pieces_.push_back({f.triangle,
                             {bary(p[0]), bary(p[k - 1]), bary(p[k])},
                             0.5 * std::abs(Polygon2::cross(p[k - 1] - p[0], p[k] - p[0])) / double(texel_.coverage)});
      }
      return pieces_;
    }
    const TileDirect& tile_;
    const LightCut& cut_;
    const LightTree::Groups* shares_;  // nullptr = the cut has no groups
    const Texel& texel_;
    const TexelSampler sampler_;
    std::vector<TexelPiece> pieces_;  // made when a light is near
    double diameter_m_ = 0.0;
    std::array<Sobol4, 2> numbers_{Sobol4(0), Sobol4(0)};
    std::array<std::array<SurfacePoint, kMostPlaces>, 2> at_;
    std::uint32_t placed_ = 0;
  };

  static bool isGroups(const LightCut& cut, std::size_t k) { return k == cut.punctual.size() + !cut.emitters.empty(); }

  /// The state of the k-th part of a cut, which is not its groups, in a neighbour, whose cut may be another.
  Part::State stateThere(const LightCut& cut, std::size_t k, int x, int y) {
    const LightCut& other = cuts_.of(x, y);
    if (&other == &cut) return part(x, y, k).state;
    if (k < cut.punctual.size()) {
      const auto it = std::ranges::lower_bound(other.punctual, cut.punctual[k]);
      return it == other.punctual.end() || *it != cut.punctual[k] ? Part::Nothing
                                                                  : part(x, y, std::size_t(it - other.punctual.begin())).state;
    }
    return other.emitters.empty() ? Part::Nothing : part(x, y, other.punctual.size()).state;
  }

  /// Sums over the parts of a texel.
  struct Total {
    double light = 0.0, unshadowed = 0.0;
    /// What errors of its parts count against.
    double against() const { return std::max(light, kDeepShadow * unshadowed); }
  };
  Total totalOf(int x, int y) {
    Total out;
    for (std::size_t k = 0; k < partsOf(cuts_.of(x, y)); ++k) {
      const Part& p = part(x, y, k);
      out.light += p.light();
      out.unshadowed += double(p.unshadowed);
    }
    return out;
  }

  /// Places, each half, for a part that is not settled: a faint light needs fewer for the same error.
  std::uint32_t placesFor(const Part& p, const Total& total) const {
    const double most = edgePlaces(goal_);
    const double wish = most * std::pow(std::min(1.0, double(p.unshadowed) / (kStrong * total.against())), 1.0 / kSamplingExponent);
    return std::uint32_t(std::min(most, std::exp2(std::ceil(std::log2(std::max(1.0, wish))))));
  }

  void finish(int x, int y) {
    const LightCut& cut = cuts_.of(x, y);
    const Total total = totalOf(x, y);
    std::array<Rgb, 2> sum{Rgb(0.0f), Rgb(0.0f)};
    std::optional<Sampling> more;
    const auto sampling = [&]() -> Sampling& { return more ? *more : more.emplace(*this, x, y); };
    bool edge = false;
    for (std::size_t k = 0; k < partsOf(cut); ++k) {
      Part p = part(x, y, k);
      if (isGroups(cut, k)) {
        edge = edge || stepsOf(x, y) > kStep * total.light;
        const std::size_t draws = drawsFor(x, y, total.light - p.light());
        if (draws > kPilotDraws) p = sampling().part(k, std::uint32_t(std::min(draws / kDrawsAPlace, std::size_t(kMostPlaces))), draws);
      } else if (!settled(x, y, k, total.light)) {
        edge = true;
        const std::uint32_t places = placesFor(p, total);
        if (places > kPilotPlaces) p = sampling().part(k, places, 0);
      }
      for (std::size_t h = 0; h < 2; ++h) sum[h] += p.half[h];
    }
    const std::size_t i = map_.index(tile_, x, y);
    map_.edge[i] = edge;
    for (std::size_t h = 0; h < 2; ++h) map_.direct[h][i] = sum[h];
  }

  /// A texel of the pilot.
  void foretell(int x, int y, DirectPilot& out, ObjectLight& object) {
    const LightCut& cut = cuts_.of(x, y);
    const Total total = totalOf(x, y);
    std::array<Rgb, 2> sum{Rgb(0.0f), Rgb(0.0f)};
    double punctual = 0.0, area = 0.0, hidden = 0.0;
    bool edge = false;
    for (std::size_t k = 0; k < partsOf(cut); ++k) {
      const Part& p = part(x, y, k);
      const auto most = double(p.unshadowed);
      hidden += std::max(0.0, most - p.light());
      const bool groups = isGroups(cut, k);
      // Groups are of either kind: they count as both.
      if (k < cut.punctual.size() || groups) punctual += most;
      if (k >= cut.punctual.size()) area += most;
      if (groups) {
        const std::size_t draws = drawsFor(x, y, total.light - p.light());
        out.rays += 2.0 * double(draws > kPilotDraws ? kPilotDraws + draws : kPilotDraws);
      } else {
        if (k < cut.punctual.size()) out.lights[cut.punctual[k]].add(most);
        if (most > 0.0) out.rays += 2.0 * kPilotPlaces;
        if (!plain(x, y, k)) {
          edge = true;
          if (const std::uint32_t places = placesFor(p, total); places > kPilotPlaces) out.rays += 2.0 * places;
        }
      }
      for (std::size_t h = 0; h < 2; ++h) sum[h] += p.half[h];
    }
    const std::size_t i = map_.index(tile_, x, y);
    map_.edge[i] = edge;
    for (std::size_t h = 0; h < 2; ++h) map_.direct[h][i] = sum[h];
    const Rgb mean = 0.5f * (sum[0] + sum[1]);
    object.light += (double(mean.r) + double(mean.g) + double(mean.b)) / 3.0;
    object.punctual.add(punctual);
    object.area.add(area);
    object.hidden.add(hidden);
  }

  /// Calls f(groups there, dx, dy) for the texels within `reach` on the same chart whose cut has groups; the texel itself is one of them.
  template <class F>
  void forGroupsAbout(int x, int y, int reach, F&& f) {
    for (int py = std::max(y - reach, -kApron); py <= std::min(y + reach, tile_.height - 1 + kApron); ++py)
      for (int px = std::max(x - reach, -kApron); px <= std::min(x + reach, tile_.width - 1 + kApron); ++px) {
        const Texel& other = tile_.at(px, py);
        if (other.fragmentCount == 0 || other.chart != tile_.at(x, y).chart) continue;
        const LightCut& there = cuts_.of(px, py);
        if (!there.groups.empty()) f(part(px, py, partsOf(there) - 1));
      }
  }

  /// Draws of the groups that a texel needs, each half, for its share of the goal; `others` is the light of the other parts. Differences of
  /// halves are pooled over neighbours: one texel's own is small by chance too often.
  std::size_t drawsFor(int x, int y, double others) {
    double squares = 0.0, light = 0.0, unshadowed = 0.0, texels = 0.0;
    forGroupsAbout(x, y, kPool, [&](const Part& p) {
      const double d = double(strength(glm::abs(p.half[0] - p.half[1])));
      squares += 0.25 * d * d;
      light += p.light();
      unshadowed += double(p.unshadowed);
      texels += 1.0;
    });
    const auto cast = double(kDrawsAPlace * places_);
    if (!(squares > 0.0)) return std::size_t(cast);
    const double against = others + std::max(light, kDeepShadow * unshadowed) / texels;
    const double excess = std::sqrt(squares / texels) / (kGroupNoise * goal_ * against);
    const double wish = cast * std::pow(excess, 1.0 / kSamplingExponent);
    return std::size_t(std::clamp(std::exp2(std::round(std::log2(wish))), cast, double(kMostDraws)));
  }

  /// By how much the light of the groups steps from a texel to its neighbours.
  double stepsOf(int x, int y) {
    const double own = part(x, y, partsOf(cuts_.of(x, y)) - 1).light();
    double step = 0.0;
    forGroupsAbout(x, y, 1, [&](const Part& p) { step = std::max(step, std::abs(p.light() - own)); });
    return step;
  }

  /// Few places prove little: a light is taken as plainly seen or hidden only when the texel's neighbours on the chart say the same.
  bool settled(int x, int y, std::size_t k, double total) {
    const Part& p = part(x, y, k);
    return p.state == Part::Nothing || (double(strength(glm::abs(p.half[0] - p.half[1]))) <= goal_ * total && plain(x, y, k));
  }

  /// Seen from all places of the texel and its neighbours, or from none.
  bool plain(int x, int y, std::size_t k) {
    const Part& p = part(x, y, k);
    if (p.state == Part::Nothing) return true;
    if (p.state == Part::Mixed) return false;
    const LightCut& cut = cuts_.of(x, y);
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx) {
        const Texel& other = tile_.at(x + dx, y + dy);
        if (other.fragmentCount == 0 || other.chart != tile_.at(x, y).chart) continue;
        const Part::State there = stateThere(cut, k, x + dx, y + dy);
        if (there != p.state && there != Part::Nothing) return false;
      }
    return true;
  }

  LightMap& map_;
  const Scene& scene_;
  const TexelTile& tile_;
  const DirectLight& direct_;
  double goal_;
  std::uint32_t places_;
  std::uint64_t seed_;
  TileCuts cuts_;
  std::vector<std::size_t> first_;
  std::vector<Part> parts_;
  std::vector<LightTree::Groups> shares_;
  std::vector<std::uint32_t> sharesOf_;  // one a texel, the apron included; kNone = its cut has no groups
};

/// All that a tile writes, and the rays to each lamp.
template <class Archive>
void keep(LightMap& map, const TexelTile& tile, std::vector<std::uint64_t>& rays, Archive& archive) {
  for (std::uint64_t& n : rays) archive(n);
  for (int y = 0; y < tile.height; ++y)
    for (int x = 0; x < tile.width; ++x) {
      if (tile.at(x, y).fragmentCount == 0) continue;
      const std::size_t i = map.index(tile, x, y);
      for (std::size_t h = 0; h < 2; ++h) archive(map.direct[h][i]);
      archive(map.edge[i]);
    }
}

/// What a ray of the bake takes [CPU s], all that goes with it included: some of the fullest tiles as bakeDirect does them. 0 where they
/// get no light.
double timeRays(LightMap& map, const Scene& scene, const TexelMap& texels, const DirectLight& direct, const MapOptions& options,
                const Run& run) {
  if (!direct.any()) return 0.0;
  std::vector<std::uint32_t> covered(texels.tileCount(), 0);
  for (std::size_t i = 0; i < map.size(); ++i) {
    if (map.chart[i] == kNone) continue;
    const std::size_t x = i % std::size_t(map.width), y = i / std::size_t(map.width);
    ++covered[y / kTile * std::size_t(texels.tilesX()) + x / kTile];
  }
  const std::uint32_t most = std::ranges::max(covered);
  std::vector<std::size_t> full;
  for (std::size_t t = 0; t < covered.size(); ++t)
    if (2 * covered[t] > most) full.push_back(t);
  if (full.empty()) return 0.0;
  const std::size_t count = std::min(full.size(), std::max(kLeastTimed, texels.tileCount() / kTimedTiles));
  std::vector<double> taken_s(count);
  const auto rays = [&] { return double(direct.tracer().rays(Purpose::Shadow) + direct.tracer().rays(Purpose::Emitter)); };
  const double before = rays();
  parallelFor(run, count, 1, [&](std::size_t k) {
    const double before_s = threadSeconds();
    const auto held = texels.held(full[(2 * k + 1) * full.size() / (2 * count)]);
    TileDirect(map, scene, *held, direct, options, kPilotPlaces, run.seed).bake();
    taken_s[k] = threadSeconds() - before_s;
  });
  return std::accumulate(taken_s.begin(), taken_s.end(), 0.0) / std::max(1.0, rays() - before);
}

}  // namespace

void bakeDirect(LightMap& map, const Scene& scene, const TexelMap& texels, const DirectLight& direct, const MapOptions& options,
                const Run& run) {
  if (!direct.any()) return;
  parallelFor(run, texels.tileCount(), 1, [&](std::size_t t) {
    const auto held = texels.held(t);
    const TexelTile& tile = *held;
    if (tile.fragments.empty()) return;
    DirectLight::Tally cast(direct);
    Journaled kept(run, direct.tracer(), {Loop::Direct, 0, std::uint32_t(t)}, [&](auto& a) { keep(map, tile, cast.rays, a); });
    if (kept.taken()) return direct.countAsCast(cast.rays);
    TileDirect(map, scene, tile, direct, options, kPilotPlaces, run.seed).bake();
    kept.put();
  });
}

DirectPilot pilotDirect(LightMap& map, const Scene& scene, const TexelMap& texels, const DirectLight& direct, const MapOptions& options,
                        const Run& run) {
  DirectPilot none;
  none.lights.resize(scene.lights.size());
  none.objects.resize(scene.objects.size());
  const double ray_s = timeRays(map, scene, texels, direct, options, run.part(0.0, kTimedShare));
  std::vector<DirectPilot> tiles(std::min(texels.tileCount(), kPilotParts), none);
  const Run rest = run.part(kTimedShare, 1.0);
  Between between(rest, texels.tileCount());
  // Few sums, each over tiles in order.
  parallelFor(run.quiet(), tiles.size(), 1, [&](std::size_t p) {
    for (std::size_t t = p; t < texels.tileCount(); t += tiles.size()) {
      const auto held = texels.held(t);
      const TexelTile& tile = *held;
      if (!tile.fragments.empty()) TileDirect(map, scene, tile, direct, options, 1, run.seed).pilot(tiles[p]);
      between.done(1);
    }
  });
  for (const DirectPilot& p : tiles) none += p;
  none.ray_s = ray_s;
  return none;
}

DirectPilot& DirectPilot::operator+=(const DirectPilot& o) {
  for (std::size_t i = 0; i < lights.size(); ++i) {
    lights[i].texels += o.lights[i].texels;
    lights[i].sum += o.lights[i].sum;
    lights[i].sum2 += o.lights[i].sum2;
  }
  for (std::size_t i = 0; i < objects.size(); ++i) objects[i] += o.objects[i];
  rays += o.rays;
  return *this;
}

}  // namespace lmc
