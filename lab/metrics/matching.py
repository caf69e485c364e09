"""Match events one to one with reference events, as many pairs as possible.

Two events may be a pair when their polarity is the same, their stamps differ by at most
tolerance_us and their pixels by at most tolerance_px in x and in y (Chebyshev); both bounds are
closed. The pairs chosen are a maximum matching of that bipartite graph, so recall and precision
depend on the two streams alone: not on the order of events, not on ties, and swapping the streams
swaps the two numbers. A greedy choice alone has none of this and may lose up to half of the pairs.

Which of the maximum matchings: pairs are first taken greedily, same pixel first, then the nearest
in time, then the earlier event, then the earlier reference event; `enlarge_matching` then adds
what greed has lost, and moves as few pairs as lie on a shortest path.

Cost, for n events, m reference events, E pairs allowed by the tolerances and r = tolerance_px:
O((2r + 1)^2 n log m) vectorised for finding them, O(E log E) for the greedy part, O(E sqrt(n + m))
at worst for the rest. E is bounded (MAX_PAIRS) because it lies in memory: about 60 bytes a pair.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from evs.msgs import Events, EvsError
from evs_lab.metrics.window import check_fields, whole_number

I64 = npt.NDArray[np.int64]

MAX_PAIRS = 20_000_000
"""pairs within tolerance, per polarity"""
MAX_TOLERANCE_PX = 16
_BLOCK = 1 << 18  # lists of numbers take five times an array's memory


@dataclass(frozen=True, eq=False)
class Matching:
    """Pairs of events and reference events; every event is in at most one."""

    events: int
    """n, number of events"""
    references: int
    """m, number of reference events"""
    event_index: I64 = field(repr=False)
    """(pairs,) int64 into the events, increasing"""
    reference_index: I64 = field(repr=False)
    """(pairs,) int64 into the reference events: the partner"""

    @property
    def pairs(self) -> int:
        """Number of pairs."""
        return len(self.event_index)

    @property
    def recall(self) -> float:
        """Share of the reference events that were found: pairs / m. NaN for m = 0."""
        return self.pairs / self.references if self.references else float("nan")

    @property
    def precision(self) -> float:
        """Share of the events that are right: pairs / n; 1 - false share. NaN for n = 0."""
        return self.pairs / self.events if self.events else float("nan")

    def unmatched(self) -> npt.NDArray[np.bool_]:
        """(n,) bool: events without a partner."""
        alone = np.ones(self.events, np.bool_)
        alone[self.event_index] = False
        return alone


def match_events(
    events: Events, reference: Events, tolerance_us: int = 3000, tolerance_px: int = 1
) -> Matching:
    """Find the largest set of one-to-one pairs; the module describes which one of several.

    Args:
        events: (n,) EVENT_DTYPE, any order
        reference: (m,) EVENT_DTYPE, any order
        tolerance_us: largest difference of stamps, us, itself allowed
        tolerance_px: largest difference of x and of y, px, itself allowed; up to MAX_TOLERANCE_PX

    Raises:
        EvsError: not events, an impossible tolerance, or more pairs than MAX_PAIRS
    """
    check_fields(events, "events")
    check_fields(reference, "reference")
    tolerance_us = whole_number("tolerance_us", tolerance_us, lowest=0)
    tolerance_px = whole_number("tolerance_px", tolerance_px, lowest=0)
    if tolerance_px > MAX_TOLERANCE_PX:
        raise EvsError(f"tolerance_px is {tolerance_px}; give at most {MAX_TOLERANCE_PX} px")

    # polarities never meet: two smaller problems
    found: list[tuple[I64, I64]] = []
    for polarity in np.union1d(events["p"], reference["p"]):
        of_events = _by_time(events, polarity)
        of_reference = _by_time(reference, polarity)
        left, right = _match_one_polarity(
            events[of_events], reference[of_reference], tolerance_us, tolerance_px
        )
        found.append((of_events[left], of_reference[right]))
    none = np.zeros(0, np.int64)
    event_index = np.concatenate([none, *(pair[0] for pair in found)])
    reference_index = np.concatenate([none, *(pair[1] for pair in found)])
    order = np.argsort(event_index)
    return Matching(len(events), len(reference), event_index[order], reference_index[order])


def _by_time(events: Events, polarity: int) -> I64:
    """Indices of the events of one polarity, by (t, y, x)."""
    chosen = np.flatnonzero(events["p"] == polarity)
    part = events[chosen]
    ordered: I64 = chosen[np.lexsort((part["x"], part["y"], part["t"]))]
    return ordered


def _match_one_polarity(
    events: Events, reference: Events, tolerance_us: int, tolerance_px: int
) -> tuple[I64, I64]:
    """Indices (pairs,) of a maximum matching; the arguments are sorted by (t, y, x)."""
    if not len(events) or not len(reference):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    left, right = _allowed_pairs(events, reference, tolerance_us, tolerance_px)

    # best first: distance in px, then in time, then the earlier event, then the earlier reference
    away = np.abs(events["t"][left] - reference["t"][right])
    far = np.maximum(
        np.abs(events["x"][left].astype(np.int32) - reference["x"][right]),
        np.abs(events["y"][left].astype(np.int32) - reference["y"][right]),
    )
    order = np.lexsort((right, left, away, far))
    left, right = left[order], right[order]
    del away, far, order

    # the greedy part: the best pair whose two events are both free, again and again
    listed_event, listed_reference = [-1] * len(events), [-1] * len(reference)
    for begin in range(0, len(left), _BLOCK):
        block = slice(begin, begin + _BLOCK)
        for i, j in zip(left[block].tolist(), right[block].tolist(), strict=True):
            if listed_event[i] < 0 and listed_reference[j] < 0:
                listed_event[i] = j
                listed_reference[j] = i

    # each event's partners stay in order, best first
    order = np.argsort(left, kind="stable")
    starts = np.searchsorted(left[order], np.arange(len(events) + 1))
    partner_of_event = np.array(listed_event, np.int64)
    partner_of_reference = np.array(listed_reference, np.int64)
    enlarge_matching(starts, right[order], partner_of_event, partner_of_reference)
    matched = np.flatnonzero(partner_of_event >= 0)
    return matched, partner_of_event[matched]


def _allowed_pairs(
    events: Events, reference: Events, tolerance_us: int, tolerance_px: int
) -> tuple[I64, I64]:
    """(E,) indices into events and into reference of all pairs within the tolerances."""
    # one number orders the reference by pixel, then time; a gap after each pixel's last stamp and
    # each row's last pixel keeps neighbours in memory apart
    t_low, t_high = _range("t", events, reference)
    tolerance_us = min(tolerance_us, t_high - t_low)
    span = t_high - t_low + tolerance_us + 1
    x_low, x_high = _range("x", events, reference)
    columns = x_high - x_low + tolerance_px + 1
    y_low, y_high = _range("y", events, reference)
    if columns * (y_high - y_low + 2 * tolerance_px + 1) * span >= 2**63:
        raise EvsError(
            f"{t_high - t_low} us of events on {x_high - x_low + 1} x {y_high - y_low + 1} px "
            "are too much for one comparison; cut them into shorter windows"
        )

    def address(part: Events, dy: int, dx: int) -> I64:
        rows = part["y"].astype(np.int64) + (dy - y_low)
        cells: I64 = (rows * columns + part["x"] + (dx - x_low)) * span
        cells += part["t"] - t_low
        return cells

    keys = address(reference, 0, 0)
    by_cell = np.argsort(keys, kind="stable")
    keys = keys[by_cell]

    steps = range(-tolerance_px, tolerance_px + 1)
    ranges = []
    total = 0
    for dy in steps:
        for dx in steps:
            target = address(events, dy, dx)
            first = np.searchsorted(keys, target - tolerance_us, "left")
            count = np.searchsorted(keys, target + tolerance_us, "right") - first
            ranges.append((first, count))
            total += int(count.sum())
    if total > MAX_PAIRS:
        raise EvsError(
            f"{total} pairs of events lie within the tolerances, more than {MAX_PAIRS}; "
            "compare shorter windows or lower tolerance_us"
        )

    left = [np.repeat(np.arange(len(events)), count) for _, count in ranges]
    right = [by_cell[_expand(first, count)] for first, count in ranges]
    return np.concatenate(left), np.concatenate(right)


def _range(name: str, events: Events, reference: Events) -> tuple[int, int]:
    """Lowest and highest value of a field in both."""
    both = events[name], reference[name]
    return min(int(part.min()) for part in both), max(int(part.max()) for part in both)


def _expand(first: I64, count: I64) -> I64:
    """first[0], first[0] + 1, ... (count[0] numbers), then those of first[1], and so on."""
    before = np.cumsum(count) - count
    numbers: I64 = np.arange(int(count.sum())) + np.repeat(first - before, count)
    return numbers


@dataclass(frozen=True)
class TimingError:
    """t_event - t_reference over all pairs, us; positive is late. NaN where there is no pair.

    Errors are limited by the tolerance of the matching, so read them with recall. Pairs of two
    different pixels count too; match with tolerance_px = 0 to exclude them.
    """

    pairs: int
    median_us: float
    """the bias"""
    iqr_us: float
    """the spread: third minus first quartile"""
    median_abs_us: float
    """median of the absolute error"""


def measure_timing(events: Events, reference: Events, matching: Matching) -> TimingError:
    """The stamp errors of a matching's pairs; quartiles interpolate linearly.

    Args:
        events: (n,) EVENT_DTYPE, those that were matched
        reference: (m,) EVENT_DTYPE, likewise
        matching: of these two
    """
    error = events["t"][matching.event_index] - reference["t"][matching.reference_index]
    if not len(error):
        return TimingError(0, float("nan"), float("nan"), float("nan"))
    low, middle, high = np.quantile(error, [0.25, 0.5, 0.75])
    return TimingError(
        len(error), float(middle), float(high - low), float(np.median(np.abs(error)))
    )


def enlarge_matching(
    starts: I64, neighbours: I64, partner_of_left: I64, partner_of_right: I64
) -> None:
    """Extend a bipartite matching to a maximum one, by shortest augmenting paths.

    A vertex that has a partner keeps one, but maybe another one. O(E sqrt(n + m)); only the walks
    along paths are not vectorised, so a start that is nearly maximum is cheap. Left vertices are
    numbered 0 ... n - 1, right ones 0 ... m - 1.

    Source: J. Hopcroft, R. Karp, "An n^5/2 algorithm for maximum matchings in bipartite graphs",
    SIAM J. Comput. 2 (1973).

    Args:
        starts: (n + 1,) int64; the neighbours of i are neighbours[starts[i] : starts[i + 1]]
        neighbours: (E,) int64 right vertices, tried in this order
        partner_of_left: (n,) int64, in and out: right vertex or -1
        partner_of_right: (m,) int64, in and out: left vertex or -1
    """
    while True:
        left, right = _edges_of_shortest_paths(
            starts, neighbours, partner_of_left, partner_of_right
        )
        if not len(left):
            return
        _flip_disjoint_paths(left, right, partner_of_left, partner_of_right)


def _edges_of_shortest_paths(
    starts: I64, neighbours: I64, partner_of_left: I64, partner_of_right: I64
) -> tuple[I64, I64]:
    """All unmatched edges of all shortest paths from a free left to a free right vertex.

    Returns:
        (k,) left and (k,) right ends; edges of one left vertex stand together, in the order of
        `neighbours`. Empty: there is no such path, the matching is maximum.
    """
    # breadth first over alternating paths, layer by layer, until one meets free right vertices
    layers: list[tuple[I64, I64]] = []
    seen = np.zeros(len(partner_of_right), np.bool_)
    frontier = np.flatnonzero(partner_of_left < 0)
    useful = np.zeros(len(partner_of_right), np.bool_)
    while len(frontier) and not useful.any():
        count = starts[frontier + 1] - starts[frontier]
        left = np.repeat(frontier, count)
        shift = np.repeat(starts[frontier] - (np.cumsum(count) - count), count)
        right = neighbours[np.arange(len(left)) + shift]
        new = ~seen[right]
        layers.append((left[new], right[new]))
        seen[right] = True
        reached = np.unique(right[new])
        owners = partner_of_right[reached]
        useful[reached[owners < 0]] = True
        frontier = owners
    if not useful.any():
        return np.zeros(0, np.int64), np.zeros(0, np.int64)

    # back from those free vertices: only edges that lead to one
    edges: list[tuple[I64, I64]] = []
    for left, right in reversed(layers):
        leads = useful[right]
        edges.append((left[leads], right[leads]))
        back = partner_of_left[edges[-1][0]]
        useful[back[back >= 0]] = True
    return np.concatenate([edge[0] for edge in edges]), np.concatenate([edge[1] for edge in edges])


def _flip_disjoint_paths(
    left: I64, right: I64, partner_of_left: I64, partner_of_right: I64
) -> None:
    """Augment along shortest paths without a common vertex, as many as a depth-first walk finds.

    Arguments as `_edges_of_shortest_paths` returns them; the matching is changed.
    """
    vertices, first, count = np.unique(left, return_index=True, return_counts=True)
    # lists and dicts are faster than arrays where one number is read at a time
    ends = right.tolist()
    following = dict(zip(vertices.tolist(), first.tolist(), strict=True))
    stop = dict(zip(vertices.tolist(), (first + count).tolist(), strict=True))
    owner = dict(zip(ends, partner_of_right[right].tolist(), strict=True))
    used: set[int] = set()

    for root in vertices[partner_of_left[vertices] < 0].tolist():
        path = [root]
        while path:
            # each edge is tried once in all walks together
            vertex = path[-1]
            position = following[vertex]
            if position == stop[vertex]:
                path.pop()
                continue
            following[vertex] = position + 1
            end = ends[position]
            if end in used:
                continue
            used.add(end)
            if owner[end] >= 0:
                path.append(owner[end])
                continue
            for step in path:
                end = ends[following[step] - 1]
                partner_of_left[step] = end
                partner_of_right[end] = step
            break
