#pragma once
#include <nlohmann/json.hpp>

#include "libscene/error.h"
#include "lmc/options.h"

namespace lmc {

/// level.lmc.json of a bake. Throws Error where it is none, or where a file is not the one that it speaks of.
nlohmann::json readSidecar(const std::filesystem::path& folder);

/// A picture of a baked level: albedo * E/pi + emission through a camera, E bilinear from the light map, tone mapped to sRGB.
Exit shade(const ShadeOptions&);

}  // namespace lmc
