#pragma once
/// For tests: with LMC_TRAP_FP in the environment an invalid operation or a division by zero in lmc's own code ends the program at the place
/// (SIGFPE). Other people's libraries compute past lanes that are masked out, and are let be.
#include <cfenv>
#include <cstdlib>

namespace lmc {

inline bool floatTraps = false;  ///< set once, before any thread starts

inline void trapFloats() {
  if (!std::getenv("LMC_TRAP_FP")) return;
  floatTraps = true;
  feenableexcept(FE_INVALID | FE_DIVBYZERO);
}

/// Around a call into another library.
class NoFloatTraps {
 public:
  NoFloatTraps() {
    if (floatTraps) before_ = fedisableexcept(FE_ALL_EXCEPT);
  }
  ~NoFloatTraps() {
    if (!floatTraps) return;
    std::feclearexcept(FE_ALL_EXCEPT);
    feenableexcept(before_);
  }
  NoFloatTraps(const NoFloatTraps&) = delete;
  NoFloatTraps& operator=(const NoFloatTraps&) = delete;

 private:
  int before_ = 0;
};

}  // namespace lmc
