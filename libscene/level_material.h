#pragma once
/// Materials with their textures and pictures. Private to libscene.
#include <vector>

#include "libscene/gltf_read.h"
#include "libscene/scene.h"

namespace lmc {

/// One entry a material of the file, and a last one for primitives that name none. Texture::image is still an index into the
/// file's images; decodeImages() turns it into one of Scene::images.
std::vector<Material> readMaterials(const GltfFile& file, const tinygltf::Model& model, const Run& run);

/// Decodes what the materials with used[i] need for diffuse light, each picture once.
std::vector<Image<glm::u8vec4>> decodeImages(GltfFile& file, std::vector<Material>& materials, const std::vector<bool>& used,
                                             const LoadLimits& limits, const Run& run);

/// The texture slots of a material that decide about diffuse light, with their names in glTF.
struct TextureSlot {
  const char* pointer;
  Texture Material::*texture;
};
extern const TextureSlot kTextureSlots[3];

}  // namespace lmc
