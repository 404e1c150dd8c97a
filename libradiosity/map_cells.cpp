#include "libradiosity/map_cells.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <unordered_map>

#include "libscene/parallel.h"

namespace lmc {

namespace {

constexpr double kJoined = 0.995;  // cosine between the normals of neighbour texels of one smooth surface: 5.7 degrees
constexpr double kFold = 0.5;      // of a texel's step: neighbours whose middles lie farther off the tangent plane than this are not joined
constexpr float kFeelerHeight = 0.25f;  // above the surface, in texels
// Error of bilinear interpolation, mean square over a cell, as a share of the sum of squares of the bends that its corners showed along x
// and y when they were middles: (rx t(1-t) + ry s(1-s))^2 has mean rx^2/30 + ry^2/30 + rx ry/18, at most 0.061 (rx^2 + ry^2) where light is
// twice differentiable; a third more for where it is not quite.
constexpr double kErrorOfBend = 1.0 / 12.0;
constexpr double kNextHalving = 1.0 / 16.0;  // of a bend's square, where light is twice differentiable

constexpr int kSampledBlock = 8;  // texels

enum Join : std::uint8_t { kRight = 1, kDown = 2 };

/// Middles of texels in the level.
struct Middles {
  TexelArray<glm::vec3> position_m, normal;
};

Middles middlesOf(const MapLayout& map, const Scene& scene, const TexelMap& texels, const Run& run) {
  Middles m;
  m.position_m = TexelArray<glm::vec3>(std::size_t(map.width) * std::size_t(map.height));
  m.normal = TexelArray<glm::vec3>(m.position_m.size());
  parallelFor(run, texels.tileCount(), 1, [&](std::size_t t) {
    const auto held = texels.held(t);
    const TexelTile& tile = *held;
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x) {
        if (tile.at(x, y).fragmentCount == 0) continue;
        const SurfacePoint p = TexelSampler(scene, tile, tile.at(x, y)).middle();
        const std::size_t i = std::size_t(tile.y0 + y) * std::size_t(map.width) + std::size_t(tile.x0 + x);
        m.position_m[i] = glm::vec3(p.position_m);
        m.normal[i] = glm::vec3(p.normal);
      }
  });
  return m;
}

/// Which texels go on smoothly to the right and downwards.
TexelArray<std::uint8_t> joins(const MapLayout& map, const Middles& at) {
  TexelArray<std::uint8_t> out(at.normal.size());
  const auto joined = [&](std::size_t i, std::size_t k) {
    if (map.chart[i] == kNone || map.chart[i] != map.chart[k] || double(glm::dot(at.normal[i], at.normal[k])) < kJoined) return false;
    const glm::vec3 step = at.position_m[k] - at.position_m[i];
    return double(std::abs(glm::dot(step, at.normal[i]))) <= kFold * double(glm::length(step));
  };
  for (int y = 0; y < map.height; ++y)
    for (int x = 0; x < map.width; ++x) {
      const std::size_t i = std::size_t(y) * std::size_t(map.width) + std::size_t(x);
      if (x + 1 < map.width && joined(i, i + 1)) out[i] |= kRight;
      if (y + 1 < map.height && joined(i, i + std::size_t(map.width))) out[i] |= kDown;
    }
  return out;
}

struct Box {
  int x0 = 1 << 30, y0 = 1 << 30, x1 = -1, y1 = -1;
};

std::vector<Box> chartBoxes(const MapLayout& map) {
  std::vector<Box> boxes;
  for (int y = 0; y < map.height; ++y)
    for (int x = 0; x < map.width; ++x) {
      const std::uint32_t c = map.chart[std::size_t(y) * std::size_t(map.width) + std::size_t(x)];
      if (c == kNone) continue;
      if (c >= boxes.size()) boxes.resize(c + 1);
      Box& b = boxes[c];
      b = {std::min(b.x0, x), std::min(b.y0, y), std::max(b.x1, x), std::max(b.y1, y)};
    }
  return boxes;
}

double mean3(const glm::dvec3& v) { return (v.x + v.y + v.z) / 3.0; }

}  // namespace

MapCells::MapCells(const MapLayout& map, const Scene& scene, const TexelMap& texels, const Tracer& tracer, bool interpolate, const Run& run)
    : map_(map), gathered_(std::size_t(map.width) * std::size_t(map.height), 0) {
  if (!interpolate) {
    for (std::size_t i = 0; i < gathered_.size(); ++i) gathered_[i] = map.chart[i] != kNone;
    return;
  }
  const Run quiet = run.quiet();
  const Middles at = middlesOf(map, scene, texels, quiet);
  const TexelArray<std::uint8_t> joined = joins(map, at);

  // Roots: the rectangle about each chart cut evenly, so that the edges of a rectangular chart are edges of cells; halved until whole.
  const std::vector<Box> boxes = chartBoxes(map);
  std::vector<Cell> open;
  for (std::uint32_t chart = 0; chart < boxes.size(); ++chart) {
    const Box& b = boxes[chart];
    if (b.x1 < 0) continue;
    const int nx = std::max(1, (b.x1 - b.x0 + kWidest - 1) / kWidest), ny = std::max(1, (b.y1 - b.y0 + kWidest - 1) / kWidest);
    for (int j = 0; j < ny; ++j)
      for (int i = 0; i < nx; ++i) {
        open.assign(1, {b.x0 + i * (b.x1 - b.x0) / nx, b.y0 + j * (b.y1 - b.y0) / ny, b.x0 + (i + 1) * (b.x1 - b.x0) / nx,
                        b.y0 + (j + 1) * (b.y1 - b.y0) / ny});
        while (!open.empty()) {
          const Cell c = open.back();
          open.pop_back();
          if (map.chart[index(c.x0, c.y0)] == chart && whole(c, joined)) {
            cells_.push_back(c);
            continue;
          }
          const int w = c.x1 - c.x0, h = c.y1 - c.y0;
          if (w == 0 && h == 0) continue;
          // Of two texels each becomes a cell; longer ones share their middle.
          Cell first = c, second = c;
          if (h > w) {
            first.y1 = c.y0 + h / 2;
            second.y0 = h == 1 ? c.y1 : first.y1;
          } else {
            first.x1 = c.x0 + w / 2;
            second.x0 = w == 1 ? c.x1 : first.x1;
          }
          open.push_back(second);
          open.push_back(first);
        }
      }
  }
  roots_ = std::uint32_t(cells_.size());
  for (std::uint32_t r = 0; r < roots_; ++r) add(cells_[r]);

  // Every root is halved once along each axis, so that its bends are known, and on where a feeler from corner to corner, close above the
  // surface, meets something: what stands there casts shadows that the corners need not see.
  const auto goesOn = [&](int x, int y, int dx, int dy) {
    const int nx = x + dx, ny = y + dy;
    return nx >= 0 && ny >= 0 && nx < map.width && ny < map.height && map.chart[index(nx, ny)] == map.chart[index(x, y)];
  };
  const auto feels = [&](const Cell& c) {
    const int w = c.x1 - c.x0, h = c.y1 - c.y0;
    const glm::vec3 &p00 = at.position_m[index(c.x0, c.y0)], &p10 = at.position_m[index(c.x1, c.y0)],
                    &p01 = at.position_m[index(c.x0, c.y1)];
    const glm::vec3 ex = w > 0 ? (p10 - p00) / float(w) : glm::vec3(0.0f), ey = h > 0 ? (p01 - p00) / float(h) : glm::vec3(0.0f);
    const float height = kFeelerHeight * std::max(glm::length(ex), glm::length(ey)) + tracer.lift_m();
    // Feelers go on for half a texel beyond their corners, so that what stands in a corner's own texel is met. At the end of a chart they
    // stop as far before: a corner in the last texel before a wall may lie in the wall's own plane.
    const auto shift = [&](int x, int y, int dx, int dy, int width, bool along) {
      if (width == 0) return 0.0f;
      if (goesOn(x, y, dx, dy)) return along ? 0.5f : 0.0f;
      return width > 1 ? -0.5f : -0.25f;
    };
    const auto end = [&](int x, int y, bool alongX, bool alongY) {
      const int dx = x == c.x0 ? -1 : 1, dy = y == c.y0 ? -1 : 1;  // outwards
      const std::size_t i = index(x, y);
      return at.position_m[i] + shift(x, y, dx, 0, w, alongX) * float(dx) * ex + shift(x, y, 0, dy, h, alongY) * float(dy) * ey +
             height * at.normal[i];
    };
    std::array<Ray, 6> rays;
    std::size_t n = 0;
    const auto feel = [&](int xa, int ya, int xb, int yb) {
      const bool alongX = xa != xb, alongY = ya != yb;
      if (!alongX && !alongY) return;
      const glm::vec3 from = end(xa, ya, alongX, alongY), to = end(xb, yb, alongX, alongY);
      rays[n++] = {from, to - from, 1.0f};
    };
    feel(c.x0, c.y0, c.x1, c.y0);
    feel(c.x1, c.y0, c.x1, c.y1);
    feel(c.x1, c.y1, c.x0, c.y1);
    feel(c.x0, c.y1, c.x0, c.y0);
    if (w > 0 && h > 0) {
      feel(c.x0, c.y0, c.x1, c.y1);
      feel(c.x1, c.y0, c.x0, c.y1);
    }
    std::array<std::uint8_t, 6> blocked;
    tracer.occluded({rays.data(), n}, {blocked.data(), n}, Purpose::Cells);
    return std::any_of(blocked.begin(), blocked.begin() + std::ptrdiff_t(n), [](std::uint8_t b) { return b != 0; });
  };
  std::vector<std::uint32_t> row(roots_);
  std::iota(row.begin(), row.end(), 0u);
  std::vector<std::uint8_t> stands;
  for (int depth = 0; !row.empty(); ++depth) {
    stands.assign(row.size(), 0);
    parallelFor(quiet, row.size(), 64, [&](std::size_t k) {
      const Cell& c = cells_[row[k]];
      stands[k] = (c.x1 - c.x0 > 1 || c.y1 - c.y0 > 1) && feels(c);
    });
    std::vector<std::uint32_t> next;
    for (std::size_t k = 0; k < row.size(); ++k) {
      if (depth > 0 && !stands[k]) continue;
      std::vector<std::uint32_t> parts{row[k]};
      for (const bool alongY : {false, true}) {
        std::vector<std::uint32_t> halves;
        for (const std::uint32_t p : parts) {
          const Cell c = cells_[p];
          if ((alongY ? c.y1 - c.y0 : c.x1 - c.x0) < 2) {
            halves.push_back(p);
            continue;
          }
          halve(p, alongY);
          halves.push_back(cells_[p].child);
          halves.push_back(cells_[p].child + 1);
        }
        parts = std::move(halves);
      }
      if (parts.size() > 1) next.insert(next.end(), parts.begin(), parts.end());
    }
    row = std::move(next);
  }
}

std::size_t MapCells::blockOf(const Cell& c) const {
  return std::size_t(c.y0 / kSampledBlock) * std::size_t((map_.width + kSampledBlock) / kSampledBlock) + std::size_t(c.x0 / kSampledBlock);
}

template <class F>
void MapCells::forTexels(const Cell& c, F&& f) const {
  for (int y = c.y0; y <= c.y1; ++y)
    for (int x = c.x0; x <= c.x1; ++x) f(index(x, y));
}

std::vector<MapCells::Block> MapCells::blocks(std::size_t probes) {
  if (cells_.empty()) {  // every texel is gathered
    for (int y = 0; y < map_.height; ++y)
      for (int x = 0; x < map_.width; ++x)
        if (gathered_[index(x, y)]) cells_.push_back({x, y, x, y});
    roots_ = std::uint32_t(cells_.size());
  }
  held_.assign(gathered_.size(), 0);
  for (std::uint32_t r = 0; r < roots_; ++r)
    forTexels(cells_[r], [&](std::size_t i) { held_[i] = std::uint8_t(std::min(254, held_[i] + 1)); });
  std::vector<Block> all(blockOf({map_.width, map_.height, 0, 0}) + 1);
  for (std::uint32_t r = 0; r < roots_; ++r) {
    Block& b = all[blockOf(cells_[r])];
    b.cells += 1.0;
    forTexels(cells_[r], [&](std::size_t i) {
      b.texels += 1.0 / double(held_[i]);
      if (gathered_[i]) b.points += 1.0 / double(held_[i]);
    });
  }
  const auto forPoints = [&](const auto& f) {
    for (std::uint32_t r = 0; r < roots_; ++r)
      forTexels(cells_[r], [&](std::size_t i) {
        if (gathered_[i]) f(blockOf(cells_[r]), i);
      });
  };
  // Evenly along the list of each block's points, counted first: lists would be as long as the map.
  std::vector<std::size_t> count(all.size(), 0), passed(all.size(), 0);
  forPoints([&](std::size_t k, std::size_t) { ++count[k]; });
  forPoints([&](std::size_t k, std::size_t i) {
    const std::size_t n = std::min(probes, count[k]), j = all[k].probes.size(), at = passed[k]++;
    if (j < n && at == (2 * j + 1) * count[k] / (2 * n)) all[k].probes.push_back(i);
  });
  std::vector<Block> out;
  for (std::size_t k = 0; k < all.size(); ++k)
    if (all[k].cells > 0.0) {
      out.push_back(all[k]);
      out.back().id = k;
    }
  return out;
}

void MapCells::sample(std::span<const Block> blocks, std::span<const double> sizes, double wanted, std::span<std::uint32_t> chart) {
  // Chances that add up to what is wanted, none above one.
  wanted = std::min(wanted, double(blocks.size()));
  double factor = 0.0;
  for (int pass = 0; pass < 20; ++pass) {
    double sure = 0.0, rest = 0.0;
    for (const double s : sizes) (factor * s >= 1.0 ? sure : rest) += factor * s >= 1.0 ? 1.0 : s;
    const double next = rest > 0.0 ? (wanted - sure) / rest : factor;
    if (next <= factor) break;
    factor = next;
  }
  std::vector<std::size_t> order(blocks.size());
  std::iota(order.begin(), order.end(), std::size_t(0));
  std::ranges::stable_sort(order, {}, [&](std::size_t k) { return blocks[k].texels / blocks[k].cells; });
  std::vector<double> weightOf(blockOf({map_.width, map_.height, 0, 0}) + 1, 0.0);
  double sum = 0.5;
  for (const std::size_t k : order) {
    const double chance = std::min(1.0, factor * sizes[k]);
    if (std::floor(sum + chance) > std::floor(sum)) weightOf[blocks[k].id] = 1.0 / chance;
    sum += chance;
  }
  std::vector<Cell> cells;
  for (std::uint32_t r = 0; r < roots_; ++r) {
    const double w = weightOf[blockOf(cells_[r])];
    if (!(w > 0.0)) continue;
    cells.push_back(cells_[r]);
    weights_.push_back(w);
  }
  const auto points = double(std::ranges::count(gathered_, std::uint8_t(1)));
  roots_ = std::uint32_t(cells.size());
  for (std::size_t at = 0; at < cells.size(); ++at) {
    if (cells[at].child == kNone) continue;
    const std::uint32_t child = cells[at].child;
    cells[at].child = std::uint32_t(cells.size());
    cells.push_back(cells_[child]);
    cells.push_back(cells_[child + 1]);
  }
  cells_ = std::move(cells);
  std::ranges::fill(gathered_, std::uint8_t(0));
  for (const Cell& c : cells_) add(c);
  const double told = estimate([](std::size_t) { return 1.0; }).sum;
  for (double& w : weights_) w *= points / told;  // how many there are is known
  standsFor_.assign(gathered_.size(), 0.0f);
  for (std::uint32_t r = 0; r < roots_; ++r)
    forTexels(cells_[r], [&](std::size_t i) { standsFor_[i] += float(weights_[r] / double(held_[i])); });
  for (std::size_t i = 0; i < standsFor_.size(); ++i)
    if (!(standsFor_[i] > 0.0f)) chart[i] = kNone;
}

MapCells::Estimate MapCells::estimate(const std::function<double(std::size_t texel)>& of) const {
  // Blocks are what was drawn.
  struct Drawn {
    double sum = 0.0, weight = 1.0;
  };
  std::unordered_map<std::size_t, Drawn> blocks;
  Estimate out;
  for (std::uint32_t r = 0; r < roots_; ++r) {
    double sum = 0.0;
    forTexels(cells_[r], [&](std::size_t i) {
      if (gathered_[i]) sum += weights_[r] * of(i) / double(held_[i]);
    });
    Drawn& b = blocks[blockOf(cells_[r])];
    b.sum += sum;
    b.weight = weights_[r];
    out.sum += sum;
  }
  const double n = out.blocks = double(blocks.size()), mean = out.sum / std::max(1.0, n);
  double squares = 0.0;
  for (const auto& [id, b] : blocks) squares += (b.sum - mean) * (b.sum - mean) * std::max(0.0, 1.0 - 1.0 / b.weight);
  if (n > 1.0) out.standardError = std::sqrt(squares * n / (n - 1.0));
  return out;
}

void MapCells::add(const Cell& c) {
  gathered_[index(c.x0, c.y0)] = gathered_[index(c.x1, c.y0)] = gathered_[index(c.x0, c.y1)] = gathered_[index(c.x1, c.y1)] = 1;
}

void MapCells::halve(std::uint32_t id, bool alongY) {
  Cell first = cells_[id], second = first;
  if (alongY)
    first.y1 = second.y0 = (first.y0 + first.y1) / 2;
  else
    first.x1 = second.x0 = (first.x0 + first.x1) / 2;
  cells_[id].child = std::uint32_t(cells_.size());
  cells_[id].alongY = alongY;
  cells_.push_back(first);
  cells_.push_back(second);
  add(first);
  add(second);
}

bool MapCells::whole(const Cell& c, std::span<const std::uint8_t> joined) const {
  for (int y = c.y0; y <= c.y1; ++y)
    for (int x = c.x0; x <= c.x1; ++x) {
      const std::uint8_t j = joined[index(x, y)];
      if ((x < c.x1 && !(j & kRight)) || (y < c.y1 && !(j & kDown))) return false;
    }
  return true;
}

MapCells::Halving MapCells::halvingOf(const Cell& c, const ValueAt& at) const {
  Halving b;
  b.known = true;
  const Cell& first = cells_[c.child];
  for (int line = 0; line < 2; ++line) {
    Value middle, from, to;
    double t = 0.0;
    if (c.alongY) {
      const int x = line == 0 ? c.x0 : c.x1;
      middle = at(index(x, first.y1));
      from = at(index(x, c.y0));
      to = at(index(x, c.y1));
      t = double(first.y1 - c.y0) / (c.y1 - c.y0);
    } else {
      const int y = line == 0 ? c.y0 : c.y1;
      middle = at(index(first.x1, y));
      from = at(index(c.x0, y));
      to = at(index(c.x1, y));
      t = double(first.x1 - c.x0) / (c.x1 - c.x0);
    }
    const glm::dvec3 r = middle.illuminance - (1.0 - t) * from.illuminance - t * to.illuminance;
    b.square += 0.5 * mean3(r * r);
    b.noise += 0.5 * (middle.variance + (1.0 - t) * (1.0 - t) * from.variance + t * t * to.variance);
  }
  return b;
}

template <class F>
void MapCells::forLeaves(const ValueAt& at, F&& f) const {
  struct Open {
    std::uint32_t id, root;
    Bend x, y;
  };
  std::vector<Open> open;
  for (std::uint32_t root = 0; root < roots_; ++root) {
    open.push_back({root, root, {}, {}});
    while (!open.empty()) {
      Open o = open.back();
      open.pop_back();
      const Cell& c = cells_[o.id];
      if (c.child == kNone) {
        f(o.id, o.root, o.x, o.y);
        continue;
      }
      Bend& bend = c.alongY ? o.y : o.x;
      bend = {halvingOf(c, at), bend.last};
      open.push_back({c.child + 1, o.root, o.x, o.y});
      open.push_back({c.child, o.root, o.x, o.y});
    }
  }
}

std::size_t MapCells::refine(const ValueAt& at, const ToleranceAt& tolerance) {
  std::vector<std::pair<std::uint32_t, std::array<bool, 2>>> wanted;
  forLeaves(at, [&](std::uint32_t id, std::uint32_t, const Bend& x, const Bend& y) {
    const Cell& c = cells_[id];
    if (c.x1 - c.x0 < 2 && c.y1 - c.y0 < 2) return;
    Tolerance allowed{1e300, 1e300, 1e300};
    for (const std::size_t i : {index(c.x0, c.y0), index(c.x1, c.y0), index(c.x0, c.y1), index(c.x1, c.y1)}) {
      const Tolerance t = tolerance(i);
      allowed = {std::min(allowed.error, t.error), std::min(allowed.significance, t.significance), std::min(allowed.steep, t.steep)};
    }
    // A shadow's edge in the very middle of a cell looks straight.
    const auto steep = [&](bool alongY) {
      double change2 = 0.0, most = 0.0, noise = 0.0;
      for (int line = 0; line < 2; ++line) {
        const Value from = at(alongY ? index(line == 0 ? c.x0 : c.x1, c.y0) : index(c.x0, line == 0 ? c.y0 : c.y1)),
                    to = at(alongY ? index(line == 0 ? c.x0 : c.x1, c.y1) : index(c.x1, line == 0 ? c.y0 : c.y1));
        const glm::dvec3 d = to.illuminance - from.illuminance;
        change2 += 0.5 * mean3(d * d);
        most = std::max({most, mean3(from.illuminance), mean3(to.illuminance)});
        noise += 0.5 * (from.variance + to.variance);
      }
      return change2 - noise > allowed.steep * allowed.steep * most * most && change2 - noise > allowed.significance * noise;
    };
    const auto bends = [&](const Bend& b, int extent, bool alongY) {
      if (extent < 2) return false;
      if (!b.before.known && steep(alongY)) return true;
      const auto tooMuch = [&](const Halving& h, double share) {
        return h.known && kErrorOfBend * share * h.sure() > 0.5 * allowed.error * allowed.error &&
               h.sure() > allowed.significance * h.noise;
      };
      return !b.last.known || tooMuch(b.last, 1.0) || tooMuch(b.before, kNextHalving);
    };
    const std::array<bool, 2> cut{bends(x, c.x1 - c.x0, false), bends(y, c.y1 - c.y0, true)};
    if (cut[0] || cut[1]) wanted.emplace_back(id, cut);
  });
  const auto before = std::accumulate(gathered_.begin(), gathered_.end(), std::size_t(0));
  for (const auto& [id, cut] : wanted) {
    if (cut[0]) halve(id, false);
    if (!cut[1]) continue;
    if (!cut[0]) {
      halve(id, true);
      continue;
    }
    const std::uint32_t child = cells_[id].child;
    halve(child, true);
    halve(child + 1, true);
  }
  return std::accumulate(gathered_.begin(), gathered_.end(), std::size_t(0)) - before;
}

void MapCells::forInterpolated(const std::function<void(std::size_t, const Corners&, const Weights&)>& f) const {
  // An edge that two cells share is the finer one's: it knows more of it.
  std::vector<std::uint32_t> leaves;
  for (std::uint32_t i = 0; i < cells_.size(); ++i)
    if (cells_[i].child == kNone) leaves.push_back(i);
  const auto area = [&](std::uint32_t i) { return (cells_[i].x1 - cells_[i].x0 + 1) * (cells_[i].y1 - cells_[i].y0 + 1); };
  std::ranges::stable_sort(leaves, [&](std::uint32_t a, std::uint32_t b) { return area(a) > area(b); });
  TexelArray<std::uint32_t> owner(gathered_.size(), kNone);
  for (const std::uint32_t id : leaves)
    for (int y = cells_[id].y0; y <= cells_[id].y1; ++y)
      for (int x = cells_[id].x0; x <= cells_[id].x1; ++x) owner[index(x, y)] = id;
  for (std::size_t i = 0; i < owner.size(); ++i) {
    if (owner[i] == kNone || gathered_[i]) continue;
    const Cell& c = cells_[owner[i]];
    const int x = int(i % std::size_t(map_.width)), y = int(i / std::size_t(map_.width));
    const double s = c.x1 > c.x0 ? double(x - c.x0) / (c.x1 - c.x0) : 0.0, t = c.y1 > c.y0 ? double(y - c.y0) / (c.y1 - c.y0) : 0.0;
    f(i, {index(c.x0, c.y0), index(c.x1, c.y0), index(c.x0, c.y1), index(c.x1, c.y1)},
      {(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t});
  }
}

void MapCells::forErrors(const ValueAt& at, const std::function<void(std::size_t, double, double)>& f) const {
  forLeaves(at, [&](std::uint32_t id, std::uint32_t root, const Bend& x, const Bend& y) {
    const Cell& c = cells_[id];
    double last = 0.0, before = 0.0;
    for (const auto& [bend, extent] : {std::pair(&x, c.x1 - c.x0), std::pair(&y, c.y1 - c.y0)}) {
      if (extent < 2) continue;
      last += bend->last.sure();
      before += bend->before.known ? kNextHalving * bend->before.sure() : bend->last.sure();
    }
    const double texels = (weights_.empty() ? 1.0 : weights_[root]) * std::max(1, c.x1 - c.x0) * std::max(1, c.y1 - c.y0);
    if (last != 0.0) f(index(c.x0, c.y0), kErrorOfBend * texels * last, kErrorOfBend * texels * before);
  });
}

}  // namespace lmc
