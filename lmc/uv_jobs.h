#pragma once
/// lmc unwrap, info and attach: light-map UVs made, looked at, and put on a level that was rewritten.
#include "lmc/options.h"

namespace lmc {

Exit unwrap(const UnwrapOptions&);
Exit showInfo(const InfoOptions&);
Exit attach(const AttachOptions&);

}  // namespace lmc
