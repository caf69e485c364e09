// What NVRTC lacks of g++'s language, for the wide code with one lane: a thread is a lane.
#pragma once

#define __asm__ asm
#define __builtin_sqrtf(x) sqrtf(x)
#define __builtin_fabsf(x) fabsf(x)
#define __builtin_fmaf(a, b, c) __fmaf_rn(a, b, c)
#define __builtin_inff() __int_as_float(0x7f800000)
#define __builtin_ctz(x) (__ffs(static_cast<int>(x)) - 1)
#define __builtin_ctzll(x) (__ffsll(static_cast<long long>(x)) - 1)
#define __builtin_popcount(x) __popc(x)
#define __builtin_memcpy(to, from, size) memcpy(to, from, size)
#define __builtin_prefetch(...) static_cast<void>(0)
#define __ATOMIC_RELAXED 0
#define __atomic_load_n(from, order) (*(from))
#define __atomic_store_n(to, value, order) static_cast<void>(*(to) = (value))

#define EVS_VECTOR_BITS 32
#define EVS_NAMESPACE cuda
#define EVS_INLINE __forceinline__
#define EVS_OUTLINE __noinline__

// before a loop that a GPU unrolls: what it indexes stays in registers
#define EVS_TEXT(...) #__VA_ARGS__
#define EVS_UNROLL(count) _Pragma(EVS_TEXT(unroll(count)))

// as memcmp, which NVRTC lacks
inline int compare_bytes(const void* a, const void* b, unsigned long size) {
  const unsigned char *left = static_cast<const unsigned char*>(a),
                      *right = static_cast<const unsigned char*>(b);
  for (unsigned long i = 0; i < size; i++) {
    if (left[i] != right[i]) return left[i] < right[i] ? -1 : 1;
  }
  return 0;
}
#define __builtin_memcmp(a, b, size) compare_bytes(a, b, size)
