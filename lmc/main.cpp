/// Parse, run, exit code: the one catch block.
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <exception>
#include <new>
#include <string_view>
#include <system_error>

#include "libscene/files.h"
#include "libscene/float_traps.h"
#include "libscene/journal.h"
#include "libscene/paging.h"
#include "lmc/ao.h"
#include "lmc/bake.h"
#include "lmc/check_shader.h"
#include "lmc/child.h"
#include "lmc/compare.h"
#include "lmc/fit_attenuation.h"
#include "lmc/normals.h"
#include "lmc/progress.h"
#include "lmc/shade.h"
#include "lmc/study.h"
#include "lmc/tangents.h"
#include "lmc/uv_jobs.h"
#include "lmc/verify.h"

namespace {

// A second is promised. The stages look often, but not within every outside library: who is asked to stop does so within this. To free
// gigabytes of files may take the system longer than all that: where there is much of them it need not be waited for.
constexpr unsigned kPatience_us = 250'000, kMoment_us = 10'000;
constexpr std::uint64_t kMuch_bytes = 256 << 20;

constexpr std::string_view kStopped = "stopped\n",
                           kGoesOn = "lmc: stopped: finished tiles are kept, and the same command goes on with them [LMC_RESUME]\n";

void leave(int signal) {
  if (lmc::isNamingFiles()) {  // a set is all but there
    ualarm(kMoment_us, 0);
    return;
  }
  lmc::removeTemporaryFiles();
  const std::string_view said = lmc::journalHoldsTiles() ? kGoesOn : kStopped;
  static_cast<void>(!write(STDERR_FILENO, said.data(), said.size()));
  _exit(128 + signal);
}

extern "C" void onSignal(int signal) {
  if (lmc::askedToStop() != 0) return leave(signal);  // asked twice
  lmc::askToStop(signal);
  ualarm(kPatience_us, 0);
  if (lmc::Paging::filesBytes() > kMuch_bytes) lmc::leaveMemoryToChild();
}

extern "C" void onAlarm(int) { leave(lmc::askedToStop()); }

constexpr char kOutOfMemory[] = "lmc: error: out of memory [LMC_MEMORY]\n";

/// Whether this thread was refused memory: where it unwinds through a function that throws nothing, the exception is not to be had.
thread_local bool refusedMemory = false;

void onNoMemory() {
  refusedMemory = true;
  throw std::bad_alloc();
}

/// What ends where nothing can be thrown: destructors of outside libraries' values (JSON's, the timers within ceres::Solve) take memory. No
/// temporary file is left behind, and no journal of a run that a fault of lmc's ended: it would come again.
void onTerminate() {
  lmc::Exit code = lmc::Exit::Internal;
  try {
    if (const std::exception_ptr e = std::current_exception()) std::rethrow_exception(e);
    if (refusedMemory) throw std::bad_alloc();
    std::fputs("lmc: error: internal: ended out of order [LMC_INTERNAL]\n", stderr);
  } catch (const std::bad_alloc&) {
    std::fputs(kOutOfMemory, stderr);
    code = lmc::Exit::Limit;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "lmc: error: internal: ended out of order: %s [LMC_INTERNAL]\n", e.what());
  } catch (...) {
    std::fputs("lmc: error: internal: not known [LMC_INTERNAL]\n", stderr);
  }
  lmc::removeTemporaryFiles();
  if (code == lmc::Exit::Internal) lmc::unlinkJournal();
  _exit(int(code));
}

void prepareProcess() {
  std::set_terminate(onTerminate);
  std::set_new_handler(onNoMemory);
  lmc::trapFloats();
  // Files that are opened must never land on descriptors 0 to 2, or the log would be written into them.
  for (int fd = 0; fd <= 2; ++fd)
    if (fcntl(fd, F_GETFD) < 0) static_cast<void>(open("/dev/null", O_RDWR));
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGALRM, onAlarm);
  std::signal(SIGINT, onSignal);
  std::signal(SIGTERM, onSignal);
}

struct Perform {
  lmc::Exit operator()(const lmc::BakeOptions& o) const { return lmc::bake(o); }
  lmc::Exit operator()(const lmc::PlanOptions& o) const { return lmc::showPlan(o); }
  lmc::Exit operator()(const lmc::CompareOptions& o) const { return lmc::compare(o); }
  lmc::Exit operator()(const lmc::ShadeOptions& o) const { return lmc::shade(o); }
  lmc::Exit operator()(const lmc::CheckShaderOptions& o) const { return lmc::checkShader(o); }
  lmc::Exit operator()(const lmc::VerifyOptions& o) const { return lmc::verify(o); }
  lmc::Exit operator()(const lmc::TangentsOptions& o) const { return lmc::tangents(o); }
  lmc::Exit operator()(const lmc::NormalsOptions& o) const { return lmc::normals(o); }
  lmc::Exit operator()(const lmc::AoJobOptions& o) const { return lmc::occlusion(o); }
  lmc::Exit operator()(const lmc::UnwrapOptions& o) const { return lmc::unwrap(o); }
  lmc::Exit operator()(const lmc::InfoOptions& o) const { return lmc::showInfo(o); }
  lmc::Exit operator()(const lmc::AttachOptions& o) const { return lmc::attach(o); }
  lmc::Exit operator()(const lmc::FitAttenuationOptions& o) const { return lmc::fitAttenuation(o); }
  lmc::Exit operator()(const lmc::StudyOptions& o) const { return lmc::study(o); }
  lmc::Exit operator()(const lmc::ShowText& t) const {
    fmt::print("{}", t.text);
    return lmc::Exit::Done;
  }
};

int runProgram(int argc, char** argv) {
  const lmc::Exit result = std::visit(Perform{}, lmc::parseCommandLine(argc, argv));
  // As fmt throws what stdout does not take.
  if (std::fflush(stdout) != 0) throw std::system_error(errno, std::generic_category());
  if (std::ferror(stdout)) throw std::system_error(EIO, std::generic_category());
  return int(result);
}

/// A reader that has gone (`lmc plan LEVEL | head`) has what it wanted: nobody is told.
lmc::Exit failedOutput(const std::system_error& e) {
  if (e.code() != std::errc::broken_pipe)
    lmc::tell(fmt::format("{}\n", lmc::line("error", "standard output", "", "cannot be written: " + e.code().message(), "LMC_FILE")));
  return lmc::Exit::Io;
}

}  // namespace

int main(int argc, char** argv) {
  prepareProcess();
  try {
    return runProgram(argc, argv);
  } catch (const lmc::Cancelled&) {
    lmc::tell(kStopped);
    return 128 + lmc::askedToStop();
  } catch (const lmc::Error& e) {
    lmc::tell(fmt::format("{}\n", e.what()));
    return int(e.kind);
  } catch (const std::bad_alloc&) {
    std::fputs(kOutOfMemory, stderr);
    return int(lmc::Exit::Limit);
  } catch (const std::system_error& e) {  // fmt's, of stdout: every file of ours ends in an Error
    return int(failedOutput(e));
  } catch (const std::exception& e) {
    lmc::tell(fmt::format("{}\n", lmc::line("error", "lmc", "", std::string("internal: ") + e.what(), "LMC_INTERNAL")));
    return int(lmc::Exit::Internal);
  }
}
