/// Direct light of whole texels against closed forms.
#include <gtest/gtest.h>

#include "libradiosity/form_factor.h"
#include "libscene/constants.h"
#include "tests/support/bake_scene.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

using test::bakeScene;
using test::SceneBuilder;

Light pointLight(glm::dvec3 at, float candela) {
  Light l;
  l.path = "/lamp";
  l.position_m = at;
  l.intensity = Rgb(candela);
  return l;
}

/// Value at the texel that holds this place of the quad (0..1 along u and v); cells of a 4 x 4 layout with margins of a tenth.
Rgb at(const test::Baked& b, std::uint32_t object, double u, double v) {
  const double cell = 0.25, margin = 0.025;
  const int x = int((double(object % 4) * cell + margin + (cell - 2 * margin) * u) * b.map.width),
            y = int((double(object / 4) * cell + margin + (cell - 2 * margin) * v) * b.map.height);
  return b.values.direct[std::size_t(y) * std::size_t(b.map.width) + std::size_t(x)];
}

/// Centre of the texel that holds u, of n along the quad.
double centre(double u, int n) { return (std::floor(u * n) + 0.5) / n; }

TEST(DirectLight, TexelMeanUnderAPointLight) {
  SceneBuilder s;
  const auto m = s.material(Rgb(0.0f));
  s.quad({-1, 0, 1}, {2, 0, 0}, {0, 0, -2}, m);
  s.scene.lights.push_back(pointLight({0, 1, 0}, 10.0f));
  const test::Baked b = bakeScene(s.scene, {.side = 80, .goal = 0.01, .bounce = false});
  // 16 texels of 1/8 m along the quad; exact mean of I h/(x^2 + z^2 + h^2)^1.5 over a texel that begins at the middle:
  // the closed form of the integral is atan(x z/(h sqrt(x^2 + z^2 + h^2))).
  const double a = 0.125, exact = 10.0 * std::atan(a * a / std::sqrt(2 * a * a + 1.0)) / (a * a);
  EXPECT_NEAR(at(b, 0, 0.5 + 1e-4, 0.5 + 1e-4).x, exact, 2e-3 * exact);
}

TEST(DirectLight, UnoccludedEmitterIsTheClosedFormWithoutNoise) {
  SceneBuilder s;
  const auto black = s.material(Rgb(0.0f)), lamp = s.material(Rgb(0.0f), Rgb(3.0f, 2.0f, 1.0f));
  s.quad({-1, 0, 1}, {2, 0, 0}, {0, 0, -2}, black);
  s.quad({-0.5f, 2, -0.5f}, {1, 0, 0}, {0, 0, 1}, lamp);  // faces down
  const test::Baked b = bakeScene(s.scene, {.side = 320, .bounce = false});
  const Polygon3 panel{{-0.5, 2, -0.5}, {0.5, 2, -0.5}, {0.5, 2, 0.5}, {-0.5, 2, 0.5}};
  for (const double wish : {0.1, 0.5, 0.9}) {
    const double u = centre(wish, 64);
    const double exact = kPi * elementToPolygon({-1 + 2 * u, 0, 1 - 2 * u}, {0, 1, 0}, panel);
    const Rgb got = at(b, 0, u, u);
    EXPECT_NEAR(got.r, 3.0 * exact, 2e-3 * 3.0 * exact);  // 8 places of a texel of 1/64, E falling by up to 1.5 % across it: 1.5 % / 8
    EXPECT_NEAR(got.g / got.r, 2.0 / 3.0, 1e-6);
  }
  EXPECT_LT(b.ledger.noise, 1e-3);
}

TEST(DirectLight, PenumbraOfAHalfPlane) {
  // The lamp 1 x 1 at height 3, an edge at height 1 over x < 0: the place x sees the part of the lamp beyond the edge, exactly a smaller
  // rectangle.
  SceneBuilder s;
  const auto black = s.material(Rgb(0.0f)), lamp = s.material(Rgb(0.0f), Rgb(1.0f));
  s.quad({-1, 0, 1}, {2, 0, 0}, {0, 0, -2}, black);
  s.quad({-0.5f, 3, -0.5f}, {1, 0, 0}, {0, 0, 1}, lamp);
  s.quad({-50, 1, -50}, {50, 0, 0}, {0, 0, 100}, black);  // blocker, edge at x = 0
  s.scene.objects[2].receive = false;
  const test::Baked b = bakeScene(s.scene, {.side = 640, .goal = 0.01, .bounce = false});
  for (const double wish : {-0.2, -0.05, 0.05, 0.2}) {
    const double u = centre(0.5 + wish / 2.0, 128), x = 2.0 * u - 1.0;
    // From (x, 0) the edge (0, 1) projects to lamp height 3 at x + 3 (0 - x) = -2x: visible where lamp x > -2x.
    const double from = std::clamp(-2.0 * x, -0.5, 0.5);
    const Polygon3 seen{{from, 3, -0.5}, {0.5, 3, -0.5}, {0.5, 3, 0.5}, {from, 3, 0.5}};
    const double exact = kPi * elementToPolygon({x, 0, 0}, {0, 1, 0}, seen);
    // 256 places a texel: 0.5 % where 29 % is visible, four times that, and a little of the lamp where next to none of it is.
    EXPECT_NEAR(at(b, 0, u, 0.5).x, exact, 0.02 * exact + 1e-3) << x;
  }
}

TEST(DirectLight, SunEdgeInsideATexelIsItsShare) {
  // A wall's straight shadow covers 30 % of one column of texels.
  SceneBuilder s;
  const auto black = s.material(Rgb(0.0f));
  s.quad({0, 0, 0}, {1, 0, 0}, {0, 0, -1}, black);                             // 16 x 16 texels at side 80
  s.quad({-5, 1, 5}, {5.0f + 0.5f + 0.3f / 16.0f, 0, 0}, {0, 0, -10}, black);  // roof with its edge 0.3 texels into the ninth column
  s.scene.objects[1].receive = false;
  Light sun;
  sun.kind = Light::Kind::Directional;
  sun.path = "/sun";
  sun.direction = {0, -1, 0};
  sun.intensity = Rgb(2.0f);
  s.scene.lights.push_back(sun);
  const test::Baked b = bakeScene(s.scene, {.side = 80, .goal = 0.01, .bounce = false});
  EXPECT_NEAR(at(b, 0, 0.53, 0.5).x, 1.4, 0.02);
  EXPECT_EQ(at(b, 0, 0.40, 0.5).x, 0.0f);
  EXPECT_NEAR(at(b, 0, 0.70, 0.5).x, 2.0, 1e-6);
}

TEST(Sky, OpenPlaneSeesAllOfItExactly) {
  SceneBuilder s;
  s.quad({-1, 0, 1}, {2, 0, 0}, {0, 0, -2}, s.material(Rgb(0.5f)));
  s.scene.sky = Rgb(1.0f, 0.5f, 0.25f);
  const test::Baked b = bakeScene(s.scene, {.side = 64});
  for (std::size_t i = 0; i < b.map.size(); ++i)
    if (b.map.chart[i] != kNone) {
      EXPECT_NEAR(b.values.direct[i].r, kPi, 1e-5);
      EXPECT_NEAR(b.values.direct[i].b, kPi / 4, 1e-5);
      EXPECT_EQ(b.values.indirect[i].r, 0.0f);
    }
}

TEST(Sky, WallHidesItsShare) {
  // A wall of height h at distance a, endless: openness = 1 - (1 - cos(atan(h/a)))/2, cosine-weighted.
  SceneBuilder s;
  const auto black = s.material(Rgb(0.0f));
  s.quad({-0.1f, 0, 0.1f}, {0.2f, 0, 0}, {0, 0, -0.2f}, black);
  s.quad({-200, -0.5f, -1}, {400, 0, 0}, {0, 2.5f, 0}, black);  // faces +z, top at 2, distance 1
  s.scene.objects[1].receive = false;
  s.scene.sky = Rgb(1.0f);
  const test::Baked b = bakeScene(s.scene, {.side = 32, .goal = 0.005, .bounce = false});
  const double exact = kPi * (1.0 - 0.5 * (1.0 - 1.0 / std::sqrt(5.0)));
  EXPECT_NEAR(b.mean(0).x, exact, 0.01 * exact);
  EXPECT_LT(b.ledger.bound95, 0.02);
}

/// A floor under a large red lamp and a small blue one, with a screen between floor and blue lamp.
Scene colouredLamps(Rgb red, Rgb blue) {
  SceneBuilder s;
  const auto black = s.material(Rgb(0.0f));
  s.quad({-2, 0, 2}, {4, 0, 0}, {0, 0, -4}, black);
  s.quad({-2, 2, -2}, {3, 0, 0}, {0, 0, 4}, s.material(Rgb(0.0f), red));
  s.quad({1.5f, 2, -0.1f}, {0.2f, 0, 0}, {0, 0, 0.2f}, s.material(Rgb(0.0f), blue));
  s.quad({1, 1, -1}, {1, 0, 0}, {0, 0, 1}, black);
  s.scene.objects[3].receive = false;
  return s.scene;
}

TEST(DirectLight, LampsOfDifferentColoursAddUp) {
  // A small blue lamp beside a large red one once lost a third of its light: no ray of a texel chose it.
  const Rgb red(5.0f, 0.0f, 0.0f), blue(0.0f, 0.0f, 3.0f);
  const test::Baked both = bakeScene(colouredLamps(red, blue), {.bounce = false}),
                    one = bakeScene(colouredLamps(red, Rgb(0.0f)), {.bounce = false}),
                    other = bakeScene(colouredLamps(Rgb(0.0f), blue), {.bounce = false});
  EXPECT_NEAR(both.mean(0).x, one.mean(0).x, 5e-3 * one.mean(0).x);
  EXPECT_NEAR(both.mean(0).z, other.mean(0).z, 5e-3 * other.mean(0).z);
  EXPECT_GT(other.mean(0).z, 0.0);
}

TEST(DirectLight, ALampDoesNotLightItself) {
  // Tilted, double-sided: its own back lies in its plane, and rounding puts half of its texels before it.
  SceneBuilder s;
  const auto lamp = s.material(Rgb(0.0f), Rgb(10.0f));
  s.scene.materials[lamp].doubleSided = true;
  s.quad({0.1f, 1, 0.2f}, {0.9f, 0.3f, 0.1f}, {0.2f, 0.3f, -0.8f}, lamp);
  s.quad({-2, 0, 2}, {4, 0, 0}, {0, 0, -4}, s.material(Rgb(0.0f)));
  const test::Baked b = bakeScene(s.scene, {.side = 128, .bounce = false});
  EXPECT_EQ(b.mean(0), glm::dvec3(0.0));
  EXPECT_GT(b.mean(1).x, 0.1);
}

TEST(DirectLight, HolesOfAnEmitterAreDark) {
  const auto lit = [](bool holes) {
    SceneBuilder s;
    const auto lamp = s.material(Rgb(0.0f), Rgb(10.0f));
    if (holes) {
      Image<glm::u8vec4> picture(2, 1);
      picture.at(0, 0) = {255, 255, 255, 255};
      picture.at(1, 0) = {255, 255, 255, 0};
      s.scene.images.push_back(picture);
      s.scene.materials[lamp].alpha = Material::Alpha::Mask;
      s.scene.materials[lamp].baseColorTexture.image = 0;
      s.scene.materials[lamp].baseColorTexture.nearest = true;
    }
    s.quad({-0.5f, 2, -0.5f}, {1, 0, 0}, {0, 0, 1}, lamp);
    s.quad({-0.5f, 0, 0.5f}, {1, 0, 0}, {0, 0, -1}, s.material(Rgb(0.0f)));
    return bakeScene(s.scene, {.bounce = false});
  };
  const test::Baked whole = lit(false), half = lit(true);
  EXPECT_NEAR(half.mean(1).x, 0.5 * whole.mean(1).x, 0.005 * whole.mean(1).x);
  EXPECT_LT(half.ledger.noise, 0.01);
}

TEST(DirectLight, ALampInASurfaceShines) {
  SceneBuilder s;
  const auto black = s.material(Rgb(0.0f));
  s.room({-1, 0, -1}, {1, 2, 1}, {black, black, black, black, black, black});
  s.scene.lights.push_back(pointLight({0.3, 2.0, 0.1}, 10.0f));  // in the plane of the ceiling
  EXPECT_GT(bakeScene(s.scene, {.bounce = false}).mean(2).x, 1.0);
}

}  // namespace
}  // namespace lmc
