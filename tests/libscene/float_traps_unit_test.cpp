/// LMC_TRAP_FP makes what must not happen in lmc's own code end the program, in every thread, and lets other libraries be.
#include "libscene/float_traps.h"

#include <gtest/gtest.h>

#include <csignal>
#include <cstdlib>

#include "libscene/parallel.h"

namespace lmc {
namespace {

double zero() {
  volatile double out = 0.0;
  return out;
}

/// As a program that was started so.
template <class F>
void trapped(F f) {
  setenv("LMC_TRAP_FP", "1", 1);
  trapFloats();
  f();
  std::exit(0);
}

TEST(FloatTraps, EndTheProgramAtAnInvalidOperationOrADivisionByZero) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(trapped([] {
                volatile double sink = zero() / zero();
                static_cast<void>(sink);
              }),
              testing::KilledBySignal(SIGFPE), "");
  EXPECT_EXIT(trapped([] {
                volatile double sink = 1.0 / zero();
                static_cast<void>(sink);
              }),
              testing::KilledBySignal(SIGFPE), "");
}

TEST(FloatTraps, HoldInEveryThread) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto inWorkers = [](double divisor) {
    lmc::Run run;
    run.threads = 2;
    withThreads(run, [&] {
      const std::thread::id own = std::this_thread::get_id();
      std::atomic<bool> other{false};
      while (!other)
        parallelFor(run, 64, 1, [&](std::size_t) {
          if (std::this_thread::get_id() == own) return;
          volatile double sink = divisor / divisor;
          static_cast<void>(sink);
          other = true;
        });
    });
  };
  EXPECT_EXIT(trapped([&] { inWorkers(zero()); }), testing::KilledBySignal(SIGFPE), "");
  EXPECT_EXIT(trapped([&] { inWorkers(2.0); }), testing::ExitedWithCode(0), "");
}

TEST(FloatTraps, LetOtherLibrariesBe) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto within = [] {
    const NoFloatTraps library;
    volatile double sink = zero() / zero();
    static_cast<void>(sink);
  };
  EXPECT_EXIT(trapped(within), testing::ExitedWithCode(0), "");
  EXPECT_EXIT(trapped([&] {
                within();
                volatile double sink = zero() / zero();
                static_cast<void>(sink);
              }),
              testing::KilledBySignal(SIGFPE), "")
      << "they are on again afterwards";
}

}  // namespace
}  // namespace lmc
