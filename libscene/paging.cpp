#include "libscene/paging.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <new>
#include <system_error>
#include <vector>

#include "libscene/error.h"

namespace lmc {

namespace fs = std::filesystem;

namespace {

// The keeper looks the oftener the nearer the limit is: at this rate two threads can fill fresh pages.
constexpr double kFill_bytes_per_s = 4e9;
constexpr std::chrono::microseconds kSoonest{500}, kLatest{50'000};
// Where what cannot be let go leaves less than this, the limit is passed by: to let go all the time would bring the work to a halt.
constexpr std::uint64_t kLeastRoom_bytes = 32 << 20;

struct Mapped {
  void* data;
  std::size_t bytes;
};

/// Blocks in files, and where new ones go.
struct Store {
  std::mutex mutex;
  std::vector<Mapped> blocks;
  bool open = false;
  fs::path folder;
  std::size_t least_bytes = 0;
};

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
  ::munmap(data_, bytes_);
}

Paging::Paging(fs::path folder, std::uint64_t most_bytes, std::size_t least_bytes) : most_bytes_(most_bytes) {
  try {
    keeper_ = std::thread([this] { keep(); });
  } catch (const std::system_error& e) {
    throw Error(Exit::Limit, folder, "", fmt::format("no thread for what keeps to --memory: {}", e.what()));
  }
  Store& s = store();
  const std::lock_guard lock(s.mutex);
  s.folder = std::move(folder);
  s.least_bytes = std::max<std::size_t>(1, least_bytes);
  s.open = true;
}

Paging::~Paging() {
  {
    Store& s = store();
    const std::lock_guard lock(s.mutex);
    s.open = false;
  }
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  ended_.notify_one();
  keeper_.join();
}

void Paging::release() {
  Store& s = store();
  const std::lock_guard lock(s.mutex);
  // The pages stay in the file's cache, which is the system's to drop; whoever reads or writes one at this moment finds it again.
  for (const Mapped& m : s.blocks) ::madvise(m.data, m.bytes, MADV_DONTNEED);
}

void Paging::keep() {
  std::uint64_t stays_bytes = 0;  // what cannot be let go, as far as it was seen
  std::unique_lock lock(mutex_);
  while (!done_) {
    std::uint64_t resident = residentBytes();
    stays_bytes = std::min(stays_bytes, resident);
    if (resident > std::max(most_bytes_, stays_bytes + kLeastRoom_bytes)) {
      release();
      stays_bytes = resident = residentBytes();
    }
    const std::uint64_t allowed_bytes = std::max(most_bytes_, stays_bytes + kLeastRoom_bytes);
    const double room_s = double(allowed_bytes - std::min(allowed_bytes, resident)) / kFill_bytes_per_s;
    const std::chrono::microseconds wait(std::int64_t(1e6 * room_s));
    ended_.wait_for(lock, std::clamp(wait, kSoonest, kLatest));
  }
}

std::uint64_t residentBytes() {
  static const int file = ::open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
  char text[128];
  const ssize_t n = file < 0 ? -1 : ::pread(file, text, sizeof text, 0);
  if (n <= 0) return 0;
  const char* at = std::find(text, text + n, ' ');
  std::uint64_t pages = 0;
  if (at < text + n) std::from_chars(at + 1, text + n, pages);
  return pages * std::uint64_t(::sysconf(_SC_PAGESIZE));
}

}  // namespace lmc
