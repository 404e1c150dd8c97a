#pragma once
/// What verbs that do one job share.
#include <cstdint>
#include <vector>

#include "libscene/run.h"
#include "libscene/scene.h"

namespace lmc {

/// Progress is not shown; messages go to stderr.
Run talkingRun(int threads);

/// Throws Error Usage where `out` is a file that `scene` was made of; `in` is the one that the user named.
void refuseSameFile(const std::filesystem::path& in, const Scene& scene, const std::filesystem::path& out);

void writeBytes(const std::filesystem::path& file, const std::vector<std::uint8_t>& bytes);

}  // namespace lmc
