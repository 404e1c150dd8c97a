#pragma once
/// Which effects run, which do not, and why. Pure: no file is touched, so that every rule of leaving out has a test.
#include <optional>
#include <string>
#include <vector>

#include "libscene/scene.h"

namespace lmc {

/// What a level calls for, gathered without a ray.
struct Facts {
  std::uint32_t pointLights = 0, spotLights = 0, directionalLights = 0;  ///< that give light
  std::uint32_t darkLights = 0;                                          ///< of intensity 0
  std::uint32_t emissiveTriangles = 0;
  bool sky = false;
  std::uint32_t receivers = 0;         ///< objects with a place in the light map
  std::uint32_t blockers = 0;          ///< triangles that cast shadows
  float largestReflectance = 0.0f;     ///< over materials, all channels
  std::uint32_t tangentMaterials = 0;  ///< that call for tangents
  /// Edges of charts that meet on smooth surfaces; not known before all light-map UVs are there.
  std::optional<std::uint64_t> smoothSeams{};
  bool lit() const { return pointLights + spotLights + directionalLights + emissiveTriangles > 0 || sky; }
};
Facts factsOf(const Scene&);

enum class Effect { Direct, Shadow, Area, Sky, Bounce, Ao, Bent, Tangents, Seams };
inline constexpr const char* kEffectNames[] = {"direct", "shadow", "area", "sky", "bounce", "ao", "bent", "tangents", "seams"};

struct Step {
  Effect effect;
  bool run;
  std::string because;
  bool possible = true;  ///< it would do something if it were asked for
};
struct Plan {
  std::vector<Step> steps;
  bool runs(Effect e) const {
    for (const Step& s : steps)
      if (s.effect == e) return s.run;
    return false;
  }
  /// Whether anything is simulated: tangents need neither ray nor map.
  bool anything() const {
    for (const Step& s : steps)
      if (s.run && s.effect != Effect::Tangents) return true;
    return false;
  }
};

/// `effects`: "auto", a list (exactly these), or changes to auto ("+sky,-bounce"). Throws Error Usage for a name it does not know.
Plan makePlan(const std::string& effects, const Facts&);

}  // namespace lmc
