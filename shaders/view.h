#pragma once
/// What both renderers, the GLSL one (reference.h) and the one in C++ (oracle.h), are given and what they give back.
#include <array>
#include <optional>
#include <string_view>
#include <vector>

#include "libscene/image.h"
#include "libscene/shading.h"

namespace lmc::shaders {

/// What a bake left: a picture for each map of the level; both empty for a level that was not baked.
struct LevelMaps {
  std::vector<Image<Rgb>> illuminance;  ///< E [lx]
  std::vector<float> scales;            ///< that the files have: E = texel * scale; empty = 1
  std::vector<Image<float>> openness;   ///< cosine-weighted; empty = that of the materials' occlusionTexture
  double scale(std::size_t map) const { return scales.empty() ? 1.0 : double(scales[map]); }
};

/// What can be looked at.
enum class Target : std::uint8_t {
  Diffuse,       ///< albedo; a: openness
  Specular,      ///< specular colour; a: power
  Normal,        ///< world normal as a colour; a: 1 where there is a surface
  Depth,         ///< x: along the camera's axis [m], 0 where there is no surface
  Baked,         ///< E of the light map [lx]; a: 1 where there is one
  Emission,      ///< [cd/m^2]
  ScreenAo,      ///< x: openness by screen space; 1 where it was not asked for
  AmbientLight,  ///< light as a white surface shows it
  DiffuseLight,  ///< the same, with the light map's E/pi
  SpecularLight,
  Radiance,  ///< surface times light [cd/m^2]
  Picture,   ///< exposed, tone mapped, encoded
};
inline constexpr std::array<std::string_view, 12> kTargetNames{"diffuse",       "specular",       "normal",    "depth",
                                                               "lightmap",      "emission",       "screen-ao", "ambient",
                                                               "diffuse-light", "specular-light", "radiance",  "final"};

enum class ToneCurve { None, Reinhard };

/// One picture.
struct View {
  Camera camera;
  int width = 640, height = 360;
  double exposure = 0.0;  ///< factor on radiance; 0 = from the picture
  ToneCurve toneCurve = ToneCurve::None;
  bool encode = true;  ///< sRGB in [0, 1]; else linear as it is

  bool lightMap = true;   ///< false: all lights are drawn by the passes, as in a level that was not baked
  bool bakedAo = true;    ///< of the map, else of the material
  bool screenAo = false;  ///< screen-space ambient occlusion, too
  bool normalMaps = true;

  // What is drawn: for a look at one pass alone.
  bool plainSurfaces = true, bumpySurfaces = true;  ///< without and with a normal map
  bool ambient = true, lightMapPass = true, directional = true, point = true, spot = true;
  std::optional<Target> only;  ///< the reference gives back this target and the radiance alone, which saves memory
  bool volumes = true;         ///< false: every light over the whole screen, so that nothing hides what its formula does far away
};

/// Rows from the top.
struct Frame {
  int width = 0, height = 0;
  double exposure = 1.0;  ///< that the picture has
  int lightsDrawn = 0;    ///< by the passes
  std::array<Image<glm::vec4>, kTargetNames.size()> targets;
  Image<glm::vec4>& operator[](Target t) { return targets[std::size_t(t)]; }
  const Image<glm::vec4>& operator[](Target t) const { return targets[std::size_t(t)]; }
};

/// A factor for which nearly all of the picture is darker than display white.
double exposureFor(const Image<glm::vec4>& radiance);

/// Nothing of the level that the camera can see is nearer [m].
double nearPlane_m(const Scene&, const Camera&);

/// Radius of screen-space ambient occlusion for this level [m].
double screenAoRadius_m(const Scene&);

/// Rooms, whose faces look inwards, are seen from within, things from outside.
Camera automaticCamera(const Scene&);
/// At `eye_m`, looking at `target_m`, +Y up; recentred coordinates.
Camera cameraAt(const glm::dvec3& eye_m, const glm::dvec3& target_m, double verticalFov_rad);

/// The inverse transpose, up to a positive factor; finite where that is not.
glm::dmat3 normalMatrix(const glm::dmat4& world);

/// The object has a place in a map, there is that map, and the view wants it.
inline bool hasMap(const ShadingLevel& level, const LevelMaps& maps, const View& view, std::size_t object) {
  return view.lightMap && level.marked[object] && level.scene.objects[object].map < maps.illuminance.size();
}
inline bool hasOpenness(const ShadingLevel& level, const LevelMaps& maps, std::size_t object) {
  return level.marked[object] && level.scene.objects[object].map < maps.openness.size();
}
/// Whether the pass with normal maps draws the object.
inline bool hasNormalMap(const ShadingLevel& level, const View& view, std::size_t object) {
  const Object& o = level.scene.objects[object];
  const Look& look = level.looks[o.material];
  return view.normalMaps && look.normalTexture && (look.objectSpaceNormals || level.tangents[o.firstVertex] != glm::vec4(0.0f));
}

/// There is light that openness darkens.
bool hasAmbient(const ShadingLevel&);

/// The light maps hold all of the light that there is, and no surface shines: its pass would add nothing.
bool addsNothing(const ShadingLevel&, const LevelMaps&, const View&, const ShadedLight&);

/// Surfaces that a deferred renderer draws: opaque ones and those with holes.
inline bool isDrawn(const ShadingLevel& level, const View& view, std::size_t object) {
  const Material& m = level.scene.materials[level.scene.objects[object].material];
  return m.opaqueToLight() && (hasNormalMap(level, view, object) ? view.bumpySurfaces : view.plainSurfaces);
}

}  // namespace lmc::shaders
