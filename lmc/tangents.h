#pragma once
/// `lmc tangents`: TANGENT for the primitives of a glTF file whose materials call for it.
#include <array>
#include <string>
#include <vector>

#include "libscene/error.h"
#include "libscene/gltf_edit.h"
#include "libscene/run.h"
#include "libtangent/tangent.h"
#include "lmc/options.h"

namespace lmc {

/// What became of a primitive.
struct PrimitiveTangents {
  std::uint32_t mesh = 0, primitive = 0;
  std::string result;  ///< "computed", "kept" or "skipped"
  std::string why;     ///< of what is not computed; for kept ones what is wrong with them, if anything
  std::string uvs;     ///< "TEXCOORD_0", or "TEXCOORD_0 transformed"
  std::size_t verticesBefore = 0, verticesAfter = 0;
  std::array<std::size_t, tangent::kMendCount> mended{};  ///< corners, by tangent::Mend
  tangent::Counts counts;
};

/// Computes in safe mode from the UVs of the material's normal texture (with KHR_texture_transform, where that turns, mirrors or stretches
/// them), splits vertices whose corners differ, and writes TANGENT and extras.lmc.tangents into the primitive. A node's mirroring is not in
/// it: tangents are in the mesh's space, as glTF has them. Throws Error.
std::vector<PrimitiveTangents> addTangents(GltfEdit&, const TangentOptions&, const Run&);

/// For the sidecar: how many primitives were computed, kept and skipped, how many corners mended, where green points.
nlohmann::ordered_json summaryOf(const std::vector<PrimitiveTangents>&);

/// The verb: reads, adds, writes one GLB, reports on stdout.
Exit tangents(const TangentsOptions&);

}  // namespace lmc
