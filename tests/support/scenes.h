#pragma once
/// Small levels made in code.
#include "libscene/scene_builder.h"

namespace lmc::test {

using lmc::furnace;
using lmc::SceneBuilder;

}  // namespace lmc::test
