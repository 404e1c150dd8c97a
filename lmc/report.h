#pragma once
#include <nlohmann/json.hpp>

#include "lmc/stages.h"

namespace lmc {

struct Spoken {
  std::vector<Message> messages;
  std::vector<StageTime> stages;
};

/// report.json: plan, error, time and rays per stage, memory. The one output that holds times.
nlohmann::ordered_json reportOf(const Bake&, const Spoken&, bool goalMet);
/// Of light-map UVs, object by object.
nlohmann::ordered_json uvOf(const UvLayout&, const Scene&);

}  // namespace lmc
