#include "libscene/place_charts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <unordered_map>

#include "libscene/constants.h"
#include "libscene/disjoint_sets.h"
#include "libscene/parallel.h"

namespace lmc {

namespace {

constexpr double kGrid = 0x1p23;           // places in a map are whole numbers of these parts: floats hold them exactly
constexpr double kStraight = 0.35;         // share of a border that must run along one direction to turn the chart by it
constexpr double kMostRounding = 0.1;      // of a chart's side, to end on a texel's border
constexpr double kFull = 0.8;              // share of a map that charts and their padding fill, about
constexpr int kStep = 4;                   // of a side that is chosen: blocks of compressed textures
constexpr int kTries = 8;                  // of a size, about
constexpr double kCloseEnough = 1.004;     // between a size that fits and one that does not
constexpr double kSprawling = 0.35;        // share of its box below which a chart is cut
constexpr double kCutHelps = 0.75;         // of the box, that the parts' boxes may take
constexpr int kOrders = 2;                 // of charts, that are tried
constexpr std::size_t kManyCharts = 4000;  // of which one order is enough
constexpr double kRectangle = 0.98;        // share of its box from which a chart counts as one
constexpr double kLeastRectangle = 4.0;    // side [texels]: smaller ones would lose too much of themselves
constexpr double kSmaller = 0.9;           // of a group that fits no map

glm::dvec2 boxOf(const FlatChart& c) {
  glm::dvec2 hi(0.0);
  for (const glm::dvec2& p : c.uv_m) hi = glm::max(hi, p);
  return hi;
}

double areaOf(const FlatChart& c) {
  double sum = 0.0;
  for (const glm::uvec3& t : c.corners) {
    const glm::dvec2 a = c.uv_m[t.x], b = c.uv_m[t.y] - a, d = c.uv_m[t.z] - a;
    sum += 0.5 * (b.x * d.y - b.y * d.x);
  }
  return sum;
}

/// A use at the size at which it is drawn.
struct Drawn {
  glm::dvec2 factor, low;
  bool rectangular = true;
  TexelMask mask{1, 1};
};

glm::dvec2 drawn(const ChartUse& u, std::uint32_t vertex, glm::dvec2 factor) {
  glm::dvec2 p = u.chart->uv_m[vertex];
  if (u.mirrored) p.x = -p.x;
  return factor * p;
}

/// Sides are rounded to whole texels where that changes little, so that both borders of a rectangle lie on the grid.
Drawn draw(const ChartUse& u, double scale) {
  Drawn d;
  const glm::dvec2 hi = boxOf(*u.chart);
  d.factor = glm::dvec2(scale * u.texels);
  for (int k = 0; k < 2; ++k) {
    const double size = d.factor[k] * hi[k], whole = std::max(1.0, std::round(size));
    const bool rounded = size > 0.0 && std::abs(whole / size - 1.0) <= kMostRounding;
    if (rounded) d.factor[k] *= whole / size;
    d.rectangular = d.rectangular && rounded;
  }
  d.low = glm::dvec2(u.mirrored ? -d.factor.x * hi.x : 0.0, 0.0);
  // Borders of a rectangle on texels' centres: look-ups near them need no padding, and half of the texel that they read is the chart's own.
  d.rectangular =
      d.rectangular && areaOf(*u.chart) >= kRectangle * hi.x * hi.y && std::min(d.factor.x * hi.x, d.factor.y * hi.y) >= kLeastRectangle;
  if (d.rectangular) d.low -= 0.5;
  std::vector<std::array<glm::dvec2, 3>> triangles;
  triangles.reserve(u.chart->corners.size());
  for (const glm::uvec3& t : u.chart->corners)
    triangles.push_back({drawn(u, t.x, d.factor) - d.low, drawn(u, t.y, d.factor) - d.low, drawn(u, t.z, d.factor) - d.low});
  d.mask = TexelMask(triangles);
  return d;
}

class Placer {
 public:
  Placer(const std::vector<ChartUse>& uses, const PlaceOptions& options, const Run& run)
      : uses_(uses), o_(options), run_(run), margin_((options.padding + 1) / 2), drawn_(uses.size()), places_(uses.size()) {
    out_.map.assign(uses.size(), 0);
    for (std::uint32_t i = 0; i < uses.size(); ++i) groups_ = std::max(groups_, uses[i].group + 1);
    shrunk_.assign(groups_, 1.0);
    longest_.assign(groups_, 0.0);
    for (const ChartUse& u : uses) {
      const glm::dvec2 box = boxOf(*u.chart);
      area_ += areaOf(*u.chart) * u.texels * u.texels;
      longest_[u.group] = std::max(longest_[u.group], std::max(box.x, box.y) * u.texels);
    }
  }
  std::optional<ChartPlaces> place();

 private:
  void drawAll(double factor);
  void drawOne(std::uint32_t i) { drawn_[i] = draw(uses_[i], out_.factor * shrunk_[uses_[i].group]); }
  double room(std::uint32_t i) const;
  int paddingOf(std::uint32_t i) const { return std::max(0, o_.padding - (drawn_[i].rectangular ? 1 : 0)); }
  int pack(const std::vector<std::uint32_t>& items, int side, int maxHeight, const TexelMask* taken);
  int packInOrder(const std::vector<std::uint32_t>& items, int order, int side, int maxHeight, const TexelMask* taken);
  bool smallestSide();
  bool fillMap();
  bool severalMaps(double factor);
  bool coarserMaps();
  void toUv();

  const std::vector<ChartUse>& uses_;
  const PlaceOptions& o_;
  const Run& run_;
  int margin_;
  std::uint32_t groups_ = 0;
  double area_ = 0.0;            // of all charts at a factor of 1 [texels]
  std::vector<double> longest_;  // side of a chart's box, one a group, at a factor of 1 [texels]
  double longest() const { return *std::ranges::max_element(longest_); }
  std::vector<Drawn> drawn_;
  std::vector<Placement> places_;
  std::vector<double> shrunk_;  // one a group
  ChartPlaces out_;
};

void Placer::drawAll(double factor) {
  out_.factor = factor;
  parallelFor(run_.quiet(), uses_.size(), 16, [&](std::size_t i) { drawOne(std::uint32_t(i)); });
}

/// Texels of a chart and of its share of the padding about it.
double Placer::room(std::uint32_t i) const {
  const TexelMask& m = drawn_[i].mask;
  return double(m.count()) + double(paddingOf(i)) * (m.width() + m.height() + paddingOf(i));
}

/// Places all of the items, in the order that takes the least height; that height, or -1 when it is more than `maxHeight`.
int Placer::pack(const std::vector<std::uint32_t>& items, int side, int maxHeight, const TexelMask* taken) {
  int best = -1;
  std::vector<Placement> bestPlaces;
  for (int order = 0; order < (items.size() > kManyCharts ? 1 : kOrders); ++order) {
    const int height = packInOrder(items, order, side, best < 0 ? maxHeight : best - 1, taken);
    if (height < 0) continue;
    best = height;
    bestPlaces = places_;
  }
  if (best >= 0) places_ = std::move(bestPlaces);
  return best;
}

/// Long ones first (order 0), or large ones.
int Placer::packInOrder(const std::vector<std::uint32_t>& items, int byArea, int side, int maxHeight, const TexelMask* taken) {
  if (side <= 2 * margin_) return -1;
  std::vector<std::uint32_t> order = items;
  std::ranges::stable_sort(order, [&](std::uint32_t a, std::uint32_t b) {
    const auto key = [&](std::uint32_t i) {
      const TexelMask& m = drawn_[i].mask;
      const int longest = std::max(m.width(), m.height()), area = m.width() * m.height();
      return byArea ? std::pair(area, longest) : std::pair(longest, area);
    };
    return key(a) > key(b);
  });
  Packer packer(side - 2 * margin_);
  if (taken) packer.block(*taken, -margin_, o_.padding);
  for (std::size_t n = 0; n < order.size(); ++n) {
    if (n % 64 == 0) run_.progress(0.5);
    Placement p = packer.add(drawn_[order[n]].mask, maxHeight - 2 * margin_, paddingOf(order[n]));
    if (p.x < 0) return -1;
    p.x += margin_;
    p.y += margin_;
    places_[order[n]] = p;
  }
  return packer.height() + 2 * margin_;
}

std::vector<std::uint32_t> all(std::size_t n) {
  std::vector<std::uint32_t> out(n);
  std::iota(out.begin(), out.end(), 0u);
  return out;
}

constexpr int kEndless = 1 << 20;

bool Placer::smallestSide() {
  if (area_ > double(o_.mostSide) * o_.mostSide || longest() > o_.mostSide - 2 * margin_) return false;
  drawAll(1.0);
  double whole = 0.0;
  int widest = 0;
  const std::vector<std::uint32_t> items = all(uses_.size());
  for (const std::uint32_t i : items) {
    whole += room(i);
    widest = std::max(widest, std::min(drawn_[i].mask.width(), drawn_[i].mask.height()));
  }
  const auto stepped = [](double side) { return std::max(kStep, int(std::ceil(side / kStep)) * kStep); };
  if (std::sqrt(whole) > o_.mostSide) return false;
  int side = stepped(std::max(std::sqrt(whole / kFull), double(widest + 2 * margin_)));
  int best = 0;
  std::vector<int> tried;
  for (int n = 0; n < kTries && side <= o_.mostSide && std::ranges::find(tried, side) == tried.end(); ++n) {
    tried.push_back(side);
    const int height = pack(items, side, kEndless, nullptr);
    if (height < 0) {
      side += kStep;
      continue;
    }
    if (height <= side && (best == 0 || side < best)) best = side;
    const double ideal = std::sqrt(double(side) * height);
    side = height <= side ? std::min(side - kStep, stepped(ideal)) : std::max(side + kStep, stepped(ideal));
    if (best > 0 && side >= best) side = best - kStep;
  }
  if (best == 0) return false;
  out_.side = best;
  return pack(items, best, best, nullptr) >= 0;
}

bool Placer::fillMap() {
  const std::vector<std::uint32_t> items = all(uses_.size());
  const double free = double(o_.side) * o_.side;
  double low = 0.0, high = std::numeric_limits<double>::infinity(), factor = std::sqrt(kFull * free / std::max(1e-30, area_));
  factor = std::min(factor, (o_.side - 2 * margin_) / std::max(1e-30, longest()));  // needles have a length and no area
  std::vector<Drawn> bestDrawn;
  std::vector<Placement> bestPlaces;
  for (int n = 0; n < 3 * kTries; ++n) {
    drawAll(factor);
    double whole = 0.0;
    for (const std::uint32_t i : items) whole += room(i);
    const int height = whole > 1.1 * free ? -1 : pack(items, o_.side, o_.side, nullptr);
    if (height >= 0) {
      low = factor;
      bestDrawn = drawn_;
      bestPlaces = places_;
    } else {
      high = factor;
    }
    if (high < std::numeric_limits<double>::infinity() && low > 0.0) {
      if (high / low < kCloseEnough) break;
      factor = std::sqrt(low * high);
    } else {
      const double step = std::sqrt(kFull * free / std::max(1.0, whole));
      factor *= height >= 0 ? std::clamp(step, 1.05, 64.0) : std::clamp(step, 0.25, 0.9);
    }
    if (factor < 1e-9) break;
  }
  if (bestDrawn.empty()) return false;
  drawn_ = std::move(bestDrawn);
  places_ = std::move(bestPlaces);
  out_.factor = low;
  out_.side = o_.side;
  return true;
}

bool Placer::severalMaps(double factor) {
  out_ = {};
  out_.map.assign(uses_.size(), 0);
  const int side = o_.side > 0 ? o_.side : o_.mostSide;
  if (factor * factor * area_ > double(o_.maxMaps) * side * side) return false;
  shrunk_.assign(groups_, 1.0);
  for (std::uint32_t g = 0; g < groups_; ++g)
    if (factor * longest_[g] > side - 2 * margin_) {
      shrunk_[g] = kSmaller * (side - 2 * margin_) / (factor * longest_[g]);
      out_.smaller.push_back(g);
    }
  drawAll(factor);
  std::vector<std::vector<std::uint32_t>> members(groups_);
  std::vector<double> rooms(groups_, 0.0);
  for (std::uint32_t i = 0; i < uses_.size(); ++i) {
    members[uses_[i].group].push_back(i);
    rooms[uses_[i].group] += room(i);
  }
  std::vector<std::uint32_t> open;
  for (std::uint32_t g = 0; g < groups_; ++g)
    if (!members[g].empty()) open.push_back(g);
  std::ranges::stable_sort(open, [&](std::uint32_t a, std::uint32_t b) { return rooms[a] > rooms[b]; });
  const double whole = double(side - 2 * margin_) * (side - 2 * margin_);
  const auto itemsOf = [&](const std::vector<std::uint32_t>& groups) {
    std::vector<std::uint32_t> items;
    for (const std::uint32_t g : groups) items.insert(items.end(), members[g].begin(), members[g].end());
    return items;
  };
  for (int map = 0; !open.empty(); ++map) {
    if (map == o_.maxMaps) return false;
    const TexelMask* taken = map == 0 ? o_.taken : nullptr;
    double budget = whole - (taken ? double(taken->count()) : 0.0);
    for (;;) {
      std::vector<std::uint32_t> chosen, rest;
      double used = 0.0;
      for (const std::uint32_t g : open)
        if (used + rooms[g] <= budget) {
          chosen.push_back(g);
          used += rooms[g];
        } else {
          rest.push_back(g);
        }
      const bool alone = chosen.empty() && !taken;
      if (alone) {  // the largest is too large for any map
        chosen = {rest.front()};
        rest.erase(rest.begin());
      } else if (chosen.empty()) {
        break;
      }
      const std::vector<std::uint32_t> items = itemsOf(chosen);
      bool fits = pack(items, side, side, taken) >= 0;
      while (!fits && alone) {
        shrunk_[chosen[0]] *= kSmaller;
        if (shrunk_[chosen[0]] < 1e-6) return false;
        for (const std::uint32_t i : items) drawOne(i);
        fits = pack(items, side, side, nullptr) >= 0;
      }
      if (alone && shrunk_[chosen[0]] < 1.0 && std::ranges::find(out_.smaller, chosen[0]) == out_.smaller.end())
        out_.smaller.push_back(chosen[0]);
      if (fits) {
        for (const std::uint32_t i : items) out_.map[i] = std::uint32_t(map);
        out_.maps = map + 1;
        open = std::move(rest);
        break;
      }
      budget = 0.97 * std::min(budget, used);
    }
  }
  out_.side = side;
  return true;
}

/// As fine as the maps allow, or nothing.
bool Placer::coarserMaps() {
  constexpr double kCoarser = 0.8;
  const int side = o_.side > 0 ? o_.side : o_.mostSide;
  double factor = std::min(1.0, std::sqrt(kFull * o_.maxMaps * side * side / std::max(1e-30, area_)));
  for (int n = 0; n < 3 * kTries; ++n, factor *= kCoarser)
    if (severalMaps(factor)) return true;
  return false;
}

void Placer::toUv() {
  const double parts = kGrid / out_.side;
  out_.uv.resize(uses_.size());
  std::vector<std::vector<std::uint32_t>> spoilt(uses_.size());
  parallelFor(run_.quiet(), uses_.size(), 16, [&](std::size_t i) {
    const ChartUse& u = uses_[i];
    const Drawn& d = drawn_[i];
    const Placement turn{0, 0, places_[i].quarters};
    const glm::i64vec2 at(glm::round(glm::dvec2(places_[i].x, places_[i].y) * parts));
    std::vector<glm::i64vec2> grid;
    for (std::uint32_t v = 0; v < u.chart->uv_m.size(); ++v)
      grid.push_back(glm::i64vec2(glm::round(placed(turn, drawn(u, v, d.factor) - d.low, d.mask.width(), d.mask.height()) * parts)));
    std::vector<glm::uvec3> corners = u.chart->corners;
    if (u.mirrored)
      for (glm::uvec3& t : corners) std::swap(t.y, t.z);
    for (std::uint32_t f = 0; f < corners.size(); ++f)
      if (twiceArea(grid, corners[f]) < 0) {
        // A face alone that is too thin for its places gets none.
        if (corners.size() == 1)
          grid[corners[0].z] = grid[corners[0].y];
        else
          spoilt[i].push_back(f);
      }
    if (spoilt[i].empty()) spoilt[i] = overlapping(grid, corners, false);
    for (const glm::i64vec2& g : grid) out_.uv[i].push_back(glm::vec2(glm::dvec2(g + at) / kGrid));
  });
  for (std::uint32_t i = 0; i < spoilt.size(); ++i)
    for (const std::uint32_t f : spoilt[i]) out_.spoilt.emplace_back(i, f);
}

std::optional<ChartPlaces> Placer::place() {
  bool done = false;
  if (!o_.taken && o_.side > 0 && o_.fill) done = fillMap();
  if (!o_.taken && o_.side == 0) done = smallestSide();
  if (!done) done = severalMaps(1.0) || (o_.fill && coarserMaps());
  if (!done) return std::nullopt;
  toUv();
  return std::move(out_);
}

}  // namespace

void alignChart(FlatChart& c) {
  // Borders: edges that one face has.
  std::unordered_map<std::uint64_t, std::uint32_t> uses;
  const auto key = [](std::uint32_t a, std::uint32_t b) { return std::uint64_t(std::min(a, b)) << 32 | std::max(a, b); };
  for (const glm::uvec3& t : c.corners)
    for (int k = 0; k < 3; ++k) ++uses[key(t[k], t[(k + 1) % 3])];
  constexpr std::size_t kBins = 360;
  constexpr double kQuarter = 0.5 * kPi;
  struct Bin {
    double length = 0.0, longest = 0.0, angle = 0.0;
  };
  std::array<Bin, kBins> bins;
  double whole = 0.0;
  std::vector<glm::dvec2> outline;
  for (const glm::uvec3& t : c.corners)
    for (int k = 0; k < 3; ++k) {
      if (uses[key(t[k], t[(k + 1) % 3])] != 1) continue;
      const glm::dvec2 a = c.uv_m[t[k]], d = c.uv_m[t[(k + 1) % 3]] - a;
      const double length = glm::length(d), angle = std::fmod(std::atan2(d.y, d.x) + 2.0 * kPi, kQuarter);
      outline.push_back(a);
      Bin& bin = bins[std::min(kBins - 1, std::size_t(angle / kQuarter * kBins))];
      bin.length += length;
      if (length > bin.longest) {
        bin.longest = length;
        bin.angle = angle;
      }
      whole += length;
    }
  const auto turned = [](glm::dvec2 v, double angle) {
    return glm::dvec2(std::cos(angle) * v.x + std::sin(angle) * v.y, std::cos(angle) * v.y - std::sin(angle) * v.x);
  };
  const auto most = std::ranges::max_element(bins, {}, &Bin::length);
  double angle = most->angle;
  if (most->length < kStraight * whole) {
    constexpr int kAngles = 90;
    double least = std::numeric_limits<double>::infinity();
    for (int i = 0; i < kAngles; ++i) {
      const double at = kQuarter * i / kAngles;
      glm::dvec2 lo(std::numeric_limits<double>::infinity()), hi(-lo);
      for (const glm::dvec2& p : outline) {
        const glm::dvec2 q = turned(p, at);
        lo = glm::min(lo, q);
        hi = glm::max(hi, q);
      }
      if (const double box = (hi.x - lo.x) * (hi.y - lo.y); box < least) {
        least = box;
        angle = at;
      }
    }
  }
  glm::dvec2 lo(std::numeric_limits<double>::infinity());
  for (glm::dvec2& p : c.uv_m) {
    p = turned(p, angle);
    lo = glm::min(lo, p);
  }
  for (glm::dvec2& p : c.uv_m) p -= lo;
}

namespace {

/// Parts of a chart: faces of one side, those that hang together by edges.
template <class Side>
std::vector<FlatChart> parted(const FlatChart& c, Side side) {
  DisjointSets joined(c.faces.size());
  std::unordered_map<std::uint64_t, std::uint32_t> faceAt;
  for (std::uint32_t f = 0; f < c.faces.size(); ++f)
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t a = c.corners[f][k], b = c.corners[f][(k + 1) % 3];
      const auto [it, fresh] = faceAt.try_emplace(std::uint64_t(std::min(a, b)) << 32 | std::max(a, b), f);
      if (!fresh && side(c.corners[f]) == side(c.corners[it->second])) joined.join(f, it->second);
    }
  std::vector<FlatChart> out;
  std::vector<std::uint32_t> partOf(c.faces.size(), kNone);
  std::vector<std::unordered_map<std::uint32_t, std::uint32_t>> vertexOf;
  for (std::uint32_t f = 0; f < c.faces.size(); ++f) {
    std::uint32_t& part = partOf[joined.root(f)];
    if (part == kNone) {
      part = std::uint32_t(out.size());
      out.emplace_back();
      out.back().stretch = c.stretch;
      vertexOf.emplace_back();
    }
    FlatChart& to = out[part];
    to.faces.push_back(c.faces[f]);
    glm::uvec3 t;
    for (int k = 0; k < 3; ++k) {
      const auto [it, fresh] = vertexOf[part].try_emplace(c.corners[f][k], std::uint32_t(to.uv_m.size()));
      if (fresh) to.uv_m.push_back(c.uv_m[c.corners[f][k]]);
      t[k] = it->second;
    }
    to.corners.push_back(t);
  }
  for (FlatChart& part : out) alignChart(part);
  return out;
}

double boxesOf(const std::vector<FlatChart>& charts) {
  double sum = 0.0;
  for (const FlatChart& c : charts) sum += boxOf(c).x * boxOf(c).y;
  return sum;
}

}  // namespace

std::vector<FlatChart> cutSprawling(FlatChart chart, double longest, double leastBox) {
  constexpr std::size_t kFacesToCut = 4;
  const glm::dvec2 box = boxOf(chart);
  const bool tooLong = std::max(box.x, box.y) > longest && chart.faces.size() >= kFacesToCut;
  if (!tooLong && (box.x * box.y < leastBox || areaOf(chart) > kSprawling * box.x * box.y)) return {std::move(chart)};
  const auto middle = [&](const glm::uvec3& t) { return (chart.uv_m[t.x] + chart.uv_m[t.y] + chart.uv_m[t.z]) / (3.0 * box) - 0.5; };
  const int axis = box.x >= box.y ? 0 : 1;
  std::vector<FlatChart> parts = parted(chart, [&](const glm::uvec3& t) { return middle(t)[axis] > 0.0; });
  // Frames and rings: by the side of the box that is nearest.
  std::vector<FlatChart> sides = parted(chart, [&](const glm::uvec3& t) {
    const glm::dvec2 m = middle(t);
    return std::abs(m.x) > std::abs(m.y) ? (m.x > 0.0 ? 0 : 1) : (m.y > 0.0 ? 2 : 3);
  });
  if (!tooLong && boxesOf(sides) < boxesOf(parts)) parts = std::move(sides);
  if (parts.size() == 1) return {std::move(chart)};
  std::vector<FlatChart> out;
  for (FlatChart& part : parts)
    for (FlatChart& p : cutSprawling(std::move(part), longest, leastBox)) out.push_back(std::move(p));
  if (!tooLong && boxesOf(out) > kCutHelps * box.x * box.y) return {std::move(chart)};
  return out;
}

std::optional<ChartPlaces> placeCharts(const std::vector<ChartUse>& uses, const PlaceOptions& options, const Run& run) {
  return Placer(uses, options, run).place();
}

}  // namespace lmc
