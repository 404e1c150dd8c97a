#pragma once
/// The stages of a bake on a scene made in code.
#include "lmc/bake_scene.h"

namespace lmc::test {

using lmc::Baked;
using lmc::bakeScene;
using lmc::BakeSceneOptions;

}  // namespace lmc::test
