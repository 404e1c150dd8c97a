#include "libradiosity/portal_sight.h"

#include <algorithm>
#include <cmath>

namespace lmc {

namespace {

constexpr std::uint64_t kMostSteps = 100'000;  // portals looked through, of all cells: about half a second
constexpr double kSharp = 1e-9;                // of the polygons' size: corners this near a plane touch it

using Bits = std::vector<std::uint64_t>;

/// A portal as it is passed in one of its two directions.
struct Passage {
  std::uint32_t to;
  glm::dvec3 normal;  // the way through
  double offset_m;
  const Polygon3* corners;
  Bits reach;  // cells that can lie behind it
};

bool has(const Bits& b, std::uint32_t i) { return (b[i / 64] >> (i % 64) & 1u) != 0; }
void add(Bits& b, std::uint32_t i) { b[i / 64] |= std::uint64_t(1) << (i % 64); }

double size(const Polygon3& p) {
  double most = 0.0;
  for (const glm::dvec3& x : p) most = std::max(most, glm::distance(x, p[0]));
  return most;
}

/// Keeps of `target` what a line through a place of `from` and then one of `through` may meet beyond them. Every plane along an edge of
/// one and a corner of the other that has them on its two sides bounds such lines: they go on to the side of `through` ([teller1991],
/// separating planes). Each plane gives way by as much as it turns when the corners that span it move by `rounding`.
void narrow(Polygon3& target, const Polygon3& from, const Polygon3& through, double rounding) {
  const double sharp = kSharp * (size(from) + size(through) + glm::distance(from[0], through[0]));
  for (const bool swapped : {false, true}) {
    const Polygon3 &edges = swapped ? through : from, &corners = swapped ? from : through;
    for (std::size_t i = 0; i < edges.size(); ++i) {
      const glm::dvec3 a = edges[i], e = edges[(i + 1) % edges.size()] - a;
      const double l = glm::length(e);
      if (!(l > sharp)) continue;
      for (const glm::dvec3& c : corners) {
        const glm::dvec3 across = glm::cross(e, c - a);
        const double h = glm::length(across) / l;  // of c from the edge
        if (!(h > sharp)) continue;
        glm::dvec3 n = across / (h * l);
        const auto sides = [&](const Polygon3& p) {
          double low = 0.0, high = 0.0;
          for (const glm::dvec3& x : p) low = std::min(low, glm::dot(n, x - a)), high = std::max(high, glm::dot(n, x - a));
          return std::pair(low, high);
        };
        const auto [fromLow, fromHigh] = sides(from);
        const auto [throughLow, throughHigh] = sides(through);
        if (fromHigh <= sharp && throughLow >= -sharp && (fromLow < -sharp || throughHigh > sharp)) {
          // as it is
        } else if (fromLow >= -sharp && throughHigh <= sharp && (fromHigh > sharp || throughLow < -sharp)) {
          n = -n;
        } else {
          continue;
        }
        double reach = 0.0;
        for (const glm::dvec3& x : target) reach = std::max(reach, glm::distance(x, a));
        const double give = 2.0 * rounding * (1.0 + reach / h + reach / l);
        target = clippedToFront(target, a - give * n, n);
        if (target.size() < 3) return;
      }
    }
  }
}

class Sight {
 public:
  Sight(std::size_t cells, std::span<const Portal> portals, double rounding_m)
      : rounding_(rounding_m), words_((cells + 63) / 64), out_(cells) {
    for (const Portal& p : portals) {
      if (p.front == p.back) continue;
      out_[p.back].push_back({p.front, p.normal, p.offset_m, &p.corners, {}});
      out_[p.front].push_back({p.back, -p.normal, -p.offset_m, &p.corners, {}});
    }
    for (auto& passages : out_)
      for (Passage& p : passages) flood(p);
  }

  Bits seenFrom(std::uint32_t cell) {
    Bits seen(words_, 0), all(words_, 0);
    add(seen, cell);
    for (const Passage& p : out_[cell]) {
      add(seen, p.to);
      for (std::size_t w = 0; w < words_; ++w) all[w] |= p.reach[w];
    }
    add(all, cell);
    steps_ = 0;
    onPath_.assign(out_.size(), 0);
    onPath_[cell] = 1;
    for (const Passage& p : out_[cell])
      if (!look(p, *p.corners, nullptr, p.reach, seen)) return all;
    return seen;
  }

 private:
  /// Cells behind a passage: portals are passed on only when some of theirs lies beyond it and it lies before them.
  void flood(Passage& p) const {
    p.reach.assign(words_, 0);
    std::vector<std::uint32_t> open{p.to};
    add(p.reach, p.to);
    while (!open.empty()) {
      const std::uint32_t cell = open.back();
      open.pop_back();
      for (const Passage& q : out_[cell]) {
        if (has(p.reach, q.to) || !beyond(*q.corners, p) || !before(*p.corners, q)) continue;
        add(p.reach, q.to);
        open.push_back(q.to);
      }
    }
  }
  bool beyond(const Polygon3& corners, const Passage& p) const {
    return std::ranges::any_of(corners, [&](const glm::dvec3& x) { return glm::dot(p.normal, x) - p.offset_m > -rounding_; });
  }
  bool before(const Polygon3& corners, const Passage& p) const {
    return std::ranges::any_of(corners, [&](const glm::dvec3& x) { return glm::dot(p.normal, x) - p.offset_m < rounding_; });
  }

  /// Lines that came through `source`, last through `last` (none yet: nullptr), and are in the cell behind `at`. False when it takes too
  /// long.
  bool look(const Passage& at, const Polygon3& source, const Polygon3* last, const Bits& may, Bits& seen) {
    onPath_[at.to] = 1;
    bool done = true;
    for (const Passage& q : out_[at.to]) {
      if (onPath_[q.to] != 0) continue;  // a line meets a convex cell once
      Bits mayBehind(words_);
      bool news = false;
      for (std::size_t w = 0; w < words_; ++w) {
        mayBehind[w] = may[w] & q.reach[w];
        news = news || (mayBehind[w] & ~seen[w]) != 0;
      }
      if (!news) continue;
      if (++steps_ > kMostSteps / out_.size()) {
        done = false;
        break;
      }
      Polygon3 target = clippedToFront(*q.corners, (at.offset_m - rounding_) * at.normal, at.normal);
      if (target.size() < 3) continue;
      if (last != nullptr) narrow(target, source, *last, rounding_);
      if (target.size() < 3) continue;
      Polygon3 narrowed = source;
      if (last != nullptr) {
        narrow(narrowed, target, *last, rounding_);
        if (narrowed.size() < 3) continue;
      }
      add(seen, q.to);
      if (!look(q, narrowed, &target, mayBehind, seen)) {
        done = false;
        break;
      }
    }
    onPath_[at.to] = 0;
    return done;
  }

  double rounding_;
  std::size_t words_;
  std::vector<std::vector<Passage>> out_;  // of each cell
  std::vector<std::uint8_t> onPath_;
  std::uint64_t steps_ = 0;
};

}  // namespace

std::vector<std::uint64_t> portalSight(std::size_t cells, std::span<const Portal> portals, double rounding_m) {
  Sight sight(cells, portals, rounding_m);
  const std::size_t words = (cells + 63) / 64;
  std::vector<Bits> seen;
  for (std::uint32_t c = 0; c < cells; ++c) seen.push_back(sight.seenFrom(c));
  // Sight is mutual: one way's proof is the other's.
  std::vector<std::uint64_t> out(cells * words, 0);
  for (std::uint32_t a = 0; a < cells; ++a)
    for (std::uint32_t b = 0; b < cells; ++b)
      if (has(seen[a], b) && has(seen[b], a)) out[a * words + b / 64] |= std::uint64_t(1) << (b % 64);
  return out;
}

}  // namespace lmc
