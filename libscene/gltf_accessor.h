#pragma once
/// Elements of accessors as plain arrays, whatever their component type, stride or sparseness. Private to libscene.
/// Ranges have been checked by gltf_check.h; only values are left to judge.
#include <cstdint>
#include <vector>

#include "libscene/gltf_read.h"

namespace lmc {

/// 1 for SCALAR, 3 for VEC3, 16 for MAT4.
int componentCount(const tinygltf::Accessor& accessor);

/// componentCount() values an element; normalised integers are mapped as the glTF specification says (section 3.11).
std::vector<float> readFloats(const GltfFile& file, const tinygltf::Model& model, int accessor);

/// Unsigned integers of a SCALAR accessor.
std::vector<std::uint32_t> readIndices(const GltfFile& file, const tinygltf::Model& model, int accessor);

/// The same as they are stored, integers not mapped.
std::vector<double> readNumbers(const GltfFile& file, const tinygltf::Model& model, int accessor);

/// Elements one behind the other as they are stored, sparse ones put in their places.
std::vector<std::uint8_t> readBytes(const GltfFile& file, const tinygltf::Model& model, int accessor);

/// Indices of all primitives and sparse accessors, whether a scene shows them or not: in range, and no restart values.
void checkIndexValues(const GltfFile& file, const tinygltf::Model& model);

}  // namespace lmc
