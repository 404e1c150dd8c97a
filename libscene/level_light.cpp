#include "libscene/level_light.h"

#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>

namespace lmc {
namespace {

constexpr double kMinAxis = 1e-150;  // below it the square of an axis' length is no number

glm::dvec3 rgb(const Json& object, const char* key, glm::dvec3 fallback) {
  const Json* values = member(object, key);
  return values ? glm::dvec3((*values)[0].get<double>(), (*values)[1].get<double>(), (*values)[2].get<double>()) : fallback;
}

ClassicAttenuation readAttenuation(const Json& lmc) {
  ClassicAttenuation out;
  const Json* from = member(lmc, "attenuation");
  if (!from) return out;
  out.range = from->value("range", 0.0);
  out.power = from->value("power", 2.0);
  const bool said = member(*from, "constant") || member(*from, "linear") || member(*from, "quadratic");
  if (out.range > 0.0 && !said) {
    out.linear = 2.0 / out.range;
    out.quadratic = 1.0 / (out.range * out.range);
    return out;
  }
  out.linear = from->value("linear", 0.0);
  out.quadratic = from->value("quadratic", 0.0);
  // Nobody who gives a linear or quadratic part alone wants the constant to be gone: 1 keeps the light finite at its place.
  out.constant = from->value("constant", 1.0);
  return out;
}

}  // namespace

const Json* lmcExtras(const Json& object) {
  const Json* extras = member(object, "extras");
  return extras ? member(*extras, "lmc") : nullptr;
}

Light readLight(const GltfFile& file, std::size_t light, const glm::dmat4& world, const std::string& nodeWhere, const Run& run) {
  const Json& json = file.json["extensions"]["KHR_lights_punctual"]["lights"][light];
  const auto where = [&](const char* key) { return fmt::format("/extensions/KHR_lights_punctual/lights/{}{}", light, key); };
  const auto warn = [&](const std::string& place, const char* text, const char* code) {
    run.warn({.file = file.path.string(), .where = place, .text = text, .code = code});
  };
  Light out;
  const auto& type = json["type"].get_ref<const std::string&>();
  out.kind = type == "spot" ? Light::Kind::Spot : type == "directional" ? Light::Kind::Directional : Light::Kind::Point;
  out.position_m = glm::dvec3(world[3]);
  const glm::dvec3 back(world[2]);
  if (const double length = glm::length(back); length > kMinAxis && std::isfinite(length)) {
    out.direction = -back / length;
  } else if (out.kind != Light::Kind::Point) {
    warn(nodeWhere, "the node's scale is 0, so its light has no direction; -Z is taken", "LMC_MATRIX_SINGULAR");
  }
  const glm::dvec3 color = rgb(json, "color", glm::dvec3(1.0));
  if (std::max({color.x, color.y, color.z}) > 1.0) warn(where("/color"), "is above 1; taken as it stands", "LMC_LIGHT_COLOR");
  const glm::dvec3 intensity = color * json.value("intensity", 1.0);
  out.range_m = json.value("range", 0.0);
  if (const Json* spot = member(json, "spot")) {
    const double inner_rad = spot->value("innerConeAngle", 0.0), outer_rad = spot->value("outerConeAngle", std::numbers::pi / 4);
    out.cosInner = std::cos(inner_rad);
    out.cosOuter = std::cos(outer_rad);
    if (inner_rad == outer_rad) warn(where("/spot"), "the inner cone is as wide as the outer: a hard edge", "LMC_SPOT_ANGLES");
  }
  out.intensity = Rgb(intensity);
  if (const Json* lmc = lmcExtras(json); lmc && lmc->value("model", std::string()) == "classic") {
    out.classic = readAttenuation(*lmc);
    out.intensity = Rgb(rgb(*lmc, "diffuse", intensity));
  }
  if (!(std::max({out.intensity.x, out.intensity.y, out.intensity.z}) <= kMaxLight))
    throw Error(Exit::Broken, file.path, where("/intensity"), fmt::format("is above {:g}", kMaxLight), "LMC_LIGHT_OVERFLOW");
  return out;
}

ShadedLight readShadedLight(const GltfFile& file, std::size_t index, const Light& light) {
  constexpr double kDefaultPower = 32.0;
  const Json& json = file.json["extensions"]["KHR_lights_punctual"]["lights"][index];
  ShadedLight out;
  out.light = light;
  out.specular = light.intensity;
  if (!light.classic) return out;
  const glm::dvec3 own = rgb(json, "color", glm::dvec3(1.0)) * json.value("intensity", 1.0);
  const Json& lmc = *lmcExtras(json);
  out.ambient = Rgb(rgb(lmc, "ambient", glm::dvec3(0.0)));
  out.specular = Rgb(rgb(lmc, "specular", own));
  out.specularIntensity = lmc.value("specularIntensity", 1.0);
  out.specularPower = lmc.value("specularPower", kDefaultPower);
  return out;
}

std::optional<Camera> readCamera(const tinygltf::Camera& from, const glm::dmat4& world) {
  if (from.type != "perspective") return std::nullopt;
  Camera out;
  out.name = from.name;
  out.position_m = glm::dvec3(world[3]);
  out.verticalFov_rad = from.perspective.yfov;
  for (int axis = 0; axis < 3; ++axis) {
    const double length = glm::length(glm::dvec3(world[axis]));
    if (length > kMinAxis && std::isfinite(length)) out.axes[axis] = glm::dvec3(world[axis]) / length;
  }
  return out;
}

void readSceneExtras(const Json& sceneJson, Scene& scene) {
  const Json* lmc = lmcExtras(sceneJson);
  if (!lmc) return;
  if (const Json* sky = member(*lmc, "sky")) scene.sky = Rgb(rgb(*sky, "radiance", glm::dvec3(0.0)));
  scene.ambient = Rgb(rgb(*lmc, "ambient", glm::dvec3(0.0)));
  if (const Json* lightmap = member(*lmc, "lightmap")) {
    scene.mapResolution = lightmap->value("resolution", 0);
    scene.texelsPerMetre = lightmap->value("texels_per_metre", 0.0);
  }
}

}  // namespace lmc
