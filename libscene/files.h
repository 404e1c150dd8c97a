#pragma once
/// Files go out whole or not at all: written beside their place under a temporary name, synced, renamed last.
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "libscene/error.h"

namespace lmc {

/// A regular file, whole. Throws Error Io (missing, a folder, no right, not a regular file) or Limit.
std::vector<std::uint8_t> readFile(const std::filesystem::path& file, std::uint64_t maxBytes = std::uint64_t(64) << 30);

/// A file being written under its temporary name. Every error of the system ends in an Error (Io, or Limit when space or quota is out).
class OutputFile {
 public:
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;
  void write(const void* data, std::size_t size);
  void write(std::string_view text) { write(text.data(), text.size()); }
  std::uint64_t position() const { return position_; }
  void seek(std::uint64_t position);
  std::uint64_t size() const { return size_; }
  std::string hash();  ///< of what was written so far, as contentHash()

 private:
  friend class OutputSet;
  explicit OutputFile(const std::filesystem::path& target);
  void flush();
  void finish();  ///< flush, fsync, check the size
  void rename();
  /// Remembered, for OpenEXR swallows what its destructor meets: finish() says it again.
  [[noreturn]] void fail(const char* doing, int error);
  std::filesystem::path target_, temporary_;
  int fd_ = -1;
  std::vector<char> buffer_;
  std::uint64_t position_ = 0, bufferStart_ = 0, size_ = 0;
  const char* failedDoing_ = nullptr;
  int failedBy_ = 0;
  bool renamed_ = false;
  std::size_t remembered_ = 0;  ///< among the names of removeTemporaryFiles()
};

/// Files that appear together: none under its final name before all are complete; renamed in the order in which they were opened, so
/// that what vouches for the set is opened last. Without commit() nothing is left behind and old files stay as they were. Temporary files
/// of runs that were killed go; those of runs at work are locked, and stay. Sets that are committed to one folder at a time do not mix.
class OutputSet {
 public:
  /// Makes the folder when it is missing and proves that it can be written to, before any work is done.
  explicit OutputSet(const std::filesystem::path& folder);
  OutputFile& open(const std::filesystem::path& nameInFolder);
  void commit();
  ~OutputSet();

 private:
  std::filesystem::path folder_;
  bool madeFolder_ = false;
  bool committed_ = false;
  std::vector<std::unique_ptr<OutputFile>> files_;
};

/// One file by the same rules.
void writeFileWhole(const std::filesystem::path& file, std::string_view bytes);

/// Whether a set is just getting its names: a moment, in which no signal should end the process. Async-signal-safe.
bool isNamingFiles() noexcept;
/// Unlinks every temporary file of this process: for a signal handler that ends it (async-signal-safe).
void removeTemporaryFiles() noexcept;

/// XXH3-64.
std::uint64_t hash64(std::span<const std::uint8_t> bytes, std::uint64_t seed = 0);
/// 16 hexadecimal digits of it.
std::string contentHash(std::span<const std::uint8_t> bytes);

}  // namespace lmc
