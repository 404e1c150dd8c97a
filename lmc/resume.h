#pragma once
/// Stop and go on: which journal a bake has, and what is said of it (docs/resume.md).
#include <memory>
#include <nlohmann/json.hpp>

#include "libscene/journal.h"
#include "lmc/progress.h"
#include "lmc/stages.h"

namespace lmc {

/// The journal of a bake whose level is loaded, and a note on what was in it; null where it shall have none.
std::unique_ptr<Journal> openJournal(const Bake&);

/// A warning, where something went wrong with it since the last time.
void reportTrouble(Journal*, const Bake&);

/// What is told when a bake ends before its time: what is kept, and that the same command goes on.
std::string goesOnText(const Journal&, const BakeOptions&, double done);

/// report.json: resume.
nlohmann::ordered_json resumeOf(const Journal&);

/// What an error leaves to go on with: the rest would come again.
bool mayGoOn(const Error&);

}  // namespace lmc
