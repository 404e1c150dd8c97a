#include "libradiosity/seams.h"

#include <algorithm>
#include <cmath>

#include "libradiosity/seam_solve.h"
#include "libscene/disjoint_sets.h"
#include "libscene/parallel.h"
#include "libscene/polygon2.h"
#include "libscene/tracer.h"

namespace lmc {

namespace {

constexpr double kOnePlace = 1e-6;     // of a map's side: nearer than that two places of a map are one, and nothing parts their texels
constexpr double kPlacesPerTexel = 2;  // of the finer side
constexpr double kNoWeight = 1e-9;     // of a texel in a lookup: rounding at the border of the footprint
constexpr double kSlopeShare = 0.5, kPaddingSlopeShare = 1.5, kGoalShare = 0.25, kMostMove = 0.5;  // see closeSeams
constexpr double kMoved = 1e-3;

bool placed(const Scene& scene, std::uint32_t t) {
  const Object& o = scene.objectOf(t);
  if (!o.receive || !o.inMap || isDegenerate(scene.corners_m(t))) return false;
  const glm::uvec3 v = scene.triangles[t];
  const glm::dvec2 a(scene.mapUv[v.x]), b(scene.mapUv[v.y]), c(scene.mapUv[v.z]);
  return Polygon2::cross(b - a, c - a) != 0.0;
}

glm::dvec3 faceNormal(const Scene& scene, std::uint32_t t) {
  const auto c = scene.corners_m(t);
  return glm::normalize(glm::cross(c[1] - c[0], c[2] - c[0]));
}

bool isSmooth(const Scene& scene, const SharedEdge& e) {
  static const double minNormalCos = std::cos(kSeamNormal_rad), minFaceCos = std::cos(kSeamBend_rad);
  for (int end = 0; end < 2; ++end) {
    const glm::dvec3 a(scene.normals[e.vertex[0][end]]), b(scene.normals[e.vertex[1][end]]);
    if (!(glm::dot(a, b) >= minNormalCos * glm::length(a) * glm::length(b))) return false;
  }
  return glm::dot(faceNormal(scene, e.triangle[0]), faceNormal(scene, e.triangle[1])) >= minFaceCos;
}

bool onePlaceInTheMap(const Scene& scene, const SharedEdge& e) {
  if (scene.objectOf(e.triangle[0]).map != scene.objectOf(e.triangle[1]).map) return false;
  for (int end = 0; end < 2; ++end) {
    const glm::dvec2 d = glm::abs(glm::dvec2(scene.mapUv[e.vertex[0][end]]) - glm::dvec2(scene.mapUv[e.vertex[1][end]]));
    if (std::max(d.x, d.y) > kOnePlace) return false;
  }
  return true;
}

/// A bilinear lookup: four texels, and their shares.
struct Lookup {
  std::array<std::uint32_t, 4> texel;
  std::array<float, 4> weight;
};

/// Reads clamp at the border of a map.
Lookup lookupAt(glm::dvec2 place, std::uint32_t map, int side) {
  const glm::dvec2 p = place - 0.5, f = glm::floor(p), w = p - f;
  const int top = int(map) * side;
  const auto index = [&](int dx, int dy) {
    const int x = std::clamp(int(f.x) + dx, 0, side - 1), y = std::clamp(int(f.y) + dy, top, top + side - 1);
    return std::uint32_t(y) * std::uint32_t(side) + std::uint32_t(x);
  };
  return {{index(0, 0), index(1, 0), index(0, 1), index(1, 1)},
          {float((1.0 - w.x) * (1.0 - w.y)), float(w.x * (1.0 - w.y)), float((1.0 - w.x) * w.y), float(w.x * w.y)}};
}

/// A place on a seam, seen from both sides.
struct Place {
  std::array<Lookup, 2> side;
  std::array<std::uint32_t, 2> at;     // the texels in which it lies
  std::array<std::uint32_t, 2> chart;  // of the sides
  float length;                        // that it stands for [texels of the finer side]
};

std::vector<Place> placesOf(const Scene& scene, const Charts& charts, const Seams& seams, int side) {
  std::vector<Place> out;
  for (const SharedEdge& e : seams.smooth) {
    std::array<std::array<glm::dvec2, 2>, 2> end;
    double length = 0.0;
    for (std::size_t s = 0; s < 2; ++s) {
      for (int k = 0; k < 2; ++k) end[s][std::size_t(k)] = scene.mapPlace(scene.objectOf(e.triangle[s]), e.vertex[s][k], side);
      length = std::max(length, glm::distance(end[s][0], end[s][1]));
    }
    const auto n = std::max(1u, std::uint32_t(std::ceil(kPlacesPerTexel * length)));
    for (std::uint32_t i = 0; i < n; ++i) {
      Place p;
      p.length = float(length / n);
      for (std::size_t s = 0; s < 2; ++s) {
        const glm::dvec2 at = glm::mix(end[s][0], end[s][1], (i + 0.5) / n);
        const std::uint32_t map = scene.objectOf(e.triangle[s]).map;
        p.side[s] = lookupAt(at, map, side);
        const glm::dvec2 top(0.0, double(map) * side), in = glm::clamp(at - top, glm::dvec2(0.0), glm::dvec2(side - 1)) + top;
        p.at[s] = std::uint32_t(in.y) * std::uint32_t(side) + std::uint32_t(in.x);
        p.chart[s] = charts.chartOf[e.triangle[s]];
      }
      out.push_back(p);
    }
  }
  return out;
}

/// A map's values as the seams see them.
class Shown {
 public:
  Shown(LightMapValues& values, const LightMap& map, const Padding& padding) : values_(values), map_(map), padding_(padding) {}
  double at(std::uint32_t texel, int c) const { return double(values_.direct[texel][c]) + double(values_.indirect[texel][c]); }
  glm::dvec3 at(const Lookup& l) const {
    glm::dvec3 sum(0.0);
    for (std::size_t k = 0; k < 4; ++k)
      for (int c = 0; c < 3; ++c) sum[c] += double(l.weight[k]) * at(l.texel[k], c);
    return sum;
  }
  bool covered(std::uint32_t texel) const { return map_.chart[texel] != kNone; }
  /// Whether a seam of a chart may move it: the chart's own, or padding that no other chart reads.
  bool movable(std::uint32_t texel, std::uint32_t chart) const {
    const std::uint32_t from = padding_.from[texel];
    return from != kNone && map_.chart[from] == chart && (covered(texel) || !std::ranges::binary_search(padding_.contested, texel));
  }
  /// By how much the value may be off [lx], and how far it may move.
  std::pair<double, double> sigmaAndLimit(std::uint32_t texel, int c, double goal) const {
    const std::uint32_t i = padding_.from[texel];
    const double value = at(texel, c), error = double(values_.error[i][c]);
    const double bound = (covered(texel) ? kSlopeShare : kPaddingSlopeShare) * slope(i, c) + kGoalShare * goal * value;
    return {error + bound, std::min(kSeamErrors * error + kSeamBounds * bound, kMostMove * value)};
  }
  void set(std::uint32_t texel, int c, double value) {
    const double factor = value / at(texel, c);
    values_.direct[texel][c] = float(factor * double(values_.direct[texel][c]));
    values_.indirect[texel][c] = float(factor * double(values_.indirect[texel][c]));
  }

 private:
  /// Largest difference from a neighbour of the same chart.
  double slope(std::uint32_t i, int c) const {
    double largest = 0.0;
    const int x = int(i % std::uint32_t(map_.width)), y = int(i / std::uint32_t(map_.width));
    const auto look = [&](bool inside, std::uint32_t k) {
      if (inside && map_.chart[k] == map_.chart[i]) largest = std::max(largest, std::abs(at(k, c) - at(i, c)));
    };
    look(x > 0, i - 1);
    look(x + 1 < map_.width, i + 1);
    look(y > 0, i - std::uint32_t(map_.width));
    look(y + 1 < map_.height, i + std::uint32_t(map_.width));
    return largest;
  }

  LightMapValues& values_;
  const LightMap& map_;
  const Padding& padding_;
};

double mean3(const glm::dvec3& v) { return (v.x + v.y + v.z) / 3.0; }

/// Differences across all places; `relative` gets one a place.
SeamJump jumpOf(const Shown& shown, const std::vector<Place>& places, double least, std::vector<float>& relative) {
  SeamJump jump;
  double squares = 0.0, relativeSquares = 0.0, length = 0.0;
  relative.resize(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) {
    const glm::dvec3 a = shown.at(places[i].side[0]), b = shown.at(places[i].side[1]), d = glm::abs(a - b);
    const double against = std::max(0.5 * mean3(a + b), least), largest = std::max({d.x, d.y, d.z});
    const double square = glm::dot(d, d) / 3.0, share = against > 0.0 ? largest / against : 0.0;
    relative[i] = float(share);
    squares += double(places[i].length) * square;
    if (against > 0.0) relativeSquares += double(places[i].length) * square / (against * against);
    length += double(places[i].length);
    jump.largest = std::max(jump.largest, largest);
    jump.relativeLargest = std::max(jump.relativeLargest, share);
  }
  if (length > 0.0) {
    jump.rms = std::sqrt(squares / length);
    jump.relativeRms = std::sqrt(relativeSquares / length);
  }
  return jump;
}

/// Unknowns, and which of them hang together by lookups.
struct Unknowns {
  std::vector<std::uint32_t> texel;            // in order
  std::vector<std::uint32_t> component;        // of each unknown, numbered in order of their first unknowns
  std::vector<std::uint32_t> local;            // number of each unknown in its component
  std::vector<std::vector<std::uint32_t>> of;  // unknowns of each component
  std::vector<std::vector<std::uint32_t>> placesOf;

  std::uint32_t find(std::uint32_t t) const {
    const auto it = std::ranges::lower_bound(texel, t);
    return it != texel.end() && *it == t ? std::uint32_t(it - texel.begin()) : kNone;
  }
};

template <class F>
void forMovable(const Shown& shown, const Place& place, F&& f) {
  for (std::size_t s = 0; s < 2; ++s)
    for (std::size_t k = 0; k < 4; ++k)
      if (place.side[s].weight[k] > kNoWeight && shown.movable(place.side[s].texel[k], place.chart[s])) f(place.side[s].texel[k]);
}

Unknowns unknownsOf(const Shown& shown, const std::vector<Place>& places) {
  Unknowns u;
  for (const Place& p : places) forMovable(shown, p, [&](std::uint32_t t) { u.texel.push_back(t); });
  std::ranges::sort(u.texel);
  u.texel.erase(std::ranges::unique(u.texel).begin(), u.texel.end());

  DisjointSets joined(u.texel.size());
  std::vector<std::uint32_t> firstOf(places.size(), kNone);  // an unknown of each place
  for (std::size_t i = 0; i < places.size(); ++i)
    forMovable(shown, places[i], [&](std::uint32_t t) {
      const std::uint32_t n = u.find(t);
      if (firstOf[i] == kNone) firstOf[i] = n;
      joined.join(firstOf[i], n);
    });
  u.component.resize(u.texel.size());
  u.local.resize(u.texel.size());
  for (std::uint32_t i = 0; i < u.texel.size(); ++i) {
    const std::uint32_t root = joined.root(i);
    if (root == i) {
      u.component[i] = std::uint32_t(u.of.size());
      u.of.emplace_back();
    }
    u.component[i] = u.component[root];
    u.local[i] = std::uint32_t(u.of[u.component[i]].size());
    u.of[u.component[i]].push_back(i);
  }
  u.placesOf.resize(u.of.size());
  for (std::uint32_t i = 0; i < places.size(); ++i)
    if (firstOf[i] != kNone) u.placesOf[u.component[firstOf[i]]].push_back(i);
  return u;
}

/// One channel of the unknowns of one component.
struct Closed {
  std::vector<double> value, limit;  // limit 0: it could not move
};

Closed closeComponent(const Shown& shown, const std::vector<Place>& places, const Unknowns& u, std::uint32_t component, int c,
                      double goal) {
  SeamSystem system;
  // A texel without light keeps it: none is carried there.
  std::vector<std::uint32_t> number(u.of[component].size(), kNone);
  for (std::size_t k = 0; k < number.size(); ++k) {
    const std::uint32_t texel = u.texel[u.of[component][k]];
    const auto [sigma, limit] = shown.sigmaAndLimit(texel, c, goal);
    if (!(limit > 0.0)) continue;
    number[k] = std::uint32_t(system.value.size());
    system.value.push_back(shown.at(texel, c));
    system.sigma.push_back(sigma);
    system.limit.push_back(limit);
  }
  for (const std::uint32_t index : u.placesOf[component]) {
    const Place& place = places[index];
    SeamEquation e;
    for (std::size_t s = 0; s < 2; ++s)
      for (std::size_t k = 0; k < 4; ++k) {
        const Lookup& l = place.side[s];
        if (!(l.weight[k] > kNoWeight)) continue;
        const double weight = s == 0 ? double(l.weight[k]) : -double(l.weight[k]);
        const std::uint32_t found = shown.movable(l.texel[k], place.chart[s]) ? u.find(l.texel[k]) : kNone;
        const std::uint32_t n = found == kNone ? kNone : number[u.local[found]];
        if (n == kNone) {
          e.constant += weight * shown.at(l.texel[k], c);
          continue;
        }
        const auto known = std::find(e.unknown.begin(), e.unknown.begin() + e.count, n);
        if (known == e.unknown.begin() + e.count) e.unknown[e.count++] = n;
        e.weight[std::size_t(known - e.unknown.begin())] += weight;
      }
    if (e.count == 0) continue;
    double sigma = 0.0;
    for (std::uint32_t k = 0; k < e.count; ++k) sigma += std::abs(e.weight[k]) * system.sigma[e.unknown[k]];
    if (!(sigma > 0.0)) continue;
    e.strength = kSeamPull * std::sqrt(double(place.length)) / sigma;
    system.equations.push_back(e);
  }
  const std::vector<double> x = solveSeams(system);
  Closed out;
  for (std::size_t k = 0; k < number.size(); ++k) {
    const std::uint32_t texel = u.texel[u.of[component][k]];
    out.value.push_back(number[k] == kNone ? shown.at(texel, c) : x[number[k]]);
    out.limit.push_back(number[k] == kNone ? 0.0 : system.limit[number[k]]);
  }
  return out;
}

}  // namespace

Seams findSeams(const Scene& scene) {
  Seams out;
  for (const SharedEdge& e : sharedEdges(scene, [&](std::uint32_t t) { return placed(scene, t); })) {
    if (onePlaceInTheMap(scene, e)) continue;
    if (isSmooth(scene, e))
      out.smooth.push_back(e);
    else
      ++out.creases;
  }
  return out;
}

void fillPadding(LightMapValues& values, const Padding& padding) {
  forRepeated(padding, [&](std::size_t to, std::uint32_t from) {
    values.direct[to] = values.direct[from];
    values.indirect[to] = values.indirect[from];
    values.error[to] = values.error[from];
  });
}

SeamResult closeSeams(LightMapValues& values, const LightMap& map, const Scene& scene, const Charts& charts, const Padding& padding,
                      const Seams& seams, double goal, const Run& run) {
  fillPadding(values, padding);
  SeamResult out;
  if (seams.smooth.empty()) return out;
  Shown shown(values, map, padding);
  double sum = 0.0, covered = 0.0;
  for (std::uint32_t i = 0; i < map.size(); ++i) {
    if (map.chart[i] == kNone) continue;
    sum += (shown.at(i, 0) + shown.at(i, 1) + shown.at(i, 2)) / 3.0;
    covered += 1.0;
  }
  const double least = covered > 0.0 ? kDimRoom * sum / covered : 0.0;

  const std::vector<Place> places = placesOf(scene, charts, seams, map.width);
  std::vector<float> before, after;
  out.before = jumpOf(shown, places, least, before);
  const Unknowns u = unknownsOf(shown, places);
  for (const std::uint32_t t : u.texel) ++(shown.covered(t) ? out.texels : out.padding);
  // A component's channel is one system, solved by one thread: the same bits for any number of them.
  std::vector<Closed> closed(3 * u.of.size());
  parallelFor(run, closed.size(), 1,
              [&](std::size_t i) { closed[i] = closeComponent(shown, places, u, std::uint32_t(i / 3), int(i % 3), goal); });
  double moves2 = 0.0;
  for (std::uint32_t i = 0; i < u.texel.size(); ++i) {
    bool moved = false, limited = false;
    for (int c = 0; c < 3; ++c) {
      const Closed& s = closed[3 * std::size_t(u.component[i]) + std::size_t(c)];
      const double was = shown.at(u.texel[i], c), limit = s.limit[u.local[i]], now = s.value[u.local[i]], move = std::abs(now - was);
      if (!(limit > 0.0) || now == was) continue;
      shown.set(u.texel[i], c, now);
      if (!shown.covered(u.texel[i])) continue;
      moves2 += move * move;
      moved |= move > kMoved * was;
      limited |= move >= limit * (1.0 - 1e-9);
      out.largestMove_lx = std::max(out.largestMove_lx, move);
      out.largestMove = std::max(out.largestMove, move / was);
    }
    out.moved += moved;
    out.limited += limited;
  }
  if (sum > 0.0) out.rmsMove = std::sqrt(moves2 / (3.0 * covered)) / (sum / covered);
  // What repeats a texel that moved follows it, but for padding that has a value of its own now.
  std::size_t next = 0;  // of the unknowns, which are in order
  for (std::uint32_t i = 0; i < map.size(); ++i) {
    while (next < u.texel.size() && u.texel[next] < i) ++next;
    const bool own = next < u.texel.size() && u.texel[next] == i;
    const std::uint32_t from = padding.from[i];
    if (from == kNone || from == i || own) continue;
    values.direct[i] = values.direct[from];
    values.indirect[i] = values.indirect[from];
  }
  out.after = jumpOf(shown, places, least, after);
  out.samples.reserve(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) out.samples.push_back({places[i].at, before[i], after[i]});
  return out;
}

}  // namespace lmc
