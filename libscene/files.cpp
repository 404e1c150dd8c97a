#include "libscene/files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace lmc {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t kBufferBytes = 1 << 20;
constexpr int kNameTries = 100;
constexpr std::string_view kTemporary = ".lmc.part";

Exit kindOf(int error) { return error == ENOSPC || error == EDQUOT || error == EFBIG || error == ENOMEM ? Exit::Limit : Exit::Io; }

struct Closer {
  int fd;
  ~Closer() {
    if (fd >= 0) ::close(fd);
  }
};

/// -1 where the file system does not let a folder be opened.
int openFolder(const fs::path& folder) { return ::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC); }

// Names of the temporary files that are there, for a signal handler: no allocation, no lock. One that finds no free place stays behind if
// the process is ended by a signal, and goes with the next run.
constexpr std::size_t kNames = 512, kNameBytes = 1024;
struct TemporaryName {
  std::atomic<bool> taken{false}, there{false};
  std::array<char, kNameBytes> path{};
};
std::array<TemporaryName, kNames> temporaryNames;
std::atomic<bool> filesAreNamed{false};

std::size_t remember(const fs::path& path) {
  if (path.native().size() >= kNameBytes) return kNames;
  for (std::size_t i = 0; i < kNames; ++i) {
    TemporaryName& name = temporaryNames[i];
    if (name.taken.exchange(true)) continue;
    std::memcpy(name.path.data(), path.c_str(), path.native().size() + 1);
    name.there = true;
    return i;
  }
  return kNames;
}

void forget(std::size_t place) {
  if (place >= kNames) return;
  temporaryNames[place].there = false;
  temporaryNames[place].taken = false;
}

/// Temporary files whose process is no more: it would hold their lock.
void removeAbandoned(const fs::path& folder) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    if (name.empty() || name.front() != '.' || !name.ends_with(kTemporary) || !entry.is_regular_file(error)) continue;
    const Closer file{::open(entry.path().c_str(), O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC)};
    if (file.fd >= 0 && ::flock(file.fd, LOCK_EX | LOCK_NB) == 0) ::unlink(entry.path().c_str());
  }
}

}  // namespace

std::string line(std::string_view kind, std::string_view file, std::string_view where, std::string_view text, std::string_view code) {
  std::string out;
  const auto put = [&](std::string_view part) {
    for (const char c : part) {
      if (static_cast<unsigned char>(c) < 32 || c == 127)
        out += fmt::format("\\x{:02x}", static_cast<unsigned char>(c));
      else
        out += c;
    }
  };
  put(file);
  if (!where.empty()) {
    out += ':';
    put(where);
  }
  if (!out.empty()) out += ": ";
  out += kind;
  out += ": ";
  put(text);
  if (!code.empty()) {
    out += " [";
    out += code;
    out += ']';
  }
  return out;
}

namespace {

/// Of errors whose text says all that a program could act on.
std::string_view codeOf(Exit kind) {
  switch (kind) {
    case Exit::Usage:
      return "LMC_USAGE";
    case Exit::Io:
      return "LMC_FILE";
    case Exit::Broken:
      return "LMC_BROKEN";
    case Exit::Unsupported:
      return "LMC_UNSUPPORTED";
    case Exit::Numerical:
      return "LMC_NUMERICAL";
    case Exit::Limit:
      return "LMC_LIMIT";
    case Exit::Internal:
      return "LMC_INTERNAL";
    default:
      return "";
  }
}

}  // namespace

Error::Error(Exit kind_, const fs::path& file_, std::string_view where_, std::string_view what_, std::string_view code_)
    : std::runtime_error(line("error", file_.string(), where_, what_, code_.empty() ? codeOf(kind_) : code_)),
      kind(kind_),
      file(file_.string()),
      where(where_),
      text(what_),
      code(code_.empty() ? codeOf(kind_) : code_) {}

std::vector<std::uint8_t> readFile(const fs::path& file, std::uint64_t maxBytes) {
  // O_NONBLOCK: a FIFO in the place of a file must not hang the run before fstat can refuse it.
  const int fd = ::open(file.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) throw Error(Exit::Io, file, "", errno == ENOENT ? "no such file" : fmt::format("cannot be opened: {}", std::strerror(errno)));
  const Closer closer{fd};
  struct stat info {};
  if (::fstat(fd, &info) != 0) throw Error(Exit::Io, file, "", fmt::format("cannot be read: {}", std::strerror(errno)));
  if (S_ISDIR(info.st_mode)) throw Error(Exit::Io, file, "", "is a folder, not a file");
  if (!S_ISREG(info.st_mode)) throw Error(Exit::Io, file, "", "is not a regular file");
  if (std::uint64_t(info.st_size) > maxBytes)
    throw Error(Exit::Limit, file, "", fmt::format("has {} bytes, the limit is {}", std::uint64_t(info.st_size), maxBytes));
  std::vector<std::uint8_t> bytes(std::size_t(info.st_size));
  for (std::size_t at = 0; at < bytes.size();) {
    const ssize_t n = ::read(fd, bytes.data() + at, bytes.size() - at);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw Error(Exit::Io, file, "", fmt::format("cannot be read: {}", std::strerror(errno)));
    if (n == 0) throw Error(Exit::Broken, file, "", "became shorter while it was read");
    at += std::size_t(n);
  }
  return bytes;
}

OutputFile::OutputFile(const fs::path& target) : target_(target) {
  // A name that a killed run of the same process number left behind is passed by.
  for (int attempt = 0; attempt < kNameTries && fd_ < 0; ++attempt) {
    temporary_ = target.parent_path() / fmt::format(".{}.{}-{}{}", target.filename().string(), ::getpid(), attempt, kTemporary);
    fd_ = ::open(temporary_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
    if (fd_ < 0 && errno != EEXIST) break;
  }
  if (fd_ < 0) fail("be written", errno);
  remembered_ = remember(temporary_);
  static_cast<void>(::flock(fd_, LOCK_EX | LOCK_NB));  // says that this run lives; a file system without locks keeps what is abandoned
  buffer_.reserve(kBufferBytes);
}

OutputFile::~OutputFile() {
  if (fd_ >= 0) ::close(fd_);
  if (!renamed_) ::unlink(temporary_.c_str());
  forget(remembered_);
}

void OutputFile::fail(const char* doing, int error) {
  failedDoing_ = doing;
  failedBy_ = error;
  throw Error(kindOf(error), target_, "", fmt::format("cannot {}: {}", doing, std::strerror(error)));
}

void OutputFile::flush() {
  for (std::size_t at = 0; at < buffer_.size();) {
    const ssize_t n = ::pwrite(fd_, buffer_.data() + at, buffer_.size() - at, off_t(bufferStart_ + at));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) fail("be written", errno);
    at += std::size_t(n);
  }
  bufferStart_ += buffer_.size();
  buffer_.clear();
}

void OutputFile::write(const void* data, std::size_t size) {
  const char* bytes = static_cast<const char*>(data);
  while (size > 0) {
    const std::size_t n = std::min(size, kBufferBytes - buffer_.size());
    buffer_.insert(buffer_.end(), bytes, bytes + n);
    bytes += n;
    size -= n;
    position_ += n;
    size_ = std::max(size_, position_);
    if (buffer_.size() == kBufferBytes) flush();
  }
}

void OutputFile::seek(std::uint64_t position) {
  flush();
  position_ = bufferStart_ = position;
}

std::string OutputFile::hash() {
  if (failedDoing_) fail(failedDoing_, failedBy_);
  flush();
  std::vector<std::uint8_t> part(kBufferBytes);
  XXH3_state_t state;
  XXH3_64bits_reset(&state);
  for (std::uint64_t at = 0; at < size_;) {
    const ssize_t n = ::pread(fd_, part.data(), part.size(), off_t(at));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) fail("be read back", n < 0 ? errno : EIO);
    XXH3_64bits_update(&state, part.data(), std::size_t(n));
    at += std::uint64_t(n);
  }
  return fmt::format("{:016x}", XXH3_64bits_digest(&state));
}

void OutputFile::finish() {
  if (failedDoing_) fail(failedDoing_, failedBy_);
  flush();
  if (::fsync(fd_) != 0) fail("be synced", errno);
  struct stat info {};
  if (::fstat(fd_, &info) != 0) fail("be checked", errno);
  if (std::uint64_t(info.st_size) != size_) fail("be written whole", EIO);
  // What only a close would tell, before anything has its name; the file itself stays open, and so locked, until then.
  const int copy = ::dup(fd_);
  if (copy < 0 || ::close(copy) != 0) fail("be closed", errno);
}

void OutputFile::rename() {
  if (::rename(temporary_.c_str(), target_.c_str()) != 0) fail("be put in its place", errno);
  renamed_ = true;
  forget(remembered_);
  remembered_ = kNames;
}

OutputSet::OutputSet(const fs::path& folder) : folder_(folder) {
  std::error_code error;
  if (!fs::exists(folder_, error)) {
    madeFolder_ = fs::create_directories(folder_, error);
    if (error) throw Error(kindOf(error.value()), folder_, "", fmt::format("cannot be made: {}", error.message()));
  }
  if (!fs::is_directory(folder_, error)) throw Error(Exit::Io, folder_, "", "is not a folder");
  if (::access(folder_.c_str(), W_OK | X_OK) != 0)
    throw Error(kindOf(errno), folder_, "", fmt::format("cannot be written to: {}", std::strerror(errno)));
  removeAbandoned(folder_);
}

OutputFile& OutputSet::open(const fs::path& name) {
  files_.emplace_back(new OutputFile(folder_ / name));
  return *files_.back();
}

void OutputSet::commit() {
  for (const auto& file : files_)
    if (fs::is_directory(file->target_)) throw Error(Exit::Io, file->target_, "", "cannot be written: a folder has its name");
  for (const auto& file : files_) file->finish();
  const Closer folder{openFolder(folder_)};
  if (folder.fd >= 0) static_cast<void>(::flock(folder.fd, LOCK_EX));  // two runs into one folder: one set after the other
  {
    struct Naming {
      Naming() { filesAreNamed = true; }
      ~Naming() { filesAreNamed = false; }
    } naming;
    for (const auto& file : files_) file->rename();
    committed_ = true;
  }
  if (folder.fd >= 0) ::fsync(folder.fd);
}

OutputSet::~OutputSet() {
  files_.clear();
  std::error_code ignored;
  if (madeFolder_ && !committed_) fs::remove(folder_, ignored);  // removes an empty folder only
}

void writeFileWhole(const fs::path& file, std::string_view bytes) {
  const fs::path folder = file.parent_path().empty() ? fs::path(".") : file.parent_path();
  OutputSet set(folder);
  set.open(file.filename()).write(bytes);
  set.commit();
}

bool isNamingFiles() noexcept { return filesAreNamed; }

void removeTemporaryFiles() noexcept {
  for (const TemporaryName& name : temporaryNames)
    if (name.there) ::unlink(name.path.data());
}

std::uint64_t hash64(std::span<const std::uint8_t> bytes, std::uint64_t seed) {
  return XXH3_64bits_withSeed(bytes.data(), bytes.size(), seed);
}

std::string contentHash(std::span<const std::uint8_t> bytes) { return fmt::format("{:016x}", hash64(bytes)); }

}  // namespace lmc
