#pragma once
#include <functional>

#include "libscene/error.h"

namespace lmc {

/// Runs a job in a process of its own, so that its memory and its time are its own, and whatever it holds goes with it. Errors are told by
/// that process; its exit code comes back. Signals that ask this process to stop are passed on; then Cancelled is thrown. To be called
/// before this process has threads.
Exit inChild(const std::function<Exit()>& job);

}  // namespace lmc
