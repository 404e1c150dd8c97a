#pragma once
/// Bytes of a level file -> checked JSON, buffers and the typed tinygltf model. Private to libscene.
///
/// tinygltf gets text that has passed gltf_check.h and neither buffers, images nor extras: it opens no file and decodes no
/// picture. What a level names is read here, and only from the level's own folder.
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

// tinygltf opens no file and decodes no picture here: both are done by lmc, after checks that it does not make.
#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#define TINYGLTF_NO_FS
#include <tiny_gltf.h>

#include "libscene/level.h"

namespace lmc {

/// Ordered, so that a level goes out with its members in the order in which they came in.
using Json = nlohmann::ordered_json;

/// Brightest light [cd, lx, cd/m^2]: the square of anything above overflows single precision.
inline constexpr double kMaxLight = 1.0e18;

/// What is known of a level before any of it is converted.
struct GltfFile {
  std::filesystem::path path;                      ///< as the user named it
  Json json;                                       ///< checked
  std::vector<std::vector<std::uint8_t>> buffers;  ///< byteLength bytes each; empty where the file gives none
  std::vector<std::filesystem::path> inputs;       ///< every file read so far, each once
  std::vector<std::uint64_t> hashes;               ///< of their bytes
  std::uint64_t bytesRead = 0;                     ///< of all of them
};

/// Container, JSON, checks, buffers. Throws Error.
GltfFile readGltf(const std::filesystem::path& level, const LoadLimits& limits, const Run& run);

/// The typed view of file.json, without buffers, images, extras, animations and skins.
tinygltf::Model typedModel(const GltfFile& file);

/// The stored bytes of /images/`image`, from its file, data URI or buffer view; adds to file.inputs.
std::vector<std::uint8_t> imageBytes(GltfFile& file, std::size_t image, const LoadLimits& limits);

/// Hash of the bytes of `inputs`, in turn; none where one of them was not read.
std::optional<std::uint64_t> contentOf(const GltfFile& file, std::span<const std::filesystem::path> inputs);

/// Refuses a URI that is neither data nor the name of a file in the level's folder or below; touches no file.
void checkUri(const std::filesystem::path& level, std::string_view uri, std::string_view where);

/// Text of a glTF URI that is no data URI as a path below the level's folder; throws Error where a link leads out of it.
std::filesystem::path pathOfUri(const std::filesystem::path& level, std::string_view uri, std::string_view where);

/// Base64 as RFC 4648, padding optional; false for anything else.
bool decodeBase64(std::string_view text, std::vector<std::uint8_t>& out);

/// Refuses text that is nested too deep or has objects with absurdly many members, before a parser sees it. Returns the name of
/// a member that stands twice in one object, or nothing.
std::string checkJsonText(std::string_view text, int maxDepth, const std::filesystem::path& file);

/// The member `key` of `object`, or null when it is not there or `object` is none.
const Json* member(const Json& object, std::string_view key);

/// f(), with what the JSON library throws as an Error: gltf_check.h lets nothing through that it should throw at, but a hole in
/// it is no reason to end without a word on the level.
template <class F>
auto withJsonErrors(const std::filesystem::path& level, F f) {
  try {
    return f();
  } catch (const nlohmann::json::exception& e) {
    throw Error(Exit::Broken, level, "", e.what(), "LMC_JSON_SCHEMA");
  }
}

/// extensions.`name` of `object`, or null.
const Json* extension(const Json& object, std::string_view name);

}  // namespace lmc
