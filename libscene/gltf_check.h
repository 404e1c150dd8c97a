#pragma once
/// What the JSON of a level must satisfy before anything else looks at it. Private to libscene.
#include <filesystem>

#include "libscene/gltf_read.h"

namespace lmc {

/// Types, ranges and references of every member that lmc reads, versions, extensions, the node tree, and that views and
/// accessors stay inside of their buffers. Throws Error with a JSON pointer; values inside of buffers are not its business.
void checkGltf(const Json& gltf, const std::filesystem::path& file, const LoadLimits& limits, const Run& run);

/// How often a checked node shows its mesh: 1, or the count of EXT_mesh_gpu_instancing.
std::uint64_t instanceCount(const Json& node, const Json& gltf);

}  // namespace lmc
