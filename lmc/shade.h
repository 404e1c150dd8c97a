#pragma once
#include "libscene/error.h"
#include "lmc/options.h"

namespace lmc {

/// A picture of a baked level: albedo * E/pi + emission through a camera, E bilinear from the light map, tone mapped to sRGB.
Exit shade(const ShadeOptions&);

}  // namespace lmc
