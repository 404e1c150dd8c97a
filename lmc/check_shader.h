#pragma once
#include "libscene/error.h"
#include "lmc/options.h"

namespace lmc {

/// Own shaders against the reference, on the level and on a small scene in which every formula shows: differences a pass on stdout, what is
/// wrong by name, a picture. Differs (7) when a difference is above the limit.
Exit checkShader(const CheckShaderOptions&);

}  // namespace lmc
