#include <cstdlib>
#include <new>
#ifdef __linux__
#include <sys/mman.h>
#endif

#include "libtangent/tangent.h"

namespace lmc::tangent {

namespace {

// Triangles round a vertex may be far apart in the arrays: with pages of 4 KiB a good part of the time would go into looking up pages.
constexpr std::size_t kLargePage = std::size_t(2) << 20;

}  // namespace

void* allocateArray(std::size_t bytes, std::size_t alignment) {
  if (bytes < kLargePage) return ::operator new(bytes, std::align_val_t(alignment));
  const std::size_t whole = (bytes + kLargePage - 1) / kLargePage * kLargePage;
  void* array = std::aligned_alloc(kLargePage, whole);
  if (array == nullptr) throw std::bad_alloc();
#ifdef __linux__
  static_cast<void>(madvise(array, whole, MADV_HUGEPAGE));  // a wish: where it is not granted, only time is lost
#endif
  return array;
}

void freeArray(void* array, std::size_t bytes, std::size_t alignment) {
  if (bytes < kLargePage)
    ::operator delete(array, std::align_val_t(alignment));
  else
    std::free(array);
}

}  // namespace lmc::tangent
