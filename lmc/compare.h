#pragma once
#include "libscene/error.h"
#include "lmc/options.h"

namespace lmc {

/// Differences of two maps or pictures, channel by channel, on stdout. Differs (7) when the largest is above the limit, or when sizes or
/// channels differ; a value that is not finite in one file only counts as an endless difference.
Exit compare(const CompareOptions&);

}  // namespace lmc
