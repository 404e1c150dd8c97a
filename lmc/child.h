#pragma once
#include <functional>

#include "libscene/error.h"

namespace lmc {

/// Runs a job in a process of its own, so that its memory and its time are its own, and whatever it holds goes with it. Errors are told by
/// that process; its exit code comes back. Signals that ask this process to stop are passed on; then Cancelled is thrown. To be called
/// before this process has threads.
Exit inChild(const std::function<Exit()>& job);

/// Before the end of a process that holds much, in files without a name above all, which the system may take seconds to free: a child holds
/// it as well, no file descriptor beside, and ends a moment after this process, which then need not wait. For signal handlers. Where the
/// system gives no further process, nothing is changed.
void leaveMemoryToChild() noexcept;

}  // namespace lmc
