#include "libradiosity/cells.h"

#include <algorithm>
#include <cmath>

#include "libradiosity/portal_sight.h"

namespace lmc {

namespace {

constexpr std::size_t kMostCells = 512;
constexpr std::size_t kMostPortals = 8192;
constexpr double kLeastClosed = 0.05;            // of a cell's cut, by its wall: less cuts air and closes nothing
constexpr double kCrack = 2.0;                   // widest crack that is closed, in roundings: one of either side
constexpr std::uint64_t kMostWork = 20'000'000;  // edges looked at: about 0.3 s

struct HalfSpace {
  glm::dvec3 normal{0.0};
  double offset_m = 0.0;  // inside: dot(normal, x) >= offset
};

Polygon2 flat(const FlatWall& w, const Polygon3& p) {
  std::vector<glm::dvec2> out;
  out.reserve(p.size());
  for (const glm::dvec3& x : p) out.push_back(w.flat(x));
  return Polygon2(std::move(out));
}

/// Where the plane of a wall passes through a convex cell.
Polygon3 section(const FlatWall& w, const std::vector<HalfSpace>& cell, double size_m) {
  Polygon3 out;
  for (const glm::dvec2& c : {glm::dvec2(-1, -1), glm::dvec2(1, -1), glm::dvec2(1, 1), glm::dvec2(-1, 1)})
    out.push_back(w.place(size_m * c));
  for (const HalfSpace& h : cell) {
    if (out.size() < 3) return {};
    out = clippedToFront(out, h.offset_m * h.normal, h.normal);
  }
  return out;
}

/// A plane that runs along the cell's own border cuts nothing.
bool runsAlong(const Polygon3& section, const std::vector<HalfSpace>& cell, double within_m) {
  return std::ranges::any_of(cell, [&](const HalfSpace& h) {
    return std::ranges::all_of(section, [&](const glm::dvec3& x) { return glm::dot(h.normal, x) - h.offset_m <= within_m; });
  });
}

struct Range {
  double lowest, highest;
};
Range along(std::span<const glm::dvec3> p, const glm::dvec3& normal, double offset_m) {
  Range r{glm::dot(normal, p[0]) - offset_m, 0.0};
  r.highest = r.lowest;
  for (const glm::dvec3& x : p) {
    const double d = glm::dot(normal, x) - offset_m;
    r.lowest = std::min(r.lowest, d);
    r.highest = std::max(r.highest, d);
  }
  return r;
}

}  // namespace

Cells::Cells(const Scene& scene, double rounding_m) : rounding_m_(rounding_m) {
  const std::vector<FlatWall> walls = flatWalls(scene, rounding_m);
  glm::dvec3 lo(0.0), hi(0.0);
  if (!scene.positions_m.empty()) lo = hi = glm::dvec3(scene.positions_m[0]);
  for (const glm::vec3& p : scene.positions_m) lo = glm::min(lo, glm::dvec3(p)), hi = glm::max(hi, glm::dvec3(p));
  if (!walls.empty()) cut(walls, lo - rounding_m, hi + rounding_m);
  if (count_ < 2) {
    *this = Cells();
    return;
  }
  sight_ = portalSight(count_, portals_, rounding_m);
}

/// The wall that closes most of its section through a cell cuts it, so that rooms come apart before what stands in them does.
void Cells::cut(const std::vector<FlatWall>& walls, const glm::dvec3& lo, const glm::dvec3& hi) {
  struct Open {
    std::vector<HalfSpace> cell;
    std::vector<std::uint32_t> walls;  // that may reach into it
    std::size_t parent = 0;
    int side = -1;
  };
  struct Opening {
    std::size_t node;
    Polygon3 corners;
  };
  std::vector<Opening> openings;
  std::vector<Open> open(1);
  for (int k = 0; k < 3; ++k) {
    glm::dvec3 n(0.0);
    n[k] = 1.0;
    open[0].cell.push_back({n, lo[k]});
    open[0].cell.push_back({-n, -hi[k]});
  }
  for (std::uint32_t w = 0; w < walls.size(); ++w) open[0].walls.push_back(w);
  const double size = 2.0 * (glm::length(lo) + glm::length(hi)), crack = kCrack * rounding_m_;
  std::uint64_t work = 0;
  // Widest first: when the bounds are met, what is left uncut is small.
  for (std::size_t next = 0; next < open.size(); ++next) {
    Open here = std::move(open[next]);
    const auto link = [&](std::int32_t id) {
      if (here.side >= 0) nodes_[here.parent].child[std::size_t(here.side)] = id;
    };
    struct Best {
      double closed = kLeastClosed, area = 0.0;
      std::uint32_t wall = kNone;
      std::vector<Polygon2> parts;
    } best;
    const bool full = count_ + (open.size() - next) >= kMostCells || work >= kMostWork;
    if (!full)
      std::erase_if(here.walls, [&](std::uint32_t w) {
        const FlatWall& wall = walls[w];
        const Polygon3 through = section(wall, here.cell, size);
        if (through.size() < 3 || runsAlong(through, here.cell, 2.0 * crack)) return true;
        const Polygon2 whole = flat(wall, through);
        if (widthOf(whole) <= crack) return true;
        std::vector<Polygon2> parts = openParts(wall, whole, crack, work, kMostWork);
        double left = 0.0;
        for (const Polygon2& p : parts) left += p.area();
        const double closed = 1.0 - left / whole.area();
        if (closed > best.closed + 1e-9 || (closed > best.closed - 1e-9 && whole.area() > best.area && best.wall != kNone))
          best = {closed, whole.area(), w, std::move(parts)};
        return !(closed > 1e-6);
      });
    if (best.wall == kNone) {
      link(~std::int32_t(count_++));
      continue;
    }
    const FlatWall& wall = walls[best.wall];
    const auto id = std::int32_t(nodes_.size());
    link(id);
    nodes_.push_back({wall.normal, wall.offset_m, {}});
    for (const Polygon2& p : best.parts) {
      Opening o{std::size_t(id), {}};
      for (const glm::dvec2& c : p.corners()) o.corners.push_back(wall.place(c));
      openings.push_back(std::move(o));
    }
    std::erase(here.walls, best.wall);
    for (const int side : {0, 1}) {
      Open child{here.cell, here.walls, std::size_t(id), side};
      const double sign = side == 0 ? 1.0 : -1.0;
      child.cell.push_back({sign * wall.normal, sign * wall.offset_m});
      open.push_back(std::move(child));
    }
  }

  // An opening joins the cells that touch it from either side.
  struct Piece {
    std::int32_t at;
    Polygon3 corners;
  };
  const auto pushed = [&](std::int32_t from, const Polygon3& corners) {
    std::vector<Piece> stack{{from, corners}}, out;
    while (!stack.empty()) {
      Piece p = std::move(stack.back());
      stack.pop_back();
      if (p.at < 0) {
        out.push_back(std::move(p));
        continue;
      }
      const Node& n = nodes_[std::size_t(p.at)];
      const Range r = along(p.corners, n.normal, n.offset_m);
      const bool front = r.lowest >= -crack, back = r.highest <= crack;
      if (front || back) {  // both: it lies in the plane, and may touch the cells of both sides
        if (front) stack.push_back({n.child[0], p.corners});
        if (back) stack.push_back({n.child[1], p.corners});
        continue;
      }
      stack.push_back({n.child[0], clippedToFront(p.corners, n.offset_m * n.normal, n.normal)});
      stack.push_back({n.child[1], clippedToFront(p.corners, n.offset_m * n.normal, -n.normal)});
    }
    return out;
  };
  for (const Opening& o : openings) {
    const Node& n = nodes_[o.node];
    for (const Piece& f : pushed(n.child[0], o.corners))
      for (Piece& b : pushed(n.child[1], f.corners))
        portals_.push_back({std::uint32_t(~f.at), std::uint32_t(~b.at), n.normal, n.offset_m, std::move(b.corners)});
    if (portals_.size() <= kMostPortals) continue;
    count_ = 0;  // a level of holes: nothing that could be proved at a bearable cost
    return;
  }
}

void Cells::addCellsOf(const std::array<glm::dvec3, 3>& corners, std::span<std::uint64_t> cells) const {
  struct Piece {
    std::int32_t at;
    Polygon3 corners;
  };
  if (nodes_.empty()) return;
  const glm::dvec3 across = glm::cross(corners[1] - corners[0], corners[2] - corners[0]);
  const glm::dvec3 normal = glm::length(across) > 0.0 ? glm::normalize(across) : glm::dvec3(0.0);
  std::vector<Piece> stack{{0, Polygon3(corners.begin(), corners.end())}};
  while (!stack.empty()) {
    Piece p = std::move(stack.back());
    stack.pop_back();
    if (p.at < 0) {
      cells[std::size_t(~p.at) / 64] |= std::uint64_t(1) << (std::size_t(~p.at) % 64);
      continue;
    }
    const Node& n = nodes_[std::size_t(p.at)];
    const Range r = along(p.corners, n.normal, n.offset_m);
    bool front = r.lowest >= -rounding_m_, back = r.highest <= rounding_m_;
    if (front && back) {
      // In the plane: it looks into the cells that it faces. A sliver that touches the plane with its edge alone is of both.
      const double facing = glm::dot(normal, n.normal);
      front = facing > -0.5;
      back = facing < 0.5;
    }
    if (front) stack.push_back({n.child[0], p.corners});
    if (back) stack.push_back({n.child[1], p.corners});
    if (front || back) continue;
    stack.push_back({n.child[0], clippedToFront(p.corners, n.offset_m * n.normal, n.normal)});
    stack.push_back({n.child[1], clippedToFront(p.corners, n.offset_m * n.normal, -n.normal)});
  }
}

void Cells::addSeen(std::span<const std::uint64_t> from, std::span<std::uint64_t> seen) const {
  for (std::size_t c = 0; c < count_; ++c)
    if ((from[c / 64] >> (c % 64) & 1u) != 0)
      for (std::size_t w = 0; w < words(); ++w) seen[w] |= sight_[c * words() + w];
}

}  // namespace lmc
