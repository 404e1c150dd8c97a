#pragma once
/// The tables behind gltf_check.h: what lmc reads of a level and what each member must be. Private to libscene.
#include <cstdint>
#include <limits>
#include <numbers>
#include <span>
#include <string_view>

#include "libscene/gltf_read.h"

namespace lmc::rules {

inline constexpr double kInf = std::numeric_limits<double>::infinity();
inline constexpr double kMaxInt = 2147483647.0;          // tinygltf keeps indices and counts in an int
inline constexpr double kMaxBytes = 9007199254740992.0;  // 2^53: sums of two such numbers cannot overflow 64 bits
inline constexpr double kMaxColor = 1.001;               // exporters write 1.0000001; anything more makes light from nothing

enum class Is { Index, Integer, Number, Text, Flag, Numbers, Indices, Texts, Object, Array };

/// One member of an object. Tables of these say what lmc reads; everything else in a file is left alone.
struct Rule {
  std::string_view key;
  Is is;
  std::string_view code = "LMC_JSON_SCHEMA";  ///< for a wrong type, length or range
  bool required = false;
  double low = -kInf, high = kInf;   ///< Integer, Number, each of Numbers
  std::size_t length = 0;            ///< of Numbers
  std::string_view of = {};          ///< Index, Indices: array of the file that they point into
  std::span<const Rule> rules = {};  ///< Object; each object of an Array
};

inline constexpr std::string_view kLightCode = "LMC_LIGHT_INTENSITY";
inline constexpr std::string_view kSpotCode = "LMC_SPOT_ANGLES";
inline constexpr double kHalfPi = std::numbers::pi / 2 + 1e-6;  // single precision pi/2 lies above it

inline constexpr Rule kTransformRules[] = {
    {.key = "offset", .is = Is::Numbers, .low = -1e6, .high = 1e6, .length = 2},
    {.key = "rotation", .is = Is::Number},
    {.key = "scale", .is = Is::Numbers, .low = -1e6, .high = 1e6, .length = 2},
    {.key = "texCoord", .is = Is::Integer, .low = 0, .high = kMaxInt},
};
inline constexpr Rule kTextureInfoExtensions[] = {{.key = "KHR_texture_transform", .is = Is::Object, .rules = kTransformRules}};
inline constexpr Rule kTextureInfoRules[] = {
    {.key = "index", .is = Is::Index, .required = true, .of = "textures"},
    {.key = "texCoord", .is = Is::Integer, .low = 0, .high = kMaxInt},
    {.key = "extensions", .is = Is::Object, .rules = kTextureInfoExtensions},
};
inline constexpr Rule kPbrRules[] = {
    {.key = "baseColorFactor", .is = Is::Numbers, .code = "LMC_ALBEDO_RANGE", .low = 0, .high = kMaxColor, .length = 4},
    {.key = "baseColorTexture", .is = Is::Object, .rules = kTextureInfoRules},
    {.key = "metallicFactor", .is = Is::Number, .code = "LMC_MATERIAL_RANGE", .low = 0, .high = kMaxColor},
    {.key = "metallicRoughnessTexture", .is = Is::Object, .rules = kTextureInfoRules},
};
inline constexpr Rule kEmissiveStrengthRules[] = {{.key = "emissiveStrength", .is = Is::Number, .code = "LMC_EMISSIVE_RANGE", .low = 0}};
inline constexpr Rule kTransmissionRules[] = {{.key = "transmissionFactor", .is = Is::Number, .code = "LMC_MATERIAL_RANGE", .low = 0}};
inline constexpr Rule kSpecularRules[] = {
    {.key = "specularFactor", .is = Is::Number, .code = "LMC_MATERIAL_RANGE", .low = 0, .high = kMaxColor},
    {.key = "specularTexture", .is = Is::Object, .rules = kTextureInfoRules},
    {.key = "specularColorFactor", .is = Is::Numbers, .code = "LMC_MATERIAL_RANGE", .low = 0, .length = 3},
    {.key = "specularColorTexture", .is = Is::Object, .rules = kTextureInfoRules},
};
inline constexpr Rule kMaterialExtensions[] = {
    {.key = "KHR_materials_emissive_strength", .is = Is::Object, .code = "LMC_EMISSIVE_RANGE", .rules = kEmissiveStrengthRules},
    {.key = "KHR_materials_specular", .is = Is::Object, .rules = kSpecularRules},
    {.key = "KHR_materials_transmission", .is = Is::Object, .rules = kTransmissionRules},
};
inline constexpr Rule kMaterialRules[] = {
    {.key = "name", .is = Is::Text},
    {.key = "pbrMetallicRoughness", .is = Is::Object, .rules = kPbrRules},
    {.key = "normalTexture", .is = Is::Object, .rules = kTextureInfoRules},
    {.key = "occlusionTexture", .is = Is::Object, .rules = kTextureInfoRules},
    {.key = "emissiveTexture", .is = Is::Object, .rules = kTextureInfoRules},
    {.key = "emissiveFactor", .is = Is::Numbers, .code = "LMC_EMISSIVE_RANGE", .low = 0, .length = 3},
    {.key = "alphaMode", .is = Is::Text},
    {.key = "alphaCutoff", .is = Is::Number, .code = "LMC_MATERIAL_RANGE", .low = 0},
    {.key = "doubleSided", .is = Is::Flag},
    {.key = "extensions", .is = Is::Object, .rules = kMaterialExtensions},
};
inline constexpr Rule kSparseIndicesRules[] = {
    {.key = "bufferView", .is = Is::Index, .required = true, .of = "bufferViews"},
    {.key = "byteOffset", .is = Is::Integer, .low = 0, .high = kMaxInt},
    {.key = "componentType", .is = Is::Integer, .code = "LMC_ACCESSOR_TYPE", .required = true},
};
inline constexpr Rule kSparseValuesRules[] = {
    {.key = "bufferView", .is = Is::Index, .required = true, .of = "bufferViews"},
    {.key = "byteOffset", .is = Is::Integer, .low = 0, .high = kMaxInt},
};
inline constexpr Rule kSparseRules[] = {
    {.key = "count", .is = Is::Integer, .required = true, .low = 1, .high = kMaxInt},
    {.key = "indices", .is = Is::Object, .required = true, .rules = kSparseIndicesRules},
    {.key = "values", .is = Is::Object, .required = true, .rules = kSparseValuesRules},
};
inline constexpr Rule kAccessorRules[] = {
    {.key = "bufferView", .is = Is::Index, .of = "bufferViews"},
    {.key = "byteOffset", .is = Is::Integer, .low = 0, .high = kMaxBytes},
    {.key = "componentType", .is = Is::Integer, .code = "LMC_ACCESSOR_TYPE", .required = true},
    {.key = "normalized", .is = Is::Flag},
    {.key = "count", .is = Is::Integer, .required = true, .low = 1},
    {.key = "type", .is = Is::Text, .code = "LMC_ACCESSOR_TYPE", .required = true},
    {.key = "sparse", .is = Is::Object, .rules = kSparseRules},
};
inline constexpr Rule kViewRules[] = {
    {.key = "buffer", .is = Is::Index, .required = true, .of = "buffers"},
    {.key = "byteOffset", .is = Is::Integer, .code = "LMC_BUFFER_VIEW", .low = 0, .high = kMaxBytes},
    {.key = "byteLength", .is = Is::Integer, .code = "LMC_BUFFER_VIEW", .required = true, .low = 1, .high = kMaxBytes},
    {.key = "byteStride", .is = Is::Integer, .code = "LMC_STRIDE", .low = 4, .high = 252},
};
inline constexpr Rule kBufferRules[] = {
    {.key = "byteLength", .is = Is::Integer, .code = "LMC_BUFFER_LENGTH", .required = true, .low = 1, .high = kMaxBytes},
    {.key = "uri", .is = Is::Text, .code = "LMC_URI"},
};
inline constexpr Rule kImageRules[] = {
    {.key = "uri", .is = Is::Text, .code = "LMC_URI"},
    {.key = "bufferView", .is = Is::Index, .of = "bufferViews"},
    {.key = "mimeType", .is = Is::Text},
};
inline constexpr Rule kTextureRules[] = {{.key = "source", .is = Is::Index, .of = "images"},
                                         {.key = "sampler", .is = Is::Index, .of = "samplers"}};
inline constexpr Rule kSamplerRules[] = {
    {.key = "magFilter", .is = Is::Integer}, {.key = "wrapS", .is = Is::Integer}, {.key = "wrapT", .is = Is::Integer}};
inline constexpr Rule kPrimitiveRules[] = {
    {.key = "attributes", .is = Is::Object, .required = true},
    {.key = "indices", .is = Is::Index, .of = "accessors"},
    {.key = "material", .is = Is::Index, .of = "materials"},
    {.key = "mode", .is = Is::Integer, .code = "LMC_MODE_BAD", .low = 0, .high = 6},
    {.key = "targets", .is = Is::Array},
};
inline constexpr Rule kMeshRules[] = {{.key = "name", .is = Is::Text},
                                      {.key = "primitives", .is = Is::Array, .required = true, .rules = kPrimitiveRules}};
inline constexpr Rule kNodeLightRules[] = {
    {.key = "light", .is = Is::Index, .required = true, .of = "/extensions/KHR_lights_punctual/lights"}};
inline constexpr Rule kInstancingAttributes[] = {
    {.key = "TRANSLATION", .is = Is::Index, .of = "accessors"},
    {.key = "ROTATION", .is = Is::Index, .of = "accessors"},
    {.key = "SCALE", .is = Is::Index, .of = "accessors"},
};
inline constexpr Rule kInstancingRules[] = {{.key = "attributes", .is = Is::Object, .required = true, .rules = kInstancingAttributes}};
inline constexpr Rule kVisibilityRules[] = {{.key = "visible", .is = Is::Flag}};
inline constexpr Rule kNodeExtensions[] = {
    {.key = "KHR_lights_punctual", .is = Is::Object, .rules = kNodeLightRules},
    {.key = "EXT_mesh_gpu_instancing", .is = Is::Object, .rules = kInstancingRules},
    {.key = "KHR_node_visibility", .is = Is::Object, .rules = kVisibilityRules},
};
inline constexpr Rule kNodeRules[] = {
    {.key = "name", .is = Is::Text},
    {.key = "children", .is = Is::Indices, .of = "nodes"},
    {.key = "mesh", .is = Is::Index, .of = "meshes"},
    {.key = "skin", .is = Is::Index, .of = "skins"},
    {.key = "camera", .is = Is::Index, .of = "cameras"},
    {.key = "matrix", .is = Is::Numbers, .length = 16},
    {.key = "translation", .is = Is::Numbers, .length = 3},
    {.key = "rotation", .is = Is::Numbers, .length = 4},
    {.key = "scale", .is = Is::Numbers, .length = 3},
    {.key = "extensions", .is = Is::Object, .rules = kNodeExtensions},
};
inline constexpr Rule kSkyRules[] = {{.key = "radiance", .is = Is::Numbers, .low = 0, .high = kMaxLight, .length = 3}};
inline constexpr Rule kLightmapRules[] = {
    {.key = "resolution", .is = Is::Integer, .low = 1, .high = 1 << 20},
    {.key = "texels_per_metre", .is = Is::Number, .low = 0},
};
inline constexpr Rule kSceneLmcRules[] = {
    {.key = "sky", .is = Is::Object, .rules = kSkyRules},
    {.key = "ambient", .is = Is::Numbers, .low = 0, .high = kMaxLight, .length = 3},
    {.key = "lightmap", .is = Is::Object, .rules = kLightmapRules},
};
inline constexpr Rule kNodeLmcRules[] = {
    {.key = "static", .is = Is::Flag},
    {.key = "receive", .is = Is::Flag},
    {.key = "cast", .is = Is::Flag},
    {.key = "texelsPerMetre", .is = Is::Number, .low = 0},
};
inline constexpr Rule kAttenuationRules[] = {
    {.key = "constant", .is = Is::Number, .low = 0},  {.key = "linear", .is = Is::Number, .low = 0},
    {.key = "quadratic", .is = Is::Number, .low = 0}, {.key = "range", .is = Is::Number, .code = "LMC_LIGHT_RANGE", .low = 0},
    {.key = "power", .is = Is::Number, .low = 0},
};
inline constexpr Rule kMaterialLmcRules[] = {
    {.key = "specularTexture", .is = Is::Object, .rules = kTextureInfoRules},
    {.key = "objectSpaceNormals", .is = Is::Flag},
};
inline constexpr Rule kLightLmcRules[] = {
    {.key = "model", .is = Is::Text},
    {.key = "ambient", .is = Is::Numbers, .code = "LMC_LIGHT_COLOR", .low = 0, .length = 3},
    {.key = "diffuse", .is = Is::Numbers, .code = "LMC_LIGHT_COLOR", .low = 0, .length = 3},
    {.key = "specular", .is = Is::Numbers, .code = "LMC_LIGHT_COLOR", .low = 0, .length = 3},
    {.key = "specularIntensity", .is = Is::Number, .low = 0},
    {.key = "specularPower", .is = Is::Number, .low = 0},
    {.key = "attenuation", .is = Is::Object, .rules = kAttenuationRules},
};
inline constexpr Rule kSceneRules[] = {{.key = "nodes", .is = Is::Indices, .of = "nodes"}};
inline constexpr Rule kSpotRules[] = {
    {.key = "innerConeAngle", .is = Is::Number, .code = kSpotCode, .low = 0, .high = kHalfPi},
    {.key = "outerConeAngle", .is = Is::Number, .code = kSpotCode, .low = 0, .high = kHalfPi},
};
inline constexpr Rule kLightRules[] = {
    {.key = "type", .is = Is::Text, .code = "LMC_LIGHT_TYPE", .required = true},
    {.key = "name", .is = Is::Text},
    {.key = "color", .is = Is::Numbers, .code = "LMC_LIGHT_COLOR", .low = 0, .length = 3},
    {.key = "intensity", .is = Is::Number, .code = kLightCode, .low = 0},
    {.key = "range", .is = Is::Number, .code = "LMC_LIGHT_RANGE", .low = 0},
    {.key = "spot", .is = Is::Object, .code = kSpotCode, .rules = kSpotRules},
};
inline constexpr Rule kLightsRules[] = {{.key = "lights", .is = Is::Array, .required = true, .rules = kLightRules}};
inline constexpr Rule kRootExtensions[] = {{.key = "KHR_lights_punctual", .is = Is::Object, .rules = kLightsRules}};
inline constexpr Rule kPerspectiveRules[] = {{.key = "yfov", .is = Is::Number, .required = true, .low = 0},
                                             {.key = "znear", .is = Is::Number, .required = true}};
inline constexpr Rule kCameraRules[] = {
    {.key = "name", .is = Is::Text},
    {.key = "type", .is = Is::Text, .required = true},
    {.key = "perspective", .is = Is::Object, .rules = kPerspectiveRules},
    {.key = "orthographic", .is = Is::Object},
};
inline constexpr Rule kAssetRules[] = {
    {.key = "version", .is = Is::Text, .code = "LMC_VERSION", .required = true},
    {.key = "minVersion", .is = Is::Text, .code = "LMC_VERSION"},
};
inline constexpr Rule kRootRules[] = {
    {.key = "asset", .is = Is::Object, .code = "LMC_VERSION", .required = true, .rules = kAssetRules},
    {.key = "extensionsUsed", .is = Is::Texts},
    {.key = "extensionsRequired", .is = Is::Texts},
    {.key = "scene", .is = Is::Index, .of = "scenes"},
    {.key = "scenes", .is = Is::Array, .rules = kSceneRules},
    {.key = "nodes", .is = Is::Array, .rules = kNodeRules},
    {.key = "meshes", .is = Is::Array, .rules = kMeshRules},
    {.key = "accessors", .is = Is::Array, .rules = kAccessorRules},
    {.key = "bufferViews", .is = Is::Array, .rules = kViewRules},
    {.key = "buffers", .is = Is::Array, .rules = kBufferRules},
    {.key = "materials", .is = Is::Array, .rules = kMaterialRules},
    {.key = "textures", .is = Is::Array, .rules = kTextureRules},
    {.key = "images", .is = Is::Array, .rules = kImageRules},
    {.key = "samplers", .is = Is::Array, .rules = kSamplerRules},
    {.key = "cameras", .is = Is::Array, .rules = kCameraRules},
    {.key = "skins", .is = Is::Array},
    {.key = "animations", .is = Is::Array},
    {.key = "extensions", .is = Is::Object, .rules = kRootExtensions},
};

/// What becomes of a file that requires an extension.
struct KnownExtension {
  std::string_view name;
  enum class Use { Read, NotDiffuse, Refused } use;
  std::string_view words = {};
};
using Use = KnownExtension::Use;

inline constexpr KnownExtension kExtensions[] = {
    {"KHR_lights_punctual", Use::Read},
    {"KHR_texture_transform", Use::Read},
    {"KHR_materials_emissive_strength", Use::Read},
    {"KHR_materials_transmission", Use::Read},
    {"KHR_mesh_quantization", Use::Read},
    {"EXT_mesh_gpu_instancing", Use::Read},
    {"KHR_node_visibility", Use::Read},
    {"KHR_materials_anisotropy", Use::NotDiffuse},
    {"KHR_materials_clearcoat", Use::NotDiffuse},
    {"KHR_materials_dispersion", Use::NotDiffuse},
    {"KHR_materials_ior", Use::NotDiffuse},
    {"KHR_materials_iridescence", Use::NotDiffuse},
    {"KHR_materials_sheen", Use::NotDiffuse},
    {"KHR_materials_specular", Use::NotDiffuse},
    {"KHR_materials_unlit", Use::NotDiffuse},
    {"KHR_materials_variants", Use::NotDiffuse},
    {"KHR_materials_volume", Use::NotDiffuse},
    {"KHR_animation_pointer", Use::NotDiffuse},
    {"KHR_node_hoverability", Use::NotDiffuse},
    {"KHR_node_selectability", Use::NotDiffuse},
    {"KHR_xmp", Use::NotDiffuse},
    {"KHR_xmp_json_ld", Use::NotDiffuse},
    {"KHR_draco_mesh_compression", Use::Refused, "its meshes are Draco-compressed; decompress them first (gltf-transform copy)"},
    {"EXT_meshopt_compression", Use::Refused, "its buffers are meshopt-compressed; decompress them first (gltf-transform copy)"},
    {"KHR_texture_basisu", Use::Refused, "its textures are Basis-compressed (KTX2); lmc reads PNG and JPEG"},
    {"EXT_texture_webp", Use::Refused, "its textures are WebP; lmc reads PNG and JPEG"},
    {"EXT_texture_avif", Use::Refused, "its textures are AVIF; lmc reads PNG and JPEG"},
    {"MSFT_texture_dds", Use::Refused, "its textures are DDS; lmc reads PNG and JPEG"},
};

struct ElementType {
  std::string_view name;
  int columns, rows;
};
inline constexpr ElementType kTypes[] = {{"SCALAR", 1, 1}, {"VEC2", 1, 2}, {"VEC3", 1, 3}, {"VEC4", 1, 4},
                                         {"MAT2", 2, 2},   {"MAT3", 3, 3}, {"MAT4", 4, 4}};

/// Which component types an attribute may have; with KHR_mesh_quantization more. Bits: 1 signed byte, 2 byte, 4 short,
/// 8 unsigned short, 16 unsigned int, 32 float.
struct AttributeRule {
  std::string_view name, types;
  unsigned components, quantized;
};
inline constexpr AttributeRule kAttributes[] = {
    {"POSITION", "VEC3", 32, 32 | 15},        {"NORMAL", "VEC3", 32, 32 | 5},           {"TANGENT", "VEC4", 32, 32 | 5},
    {"TEXCOORD_0", "VEC2", 32 | 10, 32 | 15}, {"TEXCOORD_1", "VEC2", 32 | 10, 32 | 15}, {"COLOR_0", "VEC3 VEC4", 32 | 10, 32 | 10},
};

}  // namespace lmc::rules
