/// What a tangent must be, on surfaces where it can be said by hand; and the reference's own bits.
#include <gmock/gmock.h>

#include <bit>
#include <limits>
#include <stdexcept>

#include "libtangent/angle.h"
#include "tests/libtangent/surfaces.h"

namespace lmc::tangent {
namespace {

using testing::HasSubstr;

TEST(Tangent, PointsWhereUGrows) {
  for (const bool mirrored : {false, true}) {
    const OwnedSurface s = square(mirrored);
    const Tangents got = compute(s.view());
    ASSERT_EQ(got.corners.size(), 6u);
    for (const CornerTangent& c : got.corners) EXPECT_EQ(c.tangent, glm::vec3(mirrored ? -1 : 1, 0, 0));
  }
}

TEST(Tangent, BitangentPointsAgainstVAsStoredAndMirroredUvsFlipTheDeterminant) {
  // glTF: V grows downwards in the picture and green points up, so the bitangent is where V falls: -Y here.
  for (const bool mirrored : {false, true}) {
    const OwnedSurface s = square(mirrored);
    const Tangents got = compute(s.view());
    const ReferenceTangents reference = computeReference(s.view());
    for (std::size_t c = 0; c < 6; ++c) {
      EXPECT_EQ(got.corners[c].determinant, mirrored ? 1.0f : -1.0f);
      EXPECT_EQ(glm::cross(glm::vec3(0, 0, 1), got.corners[c].tangent) * got.corners[c].determinant, glm::vec3(0, -1, 0));
      EXPECT_EQ(reference.corners[c].referenceSign, -got.corners[c].determinant);
    }
  }
}

TEST(Loop, WhatAThreadThrowsComesOutWhereTheLoopWasCalled) {
  for (const int threads : {1, 2, 4})
    for (const std::size_t failing : {0, 1, 49, 99})
      EXPECT_THROW(threadedLoop(threads).each(100,
                                              [&](std::size_t i) {
                                                if (i == failing) throw std::bad_alloc();
                                              }),
                   std::bad_alloc)
          << threads << " threads, " << failing;
}

TEST(Reference, HasTheReferencesBits) {
  // Fails when the compiler fuses a product and a sum, or sums in another order.
  for (const ReferenceMesh& mesh : referenceMeshes()) {
    const OwnedSurface s = ownedOf(mesh);
    const ReferenceTangents got = computeReference(s.view());
    ASSERT_EQ(got.corners.size(), mesh.corners.size());
    for (std::size_t c = 0; c < mesh.corners.size(); ++c) {
      const glm::vec3 want(std::bit_cast<float>(mesh.corners[c].x), std::bit_cast<float>(mesh.corners[c].y),
                           std::bit_cast<float>(mesh.corners[c].z));
      EXPECT_EQ(got.corners[c].tangent, want) << "mesh " << &mesh - referenceMeshes().data() << ", corner " << c;
      EXPECT_EQ(got.corners[c].referenceSign, float(mesh.corners[c].sign));
    }
  }
}

TEST(Angle, IsTheFloatNextToTheAngle) {
  // Every 251st float of [-1, 1], and all near the places where the formula changes.
  constexpr int kBlock = 64;
  float cosine[kBlock], angle[kBlock];
  unsigned doubt[kBlock];
  std::size_t doubts = 0, tested = 0;
  const auto test = [&](std::uint32_t first, std::uint32_t step) {
    for (int i = 0; i < kBlock; ++i) cosine[i] = std::clamp(std::bit_cast<float>(first + step * std::uint32_t(i)), -1.0f, 1.0f);
    angles(cosine, angle, doubt, kBlock);
    for (int i = 0; i < kBlock; ++i, ++tested) {
      doubts += doubt[i] != 0;
      if (doubt[i]) continue;
      ASSERT_EQ(angle[i], float(std::acos(double(cosine[i])))) << cosine[i];
    }
  };
  const std::uint32_t one = std::bit_cast<std::uint32_t>(1.0f), half = std::bit_cast<std::uint32_t>(0.5f), minus = 0x80000000u;
  for (const std::uint32_t sign : {0u, minus}) {
    for (std::uint32_t bits = 0; bits + 251 * kBlock < one; bits += 251 * kBlock) test(sign | bits, 251);
    for (const std::uint32_t middle : {half, one - 2048})
      for (std::uint32_t bits = middle - 2048; bits < middle + 2048; bits += kBlock) test(sign | bits, 1);
  }
  EXPECT_LT(double(doubts), 1e-3 * double(tested));  // a doubt costs a call, no more
  cosine[0] = std::numeric_limits<float>::quiet_NaN();
  angles(cosine, angle, doubt, 1);
  EXPECT_TRUE(doubt[0]);
}

TEST(Weld, SignsOfZeroAreEqualAndNansAreNot) {
  OwnedSurface s = square();
  // The second triangle on vertices of its own, with -0 for 0.
  for (const std::uint32_t v : {0u, 2u}) {
    const glm::vec3 p = s.positions[v];
    s.add({p.x == 0 ? -0.0f : p.x, p.y == 0 ? -0.0f : p.y, -0.0f}, {-0.0f, 0, 1}, s.uvs[v]);
  }
  s.indices = {0, 1, 2, 4, 5, 3};
  EXPECT_EQ(compute(s.view()).counts.welded, 2u);
  EXPECT_EQ(compute(s.view()).counts.groups, 4u);
  s.positions[4].x = s.positions[0].x = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(compute(s.view()).counts.welded, 1u);
}

TEST(Safe, FillersAreMendedAndTold) {
  OwnedSurface s = square();
  for (glm::vec2& uv : s.uvs) uv = {0.5f, 0.5f};
  for (glm::vec3& n : s.normals) n = {1, 0, 0};  // the reference's filler lies along it
  const Tangents got = compute(s.view());
  EXPECT_EQ(got.mended.size(), 6u);
  for (std::size_t i = 0; i < got.mended.size(); ++i) {
    EXPECT_EQ(got.mended[i].corner, i);
    EXPECT_EQ(got.mended[i].why, Mend::NoFrame);
  }
  EXPECT_EQ(firstUnfit(s, got), -1);
  for (const ReferenceTangent& c : computeReference(s.view()).corners) {
    EXPECT_EQ(c.tangent, glm::vec3(1, 0, 0));
    EXPECT_EQ(c.referenceSign, -1.0f);
  }
}

TEST(Safe, AFillersDeterminantIsItsFaces) {
  // A quad, half of which has no area in UV, mirrored or not: all four corners are of one sign.
  for (const bool mirrored : {false, true}) {
    OwnedSurface s = square(mirrored);
    s.uvs[3] = s.uvs[0];
    s.indices = {0, 1, 2, 3};
    s.faceSizes = {4};
    const Tangents got = compute(s.view());
    for (const CornerTangent& c : got.corners) EXPECT_EQ(c.determinant, mirrored ? 1.0f : -1.0f);
  }
}

TEST(Safe, ANormalAlongTheTangentTakesTheBitangentsWord) {
  OwnedSurface s = square();
  for (glm::vec3& n : s.normals) n = {1, 0, 0};
  const Tangents got = compute(s.view());
  ASSERT_EQ(got.mended.size(), 6u);
  for (const CornerTangent& c : got.corners) {
    // The bitangent stays where V falls.
    const glm::vec3 bitangent = glm::cross(glm::vec3(1, 0, 0), c.tangent) * c.determinant;
    EXPECT_NEAR(bitangent.y, -1.0f, 1e-6f);
  }
}

TEST(Safe, WhatIsNotFiniteIsMended) {
  constexpr float kBad[] = {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), 3e38f, 1e-44f};
  for (const float bad : kBad)
    for (int member = 0; member < 8; ++member)
      for (std::uint32_t seed = 0; seed < 20; ++seed) {
        OwnedSurface s = soup(seed);
        const std::size_t v = seed % s.positions.size();
        (member < 3 ? s.positions[v][member] : member < 6 ? s.normals[v][member - 3] : s.uvs[v][member - 6]) = bad;
        EXPECT_EQ(firstUnfit(s, compute(s.view())), -1) << bad << " at " << member << ", seed " << seed;
      }
}

TEST(Surface, FacesOfOtherSizesAreFilledAndTold) {
  OwnedSurface s = square();
  s.add({0.5f, 2, 0}, {0, 0, 1}, {0.5f, 2});
  s.indices = {0, 1, 2, 4, 3, 0, 1, 2};
  s.faceSizes = {5, 3};
  const Tangents got = compute(s.view());
  ASSERT_EQ(got.mended.size(), 5u);
  EXPECT_EQ(firstUnfit(s, got), -1);
  EXPECT_EQ(got.corners[5].tangent, glm::vec3(1, 0, 0));
}

TEST(Surface, ProblemsAreSaidInWords) {
  OwnedSurface s = square();
  EXPECT_EQ(problemWith(s.view()), "");
  EXPECT_EQ(problemWith({}), "");
  s.indices[4] = 4;
  EXPECT_THAT(problemWith(s.view()), HasSubstr("corner 4 is vertex 4 of 4"));
  EXPECT_THROW(compute(s.view()), std::invalid_argument);
  s.indices.pop_back();
  EXPECT_THAT(problemWith(s.view()), HasSubstr("no multiple of 3"));
  s.faceSizes = {4};
  EXPECT_THAT(problemWith(s.view()), HasSubstr("faces of 4 corners in all"));
  s.normals.pop_back();
  EXPECT_THAT(problemWith(s.view()), HasSubstr("3 normals for 4 positions"));
}

TEST(Surface, NothingIsASurfaceToo) {
  EXPECT_TRUE(compute({}).corners.empty());
  OwnedSurface s = square();
  s.indices.clear();
  EXPECT_TRUE(compute(s.view()).corners.empty());
}

}  // namespace
}  // namespace lmc::tangent
