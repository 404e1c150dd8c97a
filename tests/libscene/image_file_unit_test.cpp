#include "libscene/image_file.h"

#include <gtest/gtest.h>

#include <jpeglib.h>
#include <cstdio>
#include <cstdlib>

namespace lmc {
namespace {

constexpr std::uint64_t kMany = 1u << 20;

Image<glm::u8vec4> pattern(int width, int height) {
  Image<glm::u8vec4> image(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) image.at(x, y) = glm::u8vec4(x * 37, y * 59, x * y * 11, 255 - x);
  return image;
}

std::vector<std::uint8_t> jpegOf(int width, int height, JSAMPLE value) {
  jpeg_compress_struct jpeg;
  jpeg_error_mgr errors;
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&jpeg, &bytes, &size);
  jpeg.image_width = JDIMENSION(width);
  jpeg.image_height = JDIMENSION(height);
  jpeg.input_components = 1;
  jpeg.in_color_space = JCS_GRAYSCALE;
  jpeg_set_defaults(&jpeg);
  jpeg_start_compress(&jpeg, TRUE);
  std::vector<JSAMPLE> row(std::size_t(width), value);
  for (int y = 0; y < height; ++y) {
    JSAMPROW rows[1] = {row.data()};
    jpeg_write_scanlines(&jpeg, rows, 1);
  }
  jpeg_finish_compress(&jpeg);
  jpeg_destroy_compress(&jpeg);
  std::vector<std::uint8_t> out(bytes, bytes + size);
  std::free(bytes);
  return out;
}

TEST(ImageFile, APngComesBackAsItWent) {
  const auto image = pattern(7, 5);
  const DecodedImage back = decodeImage(encodePng(image, true), kMany);
  ASSERT_FALSE(back.problem) << back.problem->text;
  EXPECT_EQ(back.warning, "");
  EXPECT_EQ(back.image.pixels, image.pixels);
}

TEST(ImageFile, WithoutAlphaItIsOpaque) {
  const DecodedImage back = decodeImage(encodePng(pattern(3, 2), false), kMany);
  ASSERT_FALSE(back.problem);
  for (const auto& pixel : back.image.pixels) EXPECT_EQ(pixel.a, 255);
}

TEST(ImageFile, TheSamePictureIsTheSameBytes) { EXPECT_EQ(encodePng(pattern(9, 9), true), encodePng(pattern(9, 9), true)); }

TEST(ImageFile, AGreyJpegBecomesRgba) {
  const DecodedImage back = decodeImage(jpegOf(16, 8, 200), kMany);
  ASSERT_FALSE(back.problem) << back.problem->text;
  ASSERT_EQ(back.image.width, 16);
  ASSERT_EQ(back.image.height, 8);
  for (const auto& pixel : back.image.pixels) EXPECT_EQ(pixel, glm::u8vec4(200, 200, 200, 255));
}

TEST(ImageFile, SizesAreJudgedOnTheHeader) {
  auto png = encodePng(pattern(4, 4), false);
  png[16] = 0x7f;  // the width becomes 2130706436
  EXPECT_EQ(decodeImage(png, kMany).problem.value().code, "LMC_TEXTURE_TOO_LARGE");
  EXPECT_EQ(decodeImage(encodePng(pattern(4, 4), false), 15).problem.value().code, "LMC_TEXTURE_TOO_LARGE");
  EXPECT_EQ(decodeImage(jpegOf(4, 4, 9), 15).problem.value().code, "LMC_TEXTURE_TOO_LARGE");
  png[16] = png[17] = png[18] = png[19] = 0;
  EXPECT_EQ(decodeImage(png, kMany).problem.value().code, "LMC_TEXTURE_BAD");
}

TEST(ImageFile, ACutFileIsRefusedAtEveryLength) {
  const auto png = encodePng(pattern(8, 8), true);
  const std::size_t end = png.size() - 12 - 4;  // before IEND and the checksum of the data
  for (std::size_t size = 0; size < end; ++size) EXPECT_TRUE(decodeImage(std::span(png).first(size), kMany).problem) << size;
  const auto jpeg = jpegOf(8, 8, 40);
  for (std::size_t size = 0; size < jpeg.size(); ++size) {
    const DecodedImage got = decodeImage(std::span(jpeg).first(size), kMany);
    EXPECT_TRUE(got.problem || !got.warning.empty()) << size;
  }
}

TEST(ImageFile, AWrongChecksumCostsAWarning) {
  auto png = encodePng(pattern(8, 8), true);
  png[png.size() - 13] ^= 1;  // the last byte of the data's checksum
  const DecodedImage got = decodeImage(png, kMany);
  ASSERT_FALSE(got.problem) << got.problem->text;
  EXPECT_NE(got.warning, "");
  EXPECT_EQ(got.image.pixels, pattern(8, 8).pixels);
}

TEST(ImageFile, OtherKindsAreNamedAsSuch) {
  const std::string gif = "GIF89a.............";
  EXPECT_EQ(decodeImage(std::span(reinterpret_cast<const std::uint8_t*>(gif.data()), gif.size()), kMany).problem.value().code,
            "LMC_TEXTURE_TYPE");
  EXPECT_TRUE(decodeImage({}, kMany).problem);
}

}  // namespace
}  // namespace lmc
