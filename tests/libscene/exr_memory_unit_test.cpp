/// EXR files where memory runs out: at every allocation in turn, in a process of its own, for OpenEXR makes some things once only.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <new>
#include <vector>

#include "libscene/exr.h"
#include "tests/libscene/gltf_files.h"

namespace {
long failing = 0;  // counts down to the one that is refused; 0 = none is
}

void* operator new(std::size_t size) {
  if (failing > 0 && --failing == 0) throw std::bad_alloc();
  void* const out = std::malloc(size);
  if (!out) throw std::bad_alloc();
  return out;
}
void operator delete(void* p) noexcept { std::free(p); }
void operator delete(void* p, std::size_t) noexcept { std::free(p); }

namespace lmc::test {
namespace {

enum Outcome : int { Refused = 10, Whole = 11 };

/// Writes a file whose n-th allocation is refused; how the process ended.
int writtenWithout(long n, const Folder& folder) {
  const pid_t child = fork();
  if (child == 0) {
    alarm(20);
    const std::vector<float> grey(64 * 40, 0.5f);
    OutputSet set(folder.path());
    OutputFile& file = set.open("map.exr");
    const std::vector<ExrChannel> channels{{"Y", grey.data(), 1}};
    failing = n;
    try {
      writeExr(file, 64, 40, channels, {{"lmcScale", 1.0f}});
    } catch (const std::exception&) {  // std::bad_alloc, or OpenEXR's own words for it
    }
    _exit(failing == 0 ? Refused : Whole);  // what was refused may have been done without, too
  }
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

TEST(Exr, MemoryThatRunsOutAtAnyAllocationIsToldAndNothingWaitsForEver) {
  const Folder folder;
  long n = 1;
  for (int outcome = Refused; outcome == Refused; ++n) {
    outcome = writtenWithout(n, folder);
    ASSERT_TRUE(outcome == Refused || outcome == Whole) << "allocation " << n << ": " << outcome;
  }
  EXPECT_GT(n, 50) << "allocations";
}

}  // namespace
}  // namespace lmc::test
