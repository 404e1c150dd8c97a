#include "libscene/level_material.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "libscene/image_file.h"

namespace lmc {
namespace {

Wrap wrapOf(int gltf) {
  switch (gltf) {
    case TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE:
      return Wrap::Clamp;
    case TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT:
      return Wrap::Mirror;
    default:
      return Wrap::Repeat;
  }
}

/// KHR_texture_transform: uv' = T(offset) R(rotation) S(scale) uv, with the rotation as its specification writes it.
glm::mat3 transformOf(const Json& transform) {
  const auto pair = [&](const char* key, double fallback) {
    const Json* values = member(transform, key);
    return values ? glm::dvec2((*values)[0].get<double>(), (*values)[1].get<double>()) : glm::dvec2(fallback);
  };
  const glm::dvec2 offset = pair("offset", 0.0), scale = pair("scale", 1.0);
  const double angle_rad = transform.value("rotation", 0.0);
  const double c = std::cos(angle_rad), s = std::sin(angle_rad);
  const glm::dmat3 translation(1, 0, 0, 0, 1, 0, offset.x, offset.y, 1);
  const glm::dmat3 rotation(c, -s, 0, s, c, 0, 0, 0, 1);
  const glm::dmat3 scaling(scale.x, 0, 0, 0, scale.y, 0, 0, 0, 1);
  return glm::mat3(translation * rotation * scaling);
}

struct MaterialPlace {
  const GltfFile& file;
  const tinygltf::Model& model;
  const Run& run;
  std::string where;  ///< of the material
};

Texture readTexture(const MaterialPlace& place, int texture, int texCoord, const Json* info, const char* slot) {
  Texture out;
  if (texture < 0) return out;
  const tinygltf::Texture& from = place.model.textures[std::size_t(texture)];
  if (from.source < 0) {
    place.run.warn({.file = place.file.path.string(),
                    .where = place.where + slot,
                    .text = fmt::format("texture {} has no PNG or JPEG picture; it is left out", texture),
                    .code = "LMC_TEXTURE_TYPE"});
    return out;
  }
  out.image = std::uint32_t(from.source);
  if (from.sampler >= 0) {
    const tinygltf::Sampler& sampler = place.model.samplers[std::size_t(from.sampler)];
    out.wrapU = wrapOf(sampler.wrapS);
    out.wrapV = wrapOf(sampler.wrapT);
    out.nearest = sampler.magFilter == TINYGLTF_TEXTURE_FILTER_NEAREST;
  }
  if (const Json* transform = info ? extension(*info, "KHR_texture_transform") : nullptr) {
    out.transform = transformOf(*transform);
    texCoord = transform->value("texCoord", texCoord);
  }
  out.uvSet = std::uint8_t(std::min(texCoord, 255));  // above 1 is refused where a mesh uses it
  return out;
}

Rgb readEmission(const MaterialPlace& place, const tinygltf::Material& from, const Json& json) {
  glm::dvec3 emission(0.0);
  if (from.emissiveFactor.size() == 3) emission = {from.emissiveFactor[0], from.emissiveFactor[1], from.emissiveFactor[2]};
  if (std::max({emission.x, emission.y, emission.z}) > 1.0)
    place.run.warn({.file = place.file.path.string(),
                    .where = place.where + "/emissiveFactor",
                    .text = "is above 1, where KHR_materials_emissive_strength is meant; taken as it stands",
                    .code = "LMC_EMISSIVE_RANGE"});
  if (const Json* strength = extension(json, "KHR_materials_emissive_strength")) emission *= strength->value("emissiveStrength", 1.0);
  if (!(std::max({emission.x, emission.y, emission.z}) <= kMaxLight))
    throw Error(Exit::Broken, place.file.path, place.where, fmt::format("emits more than {:g} cd/m^2", kMaxLight), "LMC_EMISSIVE_RANGE");
  return Rgb(emission);
}

/// A normal map, a clearcoat's normal map or anisotropy.
bool wantsTangents(const Json& json) {
  const Json* clearcoat = extension(json, "KHR_materials_clearcoat");
  return json.contains("normalTexture") || (clearcoat && clearcoat->contains("clearcoatNormalTexture")) ||
         extension(json, "KHR_materials_anisotropy");
}

/// As readLook and the shaders have it: a dielectric's highlight, which roughness 1 takes away unless a map of its own says all.
bool shinesAsDielectric(const Json& json) {
  const Json *pbr = member(json, "pbrMetallicRoughness"), *extras = member(json, "extras"),
             *lmc = extras ? member(*extras, "lmc") : nullptr, *khr = extension(json, "KHR_materials_specular");
  if (khr && khr->value("specularFactor", 1.0) <= 0.0) return false;
  if (lmc && member(*lmc, "specularTexture")) return true;
  return pbr && (pbr->value("roughnessFactor", 1.0) < 1.0 || member(*pbr, "metallicRoughnessTexture"));
}

Material readMaterial(const MaterialPlace& place, const tinygltf::Material& from, const Json& json) {
  Material out;
  const auto& pbr = from.pbrMetallicRoughness;
  const Json* pbrJson = member(json, "pbrMetallicRoughness");
  const auto info = [](const Json* object, const char* key) { return object ? member(*object, key) : nullptr; };
  out.name = from.name;
  for (int c = 0; c < 4; ++c) out.baseColor[c] = float(std::min(pbr.baseColorFactor[std::size_t(c)], 1.0));
  out.baseColorTexture = readTexture(place, pbr.baseColorTexture.index, pbr.baseColorTexture.texCoord, info(pbrJson, "baseColorTexture"),
                                     "/pbrMetallicRoughness/baseColorTexture");
  out.metallic = float(std::min(pbr.metallicFactor, 1.0));
  if (out.metallic > 0.0f)
    out.metallicTexture = readTexture(place, pbr.metallicRoughnessTexture.index, pbr.metallicRoughnessTexture.texCoord,
                                      info(pbrJson, "metallicRoughnessTexture"), "/pbrMetallicRoughness/metallicRoughnessTexture");
  out.emission = readEmission(place, from, json);
  out.wantsTangents = wantsTangents(json);
  out.shines = out.metallic > 0.0f || shinesAsDielectric(json);
  if (out.emission != Rgb(0.0f))
    out.emissionTexture =
        readTexture(place, from.emissiveTexture.index, from.emissiveTexture.texCoord, info(&json, "emissiveTexture"), "/emissiveTexture");
  out.alpha = from.alphaMode == "MASK"    ? Material::Alpha::Mask
              : from.alphaMode == "BLEND" ? Material::Alpha::Blend
                                          : Material::Alpha::Opaque;
  out.alphaCutoff = float(from.alphaCutoff);
  out.doubleSided = from.doubleSided;
  if (const Json* transmission = extension(json, "KHR_materials_transmission"))
    out.transmissive = transmission->value("transmissionFactor", 0.0) > 0.0;
  return out;
}

Look readLook(const MaterialPlace& place, const Json& json) {
  Look out;
  const auto texture = [&](const Json* info, const char* slot) {
    return info ? readTexture(place, (*info)["index"].get<int>(), info->value("texCoord", 0), info, slot) : Texture{};
  };
  const Json *normal = member(json, "normalTexture"), *occlusion = member(json, "occlusionTexture");
  out.normalTexture = texture(normal, "/normalTexture");
  if (normal) out.normalScale = normal->value("scale", 1.0f);
  out.occlusionTexture = texture(occlusion, "/occlusionTexture");
  if (occlusion) out.occlusionStrength = occlusion->value("strength", 1.0f);
  if (const Json* pbr = member(json, "pbrMetallicRoughness")) {
    out.roughness = pbr->value("roughnessFactor", 1.0f);
    out.roughnessTexture = texture(member(*pbr, "metallicRoughnessTexture"), "/pbrMetallicRoughness/metallicRoughnessTexture");
  }
  const Json *extras = member(json, "extras"), *lmc = extras ? member(*extras, "lmc") : nullptr,
             *khr = extension(json, "KHR_materials_specular");
  const Json* own = lmc ? member(*lmc, "specularTexture") : nullptr;
  if (lmc) out.objectSpaceNormals = lmc->value("objectSpaceNormals", false);
  out.dullByRoughness = own == nullptr;
  if (khr) {
    out.specular *= khr->value("specularFactor", 1.0f);
    if (const Json* color = member(*khr, "specularColorFactor"))
      out.specular *= Rgb((*color)[0].get<float>(), (*color)[1].get<float>(), (*color)[2].get<float>());
  } else if (own) {
    out.specular = Rgb(1.0f);  // the map is what it shines with
  }
  out.specularTexture =
      own ? texture(own, "/extras/lmc/specularTexture")
          : texture(khr ? member(*khr, "specularColorTexture") : nullptr, "/extensions/KHR_materials_specular/specularColorTexture");
  return out;
}

}  // namespace

const TextureSlot kTextureSlots[3] = {{"/pbrMetallicRoughness/baseColorTexture", &Material::baseColorTexture},
                                      {"/pbrMetallicRoughness/metallicRoughnessTexture", &Material::metallicTexture},
                                      {"/emissiveTexture", &Material::emissionTexture}};

std::vector<Material> readMaterials(const GltfFile& file, const tinygltf::Model& model, const Run& run) {
  std::vector<Material> out;
  for (std::size_t i = 0; i < model.materials.size(); ++i)
    out.push_back(readMaterial({file, model, run, fmt::format("/materials/{}", i)}, model.materials[i], file.json["materials"][i]));
  out.emplace_back();
  return out;
}

std::vector<Look> readLooks(const GltfFile& file, const tinygltf::Model& model, const Run& run) {
  std::vector<Look> out;
  for (std::size_t i = 0; i < model.materials.size(); ++i)
    out.push_back(readLook({file, model, run, fmt::format("/materials/{}", i)}, file.json["materials"][i]));
  out.emplace_back();
  return out;
}

std::vector<Image<glm::u8vec4>> decodeImages(GltfFile& file, const std::vector<Texture*>& textures, const LoadLimits& limits,
                                             const Run& run) {
  std::vector<Image<glm::u8vec4>> images;
  std::vector<std::uint32_t> placeOf;
  const auto decoded = [&](std::uint32_t image) {
    if (placeOf.size() <= image) placeOf.resize(image + 1, kNone);
    if (placeOf[image] != kNone) return placeOf[image];
    const std::string where = fmt::format("/images/{}", image);
    const std::vector<std::uint8_t> bytes = imageBytes(file, image, limits);
    DecodedImage picture = decodeImage(bytes, limits.maxTexturePixels);
    if (picture.problem) throw Error(Exit::Broken, file.path, where, picture.problem->text, picture.problem->code);
    if (!picture.warning.empty())
      run.warn({.file = file.path.string(), .where = where, .text = picture.warning, .code = "LMC_TEXTURE_BAD"});
    const Json& json = file.json["images"][image];
    const bool isPng = bytes[0] == 0x89;
    if (const Json* type = member(json, "mimeType"); type && *type != (isPng ? "image/png" : "image/jpeg"))
      run.warn({.file = file.path.string(),
                .where = where + "/mimeType",
                .text = fmt::format("the picture is {}", isPng ? "a PNG" : "a JPEG"),
                .code = "LMC_TEXTURE_TYPE"});
    else if (!type && member(json, "bufferView"))
      run.warn({.file = file.path.string(), .where = where, .text = "has no mimeType", .code = "LMC_TEXTURE_TYPE"});
    images.push_back(std::move(picture.image));
    return placeOf[image] = std::uint32_t(images.size() - 1);
  };
  for (Texture* texture : textures)
    if (*texture) texture->image = decoded(texture->image);
  return images;
}

}  // namespace lmc
