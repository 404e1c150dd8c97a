#pragma once
#include "libscene/error.h"
#include "lmc/options.h"

namespace lmc {

/// A picture of a level by the reference shader (shaders/reference.h), or by its oracle.
Exit shade(const ShadeOptions&);

}  // namespace lmc
