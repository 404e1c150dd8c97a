#pragma once
/// Tangents round one vertex, whatever its ring: any number of triangles, sides of more than two, quads, opposite tangents. The plain
/// way; smooth_rings.h takes the rings that need less.
#include "libtangent/links.h"
#include "libtangent/output.h"

namespace lmc::tangent {

class Fan {
 public:
  Fan(const Mesh&, const Frames&, const Rings&, const Output&);

  /// Writes the tangents of all corners round a vertex.
  void compute(std::uint32_t id, Remarks&);

 private:
  /// What a set of triangles agrees on.
  struct Tangent {
    glm::vec3 s, t;
    float ms, mt;
  };
  /// A triangle's part, seen at the vertex.
  struct Part {
    glm::vec3 s, t;  ///< unit, in the plane of the normal
    float angle;     ///< of the corner there
    float ms, mt;    ///< Derivatives::ms, mt
  };
  const Frame& frameAt(std::size_t place) const { return frames_.of[triangleOf(ring_[place])]; }
  std::uint32_t faceAt(std::size_t place) const { return mesh_.faceOf(triangleOf(ring_[place])); }
  bool framelessAt(std::size_t place) const { return (frameAt(place).flags & kFrameless) != 0; }

  void findGroups();
  void measure(std::uint32_t id);
  void solveGroup(Remarks&);
  bool allAgree() const;
  bool partMembers();
  bool sortIntoClasses();
  bool opposite(std::uint32_t classA, std::uint32_t classB) const;
  bool findOpposites();
  template <class Left>
  Tangent sum(const Left& isLeftOut) const;
  void write(std::uint32_t id, Remarks&);

  const Mesh& mesh_;
  const Frames& frames_;
  const Rings& rings_;
  const Output& output_;
  std::span<const RingCorner> ring_;
  LinkScratch links_;
  std::vector<Across> across_;
  std::vector<std::uint32_t> groupOf_, stack_;  ///< per place
  std::vector<Part> parts_;                     ///< per place
  std::vector<Tangent> tangents_;               ///< per place
  std::uint32_t groups_ = 0;
  std::vector<std::uint32_t> members_;                 ///< places of the group in work, ascending
  std::vector<std::uint32_t> sorted_, classOf_;        ///< of members with a frame; classes have equal directions
  std::vector<std::uint32_t> classPlace_;              ///< a place of each class
  std::vector<std::vector<std::uint32_t>> opposites_;  ///< per class, ascending
};

}  // namespace lmc::tangent
