#pragma once
/// One loop is enough (TBB only here). It gives the same bits for any number of threads as long as f(i) writes nothing but what belongs to
/// i; sums are added up in order afterwards.
#include <time.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <thread>

#include "libscene/paging.h"
#include "libscene/run.h"

#ifdef __SANITIZE_THREAD__
#include <exception>
#include <vector>
#else
#include <tbb/blocked_range.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#endif

namespace lmc {

/// CPU time of the calling thread [s].
inline double threadSeconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

/// CPU time that threads spent on something [s], added up by all of them.
class SpentTime {
 public:
  /// The calling thread spent what passed since its threadSeconds() were `since_s`.
  void add(double since_s) { ns_ += std::uint64_t(1e9 * (threadSeconds() - since_s)); }
  double seconds() const { return 1e-9 * double(ns_.load()); }

 private:
  std::atomic<std::uint64_t> ns_{0};
};

inline int threadCount(const Run& run) { return run.threads > 0 ? run.threads : int(std::max(1u, std::thread::hardware_concurrency())); }

#ifdef __SANITIZE_THREAD__

// A thread sanitizer sees nothing of how Debian's TBB, built without it, hands tasks over, and takes all that they do for races. In its
// build plain threads do the loops, so that it judges what lmc does.
inline std::atomic<int> loopThreads{0};

template <class F>
void withThreads(const Run& run, F&& f) {
  loopThreads = threadCount(run);
  f();
}

template <class F>
void forRanges(std::size_t n, std::size_t grain, const F& f) {
  std::atomic<std::size_t> next{0};
  std::exception_ptr failed;
  std::mutex failing;
  const auto work = [&] {
    try {
      for (std::size_t begin; (begin = next.fetch_add(grain)) < n;) f(begin, std::min(n, begin + grain));
    } catch (...) {
      const std::lock_guard lock(failing);
      if (!failed) failed = std::current_exception();
      next = n;
    }
  };
  {
    std::vector<std::jthread> others;
    for (int k = 1; k < (loopThreads > 0 ? loopThreads.load() : 2); ++k) others.emplace_back(work);
    work();
  }
  if (failed) std::rethrow_exception(failed);
}

#else

/// Runs f with run.threads workers; everything parallel inside uses them.
template <class F>
void withThreads(const Run& run, F&& f) {
  const int n = threadCount(run);
  tbb::global_control limit(tbb::global_control::max_allowed_parallelism, std::size_t(n));
  tbb::task_arena arena(n);
  arena.execute(f);  // by this thread: the arena's first place is kept for it
}

/// f(begin, end) for ranges of at most `grain` indices that make up [0, n).
template <class F>
void forRanges(std::size_t n, std::size_t grain, const F& f) {
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, n, grain), [&](const tbb::blocked_range<std::size_t>& range) { f(range.begin(), range.end()); },
      tbb::simple_partitioner());
}

#endif

/// What the threads of a loop do between its items: what was brought in of arrays that memory need not hold is let go where it is too much,
/// and progress is reported in steps of work done, which is where a loop is stopped.
class Between {
 public:
  Between(const Run& run, std::size_t items) : run_(run), items_(items) {}
  /// After `n` more items. Throws Cancelled.
  void done(std::size_t n) {
    run_.checkStop();
    Paging::keepToMost();
    if (!run_.onProgress) return;
    const std::size_t now = done_.fetch_add(n) + n;
    if (std::unique_lock lock(reporting_, std::try_to_lock); lock) run_.onProgress(double(now) / double(items_));
  }

 private:
  const Run& run_;
  const std::size_t items_;
  std::atomic<std::size_t> done_{0};
  std::mutex reporting_;
};

/// f(i) for every i in [0, n), `grain` indices at a time. An exception of any f(i), or Cancelled between them, ends the loop and comes out
/// of it.
template <class F>
void parallelFor(const Run& run, std::size_t n, std::size_t grain, F&& f) {
  if (n == 0) return;
  Between between(run, n);
  forRanges(n, std::max<std::size_t>(1, grain), [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i != end; ++i) f(i);
    between.done(end - begin);
  });
}

}  // namespace lmc
