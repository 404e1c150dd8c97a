#pragma once
/// One loop is enough (TBB only here). It gives the same bits for any number of threads as long as f(i) writes nothing but what belongs to
/// i; sums are added up in order afterwards.
#include <tbb/blocked_range.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <mutex>
#include <thread>

#include "libscene/run.h"

#ifdef __SANITIZE_THREAD__
extern "C" void __tsan_acquire(void* address);
extern "C" void __tsan_release(void* address);
#endif

namespace lmc {

/// What one thread did before give() is done for another after take(). TBB sees to it; this tells a thread sanitizer, which sees nothing of
/// a library that was built without it. Does nothing in other builds.
class Handover {
 public:
  void give() {
#ifdef __SANITIZE_THREAD__
    __tsan_release(this);
#endif
  }
  void take() {
#ifdef __SANITIZE_THREAD__
    __tsan_acquire(this);
#endif
  }
};

template <class F>
struct AtEnd {
  F f;
  ~AtEnd() { f(); }
};

inline int threadCount(const Run& run) { return run.threads > 0 ? run.threads : int(std::max(1u, std::thread::hardware_concurrency())); }

/// Runs f with run.threads workers; everything parallel inside uses them.
template <class F>
void withThreads(const Run& run, F&& f) {
  const int n = threadCount(run);
  tbb::global_control limit(tbb::global_control::max_allowed_parallelism, std::size_t(n));
  tbb::task_arena arena(n);
  arena.execute(f);  // by this thread: the arena's first place is kept for it
}

/// f(i) for every i in [0, n), `grain` indices at a time. Reports progress in steps of work done; an exception of any f(i) (Cancelled
/// among them) ends the loop and comes out of it.
template <class F>
void parallelFor(const Run& run, std::size_t n, std::size_t grain, F&& f) {
  if (n == 0) return;
  std::atomic<std::size_t> done{0};
  std::mutex reporting;
  Handover begun, ended;
  const AtEnd after{[&] { ended.take(); }};  // also where an exception comes out
  begun.give();
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, n, std::max<std::size_t>(1, grain)),
      [&](const tbb::blocked_range<std::size_t>& range) {
        begun.take();
        const AtEnd over{[&] { ended.give(); }};
        for (std::size_t i = range.begin(); i != range.end(); ++i) f(i);
        const std::size_t now = done.fetch_add(range.size()) + range.size();
        if (std::unique_lock lock(reporting, std::try_to_lock); lock) run.progress(double(now) / double(n));
      },
      tbb::simple_partitioner());
}

}  // namespace lmc
