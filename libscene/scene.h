#pragma once
/// The level as plain values: metres, right-handed, +Y up, linear Rec. 709. Made by loadLevel (level.h), never changed after.
#include <array>
#include <cstdint>
#include <filesystem>
#include <glm/glm.hpp>
#include <glm/gtc/type_precision.hpp>
#include <optional>
#include <string>
#include <vector>

#include "libscene/image.h"

namespace lmc {

using Rgb = glm::vec3;  ///< linear Rec. 709; the unit is said where it is used

inline constexpr std::uint32_t kNone = 0xffffffffu;

enum class Wrap : std::uint8_t { Repeat, Mirror, Clamp };

/// One use of an image by a material: image, sampler and KHR_texture_transform together.
struct Texture {
  std::uint32_t image = kNone;  ///< into Scene::images; kNone = no texture
  std::uint8_t uvSet = 0;       ///< 0 or 1: Scene::uv0 or Scene::uv1
  Wrap wrapU = Wrap::Repeat, wrapV = Wrap::Repeat;
  bool nearest = false;       ///< magnification filter NEAREST
  glm::mat3 transform{1.0f};  ///< uv' = transform * (u, v, 1)
  explicit operator bool() const { return image != kNone; }
};

struct Material {
  enum class Alpha : std::uint8_t { Opaque, Mask, Blend };
  std::string name;
  glm::vec4 baseColor{1.0f};  ///< factor, [0, 1]
  Texture baseColorTexture;   ///< sRGB colour, alpha
  float metallic = 1.0f;      ///< factor; diffuse reflectance = base colour * (1 - metallic)
  Texture metallicTexture;    ///< linear; metallic in blue
  Rgb emission{0.0f};         ///< emissiveFactor * emissiveStrength [cd/m^2]
  Texture emissionTexture;    ///< sRGB
  Alpha alpha = Alpha::Opaque;
  float alphaCutoff = 0.5f;
  bool doubleSided = false;
  bool wantsTangents = false;  ///< it has a normal map, or something else that lies in tangent space
  bool shines = true;          ///< a renderer gives it highlights: a metal, or smoother than roughness 1
  bool transmissive = false;   ///< KHR_materials_transmission: as Blend, casts no shadow and reflects nothing
  bool opaqueToLight() const { return alpha != Alpha::Blend && !transmissive; }
};

/// Classic attenuation a(d) = 1/(constant + linear d + quadratic d^2) * saturate(1 - (d/range)^power), design.md section 1.
struct ClassicAttenuation {
  double constant = 1.0, linear = 0.0, quadratic = 0.0;
  double range = 0.0;  ///< [m]; 0 = no window
  double power = 2.0;
};

struct Light {
  enum class Kind : std::uint8_t { Point, Spot, Directional } kind = Kind::Point;
  std::string path;                      ///< its node's path, "/hall/lamp[3]": the address of its random numbers
  std::uint32_t node = 0;                ///< glTF index of it
  glm::dvec3 position_m{0.0};            ///< recentred, as Scene::positions
  glm::dvec3 direction{0.0, 0.0, -1.0};  ///< unit; the way its light travels
  Rgb intensity{0.0f};                   ///< color * intensity: point and spot [cd], directional [lx]; classic: see below
  double range_m = 0.0;                  ///< 0 = endless
  double cosInner = 1.0, cosOuter = 0.70710678118654752440;  ///< spot only
  std::optional<ClassicAttenuation> classic;  ///< E = pi * intensity * a(d) * n.l when set (intensity holds the classic diffuse colour)
};

/// One primitive of one node (or of one instance of it): what a light map is for.
struct Object {
  std::string name;                                               ///< of the node, else of the mesh, else "node 3"
  std::string path;                                               ///< unique: node names from the root, "/hall/column[2]"
  std::uint32_t node = 0, mesh = 0, primitive = 0, instance = 0;  ///< glTF indices, for messages and outputs
  std::uint32_t firstTriangle = 0, triangleCount = 0;
  std::uint32_t firstVertex = 0, vertexCount = 0;
  std::uint32_t material = 0;
  bool mirrored = false;           ///< its node turns it inside out: triangles are wound the other way than in the file
  bool receive = true;             ///< has a place in the light map
  bool cast = true;                ///< blocks light and reflects it
  bool inMap = false;              ///< its vertices have map UVs
  std::uint32_t map = 0;           ///< in which of the level's maps it lies
  std::uint32_t texCoord = 1;      ///< TEXCOORD_n that holds its map UVs
  std::uint32_t freeTexCoord = 1;  ///< TEXCOORD_n that new ones may have: no texture samples it
  double texelsPerMetre = 0.0;     ///< extras.lmc.texelsPerMetre; 0 = not said
};

struct Camera {
  std::string name;
  glm::dvec3 position_m{0.0};  ///< recentred
  glm::dmat3 axes{1.0};        ///< columns right, up, back
  double verticalFov_rad = 0.8;
};

struct Scene {
  std::filesystem::path file;                 ///< as the user named it
  std::vector<std::filesystem::path> inputs;  ///< every file read: the level, its buffers, its images
  std::uint64_t content = 0;                  ///< hash of their bytes as they were read
  glm::dvec3 centre_m{0.0};                   ///< added to a position gives the level's own coordinates
  float extent_m = 0.0f;                      ///< largest absolute recentred coordinate

  // Vertices, world space, recentred. All arrays but colors have one entry a vertex.
  std::vector<glm::vec3> positions_m;
  std::vector<glm::vec3> normals;           ///< unit; made from the faces where the file has none
  std::vector<glm::vec2> uv0, uv1;          ///< of textures, zero where the file has none; uv1 is empty when no texture uses it
  std::vector<glm::vec2> mapUv;             ///< place in the object's light map, [0, 1]; TEXCOORD_1 until unwrap.h makes others
  std::vector<std::uint32_t> sourceVertex;  ///< index in the vertices of its glTF primitive
  std::vector<glm::vec4> colors;            ///< COLOR_0, linear; empty when no mesh has it

  std::vector<glm::uvec3> triangles;  ///< static geometry only; wound so that the front is counter-clockwise (mirrored nodes flipped)
  std::vector<std::uint32_t> triangleObject;
  std::vector<Object> objects;  ///< triangles of an object are contiguous

  std::vector<Material> materials;
  std::vector<Image<glm::u8vec4>> images;                 ///< 8 bit as stored: colour sRGB, alpha linear
  std::vector<Light> lights;                              ///< baked ones only
  std::uint32_t dynamicLights = 0, dynamicMeshNodes = 0;  ///< seen and left to run time
  Rgb sky{0.0f};                                          ///< radiance of every direction that leaves the level [cd/m^2]
  Rgb ambient{0.0f};                                      ///< extras.lmc.ambient, for the shader alone
  bool grey = false;                                      ///< surfaces are taken by their luminance: reflectanceAt, emissionAt
  std::vector<Camera> cameras;
  int mapResolution = 0;        ///< scene extras.lmc.lightmap.resolution; 0 = not said
  double texelsPerMetre = 0.0;  ///< scene extras.lmc.lightmap.texels_per_metre; 0 = not said

  /// Place of a vertex in the maps, which lie one below the other, `side` texels each [texels].
  glm::dvec2 mapPlace(const Object& object, std::uint32_t vertex, int side) const {
    return double(side) * (glm::dvec2(mapUv[vertex]) + glm::dvec2(0.0, object.map));
  }
  const Object& objectOf(std::uint32_t triangle) const { return objects[triangleObject[triangle]]; }
  const Material& materialOf(std::uint32_t triangle) const { return materials[objectOf(triangle).material]; }
  std::array<glm::dvec3, 3> corners_m(std::uint32_t triangle) const {
    const glm::uvec3 t = triangles[triangle];
    return {glm::dvec3(positions_m[t.x]), glm::dvec3(positions_m[t.y]), glm::dvec3(positions_m[t.z])};
  }
};

}  // namespace lmc
