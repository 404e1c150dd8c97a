#pragma once
/// A small level in which every formula of the deferred shader shows: what a check of somebody's shader is drawn on, beside his own level.
#include "shaders/view.h"

namespace lmc::shaders {

struct CheckScene {
  ShadingLevel level;
  LevelMaps maps;
  View view;
};

/// Balls with normal maps (plain, mirrored UVs, mirrored node, object space), balls under scales that differ by axis, a floor with light
/// map, AO map and specular map, a double-sided panel seen from behind, a panel with holes; lights of each kind and model, baked and
/// dynamic.
CheckScene checkScene();

}  // namespace lmc::shaders
