/// An exception in a thread of the program's own, by LD_PRELOAD: LMC_THROW=KIND:N lets the N-th `new` outside of the thread of main throw
/// what no code of lmc throws (KIND = other) or std::bad_alloc (KIND = memory). When it did is written to the file that LMC_THROW_TIME
/// names [s, CLOCK_MONOTONIC]; the number of such calls to the one of LMC_THROW_COUNT, at the end (N = 0: none throws).
#include <pthread.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <new>
#include <stdexcept>

namespace {

std::atomic<long> calls{0};
long wanted = 0;
bool memory = false;

void note(const char* variable, const char* form, double value) {
  const char* name = std::getenv(variable);
  if (!name) return;
  if (std::FILE* file = std::fopen(name, "w")) {
    std::fprintf(file, form, value);
    std::fclose(file);
  }
}

struct Setting {
  Setting() {
    const char* text = std::getenv("LMC_THROW");
    if (!text) return;
    memory = std::strncmp(text, "memory:", 7) == 0;
    const char* colon = std::strchr(text, ':');
    wanted = colon ? std::atol(colon + 1) : 0;
  }
  ~Setting() { note("LMC_THROW_COUNT", "%.0f\n", double(calls)); }
} setting;

}  // namespace

void* operator new(std::size_t size) {
  if (::gettid() != ::getpid() && calls.fetch_add(1) + 1 == wanted) {
    timespec now{};
    ::clock_gettime(CLOCK_MONOTONIC, &now);
    note("LMC_THROW_TIME", "%.6f\n", double(now.tv_sec) + 1e-9 * double(now.tv_nsec));
    if (memory) {
      if (const std::new_handler handler = std::get_new_handler()) handler();  // as any `new` that finds none
      throw std::bad_alloc();
    }
    throw std::runtime_error("thrown for a test");
  }
  if (void* p = std::malloc(size ? size : 1)) return p;
  throw std::bad_alloc();
}
void operator delete(void* p) noexcept { std::free(p); }
void operator delete(void* p, std::size_t) noexcept { std::free(p); }
