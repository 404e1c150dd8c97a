#include <fstream>  // tiny_gltf.h forgets it with TINYGLTF_NO_FS
#define TINYGLTF_IMPLEMENTATION
#include "libscene/gltf_read.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <limits>
#include <unordered_set>

#include <fmt/format.h>

#include "libscene/files.h"
#include "libscene/gltf_check.h"

namespace lmc {
namespace {

namespace fs = std::filesystem;

constexpr std::uint32_t kGlbMagic = 0x46546c67u;   // "glTF"
constexpr std::uint32_t kJsonChunk = 0x4e4f534au;  // "JSON"
constexpr std::uint32_t kBinChunk = 0x004e4942u;   // "BIN\0"
// Ordered objects find a member by looking at each: more than this in one object is quadratic work and no level.
constexpr std::size_t kMaxMembers = 8192;

constexpr std::uint64_t kMaxZeroBytes = 1u << 24;  // of a buffer that the file does not give

struct Descriptor {
  int fd = -1;
  explicit Descriptor(int fd_) : fd(fd_) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (fd >= 0) ::close(fd);
  }
};

/// Who asks for a file, for the message.
struct Asker {
  const fs::path& level;
  std::string where;  ///< empty for the level itself
};

Error cannotRead(const Asker& asker, const fs::path& path, int error) {
  const bool missing = error == ENOENT || error == ENOTDIR;
  const std::string what = asker.where.empty() ? std::string(missing ? "no such file" : std::strerror(error))
                                               : fmt::format("cannot read {}: {}", path.filename().string(), std::strerror(error));
  return Error(error == ENAMETOOLONG && !asker.where.empty() ? Exit::Broken : Exit::Io, asker.level, asker.where, what,
               missing ? "LMC_FILE_MISSING" : "LMC_FILE_UNREADABLE");
}

std::vector<std::uint8_t> readFile(const fs::path& path, const Asker& asker, std::uint64_t maxBytes) {
  // O_NONBLOCK: opening a FIFO must not wait for a writer.
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC | O_NOCTTY));
  if (file.fd < 0) throw cannotRead(asker, path, errno);
  struct stat info {};
  if (::fstat(file.fd, &info) != 0) throw cannotRead(asker, path, errno);
  if (!S_ISREG(info.st_mode))
    throw Error(asker.where.empty() ? Exit::Io : Exit::Broken, asker.level, asker.where,
                S_ISDIR(info.st_mode) ? "is a folder, not a file" : "is not a regular file", "LMC_URI");
  const auto size = std::uint64_t(info.st_size);
  if (size > maxBytes)
    throw Error(Exit::Broken, asker.level, asker.where, fmt::format("{} bytes are above the limit of all input files together", size),
                "LMC_INPUT_TOO_LARGE");
  std::vector<std::uint8_t> bytes(size);
  std::size_t have = 0;
  while (have < bytes.size()) {
    const ssize_t got = ::read(file.fd, bytes.data() + have, bytes.size() - have);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw cannotRead(asker, path, errno);
    if (got == 0) throw Error(Exit::Broken, asker.level, asker.where, "became shorter while it was read", "LMC_FILE_CHANGED");
    have += std::size_t(got);
  }
  return bytes;
}

/// Reads, counts the bytes against the limit and notes the file as an input.
std::vector<std::uint8_t> readInput(GltfFile& file, const fs::path& path, const Asker& asker, const LoadLimits& limits) {
  std::vector<std::uint8_t> bytes = readFile(path, asker, limits.maxInputBytes - std::min(limits.maxInputBytes, file.bytesRead));
  file.bytesRead += bytes.size();
  const std::uint64_t hash = hash64(bytes);
  const auto known = std::size_t(std::find(file.inputs.begin(), file.inputs.end(), path) - file.inputs.begin());
  if (known == file.inputs.size()) {
    file.inputs.push_back(path);
    file.hashes.push_back(hash);
  }
  if (file.hashes[known] != hash)
    throw Error(Exit::Broken, asker.level, asker.where, fmt::format("{} changed while the level was read", path.filename().string()),
                "LMC_FILE_CHANGED");
  return bytes;
}

std::uint32_t word(std::span<const std::uint8_t> bytes, std::size_t at) {
  return std::uint32_t(bytes[at]) | std::uint32_t(bytes[at + 1]) << 8 | std::uint32_t(bytes[at + 2]) << 16 |
         std::uint32_t(bytes[at + 3]) << 24;
}

struct Container {
  std::span<const std::uint8_t> json, bin;
  bool hasBin = false;
  bool isGlb = false;
};

/// GLB 2.0, chapter 4 of the glTF specification.
Container splitGlb(std::span<const std::uint8_t> bytes, const fs::path& level, const Run& run) {
  const auto broken = [&](const std::string& what) { return Error(Exit::Broken, level, "", what, "LMC_GLB"); };
  if (bytes.size() < 12) throw broken("the GLB header is cut");
  if (const std::uint32_t version = word(bytes, 4); version != 2)
    throw Error(Exit::Unsupported, level, "", fmt::format("GLB version {} is not supported, only 2", version), "LMC_GLB");
  const std::uint64_t length = word(bytes, 8);
  if (length > bytes.size()) throw broken(fmt::format("the header says {} bytes, the file has {}: it is cut", length, bytes.size()));
  Container out;
  out.isGlb = true;
  std::uint64_t at = 12;
  for (int chunk = 0; at < length; ++chunk) {
    if (length - at < 8) throw broken(fmt::format("the header of chunk {} is cut", chunk));
    const std::uint64_t size = word(bytes, at);
    const std::uint32_t type = word(bytes, at + 4);
    at += 8;
    if (size > length - at) throw broken(fmt::format("chunk {} of {} bytes passes the end of the file", chunk, size));
    if (size % 4 != 0) throw broken(fmt::format("the length {} of chunk {} is not a multiple of 4", size, chunk));
    const auto body = bytes.subspan(at, size);
    at += size;
    if (chunk == 0) {
      if (type != kJsonChunk) throw broken("the first chunk is not JSON");
      if (size == 0) throw broken("the JSON chunk is empty");
      out.json = body;
    } else if (type == kJsonChunk) {
      throw broken("a second JSON chunk");
    } else if (type == kBinChunk) {
      if (chunk != 1) throw broken(out.hasBin ? "a second BIN chunk" : "the BIN chunk is not the second chunk");
      out.bin = body;
      out.hasBin = true;
    }
  }
  if (out.json.empty()) throw broken("no JSON chunk");
  if (length < bytes.size())
    run.warn({.file = level.string(),
              .where = "",
              .text = fmt::format("{} bytes after the end of the GLB are ignored", bytes.size() - length),
              .code = "LMC_GLB"});
  return out;
}

Container splitContainer(std::span<const std::uint8_t> bytes, const fs::path& level, const Run& run) {
  if (bytes.size() >= 4 && word(bytes, 0) == kGlbMagic) return splitGlb(bytes, level, run);
  const bool namedGlb = level.extension() == ".glb";
  const auto first = std::find_if(bytes.begin(), bytes.end(), [](std::uint8_t c) { return !std::strchr(" \t\r\n\xef\xbb\xbf", c); });
  if (first == bytes.end() || *first != '{')
    throw Error(Exit::Broken, level, "",
                bytes.empty() ? "the file is empty"
                : namedGlb    ? "not a GLB file"
                              : "neither GLB nor a JSON object",
                namedGlb ? "LMC_GLB" : "LMC_JSON");
  if (namedGlb) run.note({.file = level.string(), .where = "", .text = "the name says GLB, the file is glTF text", .code = "LMC_GLB"});
  Container out;
  out.json = bytes;
  return out;
}

Json parseJson(std::string_view text, const fs::path& level) {
  try {
    Json json = Json::parse(text.begin(), text.end());
    if (!json.is_object()) throw Error(Exit::Broken, level, "", "the JSON is not an object", "LMC_JSON");
    return json;
  } catch (const nlohmann::json::exception& e) {
    // Its text starts with "[json.exception.parse_error.101] ", which says nothing to a person.
    std::string what = e.what();
    if (const auto end = what.find("] "); end != std::string::npos) what.erase(0, end + 2);
    throw Error(Exit::Broken, level, "", what, "LMC_JSON");
  }
}

int hexDigit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

std::string percentDecoded(std::string_view uri) {
  std::string out;
  out.reserve(uri.size());
  for (std::size_t i = 0; i < uri.size(); ++i) {
    const int high = uri[i] == '%' && i + 2 < uri.size() ? hexDigit(uri[i + 1]) : -1;
    const int low = high >= 0 ? hexDigit(uri[i + 2]) : -1;
    if (low < 0) {
      out += uri[i];
    } else {
      out += char(high * 16 + low);
      i += 2;
    }
  }
  return out;
}

bool hasScheme(std::string_view uri) {
  const auto colon = uri.find(':');
  if (colon == std::string_view::npos || colon == 0 || !std::isalpha(static_cast<unsigned char>(uri[0]))) return false;
  return std::all_of(uri.begin(), uri.begin() + std::ptrdiff_t(colon),
                     [](unsigned char c) { return std::isalnum(c) || c == '+' || c == '-' || c == '.'; });
}

bool isDataUri(std::string_view uri) { return uri.starts_with("data:"); }

std::vector<std::uint8_t> dataUriBytes(std::string_view uri, const fs::path& level, const std::string& where) {
  const auto broken = [&](std::string_view what) { return Error(Exit::Broken, level, where, what, "LMC_URI"); };
  const auto comma = uri.find(',');
  if (comma == std::string_view::npos) throw broken("the data URI has no comma");
  if (!uri.substr(0, comma).ends_with(";base64")) throw broken("the data URI is not base64");
  std::vector<std::uint8_t> bytes;
  if (!decodeBase64(uri.substr(comma + 1), bytes)) throw broken("the data URI is not valid base64");
  if (bytes.empty()) throw broken("the data URI is empty");
  return bytes;
}

std::vector<std::uint8_t> uriBytes(GltfFile& file, std::string_view uri, const std::string& where, const LoadLimits& limits) {
  if (isDataUri(uri)) return dataUriBytes(uri, file.path, where);
  const fs::path path = pathOfUri(file.path, uri, where);
  return readInput(file, path, {file.path, where}, limits);
}

void readBuffers(GltfFile& file, const Container& container, const LoadLimits& limits, const Run& run) {
  const Json* buffers = member(file.json, "buffers");
  if (!buffers) return;
  for (std::size_t i = 0; i < buffers->size(); ++i) {
    const Json& buffer = (*buffers)[i];
    const std::string where = fmt::format("/buffers/{}", i);
    const auto length = buffer["byteLength"].get<std::uint64_t>();
    std::vector<std::uint8_t> bytes;
    if (const Json* uri = member(buffer, "uri")) {
      if (i == 0 && container.hasBin)
        run.note({.file = file.path.string(), .where = where, .text = "has a uri, so the BIN chunk is not used", .code = "LMC_GLB"});
      bytes = uriBytes(file, uri->get_ref<const std::string&>(), where + "/uri", limits);
    } else if (i == 0 && container.hasBin) {
      if (container.bin.size() < length)
        throw Error(Exit::Broken, file.path, where, fmt::format("says {} bytes, the BIN chunk has {}", length, container.bin.size()),
                    "LMC_GLB");
      bytes.assign(container.bin.begin(), container.bin.begin() + std::ptrdiff_t(length));
    } else if (i == 0 && container.isGlb) {
      throw Error(Exit::Broken, file.path, where, "has neither a uri nor a BIN chunk", "LMC_GLB");
    } else if (length > kMaxZeroBytes) {
      throw Error(Exit::Broken, file.path, where, fmt::format("has no uri, which would mean {} zeros", length), "LMC_MEMORY_LIMIT");
    } else {
      run.warn(
          {.file = file.path.string(), .where = where, .text = "has no uri: its bytes are taken as zeros", .code = "LMC_BUFFER_LENGTH"});
    }
    if (!bytes.empty() && bytes.size() < length)
      throw Error(Exit::Broken, file.path, where, fmt::format("says {} bytes, there are {}", length, bytes.size()), "LMC_BUFFER_LENGTH");
    if (!bytes.empty()) bytes.resize(length);
    file.buffers.push_back(std::move(bytes));
  }
}

/// A copy of the objects of an array without what tinygltf need not see.
Json withoutExtras(const Json& array) {
  Json out = Json::array();
  for (const Json& object : array) {
    Json copy = Json::object();
    for (const auto& [key, value] : object.items())
      if (key != "extras" && key != "extensions") copy[key] = value;
    out.push_back(std::move(copy));
  }
  return out;
}

}  // namespace

const Json* member(const Json& object, std::string_view key) {
  if (!object.is_object()) return nullptr;
  const auto it = object.find(std::string(key));
  return it == object.end() ? nullptr : &*it;
}

const Json* extension(const Json& object, std::string_view name) {
  const Json* extensions = member(object, "extensions");
  return extensions ? member(*extensions, name) : nullptr;
}

bool decodeBase64(std::string_view text, std::vector<std::uint8_t>& out) {
  static const auto kValue = [] {
    std::array<std::int8_t, 256> table{};
    table.fill(-1);
    const std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    for (std::size_t i = 0; i < digits.size(); ++i) table[static_cast<unsigned char>(digits[i])] = std::int8_t(i);
    return table;
  }();
  for (int padding = 0; padding < 2 && text.ends_with('='); ++padding) text.remove_suffix(1);
  if (text.size() % 4 == 1) return false;
  out.clear();
  out.reserve(text.size() / 4 * 3 + 2);
  std::uint32_t bits = 0;
  int count = 0;
  for (const char c : text) {
    const int value = kValue[static_cast<unsigned char>(c)];
    if (value < 0) return false;
    bits = bits << 6 | std::uint32_t(value);
    count += 6;
    if (count >= 8) {
      count -= 8;
      out.push_back(std::uint8_t(bits >> count));
    }
  }
  return true;
}

std::string checkJsonText(std::string_view text, int maxDepth, const fs::path& file) {
  const auto broken = [&](std::size_t at, std::string_view what) {
    return Error(Exit::Broken, file, "", fmt::format("{} at byte {}", what, at), "LMC_JSON");
  };
  struct Level {
    bool object = false, wantsKey = false;
    std::unordered_set<std::string_view> keys;
  };
  std::vector<Level> levels;
  std::string twice;
  for (std::size_t i = 0; i < text.size(); ++i) {
    switch (text[i]) {
      case '{':
      case '[':
        if (levels.size() >= std::size_t(maxDepth)) throw broken(i, fmt::format("nested more than {} deep", maxDepth));
        levels.push_back({.object = text[i] == '{', .wantsKey = text[i] == '{', .keys = {}});
        break;
      case '}':
      case ']':
        if (!levels.empty()) levels.pop_back();
        break;
      case ',':
        if (!levels.empty()) levels.back().wantsKey = levels.back().object;
        break;
      case '"': {
        const std::size_t start = ++i;
        while (i < text.size() && text[i] != '"') i += text[i] == '\\' ? 2 : 1;
        if (levels.empty() || !levels.back().wantsKey || i >= text.size()) break;
        Level& level = levels.back();
        level.wantsKey = false;
        const std::string_view key = text.substr(start, i - start);
        if (!level.keys.insert(key).second && twice.empty()) twice = key;
        if (level.keys.size() > kMaxMembers) throw broken(i, fmt::format("an object with more than {} members", kMaxMembers));
        break;
      }
      default:
        break;
    }
  }
  return twice;
}

void checkUri(const fs::path& level, std::string_view uri, std::string_view where) {
  const auto refuse = [&](std::string_view what, std::string_view code) { return Error(Exit::Broken, level, where, what, code); };
  if (uri.empty()) throw refuse("the URI is empty", "LMC_URI");
  if (isDataUri(uri)) return;
  const std::string name = percentDecoded(uri);
  if (name.find('\0') != std::string::npos) throw refuse("the URI holds a NUL", "LMC_URI");
  if (uri.starts_with("file:")) throw refuse("file: URIs are not followed", "LMC_URI_ESCAPE");
  if (hasScheme(uri) || hasScheme(name)) throw refuse("only files beside the level and data URIs are read", "LMC_URI");
  if (name.find('\\') != std::string::npos) throw refuse("the URI holds a back-slash", "LMC_URI_ESCAPE");
  if (name.starts_with('/')) throw refuse("the URI is an absolute path", "LMC_URI_ESCAPE");
  int depth = 0;
  for (const fs::path& part : fs::path(name)) {
    if (part == "..")
      --depth;
    else if (part != "." && !part.empty())
      ++depth;
    if (depth < 0) throw refuse("the URI leaves the folder of the level", "LMC_URI_ESCAPE");
  }
}

fs::path pathOfUri(const fs::path& level, std::string_view uri, std::string_view where) {
  checkUri(level, uri, where);
  const auto refuse = [&](std::string_view what, std::string_view code) { return Error(Exit::Broken, level, where, what, code); };
  const std::string name = percentDecoded(uri);
  const fs::path folder = level.has_parent_path() ? level.parent_path() : fs::path(".");
  const fs::path path = (folder / name).lexically_normal();
  std::error_code noFolder, noFile;
  const fs::path realFolder = fs::canonical(folder, noFolder);
  const fs::path realPath = fs::canonical(path, noFile);
  if (noFile.value() == ENAMETOOLONG) throw refuse("the name is too long", "LMC_URI");
  if (noFolder || noFile) throw cannotRead({level, std::string(where)}, path, noFile ? noFile.value() : noFolder.value());
  const auto [folderEnd, unused] = std::mismatch(realFolder.begin(), realFolder.end(), realPath.begin(), realPath.end());
  if (folderEnd != realFolder.end()) throw refuse("a link leads out of the folder of the level", "LMC_URI_ESCAPE");
  return path;
}

GltfFile readGltf(const fs::path& level, const LoadLimits& limits, const Run& run) {
  GltfFile file;
  file.path = level;
  const std::vector<std::uint8_t> bytes = readInput(file, level, {level, ""}, limits);
  const Container container = splitContainer(bytes, level, run);
  std::string_view text(reinterpret_cast<const char*>(container.json.data()), container.json.size());
  if (text.starts_with("\xef\xbb\xbf")) {
    text.remove_prefix(3);
    run.warn({.file = level.string(), .where = "", .text = "starts with a byte order mark, which glTF forbids", .code = "LMC_JSON"});
  }
  if (const std::string key = checkJsonText(text, limits.maxJsonDepth, level); !key.empty())
    run.warn({.file = level.string(),
              .where = "",
              .text = fmt::format("member \"{}\" stands twice in one object; the last one counts", key),
              .code = "LMC_JSON"});
  file.json = parseJson(text, level);
  checkGltf(file.json, level, limits, run);
  readBuffers(file, container, limits, run);
  return file;
}

std::optional<std::uint64_t> contentOf(const GltfFile& file, std::span<const fs::path> inputs) {
  std::uint64_t content = 0;
  for (const fs::path& path : inputs) {
    const auto at = std::size_t(std::find(file.inputs.begin(), file.inputs.end(), path) - file.inputs.begin());
    if (at == file.inputs.size()) return std::nullopt;
    content = hash64({reinterpret_cast<const std::uint8_t*>(&file.hashes[at]), sizeof(std::uint64_t)}, content);
  }
  return content;
}

tinygltf::Model typedModel(const GltfFile& file) {
  Json core = {{"asset", {{"version", "2.0"}}}};
  for (const char* name : {"scenes", "nodes", "meshes", "accessors", "bufferViews", "materials", "textures", "samplers", "cameras"})
    if (const Json* array = member(file.json, name)) core[name] = withoutExtras(*array);
  if (const Json* scene = member(file.json, "scene")) core["scene"] = *scene;
  const std::string text = core.dump();
  core = {};
  if (text.size() > std::numeric_limits<unsigned>::max())
    throw Error(Exit::Broken, file.path, "", "the JSON is larger than 4 GB", "LMC_INPUT_TOO_LARGE");
  tinygltf::TinyGLTF parser;
  tinygltf::Model model;
  std::string error, warning;
  bool done = false;
  try {
    done = parser.LoadASCIIFromString(&model, &error, &warning, text.data(), unsigned(text.size()), "");
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& e) {
    error = e.what();
  }
  if (done) return model;
  // tinygltf catches whatever its parser throws, and keeps the text alone.
  if (error.find("bad_alloc") != std::string::npos) throw std::bad_alloc();
  std::replace(error.begin(), error.end(), '\n', ' ');
  throw Error(Exit::Broken, file.path, "", "tinygltf cannot read it: " + error, "LMC_JSON_SCHEMA");
}

std::vector<std::uint8_t> imageBytes(GltfFile& file, std::size_t image, const LoadLimits& limits) {
  const Json& json = file.json["images"][image];
  if (const Json* uri = member(json, "uri"))
    return uriBytes(file, uri->get_ref<const std::string&>(), fmt::format("/images/{}/uri", image), limits);
  const Json& view = file.json["bufferViews"][json["bufferView"].get<std::size_t>()];
  const std::vector<std::uint8_t>& buffer = file.buffers[view["buffer"].get<std::size_t>()];
  if (buffer.empty())
    throw Error(Exit::Broken, file.path, fmt::format("/images/{}", image), "its buffer has no bytes", "LMC_BUFFER_LENGTH");
  const auto offset = std::ptrdiff_t(view.value("byteOffset", std::uint64_t(0)));
  return {buffer.begin() + offset, buffer.begin() + offset + std::ptrdiff_t(view["byteLength"].get<std::uint64_t>())};
}

}  // namespace lmc
