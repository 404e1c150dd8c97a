#pragma once
/// Every file of a bake, written last and in one place, whole or not at all.
#include <nlohmann/json.hpp>

#include "libscene/files.h"
#include "lmc/stages.h"

namespace lmc {

/// File names of the maps of a kind, in order: "STEM.ENDING", or "STEM.000.ENDING" where there are several.
std::vector<std::string> mapNames(const Bake&, const char* stem, const char* ending);

/// Opens and fills the light maps, maps of openness, level.glb, what --dump asks for, report.json and level.lmc.json in this order (the
/// sidecar vouches for the rest by size and hash, and is renamed last). commit() is left to the caller.
void writeOutputs(OutputSet&, const Bake&, const nlohmann::ordered_json& report);

/// A Make rule: the sidecar depends on every input.
std::string depfileText(const Bake&);

/// Throws Error Usage when a file that a bake would write is one that it reads.
void refuseToOverwriteInputs(const Bake&);

}  // namespace lmc
