// Sample points of the `path` integrator: dimension by dimension, each a point set of its own that
// is filled evenly by the first 2^n samples. A counter, no state: (pixel, seed, dimension, sample).
//
// sobol    the Sobol points of every pixel moved by a shift of its own (Cranley & Patterson 1976)
// owen     the Sobol points of every pixel scrambled in a way of its own (Owen 1995, with the hash
//          of Laine & Karras 2011 as Burley 2020 has it)
// global   the Owen-scrambled points, the same in every pixel
// random   independent numbers
// anchored as owen, but behind the first surface it is a cell of that surface that asks, not the
//          pixel: the noise moves with the surface, as a texture would
#pragma once

#include "geometry/intersect.inl"
#include "path_scene.h"

namespace evs::EVS_SPACE {
namespace {

struct Sampler {
  Int pixel;     // who asks: row * width + column, or anchor_of
  Int reversed;  // the sample's index, its bits in reverse
  int mode;      // enum SampleSet
  int seed;      // the whole image's
  int digits;    // 2^digits samples or fewer are drawn
};

template <int N>
EVS_INLINE Int shift_right_unsigned(Int a) {
  return shift_right<N>(a) & splat(static_cast<int>(0xffffffffu >> N));
}

// A permutation of 32 bits in which every bit depends on every other (the "lowbias32" of
// C. Wellons, 2018).
EVS_INLINE Int hash(Int a) {
  a = (a ^ shift_right_unsigned<16>(a)) * splat(0x7feb352d);
  a = (a ^ shift_right_unsigned<15>(a)) * splat(static_cast<int>(0x846ca68bu));
  return a ^ shift_right_unsigned<16>(a);
}
inline unsigned hash(unsigned a) {
  a = (a ^ (a >> 16)) * 0x7feb352du;
  a = (a ^ (a >> 15)) * 0x846ca68bu;
  return a ^ (a >> 16);
}

#if EVS_WIDTH >= 256
// Bytes in reverse by one shuffle, then each byte's halves by a table of 16.
EVS_INLINE Int reverse_bits(Int a) {
  const __m128i bytes = _mm_setr_epi8(3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12);
  const __m128i halves = _mm_setr_epi8(0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15);
#if EVS_WIDTH >= 512
  const __m512i table = _mm512_broadcast_i32x4(halves), low = _mm512_set1_epi8(15);
  auto reverse = [&](__m512i part) {
    __m512i x = _mm512_shuffle_epi8(part, _mm512_broadcast_i32x4(bytes));
    __m512i bottom = _mm512_shuffle_epi8(table, _mm512_and_si512(x, low));
    __m512i top = _mm512_shuffle_epi8(table, _mm512_and_si512(_mm512_srli_epi16(x, 4), low));
    return _mm512_or_si512(_mm512_slli_epi16(bottom, 4), top);
  };
#if EVS_WIDTH == 512
  return {reverse(a.v)};
#else
  return {reverse(a.v[0]), reverse(a.v[1])};
#endif
#else
  const __m256i table = _mm256_broadcastsi128_si256(halves), low = _mm256_set1_epi8(15);
  for (IntPart& part : a.v) {
    __m256i x = _mm256_shuffle_epi8((__m256i)part, _mm256_broadcastsi128_si256(bytes));
    __m256i bottom = _mm256_shuffle_epi8(table, _mm256_and_si256(x, low));
    __m256i top = _mm256_shuffle_epi8(table, _mm256_and_si256(_mm256_srli_epi16(x, 4), low));
    part = (IntPart)_mm256_or_si256(_mm256_slli_epi16(bottom, 4), top);
  }
  return a;
#endif
}
#else
EVS_INLINE Int reverse_bits(Int a) {
  auto swap = [](Int x, Int high, int mask, int times) {
    return (high & splat(mask)) | ((x & splat(mask)) * splat(times));
  };
  a = swap(a, shift_right<1>(a), 0x55555555, 2);
  a = swap(a, shift_right<2>(a), 0x33333333, 4);
  a = swap(a, shift_right<4>(a), 0x0f0f0f0f, 16);
  a = swap(a, shift_right<8>(a), 0x00ff00ff, 256);
  return swap(a, shift_right<16>(a), 0x0000ffff, 65536);
}
#endif

// Nested uniform scramble of numbers whose most significant digit is bit 0.
EVS_INLINE Int scramble_reversed(Int a, Int seed) {
  a = a ^ (a * splat(0x3d20adea));
  a = a + seed;
  a = a * (shift_right_unsigned<16>(seed) | splat(1));
  a = a ^ (a * splat(0x05526c56));
  return a ^ (a * splat(0x53a22864));
}

// 0 <= x < 1 of the 24 leading bits.
EVS_INLINE Float unit(Int a) {
  return to_float(shift_right_unsigned<8>(a)) * 5.9604644775390625e-8f;
}

// Two numbers in [0, 1) of one dimension.
EVS_INLINE Pair pair_of(const Sampler& s, int dimension) {
  Int own = s.pixel;
  if (s.mode == SAMPLES_GLOBAL) own = splat(0);
  unsigned mixed =
      hash(static_cast<unsigned>(s.seed) * 0x9e3779b9u + static_cast<unsigned>(dimension));
  Int key = hash(own ^ splat(static_cast<int>(mixed)));
  if (s.mode == SAMPLES_RANDOM) {
    Int a = hash(key + hash(reverse_bits(s.reversed) + splat(1)));
    return {unit(a), unit(hash(a ^ splat(0x68bc21eb)))};
  }
  // the order of the points differs between dimensions, so that their pairings do too
  Int order = s.mode == SAMPLES_SOBOL ? splat(static_cast<int>(hash(mixed)))
                                      : hash(key ^ splat(0x2c1b3c6d));
  Int index = reverse_bits(scramble_reversed(s.reversed, order)) & splat((1 << s.digits) - 1);
  // the second dimension's direction numbers are Pascal's triangle modulo 2
  Int second = splat(0);
  unsigned direction = 0x80000000u;
  for (int i = 0; i < s.digits; i++) {
    Mask set = (index & splat(1 << i)) == splat(1 << i);
    second = select(set, second ^ splat(static_cast<int>(direction)), second);
    direction ^= direction >> 1;
  }
  Int shift_x = hash(key + splat(0x1b873593)), shift_y = hash(key + splat(0x27d4eb2f));
  if (s.mode == SAMPLES_SOBOL) return {unit(reverse_bits(index) + shift_x), unit(second + shift_y)};
  return {unit(reverse_bits(scramble_reversed(index, shift_x))),
          unit(reverse_bits(scramble_reversed(reverse_bits(second), shift_y)))};
}

// Who asks where a ray of the camera hits: a number of the geom and of the cell around the point,
// in the geom's own frame. A cell is a power of two wide, 3/4 to 3/2 of the pixel's footprint, so
// that it stays the same cell while the camera comes nearer, until it is twice as near.
inline Int anchor_of(const Frame& f, const Rays& rays, const Hit& hit, Mask lit) {
  float pixel = f.pixel_angle * __builtin_sqrtf(static_cast<float>(f.samples));
  Float footprint = (f.orthographic ? splat(1.0f) : hit.distance) * (1.5f * pixel);
  Int exponent = as_int(footprint) & splat(0x7f800000);
  Float inverse = 1.0f / as_float(exponent);
  auto cell = [&](Float x) {
    // no border at 0 nor at round sizes: rounding would throw faces that lie there to both sides;
    // and no cell, nor a NaN, that Int does not hold
    return truncate(floor(min(max(x * inverse + 0.381966f, splat(-1e9f)), splat(1e9f))));
  };
  Int anchor = splat(0);
  for (unsigned lanes = bits(lit); lanes;) {
    int index = lane(hit.geom, first_lane(lanes));
    Mask here = (hit.geom == splat(index)) & mask_of(lanes);
    lanes &= ~bits(here);
    const Geom& g = f.geoms[index];
    Vec p = local_origin(g, rays) + to_local(g.rotation, rays.direction) * hit.distance;
    Int key = hash(exponent ^ splat(static_cast<int>(hash(static_cast<unsigned>(index)))));
    key = hash(cell(p.z) ^ hash(cell(p.y) ^ hash(cell(p.x) ^ key)));
    anchor = select(here, key, anchor);
  }
  return anchor;
}

}  // namespace
}  // namespace evs::EVS_SPACE
