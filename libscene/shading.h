#pragma once
/// The level for a renderer: a Scene, and beside it what a bake has no use for. Made by loadForShading (level.h).
#include <vector>

#include "libscene/scene.h"

namespace lmc {

/// What a material looks like beside its diffuse light.
struct Look {
  Texture normalTexture;  ///< linear; a colour c is the normal 2c - 1, green along V against the stored one (up)
  float normalScale = 1.0f;
  bool objectSpaceNormals = false;  ///< extras.lmc.objectSpaceNormals
  Texture occlusionTexture;         ///< linear; openness in red
  float occlusionStrength = 1.0f;
  Texture specularTexture;      ///< sRGB: extras.lmc.specularTexture, else specularColorTexture of KHR_materials_specular
  Rgb specular{0.04f};          ///< factor of it, where the surface is no metal
  bool dullByRoughness = true;  ///< false: the specular map of extras.lmc says all
  Texture roughnessTexture;     ///< linear; roughness in green, metallic in blue
  float roughness = 1.0f;       ///< factor
};

/// A light as a renderer draws it. `light` holds its diffuse part.
struct ShadedLight {
  Light light;
  bool baked = false;  ///< extras.lmc.baked: where there is a light map, only its specular part is left to draw
  Rgb ambient{0.0f};   ///< classic lights only; the unit of the diffuse colour
  Rgb specular{0.0f};  ///< the unit of light.intensity
  double specularIntensity = 1.0;
  double specularPower = 0.0;  ///< 0 = that of the material
};

struct ShadingLevel {
  Scene scene;                                  ///< with dynamic meshes, at rest, among its objects; its lights are the static ones
  std::vector<glm::vec3> positions_m, normals;  ///< of scene.positions_m, in the space of their mesh
  std::vector<glm::vec4> tangents;              ///< in that space too; w = determinant, 0 where the file has none
  std::vector<glm::dmat4> worlds;               ///< of each object: from its mesh to the recentred world
  std::vector<std::uint8_t> marked;             ///< of each object: extras.lmc.lightmap gives it a place in a map
  std::vector<Look> looks;                      ///< of each material
  std::vector<ShadedLight> lights;              ///< static and dynamic ones
};

}  // namespace lmc
