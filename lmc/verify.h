#pragma once
/// `lmc verify`: analytic reference cases (schema lmc-analytic/1) and tangent vectors (.tspace) through the libraries.
#include "libscene/error.h"
#include "lmc/options.h"

namespace lmc {

/// Runs the cases of all files and prints them, one after the other. Numerical (6) when one fails; throws Io for a file that cannot be read
/// and Broken, with a JSON pointer, for one that breaks the schema.
Exit verify(const VerifyOptions&);

}  // namespace lmc
