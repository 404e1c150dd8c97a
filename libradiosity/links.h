#pragma once
/// Links between clusters, one for each unordered pair, and the refinement that makes them: a pair is cut until what it leaves wrong in the
/// light that is looked at is below a threshold.
#include "libradiosity/partition.h"
#include "libradiosity/shoot.h"
#include "libscene/rng.h"

namespace lmc {

/// Light between two clusters, both ways: power into b = exchange * visible * mean exitance of a, and the reverse.
/// On both sides light is a linear function of place, 1 + slope . (x - centroid)/radius: links of constant light cost ten times as many for
/// the same error (measured), for what one wall gives a floor falls with distance in every one of its links alike.
struct Link {
  std::uint32_t a = 0, b = 0;                     ///< nodes of the cluster tree
  float exchange_m2 = 0.0f;                       ///< A_a F_ab without occluders
  std::uint16_t visible = 0xffff;                 ///< share of it that gets through, in 1/65535
  std::uint8_t samples = 0;                       ///< rays cast; 0 = a rule says that all gets through
  std::uint8_t clear = 0;                         ///< of them
  std::array<std::int8_t, 3> slopeA{}, slopeB{};  ///< in 1/kSlopeUnits
  std::uint8_t errorA = 0, errorB = 0;            ///< RMS of what the linear function leaves over a (b), of the mean, by errorOf
  double share() const { return double(visible) / 65535.0; }
  double transfer_m2() const { return double(exchange_m2) * share(); }
};
static_assert(sizeof(Link) == 24);
inline constexpr float kSlopeUnits = 127.0f;

/// What refinement must know of the light, of each node.
struct NodeLight {
  float exitance = 0.0f;  ///< area mean, largest channel [lm/m^2]
  float spread = 0.0f;    ///< its standard deviation within the node
  float weight = 0.0f;    ///< square of what 1 lx of wrong illuminance here does to what is looked at, relative [1/lx^2]
  float around = 0.0f;    ///< mean exitance of where it is
};

struct LinkStats {
  std::uint64_t links = 0, bytes = 0;
  std::uint64_t rays = 0;
  std::uint64_t pairs = 0;      ///< looked at
  double threshold = 0.0;       ///< of a link's squared error, reached [m^2]
  double predictedError = 0.0;  ///< relative RMS error that the links' own bounds add up to
  bool linksFull = false;       ///< maxLinks kept the threshold up
  int rounds = 0;
  std::array<RuleCount, kRules> rules;
};

/// The links of one level, refined in rounds.
class LinkSet {
 public:
  LinkSet(const Scene&, const PatchMesh&, const ClusterTree&, const Tracer&, const PartitionOptions&, std::uint64_t maxLinks, const Run&);

  /// Cuts every link (at first: the whole level against itself) whose squared error is above `threshold` by the light as it is known.
  /// Returns the sum of squared errors that cutting could still mend; negative = maxLinks would be passed and nothing was changed.
  double refine(const std::vector<NodeLight>&, double threshold);

  const std::vector<Link>& links() const { return links_; }
  const LinkStats& stats() const { return stats_; }

 private:
  struct Pair;
  struct Outcome;
  Outcome judge(const Pair&, const std::vector<NodeLight>&, double threshold) const;
  struct Ends;
  Ends ends(const Link&, const Sobol4&, std::uint32_t index) const;
  double exchangeByPairs(const Link&) const;
  void measure(Link&, bool& horizon) const;
  void castRays(Link&, int upTo) const;

  const Scene& scene_;
  const PatchMesh& mesh_;
  const ClusterTree& tree_;
  const Tracer& tracer_;
  Partition partition_;
  PartitionOptions options_;
  std::uint64_t maxLinks_;
  const Run& run_;
  std::vector<Link> links_;
  LinkStats stats_;
  mutable std::array<std::atomic<std::int64_t>, kRules> nanoseconds_{};
};

}  // namespace lmc
