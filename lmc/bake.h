#pragma once
#include "libscene/run.h"
#include "lmc/options.h"

namespace lmc {

/// The main job: every stage in order, files last. Returns Done or GoalMissed; throws Error and Cancelled.
Exit bake(const BakeOptions&);

/// `lmc plan`: loads the level and prints the plan on stdout.
Exit showPlan(const PlanOptions&);

/// For verbs without a bar: stops when asked to.
Run stoppableRun(int threads);

/// Set by SIGINT and SIGTERM; a bake stops at the next report of progress.
void askToStop(int signal);
int askedToStop();  ///< the signal, or 0

}  // namespace lmc
