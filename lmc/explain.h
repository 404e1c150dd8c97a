#pragma once
/// One texel, light by light: which lamps, emitters, sky and surfaces made it, and what stands in their way.
#include <nlohmann/json.hpp>
#include <string>

#include "lmc/stages.h"

namespace lmc {

/// By rays of its own, beside those of the bake, whose bytes do not change. Needs the stages up to the gather, before the field goes.
/// Throws Error Usage for a texel that is outside the map or of no chart.
nlohmann::ordered_json explainTexel(const Bake&);

/// What the map has there, before seams are closed.
void addValues(nlohmann::ordered_json& explained, const Bake&);

/// The same for a person.
std::string explainText(const nlohmann::ordered_json&);

}  // namespace lmc
