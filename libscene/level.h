#pragma once
/// A level file (glTF 2.0, .gltf or .glb) to a Scene.
#include <filesystem>

#include "libscene/run.h"
#include "libscene/scene.h"
#include "libscene/shading.h"

namespace lmc {

/// Limits on input; each has a name in `lmc bake --help`.
struct LoadLimits {
  std::uint64_t maxInputBytes = std::uint64_t(8) << 30;  ///< of all files together
  std::uint64_t maxTexturePixels = 268435456;            ///< of one picture, checked on its header
  int maxJsonDepth = 64;
  std::uint64_t maxNodes = 1000000;
  std::uint64_t maxInstances = 1000000;
  std::uint64_t maxTriangles = 200000000;
  double maxExtent_m = 1.0e9;  ///< largest distance from the origin
};

/// Reads, checks and converts. Reports what is ignored through run.note, each thing once, by name.
/// Throws Error: Io (not there, a folder, unreadable), Broken (JSON pointer given), Unsupported, Limit.
Scene loadLevel(const std::filesystem::path& level, const LoadLimits& limits, const Run& run);

/// The same for a renderer, with what a bake has no use for.
ShadingLevel loadForShading(const std::filesystem::path& level, const LoadLimits& limits, const Run& run);

}  // namespace lmc
