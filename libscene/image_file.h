#pragma once
/// PNG and JPEG (libpng, libjpeg-turbo only in image_file.cpp). Sizes are checked on the header before anything is decoded.
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <glm/gtc/type_precision.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "libscene/image.h"

namespace lmc {

/// A picture that cannot be read; the caller adds file and JSON pointer. `code`: LMC_TEXTURE_BAD, _TYPE or _TOO_LARGE.
struct ImageProblem {
  std::string text, code;
};

/// 8 bit RGBA whatever the file holds (16 bit is rounded, grey spread, palette looked up). Returns a problem or the picture;
/// `warning` receives what a careful reader wants to know of a picture that could be read all the same (a wrong checksum).
struct DecodedImage {
  Image<glm::u8vec4> image;
  std::optional<ImageProblem> problem;
  std::string warning;
};
DecodedImage decodeImage(std::span<const std::uint8_t> bytes, std::uint64_t maxPixels);
/// Of a file that stands by itself, in no level: a problem is an Error of that file (Broken).
Image<glm::u8vec4> pictureOf(const std::filesystem::path& file, std::span<const std::uint8_t> bytes, std::uint64_t maxPixels);

/// The same with 16 bits a channel: as stored where the file has them, else spread over the whole range (255 -> 65535).
struct DecodedDeepImage {
  Image<glm::u16vec4> image;
  std::optional<ImageProblem> problem;
  std::string warning;
};
DecodedDeepImage decodeDeepImage(std::span<const std::uint8_t> bytes, std::uint64_t maxPixels);

/// A PNG file in memory, 8 bit RGB(A), no time stamp.
std::vector<std::uint8_t> encodePng(const Image<glm::u8vec4>& image, bool withAlpha);
/// The same with 16 bits a channel.
std::vector<std::uint8_t> encodePng(const Image<glm::u16vec4>& image, bool withAlpha);

}  // namespace lmc
