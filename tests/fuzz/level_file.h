#pragma once
/// A level from memory, for loaders that read files; what they refuse in words is fine.
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <new>
#include <string_view>

#include "libscene/level.h"

namespace lmc::fuzz {

/// A file of this process's own, in memory where the machine has a folder for that.
inline std::filesystem::path ownFile(const char* ending) {
  const std::filesystem::path memory = "/dev/shm";
  const auto folder =
      (std::filesystem::exists(memory) ? memory : std::filesystem::temp_directory_path()) / ("lmc-fuzz-" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  return folder / (std::string("level") + ending);
}

inline void put(const std::filesystem::path& file, std::string_view bytes) {
  std::ofstream(file, std::ios::binary).write(bytes.data(), std::streamsize(bytes.size()));
}

/// Limits as small as fuzzing wants: a large level is slow, not wrong.
inline void load(const std::filesystem::path& file) {
  LoadLimits limits;
  limits.maxTexturePixels = 1 << 20;
  limits.maxNodes = limits.maxInstances = 1000;
  limits.maxTriangles = 100000;
  try {
    loadLevel(file, limits, {});
  } catch (const Error&) {
  }
}

}  // namespace lmc::fuzz
