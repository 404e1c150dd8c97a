#include "libscene/journal.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstddef>
#include <utility>

#include "libscene/files.h"

namespace lmc {

namespace fs = std::filesystem;

namespace {

constexpr std::array<char, 8> kMagic{'l', 'm', 'c', '-', 't', 'i', 'l', 'e'};
constexpr std::uint32_t kFormat = 1;
constexpr std::uint32_t kMark = 0x656c6974;  // "tile"
constexpr int kOpenTries = 8;                // against a run that removes its journal just then

// Both lie in the file as they are in memory: a journal is for the machine that wrote it.
struct Header {
  std::array<char, 8> magic = kMagic;
  std::uint32_t format = kFormat, unused = 0;
  std::uint64_t program = 0, level = 0, options = 0;
  std::uint64_t hash = 0;  // of what stands before it
};
static_assert(sizeof(Header) == 48);

struct RecordHead {
  std::uint32_t mark = kMark, loop = 0, round = 0, tile = 0;
  std::uint64_t asked = 0;
  std::uint64_t bytes = 0;    // of the payload, which follows
  std::uint64_t payload = 0;  // its hash
  std::uint64_t hash = 0;     // of what stands before it, and of where it lies
};
static_assert(sizeof(RecordHead) == 48);

template <class T>
std::span<const std::uint8_t> bytesOf(const T& value, std::size_t size = sizeof(T)) {
  return {reinterpret_cast<const std::uint8_t*>(&value), size};
}

std::uint64_t hashOf(const Header& h) { return hash64(bytesOf(h, offsetof(Header, hash))); }

/// `seed`: of the journal. A record that lies where it was not written is not sound.
std::uint64_t hashOf(const RecordHead& r, std::uint64_t seed, std::uint64_t offset) {
  return hash64(bytesOf(r, offsetof(RecordHead, hash)), seed ^ offset);
}

Header headerOf(const JournalKey& key) {
  Header h;
  h.program = key.program;
  h.level = key.level;
  h.options = key.options;
  h.hash = hashOf(h);
  return h;
}

RecordHead headOf(const JournalPlace& place, std::span<const std::uint8_t> payload, std::uint64_t seed, std::uint64_t offset) {
  RecordHead r;
  r.loop = std::uint32_t(place.loop);
  r.round = place.round;
  r.tile = place.tile;
  r.asked = place.asked;
  r.bytes = payload.size();
  r.payload = hash64(payload, seed);
  r.hash = hashOf(r, seed, offset);
  return r;
}

/// Of a record that is sound, whose loop and round are those of a program: they fit.
std::uint64_t nameOf(const JournalPlace& p) {
  return std::uint64_t(p.loop) << 56 | std::uint64_t(p.round & 0xffffffu) << 32 | std::uint64_t(p.tile);
}

bool readAt(int fd, void* to, std::size_t size, std::uint64_t offset) {
  for (std::size_t at = 0; at < size;) {
    const ssize_t n = ::pread(fd, static_cast<char*>(to) + at, size - at, off_t(offset + at));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    at += std::size_t(n);
  }
  return true;
}

std::atomic<bool> holdsTiles{false};
std::atomic<int> folderOfLocked{-1};  // of the journal whose lock this process has

}  // namespace

bool journalHoldsTiles() noexcept { return holdsTiles; }

void unlinkJournal() noexcept {
  const int folder = folderOfLocked;
  if (folder < 0) return;
  ::unlinkat(folder, Journal::kFile, 0);
  // The folder by its own descriptor: its name may be long, and to put it together takes memory.
  const int out = ::openat(folder, "..", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (out < 0) return;
  ::unlinkat(out, Journal::kFolder, AT_REMOVEDIR);
  ::close(out);
}

Journal::Journal(const fs::path& out, const JournalKey& key) : out_(out), key_(key), seed_(headerOf(key).hash) {
  if (openFolder(false) && openFile(false)) judge();
  holdsTiles = !entries_.empty();
}

Journal::~Journal() {
  if (file_ >= 0) {
    folderOfLocked = -1;
    ::close(file_);
  }
  if (folder_ >= 0) ::close(folder_);
  holdsTiles = false;
}

void Journal::giveUp(const std::string& why) {
  off_ = true;
  trouble_ = why;
}

bool Journal::openFolder(bool make) {
  const fs::path folder = out_ / kFolder;
  if (make && ::mkdir(folder.c_str(), 0777) != 0 && errno != EEXIST) {
    giveUp(fmt::format("its folder cannot be made: {}", std::strerror(errno)));
    return false;
  }
  folder_ = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
  if (folder_ >= 0) return true;
  if (make || errno != ENOENT) {
    found_ = Found::Unusable;
    giveUp(fmt::format("its folder cannot be opened: {}", std::strerror(errno)));
  }
  return false;
}

/// The file, locked: one run at a time has it.
bool Journal::openFile(bool make) {
  const auto fail = [this](Found found, const std::string& why) {
    if (file_ >= 0) ::close(file_);
    file_ = -1;
    found_ = found;
    giveUp(why);
    return false;
  };
  for (int attempt = 0; attempt < kOpenTries; ++attempt) {
    // O_NONBLOCK: a FIFO in its place must not hang the run before fstat can refuse it.
    file_ = ::openat(folder_, kFile, O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC | (make ? O_CREAT : 0), 0666);
    if (file_ < 0 && errno == ENOENT && !make) return false;
    if (file_ < 0) return fail(Found::Unusable, fmt::format("it cannot be opened: {}", std::strerror(errno)));
    struct stat opened {
    }, named{};
    if (::fstat(file_, &opened) != 0 || !S_ISREG(opened.st_mode)) return fail(Found::Unusable, "it is no regular file");
    // A file system without locks lets two runs in; what they write over each other is not sound, and done again.
    if (::flock(file_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) return fail(Found::InUse, make ? "another run has it" : "");
    if (::fstatat(folder_, kFile, &named, AT_SYMLINK_NOFOLLOW) == 0 && named.st_ino == opened.st_ino && named.st_dev == opened.st_dev) {
      folderOfLocked = folder_;
      return true;
    }
    ::close(file_);  // removed by the run that had it, before the lock was ours
    file_ = -1;
  }
  return fail(Found::InUse, "another run has it");
}

void Journal::judge() {
  struct stat info {};
  if (::fstat(file_, &info) != 0) return giveUp(fmt::format("it cannot be read: {}", std::strerror(errno)));
  const auto size = std::uint64_t(info.st_size);
  if (size == 0) return;
  Header h;
  const bool read = size >= sizeof(Header) && readAt(file_, &h, sizeof(Header), 0);
  // Another version may have had another header: that is asked before its hash is.
  if (!read || h.magic != kMagic)
    found_ = Found::Damaged;
  else if (h.format != kFormat || h.program != key_.program)
    found_ = Found::OtherVersion;
  else if (h.hash != hashOf(h))
    found_ = Found::Damaged;
  else if (h.level != key_.level)
    found_ = Found::OtherLevel;
  else if (h.options != key_.options)
    found_ = Found::OtherOptions;
  else
    index(size);
  // What is not sound must not lie behind what is written now.
  if (::ftruncate(file_, off_t(end_)) != 0) giveUp(fmt::format("it cannot be cut: {}", std::strerror(errno)));
}

void Journal::index(std::uint64_t size) {
  found_ = Found::Tiles;
  end_ = sizeof(Header);
  std::vector<std::uint8_t> payload;
  RecordHead r;
  while (size - end_ >= sizeof(RecordHead) && readAt(file_, &r, sizeof(RecordHead), end_)) {
    const Entry entry{end_ + sizeof(RecordHead), r.bytes, r.asked};
    if (r.mark != kMark || r.hash != hashOf(r, seed_, end_) || r.bytes > size - entry.offset) break;
    const JournalPlace place{Loop(r.loop), r.round, r.tile, r.asked};
    if (!readSound(place, entry, payload)) break;
    entries_[nameOf(place)] = entry;
    end_ = entry.offset + entry.bytes;
  }
  tilesFound_ = entries_.size();
  bytesDropped_ = size - end_;
}

bool Journal::readSound(const JournalPlace& place, const Entry& entry, std::vector<std::uint8_t>& payload) const {
  payload.resize(entry.bytes);
  RecordHead r;
  const std::uint64_t offset = entry.offset - sizeof(RecordHead);
  return readAt(file_, &r, sizeof(RecordHead), offset) && readAt(file_, payload.data(), payload.size(), entry.offset) &&
         r.hash == headOf(place, payload, seed_, offset).hash;
}

bool Journal::take(const JournalPlace& place, std::vector<std::uint8_t>& payload) {
  Entry entry;
  {
    const std::lock_guard lock(mutex_);
    const auto it = entries_.find(nameOf(place));
    if (it == entries_.end() || it->second.asked != place.asked) return false;
    entry = it->second;
  }
  if (readSound(place, entry, payload)) {
    ++taken_;
    return true;
  }
  const std::lock_guard lock(mutex_);
  entries_.erase(nameOf(place));
  trouble_ = "a tile of it was changed by others, or can no longer be read: it is done again";
  return false;
}

void Journal::put(const JournalPlace& place, std::span<const std::uint8_t> payload) {
  const std::lock_guard lock(mutex_);
  if (off_ || !start()) return;
  if (end_ + sizeof(RecordHead) + payload.size() > kMostBytes)
    return giveUp(fmt::format("it has {} GB: what is done from now on is not kept", kMostBytes >> 30));
  const RecordHead head = headOf(place, payload, seed_, end_);
  std::vector<std::uint8_t> record(sizeof(RecordHead) + payload.size());
  std::memcpy(record.data(), &head, sizeof(RecordHead));
  if (!payload.empty()) std::memcpy(record.data() + sizeof(RecordHead), payload.data(), payload.size());
  const Entry entry{end_ + sizeof(RecordHead), payload.size(), place.asked};
  if (!append(record)) return;
  entries_[nameOf(place)] = entry;
  holdsTiles = true;
}

/// The file with its header, made when there is something to keep.
bool Journal::start() {
  if (end_ > 0) return true;
  if (folder_ < 0 && !openFolder(true)) return false;
  if (file_ < 0) {
    if (!openFile(true)) return false;
    // Another run may have left one since the constructor looked; it is not this one's.
    if (::ftruncate(file_, 0) != 0) {
      giveUp(fmt::format("it cannot be cut: {}", std::strerror(errno)));
      return false;
    }
  }
  const Header h = headerOf(key_);
  return append(bytesOf(h));
}

bool Journal::append(std::span<const std::uint8_t> record) {
  for (std::size_t at = 0; at < record.size();) {
    const ssize_t n = ::pwrite(file_, record.data() + at, record.size() - at, off_t(end_ + at));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      giveUp(fmt::format("it cannot be written: {}", std::strerror(n < 0 ? errno : EIO)));
      static_cast<void>(!::ftruncate(file_, off_t(end_)));  // a cut record would be found as one, too
      return false;
    }
    at += std::size_t(n);
  }
  end_ += record.size();
  return true;
}

std::size_t Journal::tilesKept() const {
  const std::lock_guard lock(mutex_);
  return entries_.size();
}

std::uint64_t Journal::bytes() const {
  const std::lock_guard lock(mutex_);
  return end_;
}

std::string Journal::trouble() {
  const std::lock_guard lock(mutex_);
  return std::exchange(trouble_, {});
}

void Journal::remove() {
  const std::lock_guard lock(mutex_);
  off_ = true;
  entries_.clear();
  holdsTiles = false;
  if (file_ >= 0) {
    folderOfLocked = -1;  // another run may make its own from now on
    ::unlinkat(folder_, kFile, 0);
  }
  if (folder_ >= 0) ::rmdir((out_ / kFolder).c_str());
}

}  // namespace lmc
