#pragma once
#include "lmc/options.h"

namespace lmc {

/// `lmc study`: a ladder of bakes, each in a process of its own; what is finished is kept, and a study that was stopped goes on from there.
Exit study(const StudyOptions&);

}  // namespace lmc
