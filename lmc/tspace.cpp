#include "lmc/tspace.h"

#include <fmt/format.h>

#include <cstring>

#include "libscene/files.h"

namespace lmc {

namespace {

constexpr std::size_t kHeader = 16, kEntry = 32;
constexpr std::size_t kSizeOfType[] = {4, 4, 1};

class Reader {
 public:
  explicit Reader(const std::filesystem::path& file) : file_(file), bytes_(readFile(file)) {
    if (bytes_.size() < kHeader || std::memcmp(bytes_.data(), "TSPACE01", 8) != 0) fail("", "is no file of tangent vectors");
    if (word(8) > (bytes_.size() - kHeader) / kEntry) fail("", "ends within its table");
  }

  /// An array by its name; empty when it is missing.
  template <class T>
  std::vector<T> array(std::string_view name, std::uint32_t type, std::uint32_t components, bool needed) const {
    for (std::uint32_t i = 0; i < word(8); ++i) {
      const std::size_t entry = kHeader + kEntry * i;
      const char* text = reinterpret_cast<const char*>(bytes_.data() + entry);
      if (std::string_view(text, strnlen(text, 16)) != name) continue;
      const std::size_t count = word(entry + 24), offset = word(entry + 28), size = count * components * kSizeOfType[type];
      if (word(entry + 16) != type || word(entry + 20) != components) fail(name, "has another type or number of components");
      if (offset > bytes_.size() || size > bytes_.size() - offset) fail(name, "reaches beyond the end of the file");
      std::vector<T> out(count);
      if (size > 0) std::memcpy(static_cast<void*>(out.data()), bytes_.data() + offset, size);
      return out;
    }
    if (needed) fail(name, "is missing");
    return {};
  }

  [[noreturn]] void fail(std::string_view where, std::string_view what) const {
    throw Error(Exit::Broken, file_, where, what, "LMC_TSPACE");
  }

 private:
  std::uint32_t word(std::size_t at) const {
    std::uint32_t value;
    std::memcpy(&value, bytes_.data() + at, sizeof value);
    return value;
  }
  std::filesystem::path file_;
  std::vector<std::uint8_t> bytes_;
};

}  // namespace

TangentVectors readTangentVectors(const std::filesystem::path& file) {
  const Reader in(file);
  TangentVectors out;
  out.positions = in.array<glm::vec3>("positions", 0, 3, true);
  out.normals = in.array<glm::vec3>("normals", 0, 3, true);
  out.uvs = in.array<glm::vec2>("texcoords", 0, 2, true);
  out.indices = in.array<std::uint32_t>("indices", 1, 1, true);
  out.faceSizes = in.array<std::uint8_t>("face_sizes", 2, 1, false);
  out.tangents = in.array<glm::vec4>("tangents", 0, 4, true);
  out.ambiguity = in.array<std::uint8_t>("ambiguity", 2, 1, false);
  if (const std::string problem = tangent::problemWith(out.surface()); !problem.empty()) in.fail("", problem);
  if (out.tangents.size() != out.indices.size()) in.fail("tangents", "has not one value per corner");
  if (out.ambiguity.empty()) out.ambiguity.assign(out.indices.size(), 0);
  if (out.ambiguity.size() != out.indices.size()) in.fail("ambiguity", "has not one value per corner");
  return out;
}

}  // namespace lmc
