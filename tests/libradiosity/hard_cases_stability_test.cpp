/// Hard cases: nearly white rooms, chains of rooms, hinged patches, slivers, levels far from their origin. Rows go to docs/stability.md.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <string>

#include "libradiosity/form_factor.h"
#include "libradiosity/quadrature.h"
#include "libradiosity/solve_stored.h"
#include "libscene/constants.h"
#include "libscene/parallel.h"
#include "lmc/stages.h"
#include "tests/libscene/gltf_files.h"
#include "tests/support/bake_scene.h"
#include "tests/support/hard_case.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

using test::expectWithin;

/// The program's stages, on a scene that is there already or on the file of `options`.
void runStages(Bake& b, bool load) {
  withThreads(b.run, [&] {
    for (const StageRow& row : kStages)
      if (load || std::string(row.name) != "load") row.work(b);
  });
}

/// Largest difference of a face's mean from what it should be, relative.
double worstFace(const test::Baked& b, std::uint32_t faces, double exact) {
  double worst = 0.0;
  for (std::uint32_t f = 0; f < faces; ++f) worst = std::max(worst, std::abs(b.mean(f).x / exact - 1.0));
  return worst;
}

TEST(WhiteRooms, AreTheClosedFormByEverySolver) {
  for (const float rho : {0.99f, 0.999f})
    for (const Solver solver : {Solver::Dense, Solver::Stored}) {
      const test::Baked b = test::bakeScene(furnace(rho, 1.0f), {.side = 48, .patchSize_m = 0.8, .solver = solver});
      const double off = worstFace(b, 6, kPi / (1.0 - double(rho)));
      const std::string what =
          fmt::format("closed white room that glows, albedo {}, {}", rho, solver == Solver::Dense ? "dense" : "stored rays");
      expectWithin({what, "worst face", off, 0.01, "%", "half of the goal, against pi/(1 - rho)"});
      expectWithin({what, "iterations", double(b.solution.passes), 20.0, "", "conjugate gradients do not know the albedo"});
    }
}

TEST(WhiteRooms, ALampsLightIsAbsorbedToTheLast) {
  // What a lamp sends must be absorbed: (1 - rho) times the mean of E over all faces times their area is 4 pi I.
  for (const float rho : {0.99f, 0.999f})
    for (const Solver solver : {Solver::Dense, Solver::Stored}) {
      test::SceneBuilder s;
      const auto m = s.material(Rgb(rho));
      s.room({0, 0, 0}, {3, 2, 4}, {m, m, m, m, m, m});
      Light l;
      l.path = "/lamp";
      l.position_m = {0.7, 1.5, 0.9};
      l.intensity = Rgb(10.0f);
      s.scene.lights.push_back(l);
      const test::Baked b = test::bakeScene(s.scene, {.side = 64, .patchSize_m = 0.6, .solver = solver});
      const double areas[6] = {8, 8, 12, 12, 6, 6};
      double absorbed = 0.0;
      for (std::uint32_t f = 0; f < 6; ++f) absorbed += (1.0 - double(rho)) * areas[f] * b.mean(f).x;
      const double off = absorbed / (4.0 * kPi * 10.0) - 1.0;
      const std::string what =
          fmt::format("closed white room with a lamp, albedo {}, {}", rho, solver == Solver::Dense ? "dense" : "stored rays");
      expectWithin({what, "light absorbed against light sent", std::abs(off), 0.01, "%", "half of the goal, against 4 pi I"});
      expectWithin({what, "iterations", double(b.solution.passes), 30.0, "", "conjugate gradients do not know the albedo"});
    }
}

void albedoIsClamped(float albedo) {
  BakeOptions options;
  options.uv.mapSize = 32;
  int warnings = 0;
  lmc::Run run;
  run.onMessage = [&](const Message& m) { warnings += m.code == "LMC_ALBEDO_ONE"; };
  Bake b(options, run);
  b.scene = furnace(albedo, 1.0f);
  runStages(b, false);
  // First bounce by the hemisphere from patches of 0.999: E = pi + 0.999 (E + ...), the closed form of the clamped room.
  const double clamped = kPi / (1.0 - 0.999);
  EXPECT_EQ(warnings, 1);
  expectWithin({fmt::format("closed white room, albedo {}, taken as 0.999 with a warning", albedo), "mean",
                std::abs(b.ledger.mean / clamped - 1.0), 0.01, "%", "half of the goal, against the room of 0.999"});
  EXPECT_GT(b.ledger.bound95, 0.5) << "no light of a room that loses none is all there is";
}

TEST(WhiteRooms, AlbedoOneAndMoreIsClampedAndTheTailSaysSo) {
  albedoIsClamped(1.0f);
  albedoIsClamped(1.5f);
}

/// 16 rooms of 3 x 2.5 x 3 m in a row, joined by doors of full height; a lamp in the first.
Scene chain(float door_m, float rho) {
  test::SceneBuilder b(8);
  const auto white = b.material(Rgb(rho));
  b.room({0, 0, 0}, {48, 2.5f, 3}, {white, white, white, white, white, white});
  for (int k = 1; k < 16; ++k) {
    const float x = 3.0f * float(k);
    b.quad({x, 0, door_m}, {0, 0, 3 - door_m}, {0, 2.5f, 0}, white);
    b.quad({x + 0.05f, 0, door_m}, {0, 2.5f, 0}, {0, 0, 3 - door_m}, white);
    b.quad({x, 0, door_m}, {0, 2.5f, 0}, {0.05f, 0, 0}, white);
  }
  Light l;
  l.path = "/lamp";
  l.position_m = {1.0, 2.0, 1.5};
  l.intensity = Rgb(100.0f);
  b.scene.lights.push_back(l);
  return b.scene;
}

/// Light by bounces on the patches of each room [lm], by stored rays.
class Chain {
 public:
  Chain(float door_m, float rho) : scene_(chain(door_m, rho)), tracer_(scene_), direct_(scene_, tracer_, true) {
    mesh_ = makePatches(scene_, {.size_m = 0.6}, run_);
    exposePatches(mesh_, scene_, tracer_, run_);
    light_ = lightPatches(scene_, tracer_, mesh_, direct_, {}, run_);
  }
  std::array<double, 16> rooms(const StoredOptions& o) const {
    std::array<double, 16> sums{};
    const Bounced h = solveStored(scene_, tracer_, mesh_, light_, o, run_).solution.illuminance;
    for (std::size_t i = 0; i < h.size(); ++i)
      sums[std::size_t(std::clamp(mesh_.patches[i].centre_m.x / 3.0, 0.0, 15.0))] += mesh_.patches[i].area_m2 * double(h[i].r);
    return sums;
  }

 private:
  lmc::Run run_;
  Scene scene_;
  Tracer tracer_;
  DirectLight direct_;
  PatchMesh mesh_;
  PatchLight light_;
};

TEST(ChainOf16Rooms, EveryRoomIsConvergedToOnePercent) {
  // The same hits, iterated until nothing moves: what stopping leaves out, also where light has all but died away.
  const Chain c(1.0f, 0.8f);
  const auto rooms = c.rooms({.maxTail = 1e-3}), further = c.rooms({.maxTail = 1e-12, .maxIterations = 2000});
  double worst = 0.0;
  for (std::size_t k = 0; k < 16; ++k) {
    const double off = rooms[k] / further[k] - 1.0;
    if (further[k] > 1e-4 * further[0]) worst = std::max(worst, std::abs(off));
  }
  expectWithin({"chain of 16 rooms, doors of 1 m, albedo 0.8", "what stopping leaves out, worst room above 1e-4 of the first", worst, 0.01,
                "%", "half of the goal"});
}

TEST(ChainOf16Rooms, LitRoomsAreWithinOnePercentOfAMuchFinerSolution) {
  // Both streams of 128 rays a patch against 16 times as many of another stream, iterated much further.
  const Chain c(2.0f, 0.9f);
  const auto finer = c.rooms({.rays = 2048, .stream = 2, .maxTail = 1e-6}), a = c.rooms({.rays = 128}),
             b = c.rooms({.rays = 128, .stream = 1});
  // Of rooms that are darker still the few rays that find them make a mean too noisy: there 1 % of a light of this share.
  constexpr double kDim = 0.02;
  double worst = 0.0;
  for (std::size_t k = 0; k < 16; ++k) {
    const double off = 0.5 * (a[k] + b[k]) / finer[k] - 1.0, light = finer[k] / finer[0];
    if (light >= kDim) worst = std::max(worst, std::abs(off));
    EXPECT_LT(std::abs(off) * light, 0.01 * std::max(light, kDim)) << "room " << k + 1;
  }
  expectWithin({"chain of 16 rooms, doors of 2 m, albedo 0.9, 2 x 128 rays a patch against 2048", "worst room above 2 % of the first",
                worst, 0.01, "%", "half of the goal"});
}

TEST(TouchingPatches, HingedAt5To175DegreesAreTheIntegral) {
  double worst = 0.0;
  for (int degrees = 5; degrees <= 175; degrees += 10) {
    const double a = degrees * kPi / 180.0;
    test::SceneBuilder s;
    const auto m = s.material(Rgb(0.5f));
    s.quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, m);
    s.quad({0, 0, 0}, {0, 1, 0}, {float(std::cos(a)), 0, float(std::sin(a))}, m);
    const PatchMesh mesh = makePatches(s.scene, {.size_m = 1.0}, lmc::Run());
    double got = 0.0;
    for (std::uint32_t i = 0; i < mesh.patches.size(); ++i)
      for (std::uint32_t k = 0; k < mesh.patches.size(); ++k)
        if (mesh.patches[i].object == 0 && mesh.patches[k].object == 1) got += exchangeArea_m2(s.scene, mesh, i, k);
    // Lambert's form over the first square, places crowded towards the hinge: x = t^4.
    const Polygon3 other{{0, 0, 0}, {0, 1, 0}, {std::cos(a), 1, std::sin(a)}, {std::cos(a), 0, std::sin(a)}};
    const auto& rule = gaussLegendre<double, 64>();
    double exact = 0.0;
    for (std::size_t i = 0; i < 64; ++i)
      for (std::size_t k = 0; k < 64; ++k) {
        // Along the hinge the kernel has its own kinks at both ends: y = smoothstep.
        const double t = rule.node[i], v = rule.node[k], y = v * v * v * (10.0 - 15.0 * v + 6.0 * v * v);
        exact += rule.weight[i] * rule.weight[k] * 4.0 * t * t * t * 30.0 * v * v * (1.0 - v) * (1.0 - v) *
                 elementToPolygon({t * t * t * t, y, 0}, {0, 0, 1}, other);
      }
    worst = std::max(worst, std::abs(got / exact - 1.0));
  }
  expectWithin({"unit squares hinged at 5, 15, ... 175 degrees", "exchange area against Lambert's form integrated", worst, 1e-4, "",
                "corners are floats; at 175 degrees their rounding counts 1/sin 5 times, and the reference's quadrature 1e-6"});
}

/// samples/two_rooms.glb with all of its nodes under one that is moved. The GLB's buffer stays as it is.
std::string movedLevel(const glm::dvec3& by_m) {
  std::ifstream in(LMC_SOURCE_DIR "/samples/two_rooms.glb", std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  std::uint32_t length = 0;
  std::memcpy(&length, bytes.data() + 12, 4);
  test::Json json = test::Json::parse(bytes.substr(20, length));
  const test::Json roots = json["scenes"][0]["nodes"];
  json["nodes"].push_back({{"children", roots}, {"translation", {by_m.x, by_m.y, by_m.z}}});
  json["scenes"][0]["nodes"] = {json["nodes"].size() - 1};
  std::string text = json.dump();
  text.resize((text.size() + 3) / 4 * 4, ' ');
  std::string out = bytes.substr(0, 20) + text + bytes.substr(20 + length);
  const auto put = [&](std::size_t at, std::size_t value) {
    const auto v = std::uint32_t(value);
    std::memcpy(out.data() + at, &v, 4);
  };
  put(8, out.size());
  put(12, text.size());
  return out;
}

TEST(MovedLevel, ByOneMetreTo1000KilometresIsTheSame) {
  const test::Folder folder;
  const auto bakeAt = [&](double by_m) {
    static BakeOptions options;  // lives as long as what was baked by it
    options.level = folder.write("level.glb", movedLevel({by_m, 0.0, -by_m}));
    options.uv.mapSize = 64;
    auto b = std::make_unique<Bake>(options, lmc::Run());
    runStages(*b, true);
    return b;
  };
  const auto near = bakeAt(0.0);
  for (const double by_m : {1.0, 1e3, 1e5, 1e6}) {
    const auto far = bakeAt(by_m);
    ASSERT_EQ(near->map.chart, far->map.chart);
    double squares = 0.0;
    for (std::size_t i = 0; i < near->map.size(); ++i) {
      if (near->map.chart[i] == kNone) continue;
      const glm::dvec3 d =
          glm::dvec3(near->values.direct[i] + near->values.indirect[i]) - glm::dvec3(far->values.direct[i] + far->values.indirect[i]);
      squares += glm::dot(d, d) / 3.0;
    }
    const double rms = std::sqrt(squares / double(near->ledger.texels)) / near->ledger.mean;
    expectWithin({fmt::format("level moved by {:g} m along x and z by its node", by_m), "RMS difference", rms, near->ledger.estimate, "%",
                  "the stated error: places differ by 1e-10 m at most, and only ties can fall the other way"});
  }
}

}  // namespace
}  // namespace lmc
