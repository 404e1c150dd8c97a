#include "libscene/files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace lmc {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t kBufferBytes = 1 << 20;
constexpr int kNameTries = 100;

Exit kindOf(int error) { return error == ENOSPC || error == EDQUOT || error == EFBIG || error == ENOMEM ? Exit::Limit : Exit::Io; }

void syncFolder(const fs::path& folder) {
  const int fd = ::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;  // some file systems do not let a folder be opened; the rename itself has succeeded
  ::fsync(fd);
  ::close(fd);
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

Error::Error(Exit kind_, const fs::path& file_, std::string_view where_, std::string_view what_, std::string_view code_)
    : std::runtime_error(line("error", file_.string(), where_, what_, code_)),
      kind(kind_),
      file(file_.string()),
      where(where_),
      text(what_),
      code(code_) {}

std::vector<std::uint8_t> readFile(const fs::path& file, std::uint64_t maxBytes) {
  // O_NONBLOCK: a FIFO in the place of a file must not hang the run before fstat can refuse it.
  const int fd = ::open(file.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) throw Error(Exit::Io, file, "", errno == ENOENT ? "no such file" : fmt::format("cannot be opened: {}", std::strerror(errno)));
  struct Closer {
    int fd;
    ~Closer() { ::close(fd); }
  } closer{fd};
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

OutputFile::OutputFile(const fs::path& target, const fs::path& temporary) : target_(target), temporary_(temporary) {
  // A name that a killed run of the same process number left behind is passed by.
  for (int attempt = 1; attempt <= kNameTries; ++attempt) {
    fd_ = ::open(temporary_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
    if (fd_ >= 0 || errno != EEXIST) break;
    temporary_ = temporary;
    temporary_.replace_extension(fmt::format("{}.part", attempt));
  }
  if (fd_ < 0) fail("be written", errno);
  buffer_.reserve(kBufferBytes);
}

OutputFile::~OutputFile() {
  if (fd_ >= 0) ::close(fd_);
  if (!renamed_) ::unlink(temporary_.c_str());
}

void OutputFile::fail(std::string_view doing, int error) const {
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
  flush();
  if (::fsync(fd_) != 0) fail("be synced", errno);
  struct stat info {};
  if (::fstat(fd_, &info) != 0) fail("be checked", errno);
  if (std::uint64_t(info.st_size) != size_) fail("be written whole", EIO);
  const int fd = fd_;
  fd_ = -1;
  if (::close(fd) != 0) fail("be closed", errno);
}

void OutputFile::rename() {
  if (::rename(temporary_.c_str(), target_.c_str()) != 0) fail("be put in its place", errno);
  renamed_ = true;
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
}

OutputFile& OutputSet::open(const fs::path& name) {
  const fs::path target = folder_ / name;
  files_.emplace_back(new OutputFile(target, folder_ / fmt::format(".{}.{}.part", name.string(), ::getpid())));
  return *files_.back();
}

void OutputSet::commit() {
  for (const auto& file : files_)
    if (fs::is_directory(file->target_)) throw Error(Exit::Io, file->target_, "", "cannot be written: a folder has its name");
  for (const auto& file : files_) file->finish();
  for (const auto& file : files_) file->rename();
  syncFolder(folder_);
  committed_ = true;
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

std::string contentHash(std::span<const std::uint8_t> bytes) { return fmt::format("{:016x}", XXH3_64bits(bytes.data(), bytes.size())); }

}  // namespace lmc
