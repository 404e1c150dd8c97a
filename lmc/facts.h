#pragma once
/// What a plan is made from: what a level holds, counted without a ray, and what a pilot of few rays tells of its light.
#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "libscene/scene.h"

namespace lmc {

enum class Effect { Direct, Shadow, Area, Sky, Bounce, Ao, Bent, Tangents, Seams, Rims, Near, Colour, Alpha, Specular, ScreenAo };
inline constexpr const char* kEffectNames[] = {"direct", "shadow", "area", "sky",    "bounce", "ao",       "bent",     "tangents",
                                               "seams",  "rims",   "near", "colour", "alpha",  "specular", "screen-ao"};
inline constexpr std::size_t kEffects = std::size(kEffectNames);

/// Light, or a map; the others are ways in which these are simulated, or what a renderer is to do.
constexpr bool isSimulated(Effect e) { return e <= Effect::Bent || e == Effect::Seams || e == Effect::Rims; }
/// Follows from what else runs, and from the level: a list of effects does not speak of it.
constexpr bool isManner(Effect e) { return e >= Effect::Near; }

/// Whether all that receives or blocks light lies on one side of every surface that blocks it. Then no surface hides a lamp from another.
enum class Shape {
  Any,
  SeenFromInside,   ///< in front of every surface: an empty room, walls in a corner
  SeenFromOutside,  ///< behind every surface: a single solid without hollows
  Flat              ///< both: one plane
};

/// What leaving an effect out changes in the map, light that it would send on by bounces included. Upper bounds of the relative RMS.
struct Contribution {
  bool known = false;
  double share = 0.0;      ///< of the level's mean illuminance, as the pilot saw it; lamps and emitters as if nothing blocked them
  double bound = 0.0;      ///< relative to the level's mean
  double object = 0.0;     ///< largest over objects, each against max(its own mean, 1 % of the level's)
  std::string objectPath;  ///< whose
};

struct Forecast {
  double rays = 0.0, cpu_s = 0.0;
  double least_s = 0.0, most_s = 0.0;  ///< nine of ten bakes lie between
};

/// What a lamp can do.
struct LampFact {
  std::string path;
  double texels = 0.0;  ///< share of the covered ones that it would light if nothing blocked it
  double bound = 0.0;   ///< relative RMS over the level if nothing blocked it
};

/// Of few rays: the light on coarse patches, two places on every texel, hemisphere rays at some of them.
struct Pilot {
  double mean_lx = 0.0;
  std::array<Contribution, kEffects> effects;
  std::vector<LampFact> lamps;
  double openShare = 0.0;   ///< of rays from surfaces, those that leave the level
  double meanAlbedo = 0.0;  ///< by area
  int bounces = 0;          ///< passes until what is left is negligible
  Forecast direct, patches, solve, gather, audit, occlude, seams, rims, rest;
  double rays = 0.0, cpu_s = 0.0;  ///< spent on it
};

/// What a level calls for, gathered without a ray.
struct Facts {
  std::uint32_t pointLights = 0, spotLights = 0, directionalLights = 0;  ///< that give light
  std::uint32_t darkLights = 0;                                          ///< of intensity 0
  std::uint32_t rangedLights = 0;                                        ///< that reach no farther than their range
  std::uint32_t dynamicLights = 0, dynamicMeshes = 0;                    ///< left to run time
  std::uint32_t emissiveTriangles = 0;
  double emissiveArea_m2 = 0.0, emissivePower_lm = 0.0;  ///< power: largest channel
  bool sky = false;
  bool grey = true;                    ///< lights, sky and surfaces are without colour
  std::uint32_t receivers = 0;         ///< objects with a place in the light map
  std::uint32_t blockers = 0;          ///< triangles that cast shadows
  std::uint32_t maskedTriangles = 0;   ///< of them, those with holes
  std::uint32_t maskedMaterials = 0;   ///< of alphaMode MASK
  std::uint32_t holedMaterials = 0;    ///< of them, those whose alpha is anywhere below the cut-off
  std::uint32_t mirroredObjects = 0;   ///< whose node turns them inside out
  std::uint32_t tangentMaterials = 0;  ///< that call for tangents
  std::uint32_t shinyMaterials = 0;    ///< that a renderer gives highlights
  bool ambient = false;                ///< a renderer may add ambient light, which is all that its occlusion darkens
  float largestReflectance = 0.0f;     ///< over materials, all channels
  Shape shape = Shape::Any;
  bool lampsInFront = false;  ///< every lamp lies in front of every surface
  /// Edges of charts that meet on smooth surfaces; not known before all light-map UVs are there.
  std::optional<std::uint64_t> smoothSeams{};
  std::optional<Pilot> pilot{};
  bool lit() const { return pointLights + spotLights + directionalLights + emissiveTriangles > 0 || sky; }
};
Facts factsOf(const Scene&);

}  // namespace lmc
