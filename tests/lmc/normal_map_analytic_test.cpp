/// Normal maps against closed forms, and both ways between the spaces.
#include <gtest/gtest.h>

#include <cmath>

#include "libscene/image_file.h"
#include "libscene/tracer.h"
#include "lmc/normal_map.h"


namespace lmc {
namespace {

constexpr double kPi = 3.14159265358979323846;

double angle_deg(glm::dvec3 a, glm::dvec3 b) { return std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b)) * 180.0 / kPi; }

/// A scene of one object from triangles with normals and UVs.
struct SceneOf {
  Scene scene;
  SceneOf() {
    scene.materials.emplace_back();
    scene.objects.emplace_back();
  }
  std::uint32_t add(glm::dvec3 p, glm::dvec3 n, glm::dvec2 uv) {
    scene.positions_m.emplace_back(p);
    scene.normals.emplace_back(n);
    scene.uv0.emplace_back(uv);
    scene.mapUv.emplace_back(uv);
    scene.extent_m = std::max({scene.extent_m, float(std::abs(p.x)), float(std::abs(p.y)), float(std::abs(p.z))});
    return std::uint32_t(scene.positions_m.size() - 1);
  }
  void face(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    scene.triangles.emplace_back(a, b, c);
    scene.triangleObject.push_back(0);
    scene.objects[0].triangleCount = std::uint32_t(scene.triangles.size());
  }
  /// A grid over [-1, 1]^2 at heights h(x, y) with normals n(x, y); U along +X (or -X), V along -Y, as glTF has them.
  template <class Height, class Normal>
  static Scene grid(int n, const Height& h, const Normal& normal, bool mirrored = false) {
    SceneOf s;
    for (int j = 0; j <= n; ++j)
      for (int i = 0; i <= n; ++i) {
        const double x = 2.0 * i / n - 1.0, y = 2.0 * j / n - 1.0, u = (x + 1.0) / 2.0;
        s.add({x, y, h(x, y)}, normal(x, y), {mirrored ? 1.0 - u : u, (1.0 - y) / 2.0});
      }
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        const std::uint32_t a = std::uint32_t(j * (n + 1) + i), b = a + 1, c = b + std::uint32_t(n + 1), d = a + std::uint32_t(n + 1);
        s.face(a, b, c);
        s.face(a, c, d);
      }
    return s.scene;
  }
};

TEST(Height, NormalsAreThoseOfAKnownField) {
  // h = sin(4 pi u) cos(2 pi v) in widths times 0.05; n = (-dh/du, dh/dv, 1). Central differences of 256 texels a width are off by
  // (4 pi / 256)^2 / 6 = 4e-4 of the slope 0.63, which is 0.01 degrees.
  constexpr int kSide = 256;
  constexpr float kScale = 0.05f;
  Image<float> height(kSide, kSide);
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x)
      height.at(x, y) = float(0.5 + 0.5 * std::sin(4 * kPi * (x + 0.5) / kSide) * std::cos(2 * kPi * (y + 0.5) / kSide));
  for (const Derivative filter : {Derivative::Central, Derivative::Sobel, Derivative::Scharr}) {
    const Image<glm::vec3> got = normalsOfHeight(height, {kScale, true, filter});
    double sum = 0.0;
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x) {
        const double u = (x + 0.5) / kSide, v = (y + 0.5) / kSide, s = 0.5 * double(kScale);
        const double du = s * 4 * kPi * std::cos(4 * kPi * u) * std::cos(2 * kPi * v),
                     dv = -s * 2 * kPi * std::sin(4 * kPi * u) * std::sin(2 * kPi * v);
        sum += angle_deg(glm::dvec3(got.at(x, y)), glm::dvec3(-du, dv, 1.0));
      }
    EXPECT_LT(sum / (kSide * kSide), 0.05) << int(filter);
  }
}

TEST(Height, WrapDecidesWhatLiesBeyondTheBorder) {
  Image<float> ramp(8, 1);
  for (int x = 0; x < 8; ++x) ramp.at(x, 0) = float(x) / 8.0f;
  const glm::vec3 slope = glm::normalize(glm::vec3(-0.5f, 0.0f, 1.0f));  // 1/8 a texel times scale 0.5 times 8 texels
  const Image<glm::vec3> clamped = normalsOfHeight(ramp, {0.5f, false, Derivative::Central});
  for (int x = 0; x < 8; ++x) EXPECT_NEAR(glm::distance(clamped.at(x, 0), slope), 0.0f, 1e-6f) << x;
  const Image<glm::vec3> repeated = normalsOfHeight(ramp, {0.5f, true, Derivative::Central});
  EXPECT_GT(repeated.at(0, 0).x, 0.0f);  // falls from the other end
}

TEST(Model, AHemisphereBakedOntoAPlaneHasItsNormals) {
  // Radius 0.6 in the middle of the plane; its normals are position / radius.
  constexpr double kRadius = 0.6;
  const auto flat = [](double, double) { return 0.0; };
  const auto up = [](double, double) { return glm::dvec3(0, 0, 1); };
  SceneOf dome;
  constexpr int kRows = 128, kColumns = 256;
  for (int j = 0; j <= kRows; ++j)
    for (int i = 0; i <= kColumns; ++i) {
      const double theta = kPi / 2 * j / kRows, phi = 2 * kPi * i / kColumns;
      const glm::dvec3 n(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta));
      dome.add(kRadius * n, n, {0, 0});
    }
  for (std::uint32_t j = 0; j < kRows; ++j)
    for (std::uint32_t i = 0; i < kColumns; ++i) {
      const std::uint32_t a = j * (kColumns + 1) + i, b = a + 1, c = a + kColumns + 1, d = c + 1;
      dome.face(a, c, d);
      dome.face(a, d, b);
    }
  const Tracer tracer(dome.scene);
  constexpr int kSide = 200;
  for (const bool mirrored : {false, true}) {
    const Scene low = SceneOf::grid(4, flat, up, mirrored);
    const Image<TexelFrame> frames = texelFrames(low, low.uv0, kSide, kSide, 0, {});
    const ModelNormals got = normalsOfModel(frames, low.centre_m, dome.scene, tracer, 1.0, {});
    const Image<glm::vec3> tangent = toTangentSpace(frames, got.normals);
    EXPECT_EQ(got.rays, std::size_t(kSide * kSide));
    std::size_t outside = 0, inside = 0;
    double sum = 0.0;
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x) {
        const double px = (mirrored ? -1.0 : 1.0) * (2.0 * (x + 0.5) / kSide - 1.0), py = 1.0 - 2.0 * (y + 0.5) / kSide,
                     r = std::hypot(px, py);
        const glm::dvec3 n = glm::dvec3(tangent.at(x, y));
        if (r > 1.01 * kRadius) {
          EXPECT_LT(angle_deg(n, {0, 0, 1}), 1e-3);
          ++outside;
        } else if (r < 0.97 * kRadius) {
          // Tangent space of a mirrored plane: x along U, which is -X; y up in the picture.
          sum += angle_deg(n, glm::dvec3(mirrored ? -px : px, py, std::sqrt(kRadius * kRadius - r * r)));
          ++inside;
        }
      }
    EXPECT_LT(sum / double(inside), 0.1) << mirrored;
    EXPECT_GE(got.misses, outside);
  }
}

TEST(Spaces, ThereAndBackIsWithinOneStepOfEightBits) {
  // A bumpy sheet, mirrored or not: normals, tangents and determinants vary or turn about.
  const auto h = [](double x, double y) { return 0.2 * std::sin(3 * x) * std::cos(2 * y); };
  const auto n = [](double x, double y) {
    return glm::normalize(glm::dvec3(-0.6 * std::cos(3 * x) * std::cos(2 * y), 0.4 * std::sin(3 * x) * std::sin(2 * y), 1.0));
  };
  constexpr int kSide = 128;
  for (const bool mirrored : {false, true}) {
    const Scene scene = SceneOf::grid(24, h, n, mirrored);
    const Image<TexelFrame> frames = texelFrames(scene, scene.uv0, kSide, kSide, 0, {});
    for (const TexelFrame& f : frames.pixels) ASSERT_EQ(f.determinant, mirrored ? -1.0f : 1.0f);
    Image<glm::vec3> object(kSide, kSide);
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x) {
        const glm::dvec3 around = glm::dvec3(std::sin(0.3 * x), std::cos(0.2 * y), 3.0);
        object.at(x, y) = glm::vec3(glm::normalize(around));
      }
    const Image<glm::u8vec4> before = pictureOfNormals8(object, false);
    Image<glm::u16vec4> deep(kSide, kSide);
    for (std::size_t i = 0; i < deep.pixels.size(); ++i) deep.pixels[i] = glm::u16vec4(257u * glm::uvec4(before.pixels[i]));
    const Image<glm::vec3> stored = normalsOfPicture(deep, false);
    // By way of 16 bits, and of 8 with green up and down.
    const Image<glm::vec3> tangent = toTangentSpace(frames, stored);
    const auto largest = [&](const Image<glm::vec3>& back) {
      const Image<glm::u8vec4> after = pictureOfNormals8(toObjectSpace(frames, back), false);
      int most = 0;
      for (std::size_t i = 0; i < after.pixels.size(); ++i)
        for (int c = 0; c < 3; ++c) most = std::max(most, std::abs(int(after.pixels[i][c]) - int(before.pixels[i][c])));
      return most;
    };
    EXPECT_LE(largest(normalsOfPicture(pictureOfNormals16(tangent, false), false)), 0);
    for (const bool down : {false, true}) {
      const Image<glm::u8vec4> eight = pictureOfNormals8(tangent, down);
      Image<glm::u16vec4> spread(kSide, kSide);
      for (std::size_t i = 0; i < spread.pixels.size(); ++i) spread.pixels[i] = glm::u16vec4(257u * glm::uvec4(eight.pixels[i]));
      EXPECT_LE(largest(normalsOfPicture(spread, down)), 1);
    }
  }
}

TEST(Picture, GreyHasItsLuminanceAndSixteenBitsGoThroughAPng) {
  Image<glm::u16vec4> picture(3, 2);
  for (std::size_t i = 0; i < 6; ++i) picture.pixels[i] = glm::u16vec4(i * 13000, 65535 - i * 7, i, 65535);
  const std::vector<std::uint8_t> png = encodePng(picture, true);
  const DecodedDeepImage back = decodeDeepImage(png, 100);
  ASSERT_FALSE(back.problem);
  EXPECT_EQ(back.image.pixels, picture.pixels);
  for (glm::u16vec4& p : picture.pixels) p = glm::u16vec4(glm::uvec3(32768), 65535);
  EXPECT_NEAR(luminanceOf(picture).at(0, 0), 0.21404, 1e-4);  // ((0.5 + 0.055)/1.055)^2.4
}

}  // namespace
}  // namespace lmc
