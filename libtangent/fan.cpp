#include "libtangent/fan.h"

#include <algorithm>
#include <array>
#include <map>

namespace lmc::tangent {

namespace {

// The reference compares all pairs of a group and sums a set for each member. Here only where some pair may be opposite, and only as long
// as that is less than a second's work; beyond it (rings of tens of thousands of different directions, which the reference cannot do at
// all or takes minutes for) the group keeps one tangent.
constexpr std::size_t kMaxClasses = 1 << 15;
constexpr std::size_t kMaxPairs = std::size_t(1) << 27;
constexpr std::size_t kMaxVisits = std::size_t(1) << 29;
constexpr std::size_t kFewClasses = 128;  // all pairs of so few are compared without a grid

constexpr float kAgree = 0.05f;  // cosine: two directions within 87 degrees of a third are less than 175 apart, never opposite
constexpr float kCell = 1.0f / 256;
constexpr float kReach = 2e-3f;  // |a + b| of unit vectors whose product rounds to -1 or less is below sqrt(2e-6)

bool isZero(glm::vec3 v) { return v.x == 0.0f && v.y == 0.0f && v.z == 0.0f; }
bool isUnit(glm::vec3 v) { return std::abs(glm::dot(v, v) - 1.0f) < 0.01f; }

/// Not (a . b > -1): opposite, or not a number.
bool apart(glm::vec3 a, glm::vec3 b) { return !(glm::dot(a, b) > -1.0f); }

std::uint32_t cellOf(glm::vec3 v) {
  const auto at = [](float x) { return std::uint32_t((x + 1.5f) / kCell); };
  return at(v.x) << 20 | at(v.y) << 10 | at(v.z);
}

/// Vectors of unit length by place in space.
class Grid {
 public:
  void add(glm::vec3 v, std::uint32_t item) { cells_.emplace_back(cellOf(v), item); }
  void finish() { std::ranges::sort(cells_); }
  /// Every item within kReach of v in each coordinate, and some farther away.
  template <class Visit>
  void near(glm::vec3 v, const Visit& visit) const {
    std::array<std::uint32_t, 8> seen;
    std::size_t count = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const glm::vec3 step(corner & 1 ? kReach : -kReach, corner & 2 ? kReach : -kReach, corner & 4 ? kReach : -kReach);
      const std::uint32_t cell = cellOf(v + step);
      if (std::find(seen.begin(), seen.begin() + count, cell) != seen.begin() + count) continue;
      seen[count++] = cell;
      for (auto it = std::ranges::lower_bound(cells_, std::pair(cell, 0u)); it != cells_.end() && it->first == cell; ++it)
        visit(it->second);
    }
  }

 private:
  std::vector<std::pair<std::uint32_t, std::uint32_t>> cells_;
};

}  // namespace

Fan::Fan(const Mesh& mesh, const Frames& frames, const Rings& rings, const Output& output)
    : mesh_(mesh), frames_(frames), rings_(rings), output_(output) {}

void Fan::compute(std::uint32_t id, Remarks& remarks) {
  ring_ = rings_.of(id);
  linkRing(mesh_, ring_, links_, across_);
  findGroups();
  measure(id);
  tangents_.resize(ring_.size());
  std::vector<std::vector<std::uint32_t>> members(groups_);
  for (std::uint32_t place = 0; place < ring_.size(); ++place)
    if (groupOf_[place] != kNobody) members[groupOf_[place]].push_back(place);
  for (std::vector<std::uint32_t>& group : members) {
    members_ = std::move(group);
    solveGroup(remarks);
  }
  remarks.groups += groups_;
  write(id, remarks);
}

/// Triangles of one orientation that hang together by sides at the vertex, with at least one frame among them.
void Fan::findGroups() {
  groupOf_.assign(ring_.size(), kNobody);
  groups_ = 0;
  for (std::uint32_t start = 0; start < ring_.size(); ++start) {
    if (groupOf_[start] != kNobody || framelessAt(start)) continue;
    const std::uint32_t way = frameAt(start).flags & kPreserving;
    stack_.assign(1, start);
    while (!stack_.empty()) {
      const std::uint32_t place = stack_.back();
      stack_.pop_back();
      if (place == kNobody || groupOf_[place] != kNobody || (frameAt(place).flags & kPreserving) != way) continue;
      groupOf_[place] = groups_;
      stack_.push_back(across_[place].coming);
      stack_.push_back(across_[place].leaving);
    }
    ++groups_;
  }
}

void Fan::measure(std::uint32_t id) {
  const glm::vec3 n = mesh_.vertices[id].normal, p = mesh_.vertices[id].position;
  parts_.resize(ring_.size());
  for (std::size_t place = 0; place < ring_.size(); ++place) {
    if (framelessAt(place)) continue;
    const std::uint32_t* ids = &mesh_.ids[3 * std::size_t(triangleOf(ring_[place]))];
    const std::uint32_t c = cornerOf(ring_[place]);
    const glm::vec3 e1 = unitInPlane(n, mesh_.vertices[ids[kPreviousCorner[c]]].position - p);
    const glm::vec3 e2 = unitInPlane(n, mesh_.vertices[ids[kNextCorner[c]]].position - p);
    const float cosine = glm::dot(e1, e2);
    const float clamped = cosine > 1.0f ? 1.0f : cosine < -1.0f ? -1.0f : cosine;
    const Derivatives d = derivativesOf(mesh_, triangleOf(ring_[place]));
    parts_[place] = {unitInPlane(n, d.s), unitInPlane(n, d.t), float(std::acos(double(clamped))), d.ms, d.mt};
  }
}

template <class Left>
Fan::Tangent Fan::sum(const Left& isLeftOut) const {
  Tangent total{glm::vec3(0.0f), glm::vec3(0.0f), 0.0f, 0.0f};
  float weight = 0.0f;
  const bool quads = mesh_.hasQuads();
  for (const std::uint32_t place : members_) {
    if (framelessAt(place) || isLeftOut(place)) continue;
    const Part& part = parts_[place];
    total.s += part.angle * part.s;
    if (!quads) continue;
    total.t += part.angle * part.t;
    total.ms += part.angle * part.ms;
    total.mt += part.angle * part.mt;
    weight += part.angle;
  }
  total.s = unit(total.s);
  total.t = unit(total.t);
  if (weight > 0.0f) total.ms /= weight, total.mt /= weight;
  return total;
}

/// Whether it is plain that no two members are opposite.
bool Fan::allAgree() const {
  const Part* first = nullptr;
  for (const std::uint32_t place : members_) {
    if (framelessAt(place)) continue;
    const Part& part = parts_[place];
    if (!isUnit(part.s) || !isUnit(part.t)) return false;
    if (first == nullptr) first = &part;
    if (!(glm::dot(first->s, part.s) > kAgree) || !(glm::dot(first->t, part.t) > kAgree)) return false;
  }
  return true;
}

void Fan::solveGroup(Remarks& remarks) {
  if (!allAgree()) {
    if (partMembers()) return;
    ++remarks.hugeGroups;
  }
  const Tangent all = sum([](std::uint32_t) { return false; });
  for (const std::uint32_t place : members_) tangents_[place] = all;
}

/// Members of bit-equal directions are one class: what is opposite to one is opposite to all. False when there are too many.
bool Fan::sortIntoClasses() {
  sorted_.clear();
  for (const std::uint32_t place : members_)
    if (!framelessAt(place)) sorted_.push_back(place);
  const auto key = [&](std::uint32_t place) {
    std::array<std::uint32_t, 6> bits;
    const float values[6] = {parts_[place].s.x, parts_[place].s.y, parts_[place].s.z,
                             parts_[place].t.x, parts_[place].t.y, parts_[place].t.z};
    std::memcpy(bits.data(), values, sizeof values);
    return bits;
  };
  std::vector<std::pair<std::array<std::uint32_t, 6>, std::uint32_t>> keyed;
  const auto add = [&](std::size_t from, std::size_t to) {
    for (std::size_t i = from; i < to; ++i) keyed.emplace_back(key(sorted_[i]), sorted_[i]);
    std::ranges::sort(keyed);
  };
  // A sample first: where it has too many classes already, the rest need not be looked at.
  const std::size_t sample = std::min(sorted_.size(), 2 * kMaxClasses);
  add(0, sample);
  std::size_t classes = 1;
  for (std::size_t i = 1; i < keyed.size(); ++i) classes += keyed[i].first != keyed[i - 1].first;
  if (classes > kMaxClasses) return false;
  if (sample < sorted_.size()) add(sample, sorted_.size());
  classOf_.resize(ring_.size());
  classPlace_.clear();
  for (std::size_t i = 0; i < keyed.size(); ++i) {
    if (i == 0 || keyed[i].first != keyed[i - 1].first) classPlace_.push_back(keyed[i].second);
    classOf_[keyed[i].second] = std::uint32_t(classPlace_.size() - 1);
  }
  return classPlace_.size() <= kMaxClasses;
}

bool Fan::opposite(std::uint32_t a, std::uint32_t b) const {
  const Part &x = parts_[classPlace_[a]], &y = parts_[classPlace_[b]];
  return apart(x.s, y.s) || apart(x.t, y.t);
}

/// Fills opposites_; false when that is too much work.
bool Fan::findOpposites() {
  const std::uint32_t classes = std::uint32_t(classPlace_.size());
  opposites_.assign(classes, {});
  Grid s, t;
  std::vector<std::uint32_t> odd;  // neither unit nor zero: what they are opposite to is anybody's guess
  std::vector<bool> isOdd(classes, false);
  for (std::uint32_t c = 0; c < classes; ++c) {
    const Part& part = parts_[classPlace_[c]];
    if ((isUnit(part.s) || isZero(part.s)) && (isUnit(part.t) || isZero(part.t)) && classes > kFewClasses) {
      if (isUnit(part.s)) s.add(part.s, c);
      if (isUnit(part.t)) t.add(part.t, c);
    } else {
      odd.push_back(c);
      isOdd[c] = true;
    }
  }
  s.finish();
  t.finish();
  std::size_t pairs = 0;
  for (std::uint32_t c = 0; c < classes; ++c) {
    std::vector<std::uint32_t>& found = opposites_[c];
    const auto test = [&](std::uint32_t other) {
      ++pairs;
      if (opposite(c, other)) found.push_back(other);
    };
    if (isOdd[c]) {
      for (std::uint32_t other = 0; other < classes; ++other) test(other);
    } else {
      const Part& part = parts_[classPlace_[c]];
      if (isUnit(part.s)) s.near(-part.s, test);
      if (isUnit(part.t)) t.near(-part.t, test);
      for (const std::uint32_t other : odd) test(other);
    }
    if (pairs > kMaxPairs) return false;
    std::ranges::sort(found);
    found.erase(std::unique(found.begin(), found.end()), found.end());
  }
  return true;
}

/// A tangent per set: a member with a frame takes all but those opposite to it, its own face's other half always; a frameless one takes
/// all. False when that is too much work.
bool Fan::partMembers() {
  if (!sortIntoClasses() || !findOpposites()) return false;
  std::map<std::vector<std::uint32_t>, std::uint32_t> setOf;
  for (const std::vector<std::uint32_t>& list : opposites_) setOf.emplace(list, 0);
  if (setOf.size() * members_.size() > kMaxVisits) return false;

  std::vector<std::uint32_t> mark(classPlace_.size(), 0);
  std::uint32_t stamp = 0;
  const auto markSet = [&](std::uint32_t c) {
    ++stamp;
    for (const std::uint32_t other : opposites_[c]) mark[other] = stamp;
  };
  const auto isMarked = [&](std::uint32_t place) { return mark[classOf_[place]] == stamp; };
  std::vector<Tangent> sets;
  std::size_t visits = setOf.size() * members_.size();
  const Tangent all = sum([](std::uint32_t) { return false; });
  for (const std::uint32_t place : members_) {
    if (framelessAt(place)) {
      tangents_[place] = all;
      continue;
    }
    const std::uint32_t c = classOf_[place];
    const auto isMate = [&](std::uint32_t other) { return faceAt(other) == faceAt(place); };
    const auto mateIsOpposite = [&](std::uint32_t other) {
      return isMate(other) && std::ranges::binary_search(opposites_[c], classOf_[other]);
    };
    // A member that is opposite to its own face's half, or to itself for want of a number, has a set of its own.
    bool alone = mateIsOpposite(place);
    for (const std::int64_t next : {std::int64_t(place) - 1, std::int64_t(place) + 1})
      if (next >= 0 && next < std::int64_t(ring_.size()) && groupOf_[std::size_t(next)] == groupOf_[place] &&
          !framelessAt(std::size_t(next)))
        alone |= mateIsOpposite(std::uint32_t(next));
    if (alone) {
      visits += members_.size();
      if (visits > kMaxVisits) return false;
      markSet(c);
      tangents_[place] = sum([&](std::uint32_t other) { return isMarked(other) && !isMate(other); });
      continue;
    }
    std::uint32_t& index = setOf.at(opposites_[c]);
    if (index == 0) {
      markSet(c);
      sets.push_back(sum(isMarked));
      index = std::uint32_t(sets.size());
    }
    tangents_[place] = sets[index - 1];
  }
  return true;
}

/// A quad's corner that both halves hold comes twice, one after the other; the later group has the last word on the sign.
void Fan::write(std::uint32_t id, Remarks& remarks) {
  for (std::size_t place = 0; place < ring_.size(); ++place) {
    const RingCorner c = ring_[place];
    const std::uint32_t slot = mesh_.slotOf(triangleOf(c), cornerOf(c));
    std::size_t other = place + 1;
    const bool twice = other < ring_.size() && mesh_.hasQuads() && mesh_.slotOf(triangleOf(ring_[other]), cornerOf(ring_[other])) == slot;
    if (!twice) other = place;
    std::size_t first = place, last = other;
    if (groupOf_[first] == kNobody) first = last;
    if (groupOf_[last] == kNobody) last = first;
    place = other;
    if (groupOf_[first] == kNobody) {
      output_.writeFiller(slot);
      if (!output_.exact()) remarks.bad.push_back({slot, id, triangleOf(c), Mend::NoFrame});
      continue;
    }
    if (groupOf_[last] < groupOf_[first]) std::swap(first, last);
    const Tangent &a = tangents_[first], &b = tangents_[last];
    const bool equal = a.s == b.s && a.t == b.t && a.ms == b.ms && a.mt == b.mt;
    const glm::vec3 tangent = first == last || equal ? a.s : unit(a.s + b.s);
    output_.write(slot, tangent, output_.determinantOf(frameAt(last).flags));
    Mend why;
    if (!output_.exact() && !serves(tangent, mesh_.vertices[id].normal, why)) remarks.bad.push_back({slot, id, triangleOf(c), why});
  }
}

}  // namespace lmc::tangent
