// The light of a cycle of point sets: the mean of the sets, each traced in a tick of its own.
#pragma once

#include <cstddef>

namespace evs {

// Combine the light of the sets of a cycle. In: planes (sets, count), each as of the tick that
// traced it last; newest, the set of this tick; before (count), that set's light one cycle ago.
// Out: light (count).
//
// Where nothing moves, a set gives the same light again, bit for bit, and the result is the mean of
// all sets. Where light changes, that mean is blurred over a cycle. The change of one set since its
// last turn is known without noise, since its samples are the same. Where it is large beside the
// noise, which the spread of the sets shows, the one or two sets in the middle of the cycle are
// used instead: they are as late as the mean, but sharper.
void combine_cycle(const float* planes, const float* before, int sets, int newest, size_t count,
                   float* light);

}  // namespace evs
