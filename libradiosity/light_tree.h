#pragma once
/// All lights of a level in one tree, so that a place asks the lights that matter there and not every one of them: near and strong lights
/// each by itself, the rest as groups that are sampled in proportion to what they may give [conty2018].
#include <cmath>
#include <cstdint>
#include <vector>

#include "libradiosity/emitters.h"
#include "libscene/texels.h"

namespace lmc {

/// Which lights are asked by themselves at the places of a sphere, and the tree's nodes that stand for all others.
struct LightCut {
  std::vector<std::uint32_t> punctual;  ///< into Scene::lights
  std::vector<std::uint32_t> emitters;  ///< into Emitters::whole
  std::vector<std::uint32_t> groups;    ///< nodes of the tree, in the tree's order: neighbours here are neighbours in the level
  bool empty() const { return punctual.empty() && emitters.empty() && groups.empty(); }
};

/// Where a cut is for: every place lies in the sphere. With a normal, all of them face that way within `bend`.
struct Receivers {
  glm::dvec3 centre_m{0.0};
  double radius_m = 0.0;
  glm::dvec3 normal{0.0};  ///< unit; 0 = not known
  double bend_rad = 0.0;
};

class LightTree {
 public:
  static constexpr std::size_t kMostNodes = 512;  ///< of a cut
  static constexpr std::size_t kFewNodes = 16;    ///< of a cut that serves a single place: it is made for a handful of rays
  LightTree(const Scene&, const Emitters&);

  LightCut cutFor(const Receivers&, std::size_t mostNodes = kMostNodes) const;

  /// One light of the groups, chosen in proportion to about what it would give.
  struct Choice {
    std::uint32_t light = kNone;  ///< below punctualCount(): a punctual light, else punctualCount() + an emitter
    double share = 0.0;           ///< probability of the choice; 0 = nothing was chosen
  };
  /// Shares of a cut's groups for all places of a small neighbourhood: by what they give to its middle, and kByBound of them by the most
  /// that they can give anywhere in it, so that what a light gives never counts more than about mostWeight(). Among those that touch it,
  /// what counts is where in it a place lies: they have a common share, and each place its own of that.
  class Groups {
   public:
    Groups(const LightTree&, const LightCut&, const Receivers&);
    /// Sum of the most that the groups can give, by the share of draws that goes by it [lx].
    double mostWeight() const { return mostWeight_; }
    /// For a place of the neighbourhood; u in [0, 1) comes back as what is left of it. `at` remembers the group between calls (0 at first):
    /// where u rises from call to call, a group is found at once, and lights near each other are met one after the other.
    Choice choose(const SurfacePoint&, double& u, std::size_t& at) const;

   private:
    /// The group that u falls into for this place, and its share.
    std::uint32_t groupOf(const Receivers& here, double& u, std::size_t& at, double& share) const;
    const LightTree& tree_;
    const LightCut& cut_;
    std::vector<double> begin_;         // cumulative, of the groups and, at the end, of those that touch
    std::vector<std::uint32_t> touch_;  // those groups: by themselves their share is 0
    double total_ = 0.0, mostWeight_ = 0.0;
  };
  static constexpr double kByBound = 0.3;
  std::uint32_t punctualCount() const { return punctualCount_; }

 private:
  /// An angle in [0, pi] without trigonometric functions: they would take longer than a ray.
  struct Angle {
    double cos = 1.0, sin = 0.0;
    static Angle of(double rad) { return {std::cos(rad), std::sin(rad)}; }
    /// Of two unit vectors.
    static Angle between(const glm::dvec3& a, const glm::dvec3& b) {
      const double c = glm::clamp(glm::dot(a, b), -1.0, 1.0);
      return {c, std::sqrt(1.0 - c * c)};
    }
    /// At most pi.
    Angle operator+(const Angle& o) const {
      const Angle sum{cos * o.cos - sin * o.sin, sin * o.cos + cos * o.sin};
      return sum.sin < 0.0 ? Angle{-1.0, 0.0} : sum;
    }
    /// cos(max(0, this - o)).
    double cosBeyond(const Angle& o) const { return cos >= o.cos ? 1.0 : cos * o.cos + sin * o.sin; }
  };
  struct Node {
    glm::dvec3 lo_m{0.0}, hi_m{0.0}, centre_m{0.0};
    double radius_m = 0.0;
    glm::dvec3 axis{0.0};                // unit; directions of its light lie within `spread` of it
    Angle spread, cover;                 // cover: spread and the cone about each direction
    double strength = 0.0;               // sum of intensities towards the axis [cd], largest channel
    double most_lx = 0.0;                // however near: an emitter's solid angle is below 2 pi; infinite for lamps
    double range_m = 0.0;                // beyond it from the sphere nothing shines; 0 = endless
    std::uint32_t child = kNone;         // the first of two; kNone = a leaf
    std::uint32_t first = 0, count = 0;  // its lights: [first, first + count) of lights_
    bool flat = false;                   // all of them are emitters: their light falls with the cosine
    bool alike = false;                  // all of them shine alike about the axis: from afar they differ by their strength alone
  };
  /// What building needs besides.
  struct Extent {
    glm::dvec3 lo{1e300}, hi{-1e300};  // of positions [m]
    double spread_rad = 0.0, cone_rad = 0.0, leastCone_rad = 0.0;
  };
  struct Leaf {
    Node node;
    Extent extent;
    std::uint32_t light = kNone;
    int kind = 0;  // lights of one kind are parted by place, others by kind
  };
  static void measure(Node&, const Extent&);
  static double mostCosines(const Node&, const glm::dvec3& to, double distance, double reach, const glm::dvec3& normal, const Angle& bend);
  Extent build(std::uint32_t node, std::vector<Leaf>&, std::size_t begin, std::size_t end);
  /// The most that the node gives to a place of the sphere, each emitter counted by radiance x solid angle x cosine [lx].
  struct Bound {
    double most = 0.0;
    bool touching = false;  // distance does not limit it: the node may lie in the sphere, or fill the view
  };
  static Bound bound(const Node&, const Receivers&);
  /// About what the node gives to the middle of the sphere; 0 only where it gives nothing there [lx].
  static double estimate(const Node&, const Receivers&);

  std::uint32_t punctualCount_ = 0;
  std::vector<std::uint32_t> always_;  // directional and classic lights: their light does not fall with the square of distance
  std::vector<Node> nodes_;            // the root is the first; empty when all lights are in always_
  std::vector<std::uint32_t> lights_;  // in the tree's order, numbered as in Choice
  std::vector<double> before_;         // sums of their strengths; one more than lights_
};

}  // namespace lmc
