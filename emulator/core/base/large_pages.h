// Memory in large pages, where the system has them, for large arrays with random access: it causes
// few misses in the translation buffer.
#pragma once

#include <cstddef>
#include <cstdlib>
#include <memory>
#include <new>

#if __has_include(<sys/mman.h>)
#include <sys/mman.h>
#endif

namespace evs {

constexpr size_t LARGE_PAGE = size_t{1} << 21, CACHE_LINE = 64;

// Uninitialised memory, which the system provides when it is first written. Release with std::free.
inline void* allocate_large(size_t bytes) {
  size_t step = bytes < LARGE_PAGE ? CACHE_LINE : LARGE_PAGE;
  bytes = (bytes + step - 1) / step * step;
  void* memory = std::aligned_alloc(step, bytes);
  if (!memory && bytes) throw std::bad_alloc();
#ifdef MADV_HUGEPAGE
  // a hint that the system may ignore
  if (step == LARGE_PAGE) madvise(memory, bytes, MADV_HUGEPAGE);
#endif
  return memory;
}

struct FreeLarge {
  void operator()(void* memory) const { std::free(memory); }
};

// An array of numbers.
template <class T>
using LargeArray = std::unique_ptr<T[], FreeLarge>;

template <class T>
LargeArray<T> large_array(size_t count) {
  return LargeArray<T>(static_cast<T*>(allocate_large(count * sizeof(T))));
}

// An allocator for std::vector.
template <class T>
struct LargePages {
  using value_type = T;
  LargePages() = default;
  template <class U>
  LargePages(const LargePages<U>&) {}
  T* allocate(size_t count) { return static_cast<T*>(allocate_large(count * sizeof(T))); }
  void deallocate(T* memory, size_t) { std::free(memory); }
  bool operator==(const LargePages&) const { return true; }
};

}  // namespace evs
