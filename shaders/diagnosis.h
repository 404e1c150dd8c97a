#pragma once
/// What is wrong with a pass, by name: which known fault would give the picture that it gives.
#include <optional>
#include <string>

#include "libscene/run.h"
#include "shaders/passes.h"

namespace lmc::shaders {

/// How two pictures of a target differ, where 1 is the largest value that there is in the first (or white).
struct Difference {
  Target target;
  double largest = 0.0, mean = 0.0;
  int x = 0, y = 0;  ///< of the largest
};
Difference differenceOf(const Frame& reference, const Frame& mine, Target);

struct Finding {
  std::string name;          ///< stable: "pi", "swapped-red-blue", "missing-n.l-gate", ...
  std::string words;         ///< one sentence for a person
  double unexplained = 0.0;  ///< share of the mean difference that is left when the fault is put into the reference
};

/// One picture by the reference and by the pass that is looked at, all else equal.
struct Comparison {
  const ShadingLevel& level;
  const LevelMaps& maps;
  const View& view;  ///< with only those passes of light that the pass belongs to
  const Frame& reference;
  const Frame& mine;
};

/// The fault that explains the difference best, if one explains nearly all of it. Looks at the targets that the pass writes.
std::optional<Finding> diagnose(const Comparison&, const PassRow&, const Run&);

}  // namespace lmc::shaders
