#pragma once
/// A glTF primitive as an indexed triangle list in its own space. Private to libscene.
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <limits>
#include <vector>

#include "libscene/gltf_read.h"

namespace lmc {

/// All vertex arrays are empty or have one entry a vertex.
struct Part {
  std::vector<glm::vec3> positions, normals;
  std::vector<glm::vec2> uv0, uv1, mapUv;
  std::vector<glm::vec4> colors, tangents;
  std::vector<glm::uvec3> triangles;
  std::vector<std::uint32_t> source;  ///< the vertex of the primitive that each is a copy of; empty = they are the primitive's own
};

/// A triangle with less has no area in single precision and is left out.
inline constexpr double kMinTwiceArea = std::numeric_limits<float>::min();

/// What a primitive will hold, known without reading its values.
bool hasTriangles(const tinygltf::Primitive& primitive);  ///< mode, and POSITION is there
std::uint64_t triangleCount(const tinygltf::Model& model, const tinygltf::Primitive& primitive);

/// Strips, fans and lists, indexed or not, as vertices of the primitive; those without area too. The primitive must have triangles.
std::vector<glm::uvec3> readTriangles(const GltfFile& file, const tinygltf::Model& model, const tinygltf::Primitive& primitive);

struct PartReport {
  std::uint64_t degenerate = 0;      ///< triangles without area, left out
  std::uint64_t normalsOpposite = 0;  ///< away from every face at the vertex, made from them
  std::uint64_t normalsRebuilt = 0;  ///< zero or not finite, made from the faces at the vertex
  std::uint64_t normalsNotUnit = 0;  ///< length off by more than a tenth
};

/// Which attributes of a primitive are wanted beside those that every level needs.
struct PartWish {
  std::uint32_t mapSet = 1;  ///< TEXCOORD_n of the map UVs
  bool tangents = false;
};

/// Strips, fans and lists, indexed or not. Where normals are missing each triangle gets corners of its own
/// and the normal of its face, and no tangents. Normals are unit. Throws Error for values that no level can mean: not finite, index out of
/// range.
Part readPart(const GltfFile& file, const tinygltf::Model& model, std::size_t mesh, std::size_t primitive, const PartWish& wish,
              PartReport& report);

/// A transform as glTF names its parts.
struct Trs {
  glm::dvec3 translation{0.0};
  glm::dquat rotation{1.0, 0.0, 0.0, 0.0};  ///< as stored: not of length 1 by need
  glm::dvec3 scale{1.0};
  glm::dmat4 matrix() const;
};

/// EXT_mesh_gpu_instancing of a node: its instances relative to the node; empty where it has none.
std::vector<Trs> readInstances(const GltfFile& file, const tinygltf::Model& model, std::size_t node);

/// The lowest n >= 1 for which no texture of the primitive's materials samples TEXCOORD_n.
std::uint32_t freeTexCoord(const Json& gltf, const Json& primitive);

}  // namespace lmc
