/// Layout: "OpenEXR File Layout", openexr.com [exr-layout].
#include "libscene/exr_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <span>
#include <string_view>

#include "libscene/error.h"

namespace lmc {

namespace {

constexpr std::uint32_t kMagic = 20000630, kVersion = 2;
constexpr std::uint32_t kTiled = 0x200, kLongNames = 0x400;  // the flags of files with one flat part
constexpr std::size_t kMaxName = 255, kMaxChannels = 1024;
constexpr std::int64_t kMaxSide = 1 << 20;
// Deflate shrinks 1032-fold at most, PIZ's runs of one code less: pixels of which the file cannot hold so much are not there. Only where
// they are many is that a trap.
constexpr std::uint64_t kMostShrunk = 1100, kBombBytes = std::uint64_t(64) << 20;
constexpr std::uint64_t kOffsetBytes = 8;  // of each block, in the table behind the header

struct Box {
  std::int32_t xMin, yMin, xMax, yMax;
};

/// A part of the file that must be there.
class Reader {
 public:
  Reader(const std::filesystem::path& file, std::span<std::uint8_t> bytes) : file_(file), bytes_(bytes) {}

  [[noreturn]] void broken(std::string_view what) const {
    throw Error(Exit::Broken, file_, "", fmt::format("is not a readable EXR file: {}", what), "LMC_EXR");
  }
  std::size_t left() const { return bytes_.size() - at_; }
  std::span<std::uint8_t> take(std::size_t n) {
    if (n > left()) broken("it ends within its header");
    at_ += n;
    return bytes_.subspan(at_ - n, n);
  }
  template <class T>
  T number() {
    T value;
    std::memcpy(&value, take(sizeof(T)).data(), sizeof(T));
    return value;
  }
  /// Zero-terminated; empty at the end of a list.
  std::span<std::uint8_t> name() {
    const auto rest = bytes_.subspan(at_, std::min(left(), kMaxName + 1));
    const auto end = std::ranges::find(rest, std::uint8_t(0));
    if (end == rest.end()) broken("a name in its header does not end");
    const auto out = take(std::size_t(end - rest.begin()));
    take(1);
    return out;
  }
  Reader part(std::size_t n) { return Reader(file_, take(n)); }

 private:
  const std::filesystem::path& file_;
  std::span<std::uint8_t> bytes_;
  std::size_t at_ = 0;
};

std::string_view textOf(std::span<const std::uint8_t> bytes) { return {reinterpret_cast<const char*>(bytes.data()), bytes.size()}; }

struct Header {
  std::optional<Box> window;
  std::optional<std::uint8_t> compression;
  std::uint64_t bytesAPixel = 0;  ///< of all channels; 0 = no list of them
  std::optional<std::array<std::uint32_t, 2>> tile;
};

std::uint64_t bytesAPixel(const std::filesystem::path& file, Reader in) {
  std::uint64_t sum = 0;
  for (std::size_t count = 0;; ++count) {
    if (in.name().empty()) break;
    if (count == kMaxChannels)
      throw Error(Exit::Limit, file, "", fmt::format("has more than {} channels", kMaxChannels), "LMC_TEXTURE_TOO_LARGE");
    const auto type = in.number<std::uint32_t>();
    in.number<std::uint32_t>();  // linear or not, reserved
    const auto xSampling = in.number<std::int32_t>(), ySampling = in.number<std::int32_t>();
    if (type > 2) in.broken("a channel has an unknown type");
    if (xSampling != 1 || ySampling != 1) throw Error(Exit::Unsupported, file, "", "subsampled channels are not supported", "LMC_EXR_KIND");
    sum += type == 1 ? 2 : 4;
  }
  if (in.left() > 0) in.broken("its list of channels has an odd length");
  return sum;
}

/// Attributes that OpenEXR itself needs; those of fixed size must have it.
struct Needed {
  std::string_view name, type;
  std::size_t size;  ///< 0 = any
};
constexpr std::array kNeeded{
    Needed{"channels", "chlist", 0},        Needed{"compression", "compression", 1}, Needed{"dataWindow", "box2i", 16},
    Needed{"displayWindow", "box2i", 16},   Needed{"lineOrder", "lineOrder", 1},     Needed{"pixelAspectRatio", "float", 4},
    Needed{"screenWindowCenter", "v2f", 8}, Needed{"screenWindowWidth", "float", 4}, Needed{"tiles", "tiledesc", 9}};

Header readAttributes(const std::filesystem::path& file, Reader& in) {
  Header out;
  for (;;) {
    const auto name = in.name();
    if (name.empty()) return out;
    const auto type = in.name();
    if (type.empty()) in.broken("an attribute has no type");
    const auto size = in.number<std::uint32_t>();
    if (size > in.left()) in.broken(fmt::format("attribute '{}' is longer than the file", textOf(name)));
    Reader value = in.part(size);
    const auto needed = std::ranges::find(kNeeded, textOf(name), &Needed::name);
    if (needed == kNeeded.end()) {
      // A float is lmc's own business (lmcScale); of anything else OpenEXR shall keep the bytes.
      if (textOf(type) != "float" || size != 4) type[0] = '?';
      continue;
    }
    if (textOf(type) != needed->type || (needed->size > 0 && size != needed->size))
      in.broken(fmt::format("attribute '{}' is not a {}", textOf(name), needed->type));
    if (needed->name == "channels") out.bytesAPixel = bytesAPixel(file, value);
    if (needed->name == "compression") out.compression = value.number<std::uint8_t>();
    if (needed->name == "dataWindow") out.window = value.number<Box>();
    if (needed->name == "tiles") out.tile = value.number<std::array<std::uint32_t, 2>>();
  }
}

/// Rows of one block, by compression: none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A, DWAA, DWAB.
constexpr std::array<std::uint64_t, 10> kRows{1, 1, 1, 16, 32, 16, 32, 32, 32, 256};

}  // namespace

void checkExrHeader(const std::filesystem::path& file, std::vector<std::uint8_t>& bytes, std::uint64_t maxPixels) {
  Reader in(file, bytes);
  if (in.number<std::uint32_t>() != kMagic) in.broken("it does not begin as one");
  const auto version = in.number<std::uint32_t>();
  if ((version & 0xff) != kVersion) in.broken("it has an unknown version");
  if ((version & ~(0xff | kTiled | kLongNames)) != 0)
    throw Error(Exit::Unsupported, file, "", "EXR files of several parts and of deep pixels are not supported", "LMC_EXR_KIND");
  const Header header = readAttributes(file, in);
  if (!header.window || !header.compression || header.bytesAPixel == 0) in.broken("its header names no window, compression or channel");
  if (*header.compression >= kRows.size()) in.broken("it has an unknown compression");
  const bool tiled = (version & kTiled) != 0;
  if (tiled && !header.tile) in.broken("its header names no tiles");

  const std::int64_t width = std::int64_t(header.window->xMax) - header.window->xMin + 1,
                     height = std::int64_t(header.window->yMax) - header.window->yMin + 1;
  if (width <= 0 || height <= 0) in.broken("its window is empty");
  const auto w = std::uint64_t(width), h = std::uint64_t(height);
  if (width > kMaxSide || height > kMaxSide || w * h > maxPixels)
    throw Error(Exit::Limit, file, "", fmt::format("a picture of {} x {} is above the limit of {} in all", w, h, maxPixels),
                "LMC_TEXTURE_TOO_LARGE");
  const auto refuseBomb = [&](std::uint64_t pixels) {
    if (const std::uint64_t all = pixels * header.bytesAPixel; all > kBombBytes && all / kMostShrunk > bytes.size())
      throw Error(Exit::Limit, file, "", fmt::format("{} x {} pixels from {} bytes: a picture made to fill the memory", w, h, bytes.size()),
                  "LMC_TEXTURE_TOO_LARGE");
  };
  refuseBomb(w * h);
  std::uint64_t blocks = (h + kRows[*header.compression] - 1) / kRows[*header.compression];
  if (tiled) {
    const auto [tileW, tileH] = *header.tile;
    if (tileW == 0 || tileH == 0 || tileW > kMaxSide || tileH > kMaxSide) in.broken("its tiles have no size");
    refuseBomb(std::uint64_t(tileW) * tileH);
    blocks = ((w + tileW - 1) / tileW) * ((h + tileH - 1) / tileH);
  }
  if (blocks > in.left() / kOffsetBytes) in.broken("it ends within the table of its blocks");
}

}  // namespace lmc
