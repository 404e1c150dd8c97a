#pragma once
/// Materials with their textures and pictures. Private to libscene.
#include <array>
#include <vector>

#include "libscene/gltf_read.h"
#include "libscene/scene.h"
#include "libscene/shading.h"

namespace lmc {

/// One entry a material of the file, and a last one for primitives that name none. Texture::image is still an index into the
/// file's images; decodeImages() turns it into one of Scene::images.
std::vector<Material> readMaterials(const GltfFile& file, const tinygltf::Model& model, const Run& run);

/// One a material of readMaterials(), in its order.
std::vector<Look> readLooks(const GltfFile& file, const tinygltf::Model& model, const Run& run);

/// Decodes the pictures of these textures, each once, in their order; the textures then point at what comes back.
std::vector<Image<glm::u8vec4>> decodeImages(GltfFile& file, const std::vector<Texture*>& textures, const LoadLimits& limits,
                                             const Run& run);

/// The texture slots of a material that decide about diffuse light, with their names in glTF.
struct TextureSlot {
  const char* pointer;
  Texture Material::*texture;
};
extern const TextureSlot kTextureSlots[3];

/// Those that a renderer wants beside them.
inline constexpr std::array<Texture Look::*, 4> kLookTextures{&Look::normalTexture, &Look::occlusionTexture, &Look::specularTexture,
                                                              &Look::roughnessTexture};

}  // namespace lmc
