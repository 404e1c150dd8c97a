/// Levels whose numbers or vertex data are hard, by the program's own stages. Rows go to docs/stability.md.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "libscene/constants.h"
#include "libscene/exr.h"
#include "libscene/parallel.h"
#include "lmc/outputs.h"
#include "lmc/report.h"
#include "lmc/stages.h"
#include "tests/libscene/gltf_files.h"
#include "tests/support/hard_case.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

using test::expectWithin;

/// A bake whose options live as long as it does.
struct Job {
  BakeOptions options;
  test::Heard heard;
  std::unique_ptr<Bake> bake;
  explicit Job(int side) { options.uv.mapSize = side; }
  Bake& run(bool load) {
    bake = bake ? std::move(bake) : std::make_unique<Bake>(options, heard.run);
    withThreads(bake->run, [&] {
      for (const StageRow& row : kStages)
        if (load || std::string(row.name) != "load") row.work(*bake);
    });
    return *bake;
  }
  Bake& of(const Scene& scene) {
    bake = std::make_unique<Bake>(options, heard.run);
    bake->scene = scene;
    return run(false);
  }
  Bake& of(const std::filesystem::path& level) {
    options.level = level;
    return run(true);
  }
};

Scene litRoom(float intensity) {
  test::SceneBuilder s;
  const auto m = s.material(Rgb(0.5f));
  s.room({0, 0, 0}, {3, 2, 4}, {m, m, m, m, m, m});
  s.scene.lights.push_back(test::pointLight({1, 1, 1}, intensity));
  return s.scene;
}

double texel(const Bake& b, std::size_t i) { return double(b.values.direct[i].r) + double(b.values.indirect[i].r); }

TEST(HardLight, From1eMinus42To1e30CandelaIsLinear) {
  Job one(48);
  const Bake& a = one.of(litRoom(1.0f));
  for (const int power : {-139, -60, 60, 100}) {
    Job other(48);
    const Bake& b = other.of(litRoom(std::ldexp(1.0f, power)));
    std::size_t apart = 0;
    for (std::size_t i = 0; i < a.map.size(); ++i) apart += texel(a, i) * std::ldexp(1.0, power) != texel(b, i) * b.lightUnit;
    expectWithin({fmt::format("light of 2^{} cd ({:.0e})", power, std::ldexp(1.0, power)), "texels with another bit than at 1 cd, scaled",
                  double(apart), 0.0, "", "powers of two round nothing"});
    for (const float scale : b.scales) EXPECT_TRUE(std::isfinite(scale) && scale > 0.0f);
  }
  for (const float intensity : {1e-42f, 1e30f}) {
    Job other(48);
    const Bake& b = other.of(litRoom(intensity));
    double sum = 0.0, whole = 0.0;
    for (std::size_t i = 0; i < a.map.size(); ++i) {
      ASSERT_TRUE(std::isfinite(texel(b, i)));
      sum += texel(b, i) * b.lightUnit / double(intensity);
      whole += texel(a, i);
    }
    expectWithin({fmt::format("light of {:g} cd", double(intensity)), "mean against 1 cd, scaled", std::abs(sum / whole - 1.0),
                  a.ledger.bound95 + b.ledger.bound95, "%", "sum of the stated bounds of both"});
  }
}

/// A bake's maps as they are written.
ExrImage written(const Bake& b, const test::Folder& folder) {
  OutputSet set(folder.path() / "out");
  writeOutputs(set, b, {});
  set.commit();
  return readExr(folder.path() / "out" / "lightmap.exr");
}

/// A square of 1 m in z = 0 with a light of its own.
test::Builder squareUnder(test::Json light) {
  test::Builder b = test::squareLevel();
  b.json["extensionsUsed"] = {"KHR_lights_punctual"};
  b.json["extensions"]["KHR_lights_punctual"]["lights"] = {std::move(light)};
  test::Json lamp = {{"extensions", {{"KHR_lights_punctual", {{"light", 0}}}}}};
  b.json["nodes"].push_back(lamp);
  b.json["scenes"][0]["nodes"] = {0, 1};
  return b;
}

TEST(HardLight, AHundredKiloluxOfSunFitIntoHalfFloats) {
  const test::Folder folder;
  Job job(16);
  const Bake& b = job.of(squareUnder({{"type", "directional"}, {"intensity", 1e5}}).save(folder));
  const ExrImage map = written(b, folder);
  double worst = 0.0;
  for (std::size_t i = 0; i < b.map.size(); ++i)
    if (b.map.chart[i] != kNone)
      worst = std::max(worst, std::abs(double(map.channels.at("R")[i]) * double(map.attributes.at("lmcScale")) / 1e5 - 1.0));
  expectWithin({"sun of 100 klx in half floats", "worst texel of the file", worst, std::ldexp(1.0, -11), "",
                "half a unit in the last of 11 places"});
  EXPECT_EQ(map.attributes.at("lmcScale"), 4.0f);
}

TEST(HardVertices, NormalsThatAreZeroOppositeOrNotUnitLightAsTheFaces) {
  // The sun straight down on a square. Normals that are no directions, or point into the surface, are made anew; lengths do not matter.
  struct Case {
    const char* what;
    std::vector<float> normals;
  };
  for (const Case& c : {Case{"vertex normals of length 0", {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}},
                        Case{"vertex normals of length 0.2 and 3", {0, 0, 0.2f, 0, 0, 3, 0, 0, 0.2f, 0, 0, 3}},
                        Case{"vertex normals against the face", {0, 0, -1, 0, 0, -1, 0, 0, -1, 0, 0, -1}}}) {
    const test::Folder folder;
    test::Builder level = squareUnder({{"type", "directional"}, {"intensity", 1.0}});
    const int at = level.add<float>(c.normals, "VEC3", 3);
    level.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = at;
    Job job(16);
    const Bake& b = job.of(level.save(folder));
    double worst = 0.0;
    for (std::size_t i = 0; i < b.map.size(); ++i)
      if (b.map.chart[i] != kNone) worst = std::max(worst, std::abs(texel(b, i) - 1.0));
    expectWithin({c.what, "worst texel under the sun", worst, 1e-5, "lx", "1 lx straight down; values are floats"});
  }
}

TEST(HardVertices, MirroredEmptyAndTinyUvsBake) {
  struct Case {
    const char* what;
    std::vector<float> uvs;
  };
  for (const Case& c :
       {Case{"light-map UVs mirrored", {1, 0, 0, 0, 0, 1, 1, 1}},
        Case{"light-map UVs without area", {0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f}},
        Case{"light-map UVs on a line", {0, 0.5f, 0.5f, 0.5f, 1, 0.5f, 0.75f, 0.5f}},
        Case{"light-map chart within one texel", {0.51f, 0.51f, 0.52f, 0.51f, 0.52f, 0.52f, 0.51f, 0.52f}},
        Case{"light-map chart with its texel's centre outside", {0.501f, 0.51f, 0.52f, 0.51f, 0.52f, 0.511f, 0.501f, 0.511f}}}) {
    const test::Folder folder;
    test::Builder level = squareUnder({{"type", "directional"}, {"intensity", 1.0}});
    const int at = level.add<float>(c.uvs, "VEC2", 2);
    level.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = at;
    Job job(16);
    const Bake& b = job.of(level.save(folder));
    double worst = 0.0;
    std::size_t covered = 0;
    for (std::size_t i = 0; i < b.map.size(); ++i)
      if (b.map.chart[i] != kNone) ++covered, worst = std::max(worst, std::abs(texel(b, i) - 1.0));
    ASSERT_GT(covered, 0u) << c.what;
    expectWithin({c.what, "worst texel under the sun", worst, 1e-5, "lx", "1 lx straight down; values are floats"});
  }
}

TEST(HardVertices, SmoothNormalsOverFlatFacesMakeNoSawOfTheTerminator) {
  // A coarse ball with the normals of a sphere under the sun. Where both the face and the normal see the sun, E is the sun times the
  // normal's cosine: no face of the ball itself hides it there.
  test::SceneBuilder s(1);
  constexpr int kAround = 24, kDown = 12;
  std::vector<glm::vec3> positions;
  std::vector<glm::vec2> uvs;
  std::vector<glm::uvec3> triangles;
  for (int y = 0; y <= kDown; ++y)
    for (int x = 0; x <= kAround; ++x) {
      const double phi = 2.0 * kPi * x / kAround, theta = 0.2 + (kPi - 0.4) * y / kDown;
      positions.emplace_back(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi));
      uvs.emplace_back(0.05f + 0.9f * float(x) / kAround, 0.05f + 0.9f * float(y) / kDown);
    }
  for (std::uint32_t y = 0; y < kDown; ++y)
    for (std::uint32_t x = 0; x < kAround; ++x) {
      const std::uint32_t a = y * (kAround + 1) + x, b = a + kAround + 1;
      triangles.emplace_back(a, a + 1, b + 1);
      triangles.emplace_back(a, b + 1, b);
    }
  s.mesh(positions, positions, uvs, triangles, s.material(Rgb(0.0f)));
  Light sun;
  sun.kind = Light::Kind::Directional;
  sun.path = "/sun";
  sun.direction = glm::normalize(glm::dvec3(1.0, -0.3, 0.2));
  sun.intensity = Rgb(1.0f);
  s.scene.lights.push_back(sun);
  Job job(192);
  const Bake& b = job.of(s.scene);
  double worst = 0.0;
  std::size_t judged = 0;
  for (std::size_t t = 0; t < b.texels->tileCount(); ++t) {
    const TexelTile tile = b.texels->texels(t);
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x) {
        const Texel& here = tile.at(x, y);
        if (here.coverage < 0.999f) continue;
        double facing = 1.0, exact = 0.0;
        for (int k = 0; k < 16; ++k) {
          const SurfacePoint p = TexelSampler(b.scene, tile, here).at({(k % 4 + 0.5f) / 4.0f, (k / 4 + 0.5f) / 4.0f});
          facing = std::min({facing, glm::dot(p.geometricNormal, -sun.direction), glm::dot(p.normal, -sun.direction)});
          exact += std::max(0.0, glm::dot(p.normal, -sun.direction)) / 16.0;
        }
        if (facing <= 0.02) continue;
        ++judged;
        worst = std::max(worst, std::abs(texel(b, b.map.index(tile, x, y)) - exact));
      }
  }
  ASSERT_GT(judged, 3000u);
  expectWithin({"smooth normals over 15 degree faces", "worst texel that both face and normal turn to the sun", worst, 0.01, "lx",
                "1 lx; 16 random places against 16 even ones along 1/7 of a face of 15 degrees"});
}

}  // namespace
}  // namespace lmc
