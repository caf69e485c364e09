// Of all hits that read a node, the first in the order of their bits (`is_before`), found word by
// word: so many threads can look at once.
#pragma once

#include <cstdint>

#include "scene/irradiance.h"

namespace evs {

constexpr int HIT_WORDS = 3;  // of 8 bytes: a point and a normal
constexpr uint64_t NO_HIT = ~uint64_t{0};

// Word `w` of a hit; words are ordered as their bytes are.
inline uint64_t hit_word(const CellReader& hit, int w) {
  uint64_t word = 0;
  for (int i = 2 * w; i < 2 * w + 2; i++) {
    uint32_t bits = __builtin_bit_cast(uint32_t, i < 3 ? hit.point[i] : hit.normal[i - 3]);
    for (int byte = 0; byte < 4; byte++) word = word << 8 | (bits >> 8 * byte & 0xff);
  }
  return word;
}

// The point and normal of those words.
inline void hit_of_words(const uint64_t* words, float* point, float* normal) {
  for (int i = 0; i < 6; i++) {
    uint32_t half = static_cast<uint32_t>(i % 2 ? words[i / 2] : words[i / 2] >> 32), bits = 0;
    for (int byte = 0; byte < 4; byte++) bits = bits << 8 | (half >> 8 * byte & 0xff);
    (i < 3 ? point[i] : normal[i - 3]) = __builtin_bit_cast(float, bits);
  }
}

// Offer word `w` of a hit to the nodes that it reads, after all hits have offered the words before.
// In: least(place, word), which keeps the smaller one. In/out: first (nodes, HIT_WORDS).
template <class Least>
inline void offer_word(const CellReader& hit, int w, uint64_t* first, const Least& least) {
  for (int node : hit.node) {
    uint64_t* words = first + static_cast<long>(HIT_WORDS) * node;
    bool tied = true;
    for (int before = 0; before < w; before++)
      tied = tied && words[before] == hit_word(hit, before);
    if (tied) least(words + w, hit_word(hit, w));
  }
}

}  // namespace evs
