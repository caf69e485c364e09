// Gather four adjacent floats for each lane with one load a lane, which no gather instruction does.
#pragma once

#include "simd.inl"

struct Quads {
  Float first, second, third, fourth;
};

#if EVS_WIDTH >= 512
// For sixteen lanes. Out: the first float of every lane, the second of every lane, and so on.
EVS_INLINE void sixteen_quads(const float* base, const int* at, __m512* out) {
  auto quad = [&](int i) { return _mm_loadu_ps(base + 2l * at[i]); };
  __m512 q[4];
  _Pragma("GCC unroll 4") for (int i = 0; i < 4; i++) {
    q[i] = _mm512_castps128_ps512(quad(i));
    q[i] = _mm512_insertf32x4(q[i], quad(4 + i), 1);
    q[i] = _mm512_insertf32x4(q[i], quad(8 + i), 2);
    q[i] = _mm512_insertf32x4(q[i], quad(12 + i), 3);
  }
  // transpose within each 128 bits
  __m512d low = _mm512_castps_pd(_mm512_unpacklo_ps(q[0], q[1]));
  __m512d low_next = _mm512_castps_pd(_mm512_unpacklo_ps(q[2], q[3]));
  __m512d high = _mm512_castps_pd(_mm512_unpackhi_ps(q[0], q[1]));
  __m512d high_next = _mm512_castps_pd(_mm512_unpackhi_ps(q[2], q[3]));
  out[0] = _mm512_castpd_ps(_mm512_unpacklo_pd(low, low_next));
  out[1] = _mm512_castpd_ps(_mm512_unpackhi_pd(low, low_next));
  out[2] = _mm512_castpd_ps(_mm512_unpacklo_pd(high, high_next));
  out[3] = _mm512_castpd_ps(_mm512_unpackhi_pd(high, high_next));
}
#endif

// base[2 at] ... base[2 at + 3] for each lane.
EVS_INLINE Quads gather_quads(const float* base, Int at) {
  alignas(64) int index[LANES];
  store(index, at);
  // read the indices from memory: extracting lanes from a register one by one is slower
  __asm__("" : "+m"(index));
#if EVS_WIDTH == 1024
  __m512 low[4], high[4];
  sixteen_quads(base, index, low);
  sixteen_quads(base, index + 16, high);
  return {{low[0], high[0]}, {low[1], high[1]}, {low[2], high[2]}, {low[3], high[3]}};
#elif EVS_WIDTH == 512
  __m512 q[4];
  sixteen_quads(base, index, q);
  return {{q[0]}, {q[1]}, {q[2]}, {q[3]}};
#else
  alignas(64) float out[4][LANES];
  _Pragma("GCC unroll 4") for (int i = 0; i < LANES; i += 4) {
    const float *a = base + 2l * index[i], *b = base + 2l * index[i + 1];
    const float *c = base + 2l * index[i + 2], *d = base + 2l * index[i + 3];
#if defined(__SSE2__)
    __m128 q0 = _mm_loadu_ps(a), q1 = _mm_loadu_ps(b);
    __m128 q2 = _mm_loadu_ps(c), q3 = _mm_loadu_ps(d);
    _MM_TRANSPOSE4_PS(q0, q1, q2, q3);
    _mm_store_ps(out[0] + i, q0);
    _mm_store_ps(out[1] + i, q1);
    _mm_store_ps(out[2] + i, q2);
    _mm_store_ps(out[3] + i, q3);
#else
    for (int k = 0; k < 4; k++) {
      out[k][i] = a[k], out[k][i + 1] = b[k], out[k][i + 2] = c[k], out[k][i + 3] = d[k];
    }
#endif
  }
  return {load(out[0]), load(out[1]), load(out[2]), load(out[3])};
#endif
}
