#pragma once
/// What a person sees while a bake runs: a bar with time left on a terminal, a line a stage in a log, JSON lines for an editor.
#include <chrono>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include "lmc/options.h"

namespace lmc {

struct StageTime {
  std::string name;
  double seconds = 0.0;
  double cpuSeconds = 0.0;
  std::uint64_t rays = 0;
  std::string summary;
};

double cpuSeconds();          ///< user and system time of this process
std::uint64_t peakBytes();    ///< largest resident size so far
std::uint64_t memoryBytes();  ///< of this machine, or the process's own limit if that is less

/// Text for stderr; a log that cannot be written ends no work.
void tell(std::string_view text);

class Progress {
 public:
  explicit Progress(ProgressKind kind);
  void begin(const std::string& stage, double shareOfJobBefore, double shareOfJob);
  void update(double shareOfStage);  ///< thread-safe
  void end(const StageTime&);
  void say(const std::string& line);  ///< a message; does not tear the bar
  double done();                      ///< share of the job

 private:
  void clearBar();
  ProgressKind kind_;
  std::mutex mutex_;
  std::string stage_;
  double before_ = 0.0, share_ = 0.0, done_ = 0.0;
  bool barShown_ = false;
  std::chrono::steady_clock::time_point start_, lastShown_;
};

}  // namespace lmc
