#pragma once
/// Finished tiles of a bake under way, kept in OUT/.lmc-resume/journal so that a run that was stopped or killed loses at most the tiles in
/// work. An append-only file of records {place, payload, hashes} under a header that names what they depend on: program, level, options.
#include <atomic>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <span>
#include <string>
#include <type_traits>
#include <unordered_map>
#include <utility>
#include <vector>

#include "libscene/run.h"
#include "libscene/tracer.h"

namespace lmc {

/// All that the bytes of a bake depend on, as hashes.
struct JournalKey {
  std::uint64_t program = 0, level = 0, options = 0;
};

/// The loop that a tile was done in. A number stays with its loop for ever: files hold it.
enum class Loop : std::uint8_t { Direct = 1, Solve = 2, Hemisphere = 3, Openness = 4, Audit = 5 };

/// A tile's place in a bake; `round` counts how often its loop has run, below 2^24.
struct JournalPlace {
  Loop loop = Loop::Direct;
  std::uint32_t round = 0, tile = 0;
  std::uint64_t asked = 0;  ///< a hash of what is asked of the tile, where the key does not say it all: a record of something else is none
};

/// Thread-safe. Nothing that goes wrong with its file ends a bake: it then goes on without a journal, and trouble() says why.
class Journal {
 public:
  /// What was there when it was opened.
  enum class Found {
    Nothing,
    Tiles,         ///< those of this very bake, up to the first that is cut or damaged
    OtherVersion,  ///< these four are discarded
    OtherLevel,
    OtherOptions,
    Damaged,
    InUse,    ///< by a run at work: it stays, and this run keeps nothing
    Unusable  ///< trouble() says why
  };

  /// Looks into the folder; makes nothing before the first put().
  Journal(const std::filesystem::path& out, const JournalKey&);
  ~Journal();  ///< what is kept stays
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  Found found() const { return found_; }
  std::size_t tilesFound() const { return tilesFound_; }
  std::uint64_t bytesDropped() const { return bytesDropped_; }  ///< behind the last sound tile

  /// The payload of a tile, if it is there and sound.
  bool take(const JournalPlace&, std::vector<std::uint8_t>& payload);
  /// One write: it is the file's when this returns, whatever becomes of the process.
  void put(const JournalPlace&, std::span<const std::uint8_t> payload);

  std::uint64_t tilesTaken() const { return taken_; }
  std::size_t tilesKept() const;  ///< in the file
  std::uint64_t bytes() const;    ///< of the file
  std::string trouble();          ///< what went wrong since it was last asked; empty = nothing
  void remove();                  ///< the file, and its folder if nothing else is in it

  static constexpr const char* kFolder = ".lmc-resume";
  static constexpr const char* kFile = "journal";
  static constexpr std::uint64_t kMostBytes = std::uint64_t(16) << 30;  ///< it takes no more tiles then

 private:
  struct Entry {
    std::uint64_t offset = 0, bytes = 0;  // of the payload
    std::uint64_t asked = 0;
  };
  bool openFolder(bool make);
  bool openFile(bool make);
  bool start();
  void judge();
  void index(std::uint64_t size);
  bool readSound(const JournalPlace&, const Entry&, std::vector<std::uint8_t>& payload) const;
  bool append(std::span<const std::uint8_t> record);
  void giveUp(const std::string& why);

  std::filesystem::path out_;
  JournalKey key_;
  std::uint64_t seed_;  // of all hashes: a record of another journal is not sound in this one
  Found found_ = Found::Nothing;
  std::size_t tilesFound_ = 0;
  std::uint64_t bytesDropped_ = 0;
  int folder_ = -1, file_ = -1;
  std::atomic<std::uint64_t> taken_{0};

  mutable std::mutex mutex_;  // of what follows
  bool off_ = false;          // no more puts
  std::uint64_t end_ = 0;     // of the sound part; 0 = not even a header
  std::unordered_map<std::uint64_t, Entry> entries_;
  std::string trouble_;
};

/// Whether a journal of this process holds tiles. Async-signal-safe.
bool journalHoldsTiles() noexcept;
/// Unlinks the journal that this process has, where Journal::remove() can no longer be called: for a process that ends out of order.
/// Async-signal-safe.
void unlinkJournal() noexcept;

// What a tile is made of is said once, by a function that calls archive(value) for each value that the tile writes: these count, write and
// read them. Values are plain, their number is known before the tile is computed.
class ArchiveSize {
 public:
  template <class T>
  void operator()(const T&) {
    static_assert(std::is_trivially_copyable_v<T>);
    bytes += sizeof(T);
  }
  std::size_t bytes = 0;
};
class ArchiveWriter {
 public:
  explicit ArchiveWriter(std::span<std::uint8_t> to) : to_(to.data()) {}
  template <class T>
  void operator()(const T& value) {
    std::memcpy(to_, &value, sizeof(T));
    to_ += sizeof(T);
  }

 private:
  std::uint8_t* to_;
};
class ArchiveReader {
 public:
  explicit ArchiveReader(std::span<const std::uint8_t> from) : from_(from.data()) {}
  template <class T>
  void operator()(T& value) {
    std::memcpy(&value, from_, sizeof(T));
    from_ += sizeof(T);
  }

 private:
  const std::uint8_t* from_;
};

/// Whose rays a piece of work casts; OfAll: nothing else casts any meanwhile.
enum class WorkOf { ThisThread, All };

/// One piece of work that may be in the run's journal; without a journal it costs nothing.
///   Journaled kept(run, tracer, place, state);
///   if (kept.taken()) return;   // what the work writes is there again, and its rays count as cast
///   ...the work...
///   kept.put();
template <class State>
class Journaled {
 public:
  /// state(archive): see above. It is called at once where there is a journal.
  Journaled(const Run& run, const Tracer& tracer, const JournalPlace& place, State state, WorkOf threads = WorkOf::ThisThread)
      : journal_(run.journal), tracer_(tracer), place_(place), state_(std::move(state)), threads_(threads) {
    if (!journal_) return;
    ArchiveSize size;
    keep(size);
    if (journal_->take(place_, payload_) && payload_.size() == size.bytes) {
      ArchiveReader reader(payload_);
      keep(reader);
      tracer_.countAsCast(cast_);
      taken_ = true;
    }
    payload_.resize(size.bytes);
    cast_ = counts();
  }
  bool taken() const { return taken_; }
  void put() {
    if (!journal_) return;
    cast_ = counts() - cast_;
    ArchiveWriter writer(payload_);
    keep(writer);
    journal_->put(place_, payload_);
  }

 private:
  template <class Archive>
  void keep(Archive& archive) {
    archive(cast_);
    state_(archive);
  }
  CastCounts counts() const { return threads_ == WorkOf::All ? tracer_.counts() : Tracer::castByThisThread(); }

  Journal* journal_;
  const Tracer& tracer_;
  JournalPlace place_;
  State state_;
  WorkOf threads_;
  bool taken_ = false;
  CastCounts cast_{};
  std::vector<std::uint8_t> payload_;
};

}  // namespace lmc
