#pragma once
/// Large arrays that memory need not hold. While a Paging is at work, blocks of memory that are made lie in files without a name, and what
/// of them is resident is let go whenever the process holds more than it may; what is read again comes back from the file. No value
/// depends on when that happens. Loops see to it themselves (keepToMost), for they bring in pages faster than anybody could look on; a
/// thread beside them does for what is no loop of many threads.
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <thread>
#include <utility>

namespace lmc {

/// Zeroed memory.
class Block {
 public:
  Block() = default;
  /// Throws std::bad_alloc; Error Limit where the folder of the Paging at work has no room for it, Io where it takes no files.
  explicit Block(std::size_t bytes);
  ~Block();
  Block(Block&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)), bytes_(std::exchange(other.bytes_, 0)), inFile_(other.inFile_) {}
  Block& operator=(Block&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(bytes_, other.bytes_);
    std::swap(inFile_, other.inFile_);
    return *this;
  }
  void* data() const { return data_; }

 private:
  void* data_ = nullptr;
  std::size_t bytes_ = 0;
  bool inFile_ = false;
};

/// At work from its making to its end; one at a time. Blocks may outlive it.
class Paging {
 public:
  /// `folder`: of the files, whose room is set aside when a block is made: a disk that fills up later is no trouble. `most_bytes`: that the
  /// process is to hold resident. `threads`: of its loops. Blocks of less than `least_bytes` stay in memory.
  Paging(std::filesystem::path folder, std::uint64_t most_bytes, int threads, std::size_t least_bytes = kLeastPaged_bytes);
  ~Paging();
  Paging(const Paging&) = delete;
  Paging& operator=(const Paging&) = delete;

  /// What all blocks in files are now. For signal handlers too.
  static std::uint64_t filesBytes() noexcept;
  /// Lets go of all that is resident of all blocks in files.
  static void release();
  /// The same if the process holds more than it may; returns how much may come in before that. Nothing where no Paging is at work. For
  /// threads that bring in pages, between two pieces of work: parallelFor calls it. Takes about 1 us.
  static std::uint64_t keepToMost();
  /// Before a read at a place that nobody could foretell: keepToMost() as often as it has to be.
  static void touched() {
    thread_local unsigned left = 0;
    if (left == 0) left = touchesAllowed();
    --left;
  }

  static constexpr std::size_t kLeastPaged_bytes = 256 << 10;

 private:
  static unsigned touchesAllowed();
  void keep();
  std::mutex mutex_;  // of done_
  std::condition_variable ended_;
  bool done_ = false;
  std::thread keeper_;
};

/// Of the process, now; 0 where the system does not tell.
std::uint64_t residentBytes();
/// What memory the machine has.
std::uint64_t physicalBytes();

}  // namespace lmc
