// Samplers of the `path` integrator. Each dimension is a point set of its own, filled evenly by the
// first 2^n samples. A cycle of seeds divides a larger set into blocks of 2^n samples, one per
// tick: each block is as even as a set of its own, and so are all of them together. Stateless: a
// function of (pixel, seed, block, dimension, sample).
//
//  sobol    Sobol points, shifted at random for each pixel (Cranley & Patterson 1976)
//  owen     Sobol points, scrambled for each pixel (Owen 1995, with the hash of Laine & Karras
//           2011 as in Burley 2020)
//  global   Owen-scrambled points, the same in every pixel
//  random   independent random numbers
//  anchored as owen, but beyond the first hit the pixel is replaced by a cell of that surface, so
//           the noise moves with the surface as a texture would
#pragma once

#include "render/geometry/intersect.inl"
#include "scene/path_scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

struct Sampler {
  Int pixel;           // row * width + column, or surface_anchor
  Int reversed_index;  // the sample's index, bit-reversed
  int mode;            // enum SampleSet
  int seed;            // of the whole image
  int log2_samples;    // at most 2^log2_samples samples are drawn in a block
  int block, log2_blocks;
  bool quarters;  // of the samples: see point_index
};

template <int N>
EVS_INLINE Int shift_right_unsigned(Int a) {
  return shift_right<N>(a) & splat(static_cast<int>(0xffffffffu >> N));
}

// A permutation of 32 bits in which every bit depends on every other ("lowbias32", C. Wellons
// 2018).
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

#if EVS_VECTOR_BITS >= 256
// Reverse the bytes by one shuffle, then the bits of each byte by a table of 16.
EVS_INLINE Int reverse_bits(Int a) {
  const __m128i bytes = _mm_setr_epi8(3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12);
  const __m128i halves = _mm_setr_epi8(0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15);
#if EVS_VECTOR_BITS >= 512
  const __m512i table = _mm512_broadcast_i32x4(halves), low = _mm512_set1_epi8(15);
  auto reverse = [&](__m512i part) {
    __m512i x = _mm512_shuffle_epi8(part, _mm512_broadcast_i32x4(bytes));
    __m512i bottom = _mm512_shuffle_epi8(table, _mm512_and_si512(x, low));
    __m512i top = _mm512_shuffle_epi8(table, _mm512_and_si512(_mm512_srli_epi16(x, 4), low));
    return _mm512_or_si512(_mm512_slli_epi16(bottom, 4), top);
  };
#if EVS_VECTOR_BITS == 512
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
#elif EVS_NEON
EVS_INLINE Int reverse_bits(Int a) {
  for (IntPart& part : a.v) part = (IntPart)vrev32q_u8(vrbitq_u8((uint8x16_t)part));
  return a;
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

// Nested uniform scramble of bit-reversed numbers.
EVS_INLINE Int scramble_reversed(Int a, Int seed) {
  a = a ^ (a * splat(0x3d20adea));
  a = a + seed;
  a = a * (shift_right_unsigned<16>(seed) | splat(1));
  a = a ^ (a * splat(0x05526c56));
  return a ^ (a * splat(0x53a22864));
}

// The 24 leading bits as a float in [0, 1).
EVS_INLINE Float to_unit_float(Int a) {
  return to_float(shift_right_unsigned<8>(a)) * 5.9604644775390625e-8f;
}

// What the numbers of one dimension follow from.
struct DimensionKey {
  unsigned mixed;  // of seed and dimension
  Int pixel;       // of these and the pixel
};
EVS_INLINE DimensionKey dimension_key(const Sampler& s, int dimension) {
  Int seed_pixel = s.pixel;
  if (s.mode == SAMPLES_GLOBAL) seed_pixel = splat(0);
  unsigned mixed =
      hash(static_cast<unsigned>(s.seed) * 0x9e3779b9u + static_cast<unsigned>(dimension));
  return {mixed, hash(seed_pixel ^ splat(static_cast<int>(mixed)))};
}

// The index of a Sobol point. Their order is shuffled, so that dimensions pair differently.
EVS_INLINE Int point_index(const Sampler& s, const DimensionKey& key) {
  Int order = s.mode == SAMPLES_SOBOL ? splat(static_cast<int>(hash(key.mixed)))
                                      : hash(key.pixel ^ splat(0x2c1b3c6d));
  // differently in each block
  Int order_in_block =
      order + splat(static_cast<int>(static_cast<unsigned>(s.block) * 0x9e3779b9u));
  Int index = reverse_bits(scramble_reversed(s.reversed_index, order_in_block)) &
              splat((1 << s.log2_samples) - 1);
  Int block = splat(s.block);
  if (s.log2_blocks > 0) block = block ^ (hash(order) & splat((1 << s.log2_blocks) - 1));
  if (s.quarters) {
    // The first quarter of a block's samples is used alone, together with those of other blocks.
    // Each of four blocks takes another quarter of its points, in Gray code: then those of all four
    // are as even, but for one of the five shapes of sixteen equal boxes.
    const int quarter = s.log2_samples - 2;
    Int own = reverse_bits(s.reversed_index), gray = block ^ shift_right_unsigned<1>(block);
    Int moved = (gray ^ shift_right_unsigned<8>(hash(order ^ splat(0x5bd1e995)))) & splat(3);
    index = (index & splat((1 << quarter) - 1)) |
            ((own ^ (moved * splat(1 << quarter))) & splat(3 << quarter));
  }
  if (s.log2_blocks > 0) index = index | (block * splat(1 << s.log2_samples));
  return index;
}

// Sample one dimension: two numbers in [0, 1).
EVS_INLINE Point2 sample_2d(const Sampler& s, int dimension) {
  DimensionKey key = dimension_key(s, dimension);
  if (s.mode == SAMPLES_RANDOM) {
    const int before = s.block << s.log2_samples;
    Int a = hash(key.pixel + hash(reverse_bits(s.reversed_index) + splat(before + 1)));
    return {to_unit_float(a), to_unit_float(hash(a ^ splat(0x68bc21eb)))};
  }
  Int index = point_index(s, key);
  // the direction numbers of the second dimension are Pascal's triangle modulo 2
  Int second = splat(0);
  unsigned direction = 0x80000000u;
  for (int i = 0; i < s.log2_samples + s.log2_blocks; i++) {
    Mask set = (index & splat(1 << i)) == splat(1 << i);
    second = select(set, second ^ splat(static_cast<int>(direction)), second);
    direction ^= direction >> 1;
  }
  Int shift_x = hash(key.pixel + splat(0x1b873593)), shift_y = hash(key.pixel + splat(0x27d4eb2f));
  if (s.mode == SAMPLES_SOBOL)
    return {to_unit_float(reverse_bits(index) + shift_x), to_unit_float(second + shift_y)};
  return {to_unit_float(reverse_bits(scramble_reversed(index, shift_x))),
          to_unit_float(reverse_bits(scramble_reversed(reverse_bits(second), shift_y)))};
}

// A number in [0, 1) that chooses between a surface and its mirror at the first vertex. It follows
// the order of the points in the pixel, and `u` between two of them. So the samples that see the
// mirror, and the others, are each spread evenly over the pixel.
EVS_INLINE Float mirror_choice(const Sampler& s, int pixel_dimension, Float u) {
  if (s.mode == SAMPLES_RANDOM || s.mode == SAMPLES_ANCHORED) return u;
  const int strata = 1 << (s.quarters ? s.log2_samples - 2 : s.log2_samples);
  Int index = point_index(s, dimension_key(s, pixel_dimension)) & splat(strata - 1);
  Float choice = (to_float(index) + u) * (1.0f / static_cast<float>(strata));
  return min(choice, splat(0.99999994f));
}

// Identify the surface cell that a camera ray hits, in the geom's own frame. A cell is a power of
// two wide, 3/4 to 3/2 of the pixel's footprint, so it stays the same until the camera is twice as
// near.
inline Int surface_anchor(const Frame& f, const Rays& rays, const Hit& hit, Mask lit) {
  float pixel = f.pixel_angle * __builtin_sqrtf(static_cast<float>(f.samples));
  Float footprint = (f.orthographic ? splat(1.0f) : hit.distance) * (1.5f * pixel);
  Int exponent = as_int(footprint) & splat(0x7f800000);
  Float inverse = 1.0f / as_float(exponent);
  auto cell = [&](Float x) {
    // keep cell borders off 0 and round sizes, where rounding would split a face; clamp, so that
    // any value, even a NaN, fits an Int
    return truncate(floor(min(max(x * inverse + 0.381966f, splat(-1e9f)), splat(1e9f))));
  };
  Int anchor = splat(0);
  for (unsigned lanes = to_bits(lit); lanes;) {
    int index = lane(hit.geom, first_lane(lanes));
    Mask here = (hit.geom == splat(index)) & mask_from_bits(lanes);
    lanes &= ~to_bits(here);
    const Geom& g = f.geoms[index];
    Vec p = local_origin(g, rays) + to_local(g.rotation, rays.direction) * hit.distance;
    Int key = hash(exponent ^ splat(static_cast<int>(hash(static_cast<unsigned>(index)))));
    key = hash(cell(p.z) ^ hash(cell(p.y) ^ hash(cell(p.x) ^ key)));
    anchor = select(here, key, anchor);
  }
  return anchor;
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
