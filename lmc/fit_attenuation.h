#pragma once
#include <vector>

#include "lmc/fits.h"
#include "lmc/options.h"

namespace lmc {

/// The places that a fit goes by: of a kind of fall-off by name, or of a file with a distance and a value a line.
/// Throws Error Usage, Io or Broken.
std::vector<FallOffPlace> fallOffPlaces(const FitAttenuationOptions&);

/// `lmc fit-attenuation`: constants of the classic attenuation for a wished fall-off, and how far they are off.
Exit fitAttenuation(const FitAttenuationOptions&);

}  // namespace lmc
