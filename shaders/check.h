#pragma once
/// Somebody's passes against those of the reference shader.
#include <span>

#include "shaders/check_scene.h"
#include "shaders/diagnosis.h"
#include "shaders/reference.h"

namespace lmc::shaders {

/// One pass of the user's, drawn in place of lmc's with everything else left alone.
struct PassCheck {
  Pass pass;
  std::vector<std::vector<Difference>> differences;  ///< by stage: of the targets that the pass writes
  std::optional<Finding> finding;                    ///< on the last stage that shows a difference
  double largest() const;
};

/// A level that passes are tried on.
struct Stage {
  const ShadingLevel& level;
  const LevelMaps& maps;
  View view;
};

struct ShaderCheck {
  std::vector<PassCheck> passes;  ///< those that the folder replaces, in their order; empty: it replaces none
  Frame reference, mine;          ///< the first stage, whole, with all of the user's passes
  Difference picture;             ///< of these two
};

/// Tries the folder's passes one by one on each stage, then all together on the first. Of several stages the last is to be the one on which
/// faults are told apart best. Throws Error Broken for one that does not compile.
ShaderCheck checkShaders(std::span<const Stage>, const std::filesystem::path& folder, double maxDiff, const Run&);

}  // namespace lmc::shaders
