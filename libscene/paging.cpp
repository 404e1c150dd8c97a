#include "libscene/paging.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>
#include <system_error>
#include <vector>

#include "libscene/error.h"

namespace lmc {

namespace fs = std::filesystem;

namespace {

// Of the machine's memory: files up to there stay in the cache. Nothing is to be read ahead for them then: newer kernels (6.18 does) fill
// it in pieces of up to 2 MB and map a whole one wherever a byte is read; else a read maps 64 KB.
constexpr double kShareOfCache = 0.5;
constexpr std::uint64_t kMostMapped_bytes = 2 << 20;
// Who looks after what is resident does it the oftener the nearer the limit is: loops between their items and by places read, the keeper
// for all else.
constexpr unsigned kMostTouches = 64;
constexpr double kFill_bytes_per_s = 2e10;
constexpr std::chrono::microseconds kSoonest{500}, kLatest{20'000};
// Where what is no file leaves less than this, the limit is passed by: to let go all the time would bring the work to a halt. The program's
// own code is a part of it.
constexpr std::uint64_t kLeastRoom_bytes = 32 << 20;

/// Of the process, now; all 0 where the system does not tell.
struct Resident {
  std::uint64_t all_bytes = 0;
  std::uint64_t files_bytes = 0;  // of files and what is shared: blocks, and the program itself
};

Resident resident() {
  static const int file = ::open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
  char text[128];
  const ssize_t n = file < 0 ? -1 : ::pread(file, text, sizeof text - 1, 0);
  if (n <= 0) return {};
  text[n] = '\0';
  unsigned long all = 0, files = 0;  // pages, after those that are mapped
  if (std::sscanf(text, "%*u %lu %lu", &all, &files) != 2) return {};
  const auto page_bytes = std::uint64_t(::sysconf(_SC_PAGESIZE));
  return {all * page_bytes, std::min(all, files) * page_bytes};
}

struct Mapped {
  void* data;
  std::size_t bytes;
};

constexpr std::uint64_t kNoLimit = ~std::uint64_t(0);

/// Blocks in files, and where new ones go.
struct Store {
  std::mutex mutex;
  std::vector<Mapped> blocks;
  bool open = false;
  fs::path folder;
  std::size_t least_bytes = 0;
  std::atomic<std::uint64_t> most_bytes = kNoLimit;  // while no Paging is at work
  std::atomic<unsigned> threads = 1;

  // The pages stay in the file's cache, which is the system's to drop; whoever reads or writes one at this moment finds it again.
  void release() const {
    for (const Mapped& m : blocks) ::madvise(m.data, m.bytes, MADV_DONTNEED);
  }
};

std::atomic<std::uint64_t> inFiles_bytes = 0;
static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

// Not a static object's destructor: blocks of other static objects may end after it.
Store& store() {
  static Store* const s = new Store;
  return *s;
}

[[noreturn]] void fail(const fs::path& folder, std::size_t bytes, int error) {
  const bool noRoom = error == ENOSPC || error == EDQUOT || error == EFBIG || error == ENOMEM;
  throw Error(noRoom ? Exit::Limit : Exit::Io, folder, "",
              fmt::format("cannot set aside {} MB for what memory is not to hold: {}", bytes >> 20, std::strerror(error)));
}

/// A file that is gone when it is closed, however the process ends.
int openNameless(const fs::path& folder) {
  const char* const where = folder.empty() ? "." : folder.c_str();
  const int fd = ::open(where, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (fd >= 0 || (errno != EOPNOTSUPP && errno != EISDIR && errno != EINVAL)) return fd;
  // A file system without files that have no name: it has one for a moment.
  std::string name = (folder / ".pages.XXXXXX.lmc.part").string();
  const int named = ::mkostemps(name.data(), int(std::strlen(".lmc.part")), O_CLOEXEC);
  if (named >= 0) ::unlink(name.c_str());
  return named;
}

void* mapFile(const fs::path& folder, std::size_t bytes) {
  const int fd = openNameless(folder);
  if (fd < 0) fail(folder, bytes, errno);
  // Room is taken now: a page of a sparse file that finds the disk full would be a SIGBUS.
  int error = 0;
  do error = ::posix_fallocate(fd, 0, off_t(bytes));
  while (error == EINTR);
  void* data = MAP_FAILED;
  if (error == 0) {
    data = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (data == MAP_FAILED) error = errno;
  }
  ::close(fd);
  if (error != 0) fail(folder, bytes, error);
  return data;
}

/// In a file, if one is to be.
void* mapWhereOpen(std::size_t bytes) {
  Store& s = store();
  const std::lock_guard lock(s.mutex);
  if (!s.open || bytes < s.least_bytes) return nullptr;
  s.blocks.reserve(s.blocks.size() + 1);  // what follows may not throw any more
  void* const data = mapFile(s.folder, bytes);
  s.blocks.push_back({data, bytes});
  inFiles_bytes += bytes;
  if (double(inFiles_bytes) < kShareOfCache * double(physicalBytes())) ::madvise(data, bytes, MADV_RANDOM);
  return data;
}

}  // namespace

Block::Block(std::size_t bytes) : bytes_(bytes) {
  if (bytes == 0) return;
  if ((data_ = mapWhereOpen(bytes))) {
    inFile_ = true;
    return;
  }
  data_ = std::calloc(bytes, 1);
  if (!data_) throw std::bad_alloc();
}

Block::~Block() {
  if (!data_) return;
  if (!inFile_) {
    std::free(data_);
    return;
  }
  Store& s = store();
  const std::lock_guard lock(s.mutex);
  std::erase_if(s.blocks, [this](const Mapped& m) { return m.data == data_; });
  inFiles_bytes -= bytes_;
  ::munmap(data_, bytes_);
}

Paging::Paging(fs::path folder, std::uint64_t most_bytes, int threads, std::size_t least_bytes) {
  try {
    keeper_ = std::thread([this] { keep(); });
  } catch (const std::system_error& e) {
    throw Error(Exit::Limit, folder, "", fmt::format("no thread for what keeps to --memory: {}", e.what()));
  }
  Store& s = store();
  const std::lock_guard lock(s.mutex);
  s.folder = std::move(folder);
  s.least_bytes = std::max<std::size_t>(1, least_bytes);
  s.most_bytes = most_bytes;
  s.threads = unsigned(std::max(1, threads));
  s.open = true;
}

Paging::~Paging() {
  {
    Store& s = store();
    const std::lock_guard lock(s.mutex);
    s.open = false;
    s.most_bytes = kNoLimit;
  }
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  ended_.notify_one();
  keeper_.join();
}

std::uint64_t Paging::filesBytes() noexcept { return inFiles_bytes; }

void Paging::release() {
  Store& s = store();
  const std::lock_guard lock(s.mutex);
  s.release();
}

std::uint64_t Paging::keepToMost() {
  Store& s = store();
  const auto room = [&] {
    const std::uint64_t most = s.most_bytes;
    if (most == kNoLimit) return kNoLimit;
    const Resident now = resident();
    const std::uint64_t allowed = std::max(most, now.all_bytes - now.files_bytes + kLeastRoom_bytes);
    return allowed - std::min(allowed, now.all_bytes);
  };
  if (const std::uint64_t left = room(); left > 0) return left;
  // Threads that come here meanwhile wait, and find it done: so no more comes in than each brings between two calls.
  const std::lock_guard lock(s.mutex);
  if (const std::uint64_t left = room(); left > 0) return left;
  s.release();
  return room();
}

unsigned Paging::touchesAllowed() {
  // Half of the room, shared by all threads: what others bring in meanwhile is not known.
  const std::uint64_t share_bytes = keepToMost() / (2 * store().threads);
  return unsigned(std::clamp<std::uint64_t>(share_bytes / kMostMapped_bytes, 1, kMostTouches));
}

void Paging::keep() {
  std::unique_lock lock(mutex_);
  while (!done_) {
    const double room_s = double(keepToMost()) / kFill_bytes_per_s;
    ended_.wait_for(lock, std::clamp(std::chrono::microseconds(std::int64_t(1e6 * room_s)), kSoonest, kLatest));
  }
}

std::uint64_t residentBytes() { return resident().all_bytes; }

std::uint64_t physicalBytes() { return std::uint64_t(::sysconf(_SC_PHYS_PAGES)) * std::uint64_t(::sysconf(_SC_PAGESIZE)); }

}  // namespace lmc
