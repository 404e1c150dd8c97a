#include "lmc/plan.h"

#include <gtest/gtest.h>

#include <cmath>

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
  const Plan p = makePlan({"auto"}, room());
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
  EXPECT_FALSE(makePlan({"auto"}, f).anything());
  f = room();
  f.receivers = 0;
  EXPECT_FALSE(makePlan({"auto"}, f).anything());
}

TEST(Plan, BlackSurfacesNeedNoBounce) {
  Facts f = room();
  f.largestReflectance = 0.0f;
  EXPECT_FALSE(makePlan({"auto"}, f).runs(Effect::Bounce));
  EXPECT_TRUE(makePlan({"auto"}, f).runs(Effect::Direct));
}

TEST(Plan, SeamsAreClosedWhereThereAreSmoothOnes) {
  Facts f = room();
  EXPECT_TRUE(makePlan({"auto"}, f).runs(Effect::Seams)) << "not known before light-map UVs are there";
  f.smoothSeams = 7;
  Plan p = makePlan({"auto"}, f);
  EXPECT_TRUE(p.runs(Effect::Seams));
  EXPECT_EQ(p.steps[std::size_t(Effect::Seams)].because, "7 chart edges meet on smooth surfaces");
  EXPECT_FALSE(makePlan({"-seams"}, f).runs(Effect::Seams));
  f.smoothSeams = 0;
  p = makePlan({"auto"}, f);
  EXPECT_FALSE(p.runs(Effect::Seams));
  EXPECT_EQ(p.steps[std::size_t(Effect::Seams)].because, "no smooth seam");
}

TEST(Plan, RimsAreFilledWhereThatIsAskedFor) {
  Facts f = room();
  EXPECT_FALSE(makePlan({"auto"}, f).runs(Effect::Rims)) << "a map of means is what a goal speaks of";
  EXPECT_TRUE(makePlan({"+rims"}, f).runs(Effect::Rims));
  EXPECT_TRUE(makePlan({"direct,rims"}, f).runs(Effect::Rims));
  f.shape = Shape::SeenFromInside;
  EXPECT_FALSE(makePlan({"+rims"}, f).runs(Effect::Rims)) << "an empty room";
  f = room();
  f.pointLights = 0;
  EXPECT_FALSE(makePlan({"+rims"}, f).runs(Effect::Rims));
}

TEST(Plan, EffectsCanBeListedOrChanged) {
  EXPECT_FALSE(makePlan({"direct"}, room()).runs(Effect::Bounce));
  EXPECT_TRUE(makePlan({"direct"}, room()).runs(Effect::Direct));
  const Plan p = makePlan({"-bounce,-shadow"}, room());
  EXPECT_TRUE(p.runs(Effect::Direct));
  EXPECT_FALSE(p.runs(Effect::Bounce));
  EXPECT_EQ(p.steps[std::size_t(Effect::Bounce)].because, "--effects -bounce,-shadow");
  EXPECT_FALSE(makePlan({"+sky"}, room()).runs(Effect::Sky)) << "asked for what the level has not";
  EXPECT_THROW(makePlan({"glow"}, room()), Error);
  EXPECT_THROW(makePlan({"+sky,bounce"}, room()), Error);
  EXPECT_THROW(makePlan({""}, room()), Error);
}

TEST(Plan, WhatLmcLeavesOutBelongsToTheMapYet) {
  // What checks a map has all its light, but for what a user took away.
  Facts f = room();
  EXPECT_TRUE(makePlan({"auto"}, f).isMeant(Effect::Bounce));
  EXPECT_FALSE(makePlan({"-bounce"}, f).isMeant(Effect::Bounce));
  EXPECT_FALSE(makePlan({"direct"}, f).isMeant(Effect::Shadow));
  f.blockers = 0;
  const Plan p = makePlan({"auto"}, f);
  EXPECT_FALSE(p.runs(Effect::Shadow));
  EXPECT_TRUE(p.isMeant(Effect::Shadow));
  f = room();
  Pilot pilot;
  Contribution& little = pilot.effects[std::size_t(Effect::Bounce)];
  little.known = true;
  little.bound = little.object = 1e-4;
  f.pilot = pilot;
  const Plan weak = makePlan({"auto"}, f);
  EXPECT_FALSE(weak.runs(Effect::Bounce));
  EXPECT_TRUE(weak.isMeant(Effect::Bounce));
}

TEST(Plan, MannersFollowWhatRunsAndTheLevel) {
  Facts f = room();
  f.grey = false;
  Plan p = makePlan({"auto"}, f);
  EXPECT_TRUE(p.runs(Effect::Near));
  EXPECT_TRUE(p.runs(Effect::Colour));
  EXPECT_FALSE(p.runs(Effect::Alpha));
  EXPECT_FALSE(p.runs(Effect::Specular));
  EXPECT_FALSE(p.runs(Effect::ScreenAo));
  EXPECT_EQ(makePlan({"-bounce"}, f).steps[std::size_t(Effect::Near)].because, "no bounces");
  EXPECT_FALSE(makePlan({"auto", 0.02, true}, f).runs(Effect::Near)) << "bounces are counted";
  EXPECT_FALSE(makePlan({"-near"}, f).runs(Effect::Near));
  f.grey = true;
  EXPECT_FALSE(makePlan({"auto"}, f).runs(Effect::Colour));
  f.maskedMaterials = 2;
  EXPECT_FALSE(makePlan({"auto"}, f).runs(Effect::Alpha)) << "nothing has a hole";
  EXPECT_TRUE(makePlan({"+alpha"}, f).runs(Effect::Alpha));
  f.holedMaterials = 1;
  EXPECT_TRUE(makePlan({"auto"}, f).runs(Effect::Alpha));
  f.shinyMaterials = 1;
  f.ambient = true;
  p = makePlan({"+screen-ao"}, f);
  EXPECT_TRUE(p.runs(Effect::Specular));
  EXPECT_TRUE(p.runs(Effect::ScreenAo));
  f.pointLights = 0;
  EXPECT_FALSE(makePlan({"auto"}, f).runs(Effect::Alpha)) << "nothing is simulated";
  EXPECT_FALSE(makePlan({"auto"}, f).runs(Effect::Specular));
}

TEST(Plan, AListDoesNotSpeakOfManners) {
  Facts f = room();
  f.grey = false;
  f.maskedMaterials = f.holedMaterials = 1;
  Plan p = makePlan({"direct,bounce"}, f);
  EXPECT_FALSE(p.runs(Effect::Shadow));
  EXPECT_TRUE(p.runs(Effect::Near));
  EXPECT_TRUE(p.runs(Effect::Colour));
  EXPECT_TRUE(p.runs(Effect::Alpha));
  p = makePlan({"direct"}, f);
  EXPECT_FALSE(p.runs(Effect::Near));
  EXPECT_TRUE(p.runs(Effect::Colour));
}

Contribution worth(double bound, double object) {
  Contribution c;
  c.known = true;
  c.bound = bound;
  c.object = object;
  return c;
}

TEST(Plan, ConvexRoomsWithTheirLampsInsideNeedNoShadows) {
  Facts f = room();
  f.shape = Shape::SeenFromInside;
  EXPECT_TRUE(makePlan({"auto"}, f).runs(Effect::Shadow)) << "a lamp may be outside";
  f.lampsInFront = true;
  EXPECT_FALSE(makePlan({"auto"}, f).runs(Effect::Shadow));
  EXPECT_TRUE(makePlan({"auto"}, f).runs(Effect::Bounce));
  EXPECT_TRUE(makePlan({"+shadow"}, f).runs(Effect::Shadow)) << "whoever asks gets it";
}

TEST(Plan, OnePlaneOrOneSolidSeesNothingOfItself) {
  for (const Shape shape : {Shape::Flat, Shape::SeenFromOutside}) {
    Facts f = room();
    f.shape = shape;
    const Plan p = makePlan({"auto"}, f);
    EXPECT_TRUE(p.runs(Effect::Direct));
    for (const Effect e : {Effect::Shadow, Effect::Bounce, Effect::Ao}) EXPECT_FALSE(p.runs(e)) << kEffectNames[std::size_t(e)];
  }
}

TEST(Plan, LeavesOutTheWeakestUntilAQuarterOfTheGoalIsUsed) {
  Facts f = room();
  f.sky = true;
  f.emissiveTriangles = 2;
  f.pilot.emplace();
  f.pilot->effects[std::size_t(Effect::Direct)] = worth(1.0, 1.0);
  f.pilot->effects[std::size_t(Effect::Sky)] = worth(0.003, 0.004);
  f.pilot->effects[std::size_t(Effect::Area)] = worth(0.001, 0.002);
  f.pilot->effects[std::size_t(Effect::Bounce)] = worth(0.0015, 0.003);
  const Plan p = makePlan({"auto", 0.02}, f);  // 0.005 to spare
  EXPECT_FALSE(p.runs(Effect::Area));
  EXPECT_FALSE(p.runs(Effect::Bounce));
  EXPECT_TRUE(p.runs(Effect::Sky)) << "0.0055 with the two weaker ones";
  EXPECT_TRUE(p.runs(Effect::Direct));
  EXPECT_DOUBLE_EQ(p.leftOut, 0.0025);
  EXPECT_DOUBLE_EQ(p.leftOutObject, 0.005);
  EXPECT_FALSE(makePlan({"auto", 0.08}, f).runs(Effect::Sky)) << "a coarser goal has room for it";
  const Plan asked = makePlan({"+area", 0.02}, f);
  EXPECT_TRUE(asked.runs(Effect::Area)) << "asked for";
  EXPECT_FALSE(asked.runs(Effect::Sky)) << "now there is room: 0.0045";
  EXPECT_DOUBLE_EQ(asked.leftOut, 0.0045);
}

TEST(Plan, KeepsWhatOneObjectLivesBy) {
  Facts f = room();
  f.pilot.emplace();
  f.pilot->effects[std::size_t(Effect::Bounce)] = worth(0.001, 0.02);  // limit of an object: a quarter of three goals
  EXPECT_TRUE(makePlan({"auto", 0.02}, f).runs(Effect::Bounce));
  f.pilot->effects[std::size_t(Effect::Bounce)] = worth(0.001, 0.0149);
  EXPECT_FALSE(makePlan({"auto", 0.02}, f).runs(Effect::Bounce));
}

TEST(Plan, WhatIsPartOfTheBouncesCountsOnce) {
  Facts f = room();
  f.pilot.emplace();
  f.pilot->effects[std::size_t(Effect::Bounce)] = worth(0.004, 0.004);
  f.pilot->effects[std::size_t(Effect::Near)] = worth(0.002, 0.002);
  Plan p = makePlan({"auto", 0.02}, f);  // 0.005 to spare
  EXPECT_FALSE(p.runs(Effect::Bounce));
  EXPECT_FALSE(p.runs(Effect::Near));
  EXPECT_DOUBLE_EQ(p.leftOut, 0.004);
  f.pilot->effects[std::size_t(Effect::Bounce)] = worth(0.4, 0.4);
  p = makePlan({"auto", 0.02}, f);
  EXPECT_TRUE(p.runs(Effect::Bounce));
  EXPECT_FALSE(p.runs(Effect::Near));
  EXPECT_DOUBLE_EQ(p.leftOut, 0.002);
}

TEST(Plan, ForetellsTheStagesThatRun) {
  Facts f = room();
  Pilot& p = f.pilot.emplace();
  p.direct = {1e6, 1.0, 0.9, 1.2};
  p.gather = {4e6, 3.0, 2.6, 3.6};
  p.patches = p.solve = {};
  p.occlude = {8e6, 2.0, 1.7, 2.3};
  const Plan whole = makePlan({"-seams"}, f), direct = makePlan({"direct,shadow"}, f);
  EXPECT_DOUBLE_EQ(forecastOf(whole, p).cpu_s, 6.0);
  EXPECT_DOUBLE_EQ(forecastOf(whole, p).rays, 13e6);
  EXPECT_DOUBLE_EQ(forecastOf(whole, p).least_s, 6.0 - std::sqrt(0.1 * 0.1 + 0.4 * 0.4 + 0.3 * 0.3));
  EXPECT_DOUBLE_EQ(forecastOf(direct, p).cpu_s, 1.0);
  EXPECT_EQ(costOf(Effect::Shadow, direct, p).with, Effect::Direct);
}

}  // namespace
}  // namespace lmc
