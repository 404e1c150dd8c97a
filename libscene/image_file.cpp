#include "libscene/image_file.h"

#include <bit>
#include <csetjmp>
#include <cstdio>
#include <cstring>
#include <memory>

#include <fmt/format.h>
#include <jpeglib.h>
#include <png.h>

#include "libscene/error.h"

namespace lmc {
namespace {

// A picture of one colour shrinks a thousandfold; only where it is large as well is that a trap. 2^26 texels are 8192 x 8192.
constexpr std::uint64_t kBombPixels = std::uint64_t(1) << 26;
constexpr std::uint64_t kBombRatio = 200;
constexpr std::size_t kMaxPngChunk = 8 << 20;  // of memory for one ancillary chunk

DecodedImage problem(std::string text, std::string code) {
  DecodedImage out;
  out.problem = ImageProblem{std::move(text), std::move(code)};
  return out;
}

std::optional<ImageProblem> sizeProblem(std::uint64_t width, std::uint64_t height, std::uint64_t bytesAPixel, std::uint64_t fileBytes,
                                        std::uint64_t maxPixels) {
  if (width == 0 || height == 0) return ImageProblem{fmt::format("the picture has {} x {} texels", width, height), "LMC_TEXTURE_BAD"};
  if (width > maxPixels / height)
    return ImageProblem{fmt::format("the picture says {} x {} texels, the limit is {} in all", width, height, maxPixels),
                        "LMC_TEXTURE_TOO_LARGE"};
  const std::uint64_t pixels = width * height;
  if (pixels > kBombPixels && pixels * bytesAPixel / kBombRatio > fileBytes)
    return ImageProblem{fmt::format("{} x {} texels from {} bytes: a picture made to fill the memory", width, height, fileBytes),
                        "LMC_TEXTURE_TOO_LARGE"};
  return std::nullopt;
}

// ---- PNG. libpng leaves by longjmp: everything that must survive it lives in PngJob, which the caller owns.

struct PngJob {
  std::span<const std::uint8_t> bytes;
  std::size_t at = 0;
  png_structp png = nullptr;
  png_infop info = nullptr;
  DecodedImage result;
  bool deep = false;  ///< then the picture goes here
  Image<glm::u16vec4> deepImage;
  std::vector<std::uint8_t> row;
  std::string text;  ///< of the error
  bool damaged = false;

  ~PngJob() { png_destroy_read_struct(&png, &info, nullptr); }
};

void pngFailed(png_structp png, png_const_charp text) {
  static_cast<PngJob*>(png_get_error_ptr(png))->text = text;
  png_longjmp(png, 1);
}

void pngWarned(png_structp png, png_const_charp text) {
  auto& job = *static_cast<PngJob*>(png_get_error_ptr(png));
  if (job.result.warning.empty()) job.result.warning = text;
}

void pngRead(png_structp png, png_bytep to, std::size_t count) {
  auto& job = *static_cast<PngJob*>(png_get_io_ptr(png));
  if (count > job.bytes.size() - job.at) png_error(png, "the file is cut");
  std::memcpy(to, job.bytes.data() + job.at, count);
  job.at += count;
}

/// Header only; the limits are judged before a byte of the picture is decoded.
std::optional<ImageProblem> pngHeaderProblem(std::span<const std::uint8_t> bytes, std::uint64_t maxPixels) {
  const auto number = [&](std::size_t at) {
    return std::uint64_t(bytes[at]) << 24 | std::uint64_t(bytes[at + 1]) << 16 | std::uint64_t(bytes[at + 2]) << 8 | bytes[at + 3];
  };
  if (bytes.size() < 33 || std::memcmp(bytes.data() + 12, "IHDR", 4) != 0) return ImageProblem{"the PNG has no header", "LMC_TEXTURE_BAD"};
  static constexpr int kChannels[8] = {1, 0, 3, 1, 2, 0, 4, 0};  // by colour type
  const std::uint64_t bits = std::uint64_t(bytes[24]) * std::uint64_t(kChannels[bytes[25] & 7]);
  return sizeProblem(number(16), number(20), std::max<std::uint64_t>(1, bits / 8), bytes.size(), maxPixels);
}

void setUpPng(PngJob& job) {
  png_set_read_fn(job.png, &job, pngRead);
  png_set_user_limits(job.png, 0x7fffffff, 0x7fffffff);  // judged above, by area
  png_set_chunk_malloc_max(job.png, kMaxPngChunk);
  png_set_crc_action(job.png, PNG_CRC_WARN_USE, PNG_CRC_QUIET_USE);
  // Texts, profiles and dates are other people's business, and their warnings too.
  static const png_byte kSkipped[] = "iCCP\0tEXt\0zTXt\0iTXt\0eXIf\0sPLT\0tIME\0hIST\0pCAL\0sCAL\0oFFs\0pHYs\0bKGD\0sBIT\0cHRM\0gAMA\0sRGB";
  png_set_keep_unknown_chunks(job.png, PNG_HANDLE_CHUNK_NEVER, nullptr, 0);
  png_set_keep_unknown_chunks(job.png, PNG_HANDLE_CHUNK_NEVER, kSkipped, int(sizeof kSkipped / 5));
}

void decodePngBody(PngJob& job) {
  png_read_info(job.png, job.info);
  const int depth = png_get_bit_depth(job.png, job.info);
  if (depth == 16 && !job.deep) png_set_scale_16(job.png);
  job.deep ? png_set_expand_16(job.png) : png_set_expand(job.png);
  png_set_gray_to_rgb(job.png);
  png_set_add_alpha(job.png, job.deep ? 0xffff : 0xff, PNG_FILLER_AFTER);
  if (job.deep && std::endian::native == std::endian::little) png_set_swap(job.png);
  const int passes = png_set_interlace_handling(job.png);
  png_read_update_info(job.png, job.info);
  const auto width = png_get_image_width(job.png, job.info), height = png_get_image_height(job.png, job.info);
  if (png_get_rowbytes(job.png, job.info) != std::size_t(width) * (job.deep ? 8 : 4)) png_error(job.png, "an unknown kind of picture");
  if (job.deep)
    job.deepImage = Image<glm::u16vec4>(int(width), int(height), glm::u16vec4(0, 0, 0, 65535));
  else
    job.result.image = Image<glm::u8vec4>(int(width), int(height), glm::u8vec4(0, 0, 0, 255));
  for (int pass = 0; pass < passes; ++pass)
    for (png_uint_32 y = 0; y < height; ++y) {
      const std::size_t at = std::size_t(y) * width;
      png_read_row(
          job.png,
          job.deep ? reinterpret_cast<png_bytep>(&job.deepImage.pixels[at]) : reinterpret_cast<png_bytep>(&job.result.image.pixels[at]),
          nullptr);
    }
}

/// With `deep` the picture has 16 bits a channel and goes there.
DecodedImage decodePng(std::span<const std::uint8_t> bytes, std::uint64_t maxPixels, Image<glm::u16vec4>* deep = nullptr) {
  if (auto bad = pngHeaderProblem(bytes, maxPixels)) return problem(bad->text, bad->code);
  PngJob job;
  job.bytes = bytes;
  job.deep = deep != nullptr;
  job.png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &job, pngFailed, pngWarned);
  job.info = job.png ? png_create_info_struct(job.png) : nullptr;
  if (!job.info) throw std::bad_alloc();
  if (setjmp(png_jmpbuf(job.png))) return problem("the PNG cannot be decoded: " + job.text, "LMC_TEXTURE_BAD");
  setUpPng(job);
  decodePngBody(job);
  if (deep) *deep = std::move(job.deepImage);
  // All rows are there: what is wrong behind them costs a warning, not the picture.
  if (setjmp(png_jmpbuf(job.png))) {
    if (job.result.warning.empty()) job.result.warning = job.text;
    return std::move(job.result);
  }
  png_read_end(job.png, nullptr);
  return std::move(job.result);
}

// ---- JPEG

struct JpegJob {
  jpeg_error_mgr errors{};  // first, so that libjpeg's pointer to it is a pointer to the job
  std::jmp_buf leave;
  jpeg_decompress_struct jpeg{};
  DecodedImage result;
  std::vector<std::uint8_t> row;
  char text[JMSG_LENGTH_MAX] = "";
  bool created = false;

  ~JpegJob() {
    if (created) jpeg_destroy_decompress(&jpeg);
  }
};

void jpegFailed(j_common_ptr jpeg) {
  auto& job = *reinterpret_cast<JpegJob*>(jpeg->err);
  jpeg->err->format_message(jpeg, job.text);
  std::longjmp(job.leave, 1);
}

void jpegWarned(j_common_ptr jpeg, int level) {
  if (level >= 0) return;  // a trace
  auto& job = *reinterpret_cast<JpegJob*>(jpeg->err);
  char text[JMSG_LENGTH_MAX];
  jpeg->err->format_message(jpeg, text);
  if (job.result.warning.empty()) job.result.warning = text;
  // libjpeg goes on for ever through a progressive picture without data; the first thousand complaints are enough.
  if (++jpeg->err->num_warnings > 1000) jpegFailed(jpeg);
}

void decodeJpegBody(JpegJob& job) {
  jpeg_start_decompress(&job.jpeg);
  const int width = int(job.jpeg.output_width), height = int(job.jpeg.output_height);
  job.result.image = Image<glm::u8vec4>(width, height, glm::u8vec4(0, 0, 0, 255));
  job.row.resize(std::size_t(width) * std::size_t(job.jpeg.output_components));
  while (job.jpeg.output_scanline < job.jpeg.output_height) {
    glm::u8vec4* to = &job.result.image.pixels[std::size_t(job.jpeg.output_scanline) * std::size_t(width)];
    JSAMPROW row = job.row.data();
    jpeg_read_scanlines(&job.jpeg, &row, 1);
    for (int x = 0; x < width; ++x) to[x] = glm::u8vec4(row[3 * x], row[3 * x + 1], row[3 * x + 2], 255);
  }
  jpeg_finish_decompress(&job.jpeg);
}

DecodedImage decodeJpeg(std::span<const std::uint8_t> bytes, std::uint64_t maxPixels) {
  JpegJob job;
  job.jpeg.err = jpeg_std_error(&job.errors);
  job.errors.error_exit = jpegFailed;
  job.errors.emit_message = jpegWarned;
  if (setjmp(job.leave)) return problem(fmt::format("the JPEG cannot be decoded: {}", job.text), "LMC_TEXTURE_BAD");
  jpeg_create_decompress(&job.jpeg);
  job.created = true;
  jpeg_mem_src(&job.jpeg, bytes.data(), bytes.size());
  jpeg_read_header(&job.jpeg, TRUE);
  if (auto bad = sizeProblem(job.jpeg.image_width, job.jpeg.image_height, std::uint64_t(job.jpeg.num_components), bytes.size(), maxPixels))
    return problem(bad->text, bad->code);
  if (job.jpeg.num_components == 4) return problem("a CMYK JPEG, which glTF does not know", "LMC_TEXTURE_TYPE");
  job.jpeg.out_color_space = JCS_RGB;
  job.jpeg.dct_method = JDCT_ISLOW;  // the accurate one, and the same on every machine
  decodeJpegBody(job);
  return std::move(job.result);
}

constexpr std::uint8_t kPng[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};

// ---- writing

struct PngWriter {
  png_structp png = nullptr;
  png_infop info = nullptr;
  std::vector<std::uint8_t> bytes;
  std::vector<std::uint8_t> row;
  ~PngWriter() { png_destroy_write_struct(&png, &info); }
};

void pngWrite(png_structp png, png_bytep from, std::size_t count) {
  auto& bytes = static_cast<PngWriter*>(png_get_io_ptr(png))->bytes;
  bytes.insert(bytes.end(), from, from + count);
}

}  // namespace

DecodedImage decodeImage(std::span<const std::uint8_t> bytes, std::uint64_t maxPixels) {
  static constexpr std::uint8_t kJpeg[3] = {0xff, 0xd8, 0xff};
  const auto startsWith = [&](std::span<const std::uint8_t> magic) {
    return bytes.size() >= magic.size() && std::memcmp(bytes.data(), magic.data(), magic.size()) == 0;
  };
  if (startsWith(kPng)) return decodePng(bytes, maxPixels);
  if (startsWith(kJpeg)) return decodeJpeg(bytes, maxPixels);
  return problem("neither a PNG nor a JPEG", "LMC_TEXTURE_TYPE");
}

Image<glm::u8vec4> pictureOf(const std::filesystem::path& file, std::span<const std::uint8_t> bytes, std::uint64_t maxPixels) {
  DecodedImage decoded = decodeImage(bytes, maxPixels);
  if (decoded.problem) throw Error(Exit::Broken, file, "", decoded.problem->text, decoded.problem->code);
  return std::move(decoded.image);
}

DecodedDeepImage decodeDeepImage(std::span<const std::uint8_t> bytes, std::uint64_t maxPixels) {
  DecodedDeepImage out;
  if (bytes.size() >= sizeof kPng && std::memcmp(bytes.data(), kPng, sizeof kPng) == 0) {
    DecodedImage png = decodePng(bytes, maxPixels, &out.image);
    out.problem = std::move(png.problem);
    out.warning = std::move(png.warning);
    return out;
  }
  DecodedImage shallow = decodeImage(bytes, maxPixels);
  out.problem = std::move(shallow.problem);
  out.warning = std::move(shallow.warning);
  out.image = Image<glm::u16vec4>(shallow.image.width, shallow.image.height);
  for (std::size_t i = 0; i < out.image.pixels.size(); ++i) out.image.pixels[i] = glm::u16vec4(257u * glm::uvec4(shallow.image.pixels[i]));
  return out;
}

namespace {

template <class Channel, class Pixel>
std::vector<std::uint8_t> encode(const Image<Pixel>& image, bool withAlpha) {
  PngWriter writer;
  writer.png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  writer.info = writer.png ? png_create_info_struct(writer.png) : nullptr;
  if (!writer.info) throw std::bad_alloc();
  const int channels = withAlpha ? 4 : 3, bytes = int(sizeof(Channel));
  writer.row.resize(std::size_t(image.width) * std::size_t(channels * bytes));
  if (setjmp(png_jmpbuf(writer.png))) throw std::runtime_error("libpng cannot write a picture of this size");
  png_set_write_fn(writer.png, &writer, pngWrite, nullptr);
  png_set_IHDR(writer.png, writer.info, png_uint_32(image.width), png_uint_32(image.height), 8 * bytes,
               withAlpha ? PNG_COLOR_TYPE_RGB_ALPHA : PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
               PNG_FILTER_TYPE_DEFAULT);
  png_write_info(writer.png, writer.info);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x)
      for (int c = 0; c < channels; ++c)
        for (int b = 0; b < bytes; ++b)  // the high byte first
          writer.row[std::size_t((x * channels + c) * bytes + b)] = std::uint8_t(image.at(x, y)[c] >> 8 * (bytes - 1 - b));
    png_write_row(writer.png, writer.row.data());
  }
  png_write_end(writer.png, writer.info);
  return std::move(writer.bytes);
}

}  // namespace

std::vector<std::uint8_t> encodePng(const Image<glm::u8vec4>& image, bool withAlpha) { return encode<std::uint8_t>(image, withAlpha); }
std::vector<std::uint8_t> encodePng(const Image<glm::u16vec4>& image, bool withAlpha) { return encode<std::uint16_t>(image, withAlpha); }

}  // namespace lmc
