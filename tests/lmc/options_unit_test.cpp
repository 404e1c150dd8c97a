#include "lmc/options.h"

#include "lmc/memory.h"

#include <gtest/gtest.h>

#include <variant>

namespace lmc {
namespace {

template <class... Words>
Command parse(Words... words) {
  const char* argv[] = {"lmc", words...};
  return parseCommandLine(int(std::size(argv)), argv);
}

TEST(Options, GoalIsPercentOrShare) {
  EXPECT_EQ(std::get<BakeOptions>(parse("bake", "a.glb", "-o", "out")).goal, 0.02);
  EXPECT_FALSE(std::get<BakeOptions>(parse("bake", "a.glb", "-o", "out")).goalIsExplicit);
  EXPECT_EQ(std::get<BakeOptions>(parse("bake", "a.glb", "-o", "out", "--max-error", "1%")).goal, 0.01);
  EXPECT_EQ(std::get<BakeOptions>(parse("bake", "a.glb", "-o", "out", "--max-error", "0.005")).goal, 0.005);
  EXPECT_EQ(std::get<BakeOptions>(parse("bake", "a.glb", "-o", "out", "--preset", "draft")).goal, 0.08);
  const auto both = std::get<BakeOptions>(parse("bake", "a.glb", "-o", "out", "--max-error", "1%", "--preset", "draft"));
  EXPECT_EQ(both.goal, 0.01);
  EXPECT_TRUE(both.goalIsExplicit);
}

TEST(Options, EveryComplaintIsAUsageError) {
  const auto refused = [](auto... words) {
    try {
      parse(words...);
    } catch (const Error& e) {
      return e.kind == Exit::Usage && std::string(e.what()).find('\n') == std::string::npos;
    }
    return false;
  };
  EXPECT_TRUE(refused("bake"));
  EXPECT_TRUE(refused("bake", "a.glb"));
  EXPECT_TRUE(refused("bake", "a.glb", "-o", "out", "--nonsense"));
  EXPECT_TRUE(refused("bake", "a.glb", "-o", "out", "--max-error", "-1%"));
  EXPECT_TRUE(refused("bake", "a.glb", "-o", "out", "--max-error", "nan"));
  EXPECT_TRUE(refused("bake", "a.glb", "-o", "out", "--sky", "1,2"));
  EXPECT_TRUE(refused("bake", "a.glb", "-o", "out", "--sky", "1,2,-3"));
  EXPECT_TRUE(refused("bake", "a.glb", "-o", "out", "--passes", "0.5"));
  EXPECT_TRUE(refused("bake", "a.glb", "-o", "out", "-j", "0"));
  EXPECT_TRUE(refused("frobnicate"));
}

TEST(Options, SkyTakesNoneSceneOrARadiance) {
  EXPECT_FALSE(std::get<BakeOptions>(parse("bake", "a.glb", "-o", "out", "--sky", "scene")).sky.has_value());
  EXPECT_EQ(*std::get<BakeOptions>(parse("bake", "a.glb", "-o", "out", "--sky", "none")).sky, Rgb(0.0f));
  EXPECT_EQ(*std::get<BakeOptions>(parse("bake", "a.glb", "-o", "out", "--sky", "1,2,0.5")).sky, Rgb(1.0f, 2.0f, 0.5f));
}

TEST(Options, MemoryIsASizeInPowersOf1024) {
  const auto memory = [](const char* t) { return std::get<BakeOptions>(parse("bake", "a.glb", "-o", "out", "--memory", t)).memory_bytes; };
  EXPECT_EQ(std::get<BakeOptions>(parse("bake", "a.glb", "-o", "out")).memory_bytes, 0u) << "what the machine has";
  EXPECT_EQ(memory("512M"), 512u << 20);
  EXPECT_EQ(memory("1.5G"), std::uint64_t(3) << 29);
  EXPECT_EQ(memory("4096"), 4096u);
  EXPECT_EQ(memory("2T"), std::uint64_t(1) << 41);
  for (const char* t : {"", "M", "0", "-1G", "2g", "2GB", "nan", "1e30G", "2 G"}) EXPECT_THROW(memory(t), Error) << t;
  EXPECT_EQ(bytesOf(sizeText((5u << 20) + 1)), 6u << 20);
}

TEST(Options, HelpIsTextForStdout) {
  EXPECT_NE(std::get<ShowText>(parse("--help")).text.find("bake"), std::string::npos);
  EXPECT_NE(std::get<ShowText>(parse("bake", "--help")).text.find("--max-error"), std::string::npos);
}

TEST(Options, HelpOfABakeNamesEveryLimitWithItsDefault) {
  const std::string help = std::get<ShowText>(parse("bake", "--help")).text;
  for (const char* limit : {"--max-input-bytes UINT=8589934592", "--max-texture-pixels UINT=268435456", "--max-triangles UINT=200000000",
                            "--max-nodes UINT=1000000", "--max-instances UINT=1000000", "--max-json-depth INT:INT in [1 - 512]=64",
                            "--max-extent FLOAT:FLOAT in [1e-09 - 1e+15]=1e+09", "--max-patches UINT:INT in [16 - 10000000]=200000",
                            "--max-links UINT:UINT in [1 - 1099511627776]=40000000", "--max-maps INT:INT in [1 - 1024]=16",
                            "--map-size INT:INT in [4 - 16384]", "--memory SIZE", "default: 960M", "16384 x 16384 texels", "Exit codes: "})
    EXPECT_NE(help.find(limit), std::string::npos) << limit;
  EXPECT_EQ(help.find("{false}"), std::string::npos);
}

TEST(Options, LimitsReachTheLoader) {
  const auto o =
      std::get<BakeOptions>(parse("bake", "a.glb", "-o", "out", "--max-triangles", "5", "--max-extent", "20", "--max-nodes", "6",
                                  "--max-instances", "7", "--max-json-depth", "8", "--max-input-bytes", "9", "--max-texture-pixels", "10"));
  EXPECT_EQ(o.limits.maxTriangles, 5u);
  EXPECT_EQ(o.limits.maxExtent_m, 20.0);
  EXPECT_EQ(o.limits.maxNodes, 6u);
  EXPECT_EQ(o.limits.maxInstances, 7u);
  EXPECT_EQ(o.limits.maxJsonDepth, 8);
  EXPECT_EQ(o.limits.maxInputBytes, 9u);
  EXPECT_EQ(o.limits.maxTexturePixels, 10u);
}

}  // namespace
}  // namespace lmc
