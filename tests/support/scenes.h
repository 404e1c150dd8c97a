#pragma once
/// Small levels made in code.
#include "libscene/scene_builder.h"

namespace lmc::test {

using lmc::furnace;
using lmc::SceneBuilder;

inline Light pointLight(glm::dvec3 position_m, float intensity_cd) {
  Light l;
  l.path = "/lamp";
  l.position_m = position_m;
  l.intensity = Rgb(intensity_cd);
  return l;
}

/// A room with an emitter, a lamp and a shelf, scaled and moved. Light is scaled so that E stays as it is.
inline Scene litRoom(float scale = 1.0f, glm::vec3 at = glm::vec3(0.0f), int cuts = 1) {
  SceneBuilder s;
  const auto white = s.material(Rgb(0.7f)), red = s.material(Rgb(0.6f, 0.1f, 0.1f)), lamp = s.material(Rgb(0.0f), Rgb(2.0f));
  s.room(at, at + scale * glm::vec3(3, 2.5f, 4), {white, red, white, white, white, white}, cuts);
  s.quad(at + scale * glm::vec3(1, 2.4f, 1), scale * glm::vec3(1, 0, 0), scale * glm::vec3(0, 0, 1), lamp, cuts);
  s.quad(at + scale * glm::vec3(0.5f, 0.8f, 2), scale * glm::vec3(1, 0, 0), scale * glm::vec3(0, 0, -1), white, cuts);
  s.scene.lights.push_back(pointLight(glm::dvec3(at) + double(scale) * glm::dvec3(2.2, 1.5, 3.1), 3.0f * scale * scale));
  return s.scene;
}

}  // namespace lmc::test
