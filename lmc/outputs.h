#pragma once
/// Every file of a bake, written last and in one place, whole or not at all.
#include <nlohmann/json.hpp>

#include "libscene/files.h"
#include "lmc/stages.h"

namespace lmc {

/// File names of the light maps, in order.
std::vector<std::string> mapNames(const Bake&);

/// Opens and fills the light maps, level.glb, what --dump asks for, report.json and level.lmc.json in this order (the sidecar vouches for
/// the rest by size and hash, and is renamed last). commit() is left to the caller.
void writeOutputs(OutputSet&, const Bake&, const nlohmann::ordered_json& report);

/// A Make rule: the sidecar depends on every input.
std::string depfileText(const Bake&);

/// Throws Error Usage when a file that a bake would write is one that it reads.
void refuseToOverwriteInputs(const Bake&);

}  // namespace lmc
