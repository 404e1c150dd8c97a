#include "lmc/plan.h"

#include <gtest/gtest.h>

#include "libscene/error.h"

namespace lmc {
namespace {

Facts room() {
  Facts f;
  f.pointLights = 2;
  f.receivers = 3;
  f.blockers = 100;
  f.largestReflectance = 0.7f;
  return f;
}

TEST(Plan, RunsWhatTheLevelCallsFor) {
  const Plan p = makePlan("auto", room());
  EXPECT_TRUE(p.runs(Effect::Direct));
  EXPECT_TRUE(p.runs(Effect::Shadow));
  EXPECT_FALSE(p.runs(Effect::Area));
  EXPECT_FALSE(p.runs(Effect::Sky));
  EXPECT_TRUE(p.runs(Effect::Bounce));
  for (const Step& s : p.steps) EXPECT_FALSE(s.because.empty());
}

TEST(Plan, WithoutLightNothingRuns) {
  Facts f = room();
  f.pointLights = 0;
  EXPECT_FALSE(makePlan("auto", f).anything());
  f = room();
  f.receivers = 0;
  EXPECT_FALSE(makePlan("auto", f).anything());
}

TEST(Plan, BlackSurfacesNeedNoBounce) {
  Facts f = room();
  f.largestReflectance = 0.0f;
  EXPECT_FALSE(makePlan("auto", f).runs(Effect::Bounce));
  EXPECT_TRUE(makePlan("auto", f).runs(Effect::Direct));
}

TEST(Plan, SeamsAreClosedWhereThereAreSmoothOnes) {
  Facts f = room();
  EXPECT_TRUE(makePlan("auto", f).runs(Effect::Seams)) << "not known before light-map UVs are there";
  f.smoothSeams = 7;
  Plan p = makePlan("auto", f);
  EXPECT_TRUE(p.runs(Effect::Seams));
  EXPECT_EQ(p.steps[std::size_t(Effect::Seams)].because, "7 chart edges meet on smooth surfaces");
  EXPECT_FALSE(makePlan("-seams", f).runs(Effect::Seams));
  f.smoothSeams = 0;
  p = makePlan("auto", f);
  EXPECT_FALSE(p.runs(Effect::Seams));
  EXPECT_EQ(p.steps[std::size_t(Effect::Seams)].because, "no smooth seam");
}

TEST(Plan, EffectsCanBeListedOrChanged) {
  EXPECT_FALSE(makePlan("direct", room()).runs(Effect::Bounce));
  EXPECT_TRUE(makePlan("direct", room()).runs(Effect::Direct));
  const Plan p = makePlan("-bounce,-shadow", room());
  EXPECT_TRUE(p.runs(Effect::Direct));
  EXPECT_FALSE(p.runs(Effect::Bounce));
  EXPECT_EQ(p.steps[std::size_t(Effect::Bounce)].because, "--effects -bounce,-shadow");
  EXPECT_FALSE(makePlan("+sky", room()).runs(Effect::Sky)) << "asked for what the level has not";
  EXPECT_THROW(makePlan("glow", room()), Error);
  EXPECT_THROW(makePlan("+sky,bounce", room()), Error);
  EXPECT_THROW(makePlan("", room()), Error);
}

}  // namespace
}  // namespace lmc
