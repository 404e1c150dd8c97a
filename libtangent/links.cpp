#include "libtangent/links.h"

#include <algorithm>

namespace lmc::tangent {

namespace {

std::uint64_t sideOf(std::uint32_t other, std::size_t place, bool leaving) {
  return std::uint64_t(other) << 32 | place << 1 | (leaving ? 1 : 0);
}
std::uint32_t otherOf(std::uint64_t side) { return std::uint32_t(side >> 32); }
std::uint32_t placeOf(std::uint64_t side) { return std::uint32_t(side) >> 1; }
bool leaves(std::uint64_t side) { return side & 1; }

/// Pairs the sides of one edge, given in ascending places. All that wait run the same way, or they would have paired: so the first of them
/// is the right one for whoever comes the other way. The queue lives at the front of what has been read.
void pairEdge(std::span<std::uint64_t> sides, std::vector<Across>& across) {
  const auto set = [&](std::uint64_t side, std::uint32_t neighbour) {
    (leaves(side) ? across[placeOf(side)].leaving : across[placeOf(side)].coming) = neighbour;
  };
  std::size_t head = 0, tail = 0;
  for (const std::uint64_t side : sides) {
    if (head < tail && leaves(sides[head]) != leaves(side)) {
      set(side, placeOf(sides[head]));
      set(sides[head++], placeOf(side));
    } else {
      sides[tail++] = side;
    }
  }
}

constexpr std::uint32_t kContested =
    16;  // Frame::flags, here alone: no group has reached this frameless triangle yet, and groups may differ

/// Which orientations the triangles with a frame round a vertex have, each vertex looked at once.
class RingWays {
 public:
  RingWays(const Rings& rings, const Frames& frames) : rings_(rings), frames_(frames), known_(rings.start.size() - 1, 0) {}
  std::uint8_t of(std::uint32_t id) {
    if (known_[id] == 0) {
      known_[id] = kKnown;
      for (const RingCorner c : rings_.of(id)) {
        const std::uint32_t flags = frames_.of[triangleOf(c)].flags;
        if (!(flags & kFrameless)) known_[id] |= flags & kPreserving ? kRight : kLeft;
      }
    }
    return known_[id];
  }
  static constexpr std::uint8_t kLeft = 1, kRight = 2, kKnown = 4;

 private:
  const Rings& rings_;
  const Frames& frames_;
  std::vector<std::uint8_t> known_;
};

/// The rings that touch a contested triangle, followed as the reference does.
class Contest {
 public:
  Contest(const Mesh& mesh, const Rings& rings, Frames& frames) : mesh_(mesh), rings_(rings), frames_(frames) {}

  void add(std::uint32_t id) { ids_.push_back(id); }

  void settle() {
    std::ranges::sort(ids_);
    ids_.erase(std::unique(ids_.begin(), ids_.end()), ids_.end());
    LinkScratch scratch;
    std::vector<Across> across;
    std::vector<std::pair<RingCorner, std::uint32_t>> starts;
    for (const std::uint32_t id : ids_) {
      const std::span<const RingCorner> ring = rings_.of(id);
      linkRing(mesh_, ring, scratch, across);
      const std::uint32_t base = std::uint32_t(corners_.size());
      for (std::size_t i = 0; i < ring.size(); ++i) {
        if (!(flagsOf(ring[i]) & kFrameless)) starts.emplace_back(ring[i], base + std::uint32_t(i));
        const auto moved = [&](std::uint32_t place) { return place == kNobody ? kNobody : base + place; };
        across_.push_back({moved(across[i].leaving), moved(across[i].coming)});
        corners_.push_back(ring[i]);
      }
    }
    grouped_.assign(corners_.size(), false);
    std::ranges::sort(starts);
    for (const auto& [corner, place] : starts)
      if (!grouped_[place]) grow(place);
  }

 private:
  std::uint32_t& flagsOf(RingCorner c) { return frames_.of[triangleOf(c)].flags; }

  /// The group that starts at a place. In what order it grows does not matter: all its members have one orientation.
  void grow(std::uint32_t start) {
    const std::uint32_t way = flagsOf(corners_[start]) & kPreserving;
    stack_.assign(1, start);
    while (!stack_.empty()) {
      const std::uint32_t place = stack_.back();
      stack_.pop_back();
      if (place == kNobody || grouped_[place]) continue;
      std::uint32_t& flags = flagsOf(corners_[place]);
      if (flags & kContested) flags = (flags & ~(kContested | kPreserving)) | way;
      if ((flags & kPreserving) != way) continue;
      grouped_[place] = true;
      stack_.push_back(across_[place].coming);
      stack_.push_back(across_[place].leaving);
    }
  }

  const Mesh& mesh_;
  const Rings& rings_;
  Frames& frames_;
  std::vector<std::uint32_t> ids_, stack_;
  std::vector<RingCorner> corners_;
  std::vector<Across> across_;
  std::vector<bool> grouped_;
};

}  // namespace

void linkRing(const Mesh& m, std::span<const RingCorner> ring, LinkScratch& scratch, std::vector<Across>& across) {
  across.assign(ring.size(), {});
  scratch.clear();
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const std::uint32_t* id = &m.ids[3 * std::size_t(triangleOf(ring[i]))];
    const std::uint32_t c = cornerOf(ring[i]);
    scratch.push_back(sideOf(id[kNextCorner[c]], i, true));
    scratch.push_back(sideOf(id[kPreviousCorner[c]], i, false));
  }
  std::ranges::sort(scratch);
  for (std::size_t first = 0, last; first < scratch.size(); first = last) {
    for (last = first + 1; last < scratch.size() && otherOf(scratch[last]) == otherOf(scratch[first]);) ++last;
    pairEdge({scratch.data() + first, last - first}, across);
  }
}

void orientFrameless(const Mesh& m, const Rings& rings, Frames& frames) {
  if (frames.frameless.empty()) return;
  RingWays ways(rings, frames);
  Contest contest(m, rings, frames);
  bool contested = false;
  for (const std::uint32_t t : frames.frameless) {
    std::uint8_t around = 0;
    for (std::size_t c = 0; c < 3; ++c) around |= ways.of(m.ids[3 * std::size_t(t) + c]);
    std::uint32_t& flags = frames.of[t].flags;
    if ((around & RingWays::kLeft) && (around & RingWays::kRight)) {
      flags |= kContested;
      contested = true;
      for (std::size_t c = 0; c < 3; ++c) contest.add(m.ids[3 * std::size_t(t) + c]);
    } else if (around & (RingWays::kLeft | RingWays::kRight)) {
      flags = (flags & ~kPreserving) | (around & RingWays::kRight ? kPreserving : 0u);
    }
  }
  if (contested) contest.settle();
  for (const std::uint32_t t : frames.frameless) frames.of[t].flags &= ~kContested;
}

}  // namespace lmc::tangent
