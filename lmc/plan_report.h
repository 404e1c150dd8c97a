#pragma once
/// The plan as people and scripts read it: effects, reasons, bounds and costs, foretold and as they came.
#include <nlohmann/json.hpp>
#include <string>

#include "lmc/stages.h"

namespace lmc {

/// One entry an effect; with the stages' times, forecasts and what became of them.
nlohmann::ordered_json planOf(const Bake&, const std::vector<StageTime>&);
/// The whole bake: what was spent before the forecast and what was foretold, against what it took (0 while it has not run).
nlohmann::ordered_json forecastOf(const Bake&, const std::vector<StageTime>&);
nlohmann::ordered_json factsOf(const Bake&);

/// The same as a table.
std::string planText(const Bake&, const std::vector<StageTime>&);

}  // namespace lmc
