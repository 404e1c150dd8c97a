#pragma once
/// The same pictures as the reference shader's, without GL: C++ in double precision, from the formulas (formulas.h).
#include "libscene/run.h"
#include "shaders/slips.h"
#include "shaders/view.h"

namespace lmc::shaders {

/// Does not depend on run.threads. With a slip, what a shader with that fault would draw.
Frame renderOracle(const ShadingLevel&, const LevelMaps&, const View&, const Run&, Slip = Slip::None);

/// The triangle that each pixel's centre sees; kNone where there is none.
Image<std::uint32_t> trianglesSeen(const ShadingLevel&, const View&);

}  // namespace lmc::shaders
