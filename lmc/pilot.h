#pragma once
/// A small part of a bake, by the bake's own code: what each effect is worth, and what the whole is going to cost.
#include "lmc/facts.h"

namespace lmc {

struct Bake;

/// Needs the stages up to `trace`; leaves the map as they left it. What the plan has ruled out is not asked for. The same counts for any
/// number of threads; only the seconds of its forecasts are a clock's.
Pilot runPilot(Bake&);

}  // namespace lmc
