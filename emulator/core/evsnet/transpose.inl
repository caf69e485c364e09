// Transposition of 16 rows of 16 floats in registers.
#pragma once

#include "simd.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// Move float k of row i to float i of column k. In: from(i) and to(k), where rows and columns
// begin.
#if EVS_VECTOR_BITS == 512
template <class From, class To>
EVS_INLINE void transpose_16x16(const From& from, const To& to) {
  __m512 a[16], b[16];
  // load the rows
#pragma GCC unroll 16
  for (int i = 0; i < 16; i++) a[i] = _mm512_loadu_ps(from(i));
  // interleave floats of neighbouring rows, then pairs of floats
#pragma GCC unroll 8
  for (int i = 0; i < 16; i += 2) {
    b[i] = _mm512_unpacklo_ps(a[i], a[i + 1]);
    b[i + 1] = _mm512_unpackhi_ps(a[i], a[i + 1]);
  }
#pragma GCC unroll 4
  for (int i = 0; i < 16; i += 4) {
#pragma GCC unroll 2
    for (int h = 0; h < 2; h++) {
      const __m512d low = _mm512_castps_pd(b[i + h]), high = _mm512_castps_pd(b[i + h + 2]);
      a[i + 2 * h] = _mm512_castpd_ps(_mm512_unpacklo_pd(low, high));
      a[i + 2 * h + 1] = _mm512_castpd_ps(_mm512_unpackhi_pd(low, high));
    }
  }
  // quarter q of a[4 g + c] now holds float 4 q + c of rows 4 g ... 4 g + 3; gather the quarters
#pragma GCC unroll 4
  for (int c = 0; c < 4; c++) {
    const __m512 low_even = _mm512_shuffle_f32x4(a[c], a[4 + c], 0x88);
    const __m512 low_odd = _mm512_shuffle_f32x4(a[c], a[4 + c], 0xdd);
    const __m512 high_even = _mm512_shuffle_f32x4(a[8 + c], a[12 + c], 0x88);
    const __m512 high_odd = _mm512_shuffle_f32x4(a[8 + c], a[12 + c], 0xdd);
    _mm512_storeu_ps(to(c), _mm512_shuffle_f32x4(low_even, high_even, 0x88));
    _mm512_storeu_ps(to(4 + c), _mm512_shuffle_f32x4(low_odd, high_odd, 0x88));
    _mm512_storeu_ps(to(8 + c), _mm512_shuffle_f32x4(low_even, high_even, 0xdd));
    _mm512_storeu_ps(to(12 + c), _mm512_shuffle_f32x4(low_odd, high_odd, 0xdd));
  }
}
#else
// in blocks of 4 x 4
template <class From, class To>
EVS_INLINE void transpose_16x16(const From& from, const To& to) {
  typedef float Four __attribute__((vector_size(16)));
  for (int r = 0; r < 16; r += 4) {
    for (int c = 0; c < 16; c += 4) {
      Four a[4];
#pragma GCC unroll 4
      for (int i = 0; i < 4; i++) __builtin_memcpy(&a[i], from(r + i) + c, sizeof a[i]);
      const Four low = __builtin_shufflevector(a[0], a[1], 0, 4, 1, 5);
      const Four high = __builtin_shufflevector(a[0], a[1], 2, 6, 3, 7);
      const Four low_next = __builtin_shufflevector(a[2], a[3], 0, 4, 1, 5);
      const Four high_next = __builtin_shufflevector(a[2], a[3], 2, 6, 3, 7);
      a[0] = __builtin_shufflevector(low, low_next, 0, 1, 4, 5);
      a[1] = __builtin_shufflevector(low, low_next, 2, 3, 6, 7);
      a[2] = __builtin_shufflevector(high, high_next, 0, 1, 4, 5);
      a[3] = __builtin_shufflevector(high, high_next, 2, 3, 6, 7);
#pragma GCC unroll 4
      for (int i = 0; i < 4; i++) __builtin_memcpy(to(c + i) + r, &a[i], sizeof a[i]);
    }
  }
}
#endif

// The same for any number of rows and columns up to 16.
template <class From, class To>
EVS_INLINE void transpose(const From& from, const To& to, int rows, int columns) {
  if (rows == LANES && columns == LANES) return transpose_16x16(from, to);
  for (int i = 0; i < rows; i++) {
    for (int k = 0; k < columns; k++) to(k)[i] = from(i)[k];
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
