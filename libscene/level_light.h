#pragma once
/// KHR_lights_punctual, cameras and what extras.lmc of a scene says. Private to libscene.
#include <glm/glm.hpp>

#include "libscene/gltf_read.h"
#include "libscene/scene.h"
#include "libscene/shading.h"

namespace lmc {

/// The light /extensions/KHR_lights_punctual/lights/`light` at a node; Light::path is left to the caller.
Light readLight(const GltfFile& file, std::size_t light, const glm::dmat4& world, const std::string& nodeWhere, const Run& run);

/// The same with what of a classic light is not baked: ambient, specular. `baked` is left to the caller.
ShadedLight readShadedLight(const GltfFile& file, std::size_t index, const Light& light);

/// A perspective camera, or nothing.
std::optional<Camera> readCamera(const tinygltf::Camera& from, const glm::dmat4& world);

/// extras.lmc of the scene object: sky, ambient, lightmap.
void readSceneExtras(const Json& sceneJson, Scene& scene);

/// The object extras.lmc of a glTF object, or null.
const Json* lmcExtras(const Json& object);

}  // namespace lmc
