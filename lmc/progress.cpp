#include "lmc/progress.h"

#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <nlohmann/json.hpp>

#include "libscene/paging.h"

namespace lmc {

namespace {
using Clock = std::chrono::steady_clock;
double since(Clock::time_point t) { return std::chrono::duration<double>(Clock::now() - t).count(); }
}  // namespace

void tell(std::string_view text) { static_cast<void>(std::fwrite(text.data(), 1, text.size(), stderr)); }

double cpuSeconds() {
  rusage u{};
  getrusage(RUSAGE_SELF, &u);
  return double(u.ru_utime.tv_sec + u.ru_stime.tv_sec) + 1e-6 * double(u.ru_utime.tv_usec + u.ru_stime.tv_usec);
}

std::uint64_t peakBytes() {
  rusage u{};
  getrusage(RUSAGE_SELF, &u);
  return std::uint64_t(u.ru_maxrss) * 1024;
}

std::uint64_t memoryBytes() {
  std::uint64_t bytes = physicalBytes();
  rlimit limit{};
  if (getrlimit(RLIMIT_AS, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY) bytes = std::min<std::uint64_t>(bytes, limit.rlim_cur);
  return bytes;
}

Progress::Progress(ProgressKind kind) : kind_(kind), start_(Clock::now()), lastShown_(start_) {
  if (kind_ != ProgressKind::Auto) return;
  const char* term = std::getenv("TERM");
  kind_ = isatty(STDERR_FILENO) && term && std::strcmp(term, "dumb") != 0 ? ProgressKind::Bar : ProgressKind::Lines;
}

void Progress::clearBar() {
  if (barShown_) tell(fmt::format("\r\x1b[K"));
  barShown_ = false;
}

void Progress::begin(const std::string& stage, double before, double share) {
  const std::lock_guard lock(mutex_);
  stage_ = stage;
  before_ = done_ = before;
  share_ = share;
}

void Progress::update(double shareOfStage) {
  const std::lock_guard lock(mutex_);
  done_ = before_ + share_ * shareOfStage;
  if (kind_ != ProgressKind::Bar && kind_ != ProgressKind::Json) return;
  if (since(lastShown_) < 0.1) return;
  lastShown_ = Clock::now();
  const double done = done_, elapsed = since(start_);
  const double left = done > 0.02 ? elapsed * (1.0 - done) / done : -1.0;
  if (kind_ == ProgressKind::Json) {
    tell(fmt::format(
        "{}\n",
        nlohmann::json{{"stage", stage_}, {"stage_done", shareOfStage}, {"done", done}, {"elapsed_s", elapsed}, {"left_s", left}}.dump()));
    return;
  }
  const int width = 30, full = int(done * width);
  tell(fmt::format("\r\x1b[K[{}{}] {:3.0f} %  {:<8} {}", std::string(std::size_t(full), '#'), std::string(std::size_t(width - full), '.'),
                   100.0 * done, stage_, left >= 0.0 ? fmt::format("{:.0f} s left", left) : std::string()));
  std::fflush(stderr);
  barShown_ = true;
}

void Progress::end(const StageTime& t) {
  const std::lock_guard lock(mutex_);
  clearBar();
  if (kind_ == ProgressKind::None) return;
  if (kind_ == ProgressKind::Json) {
    tell(fmt::format(
        "{}\n", nlohmann::json{{"stage", t.name}, {"seconds", t.seconds}, {"cpu_s", t.cpuSeconds}, {"rays", t.rays}, {"summary", t.summary}}
                    .dump()));
    return;
  }
  tell(fmt::format("{:<8} {:8.2f} s  {:>12} rays  {}\n", t.name, t.seconds, t.rays, t.summary));
}

void Progress::say(const std::string& text) {
  const std::lock_guard lock(mutex_);
  clearBar();
  if (kind_ == ProgressKind::Json)
    tell(fmt::format("{}\n", nlohmann::json{{"message", text}}.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)));
  else
    tell(fmt::format("{}\n", text));
}

double Progress::done() {
  const std::lock_guard lock(mutex_);
  return done_;
}

}  // namespace lmc
