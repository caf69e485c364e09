"""Extend a bipartite matching to the largest one, by shortest augmenting paths.

Source: J. Hopcroft, R. Karp, "An n^5/2 algorithm for maximum matchings in bipartite graphs", SIAM
J. Comput. 2 (1973). Left vertices are numbered 0 ... n-1, right ones 0 ... m-1.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

I64 = npt.NDArray[np.int64]


def enlarge_matching(
    starts: I64, neighbours: I64, partner_of_left: I64, partner_of_right: I64
) -> None:
    """Changes the two arrays, a matching of any size, into a maximum matching.

    Whoever has a partner keeps one, though maybe another. O(E sqrt(n + m)); vectorised but for
    the walks along paths, so a start that is nearly maximum is cheap.

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
    kept: list[tuple[I64, I64]] = []
    for left, right in reversed(layers):
        leads = useful[right]
        kept.append((left[leads], right[leads]))
        back = partner_of_left[kept[-1][0]]
        useful[back[back >= 0]] = True
    return np.concatenate([edge[0] for edge in kept]), np.concatenate([edge[1] for edge in kept])


def _flip_disjoint_paths(
    left: I64, right: I64, partner_of_left: I64, partner_of_right: I64
) -> None:
    """Augments along shortest paths without a common vertex, as many as a depth-first walk finds.

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
