#include "libscene/cut_charts.h"

#include <algorithm>
#include <numeric>
#include <queue>

#include "libscene/disjoint_sets.h"
#include "libscene/parallel.h"

namespace lmc {

namespace {

using Faces = std::vector<std::uint32_t>;

constexpr double kPlaceWeight = 0.2;  // of a face's place beside its normal: parts stay compact where normals do not tell
constexpr int kRounds = 4;            // of Lloyd's iteration
constexpr int kStraightenings = 4;    // of the border between two parts

/// What stands for a part: mean normal and centre.
struct Proxy {
  glm::dvec3 normal, centre_m;
};

struct Splitter {
  const Surface& s;
  const Faces& faces;
  const FaceSets& sets;
  double unit_m2;

  Splitter(const Surface& surface, const Faces& f, const FaceSets& of) : s(surface), faces(f), sets(of), unit_m2(0.0) {
    for (const std::uint32_t i : faces)
      unit_m2 = std::max(unit_m2, glm::dot(s.centres_m[i] - s.centres_m[faces[0]], s.centres_m[i] - s.centres_m[faces[0]]));
    if (unit_m2 == 0.0) unit_m2 = 1.0;
  }

  double distance(std::uint32_t face, const Proxy& p) const {
    const glm::dvec3 dn = s.normals[face] - p.normal, dc = s.centres_m[face] - p.centre_m;
    return glm::dot(dn, dn) + kPlaceWeight * glm::dot(dc, dc) / unit_m2;
  }
  Proxy of(std::uint32_t face) const { return {s.normals[face], s.centres_m[face]}; }
  Proxy mean(const std::vector<std::uint8_t>& label, int which) const {
    Proxy p{glm::dvec3(0.0), glm::dvec3(0.0)};
    double area = 0.0;
    for (std::size_t i = 0; i < faces.size(); ++i) {
      if (which >= 0 && label[i] != which) continue;
      const double a = s.areas_m2[faces[i]];
      p.normal += a * s.normals[faces[i]];
      p.centre_m += a * s.centres_m[faces[i]];
      area += a;
    }
    const double length = glm::length(p.normal);
    return {length > 0.0 ? p.normal / length : glm::dvec3(0.0), area > 0.0 ? p.centre_m / area : s.centres_m[faces[0]]};
  }
  /// The face of the label that is nearest to its proxy or, with `farthest`, farthest from it.
  std::size_t pick(const Proxy& p, const std::vector<std::uint8_t>& label, int which, bool farthest) const {
    std::size_t best = faces.size();
    double value = 0.0;
    for (std::size_t i = 0; i < faces.size(); ++i) {
      if (which >= 0 && label[i] != which) continue;
      const double d = distance(faces[i], p);
      if (best == faces.size() || (farthest ? d > value : d < value)) {
        best = i;
        value = d;
      }
    }
    return best;
  }

  /// Grows both parts from their seeds, the face nearest to its proxy first; each hangs together.
  void flood(const std::array<std::size_t, 2>& seeds, const std::array<Proxy, 2>& proxies, std::vector<std::uint8_t>& label) const {
    struct Offer {
      double distance;
      std::uint32_t face;
      std::uint8_t label;
      bool operator<(const Offer& o) const {
        return distance != o.distance ? distance > o.distance : face != o.face ? face > o.face : label > o.label;
      }
    };
    constexpr std::uint8_t kOpen = 2;
    std::ranges::fill(label, kOpen);
    const std::uint32_t set = sets.set[faces[0]];
    std::priority_queue<Offer> offers;
    const auto take = [&](std::size_t i, std::uint8_t l) {
      label[i] = l;
      for (const std::uint32_t n : s.neighbours[faces[i]])
        if (n != kNone && sets.set[n] == set) offers.push({distance(n, proxies[l]), n, l});
    };
    for (std::uint8_t l = 0; l < 2; ++l) take(seeds[l], l);
    while (!offers.empty()) {
      const Offer o = offers.top();
      offers.pop();
      if (const std::uint32_t i = sets.number[o.face]; label[i] == kOpen) take(i, o.label);
    }
  }

  /// Faces with two sides on the border between the parts go over: each makes it shorter, and leaves both parts in one piece.
  void straighten(std::vector<std::uint8_t>& label) const {
    const std::uint32_t set = sets.set[faces[0]];
    std::array<std::size_t, 2> count{};
    for (const std::uint8_t l : label) ++count[l];
    for (int pass = 0; pass < kStraightenings; ++pass)
      for (std::size_t i = 0; i < faces.size(); ++i) {
        int same = 0, other = 0;
        for (const std::uint32_t n : s.neighbours[faces[i]])
          if (n != kNone && sets.set[n] == set) ++(label[sets.number[n]] == label[i] ? same : other);
        if (other < 2 || same > 1 || count[label[i]] == 1) continue;
        --count[label[i]];
        label[i] ^= 1;
        ++count[label[i]];
      }
  }

  std::array<Faces, 2> split() const {
    std::vector<std::uint8_t> label(faces.size(), 0);
    std::array<std::size_t, 2> seeds;
    seeds[0] = pick(mean(label, -1), label, -1, true);
    seeds[1] = pick(of(faces[seeds[0]]), label, -1, true);
    if (seeds[0] == seeds[1]) seeds[1] = seeds[0] == 0 ? 1 : 0;  // faces that lie on each other
    std::array<Proxy, 2> proxies{of(faces[seeds[0]]), of(faces[seeds[1]])};
    for (int round = 0;; ++round) {
      flood(seeds, proxies, label);
      if (round == kRounds) break;
      const std::array<std::size_t, 2> before = seeds;
      for (int l = 0; l < 2; ++l) {
        proxies[std::size_t(l)] = mean(label, l);
        seeds[std::size_t(l)] = pick(proxies[std::size_t(l)], label, l, false);
      }
      if (seeds == before) break;
    }
    straighten(label);
    std::array<Faces, 2> out;
    for (std::size_t i = 0; i < faces.size(); ++i) out[label[i] == 1 ? 1 : 0].push_back(faces[i]);
    return out;
  }
};

/// Sets of `faces` that hang together, each in order.
std::vector<Faces> components(const Surface& s, const Faces& faces) {
  enum : std::uint8_t { Outside, Open, Seen };
  std::vector<std::uint8_t> state(s.triangles.size(), Outside);
  for (const std::uint32_t f : faces) state[f] = Open;
  std::vector<Faces> out;
  for (const std::uint32_t f : faces) {
    if (state[f] != Open) continue;
    Faces part{f};
    state[f] = Seen;
    for (std::size_t i = 0; i < part.size(); ++i)
      for (const std::uint32_t n : s.neighbours[part[i]])
        if (n != kNone && state[n] == Open) {
          state[n] = Seen;
          part.push_back(n);
        }
    std::ranges::sort(part);
    out.push_back(std::move(part));
  }
  return out;
}

}  // namespace

std::vector<FlatChart> cutCharts(const Surface& s, std::vector<std::uint32_t> faces, const Run& run) {
  std::vector<FlatChart> out;
  std::vector<Faces> open = components(s, faces);
  FaceSets sets{std::vector<std::uint32_t>(s.triangles.size(), kNone), std::vector<std::uint32_t>(s.triangles.size(), 0)};
  std::uint32_t set = 0;  // a new number for every set: what became a chart keeps its own
  while (!open.empty()) {
    for (const Faces& part : open) {
      for (std::uint32_t i = 0; i < part.size(); ++i) {
        sets.set[part[i]] = set;
        sets.number[part[i]] = i;
      }
      ++set;
    }
    struct Result {
      std::optional<FlatChart> chart;
      std::array<Faces, 2> halves;
    };
    std::vector<Result> results(open.size());
    parallelFor(run.quiet(), open.size(), 1, [&](std::size_t i) {
      results[i].chart = flatten(s, open[i], sets, kMaxChartStretch);
      if (!results[i].chart) results[i].halves = Splitter(s, open[i], sets).split();
    });
    std::vector<Faces> next;
    for (Result& r : results)
      if (r.chart)
        out.push_back(std::move(*r.chart));
      else
        for (Faces& half : r.halves) next.push_back(std::move(half));
    open = std::move(next);
  }
  return out;
}

KnownCharts knownCharts(const Scene& scene, const Object& o, const Surface& s, double maxStretch) {
  // Vertices of one place in the map are one; faces that share one are a chart.
  std::vector<std::uint32_t> order(o.vertexCount), vertexOf(o.vertexCount);
  std::iota(order.begin(), order.end(), 0u);
  const auto uv = [&](std::uint32_t v) { return scene.mapUv[o.firstVertex + v]; };
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return uv(a).x != uv(b).x ? uv(a).x < uv(b).x : uv(a).y != uv(b).y ? uv(a).y < uv(b).y : a < b;
  });
  for (std::size_t i = 0; i < order.size(); ++i)
    vertexOf[order[i]] = i > 0 && uv(order[i]) == uv(order[i - 1]) ? vertexOf[order[i - 1]] : order[i];
  DisjointSets joined(o.vertexCount);
  const auto corner = [&](std::uint32_t face, int k) { return vertexOf[scene.triangles[o.firstTriangle + face][k] - o.firstVertex]; };
  for (std::uint32_t f = 0; f < o.triangleCount; ++f)
    for (int k = 1; k < 3; ++k) joined.join(corner(f, 0), corner(f, k));
  std::vector<std::uint32_t> chartOf(o.vertexCount, kNone);
  std::vector<Faces> sets;
  for (std::uint32_t f = 0; f < o.triangleCount; ++f) {
    std::uint32_t& c = chartOf[joined.root(corner(f, 0))];
    if (c == kNone) {
      c = std::uint32_t(sets.size());
      sets.emplace_back();
    }
    sets[c].push_back(f);
  }
  KnownCharts out;
  std::vector<std::uint32_t> number(o.vertexCount, kNone);
  for (Faces& faces : sets) {
    FlatChart chart;
    chart.faces = faces;
    std::vector<std::uint32_t> used;
    double area_m2 = 0.0, flat = 0.0;
    for (const std::uint32_t f : faces) {
      glm::uvec3 t;
      for (int k = 0; k < 3; ++k) {
        const std::uint32_t v = corner(f, k);
        if (number[v] == kNone) {
          number[v] = std::uint32_t(chart.uv_m.size());
          chart.uv_m.push_back(glm::dvec2(uv(v)));
          used.push_back(v);
        }
        t[k] = number[v];
      }
      chart.corners.push_back(t);
      area_m2 += s.areas_m2[f];
      const glm::dvec2 a = chart.uv_m[t.x], b = chart.uv_m[t.y] - a, c = chart.uv_m[t.z] - a;
      flat += b.x * c.y - b.y * c.x;
    }
    for (const std::uint32_t v : used) number[v] = kNone;
    if (flat < 0.0)
      for (glm::dvec2& v : chart.uv_m) v.x = -v.x;
    if (acceptChart(chart, s, maxStretch))
      out.charts.push_back(std::move(chart));
    else
      out.other.insert(out.other.end(), faces.begin(), faces.end());
  }
  std::ranges::sort(out.other);
  return out;
}

}  // namespace lmc
