#pragma once
/// Reference vectors of tangents, .tspace: a mesh, and what the reference gives for each corner. Little-endian: "TSPACE01", u32 number of
/// arrays, u32 0, then for each array 16 bytes of name, u32 type (0 float32, 1 uint32, 2 uint8), components, count, offset of the data.
#include <filesystem>
#include <vector>

#include "libtangent/tangent.h"

namespace lmc {

struct TangentVectors {
  std::vector<glm::vec3> positions, normals;  ///< per vertex
  std::vector<glm::vec2> uvs;                 ///< per vertex
  std::vector<std::uint32_t> indices;         ///< per corner
  std::vector<std::uint8_t> faceSizes;        ///< per face; empty = all triangles
  std::vector<glm::vec4> tangents;            ///< per corner: the reference's, w = its sign
  std::vector<std::uint8_t> ambiguity;        ///< per corner: 0-8 must agree in bits, 9 reference not finite, 10 either of two values

  tangent::Surface surface() const { return {positions, normals, uvs, indices, faceSizes}; }
};

/// Throws Error Io, or Broken with the array's name where something does not fit.
TangentVectors readTangentVectors(const std::filesystem::path& file);

}  // namespace lmc
