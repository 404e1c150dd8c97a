#include "lmc/child.h"

#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <new>

#include "libscene/run.h"
#include "lmc/bake.h"

namespace lmc {

namespace {

int resultOf(const std::function<Exit()>& job) {
  try {
    return int(job());
  } catch (const Cancelled&) {
    return 128 + askedToStop();
  } catch (const Error& e) {
    fmt::print(stderr, "{}\n", e.what());
    return int(e.kind);
  } catch (const std::bad_alloc&) {
    std::fputs("lmc: error: out of memory [LMC_MEMORY]\n", stderr);
    return int(Exit::Limit);
  } catch (const std::exception& e) {
    fmt::print(stderr, "{}\n", line("error", "lmc", "", std::string("internal: ") + e.what(), "LMC_INTERNAL"));
    return int(Exit::Internal);
  }
}

}  // namespace

Exit inChild(const std::function<Exit()>& job) {
  std::fflush(nullptr);
  const pid_t parent = getpid(), child = fork();
  if (child < 0) throw Error(Exit::Limit, "lmc", "", "no further process can be started", "LMC_PROCESS");
  if (child == 0) {
    // A group of its own: a signal from the terminal comes once, through the parent; and the job ends with its parent.
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent) _exit(int(Exit::Terminated));
    const int result = resultOf(job);
    std::fflush(nullptr);
    _exit(result);
  }
  int status = 0;
  bool told = false;
  while (waitpid(child, &status, 0) < 0) {
    if (errno != EINTR) throw Error(Exit::Internal, "lmc", "", "the process of a job was lost");
    if (askedToStop() != 0 && !told) {
      kill(child, SIGTERM);
      told = true;
    }
  }
  if (told || askedToStop() != 0) throw Cancelled();
  if (WIFEXITED(status)) return Exit(WEXITSTATUS(status));
  const int signal = WTERMSIG(status);
  if (signal == SIGKILL) throw Error(Exit::Limit, "lmc", "", "the process of a job was killed: out of memory, as a rule", "LMC_MEMORY");
  throw Error(Exit::Internal, "lmc", "", fmt::format("the process of a job ended by signal {}", signal));
}

void leaveMemoryToChild() noexcept {
  const int before = errno;
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) {
    errno = before;
    return;
  }
  const auto waitForOther = [](int end) {
    char byte = 0;
    while (read(end, &byte, 1) < 0 && errno == EINTR) continue;
  };
  const pid_t child = _Fork();
  if (child == 0) {
    std::signal(SIGINT, SIG_IGN);
    std::signal(SIGTERM, SIG_IGN);
    // Files are locked, and somebody may read what is written to its end.
    const auto kept = unsigned(ends[1]);
    if (kept > 0) close_range(0, kept - 1, 0);
    close_range(kept + 1, ~0u, 0);
    static_cast<void>(!write(ends[1], "", 1));
    waitForOther(ends[1]);  // a process closes its files after it has given back its memory
    _exit(0);
  }
  close(ends[1]);
  if (child > 0) waitForOther(ends[0]);  // until only what is to be left is there
  errno = before;
}

}  // namespace lmc
