"""The earth mover's distance of event sequences, per pixel and polarity: the paper's training loss.

Equation numbers are those of the EventTracer paper, counted from its first: (7) is labelled `emd`,
(8) `emd2`; (9) adds the two polarities.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from evs.msgs import Events
from evs_lab.metrics.window import Window

F64 = npt.NDArray[np.float64]


def emd_map(events: Events, reference: Events, window: Window, tick_us: int = 1000) -> F64:
    """Bidirectional EMD of every pixel and polarity, equations (7) and (8).

    A window of K ticks gives each pixel and polarity two sequences: S_i events and E_i reference
    events in tick i = 1 ... K. Equation (7) compares their running sums,

        L(E, S) = 1/K sum_i |sum_{j <= i} S_j - sum_{j <= i} E_j|,

    and (8) is the mean of that and of the same for the reversed sequences. The unit is events: one
    event that comes d ticks early or late costs d / K.

    Equal counts: both directions agree, and K L' is the sum of |i - i'| ticks over events paired in
    order. Unequal counts: forwards the surplus is moved past the end (tick K + 1), backwards before
    the beginning (tick 0). One side empty: n events cost n (K + 1) / 2K, so about half an event
    each, wherever they are. Both empty: 0.
    Several events in a tick all count; stamps inside a tick make no difference.

    Sorted events and one pass over them, all pixels at once: O((n + m) log(n + m)), whatever K.
    Sums are whole numbers, so only the last division rounds.

    Args:
        events: (n,) EVENT_DTYPE, any order; those outside the window are left out
        reference: (m,) EVENT_DTYPE, likewise
        window: pixels and time
        tick_us: length of a tick, us; the window is a multiple of it

    Returns:
        (2, height, width) float64, events; [0] OFF, [1] ON

    Raises:
        EvsError: impossible events, or a window that is no multiple of the tick
    """
    ticks = window.ticks(tick_us)
    events, reference = window.cut(events), window.cut(reference, "reference")
    moved = np.zeros(2 * window.pixels, np.int64)
    if len(events) + len(reference):
        both = [(events, 1), (reference, -1)]
        # tick i owns (t_{i-1}, t_i]
        tick = np.concatenate([-((window.t_begin_us - part["t"]) // tick_us) for part, _ in both])
        cell = np.concatenate(
            [
                part["p"].astype(np.int64) * window.pixels + window.pixel_index(part)
                for part, _ in both
            ]
        )
        weight = np.concatenate([np.full(len(part), sign, np.int64) for part, sign in both])
        order = np.lexsort((tick, cell))
        moved = _moved(cell[order], tick[order], weight[order], ticks, 2 * window.pixels)
    return (moved / (2 * ticks)).reshape(2, window.height, window.width)


def mean_emd(events: Events, reference: Events, window: Window, tick_us: int = 1000) -> float:
    """L_EMD, equation (9): both polarities added; the mean over all pixels of the window.

    Arguments, unit and errors as `emd_map`. It rewards silence, since a missing event costs as
    much as an additional one, half an event: always report it with recall and count ratio.
    """
    return float(emd_map(events, reference, window, tick_us).sum() / window.pixels)


def _moved(
    cell: npt.NDArray[np.int64],
    tick: npt.NDArray[np.int64],
    weight: npt.NDArray[np.int64],
    ticks: int,
    cells: int,
) -> npt.NDArray[np.int64]:
    """Sum over i of |D_i| + |D_K - D_{i-1}| for each cell, D_i the running sum up to tick i.

    D_K - D_{i-1} is the running sum of the reversed sequences. D changes at events only, so each
    event stands for the ticks up to the next one of its cell.

    Args:
        cell: (n,) increasing, 0 ... cells - 1
        tick: (n,) 1 ... ticks, increasing within a cell
        weight: (n,) +1 or -1
        ticks: K
        cells: how many

    Returns:
        (cells,) int64
    """
    first = np.concatenate([[True], cell[1:] != cell[:-1]])
    start = np.flatnonzero(first)
    last = np.concatenate([start[1:], [len(cell)]]) - 1
    group = np.cumsum(first) - 1

    running = np.cumsum(weight)
    before = (running - weight)[start]
    running -= before[group]
    total = running[last]

    # the last event of a cell stands for its own tick and all that follow
    until = np.append(tick[1:], 0)
    until[last] = ticks + 1
    length = until - tick
    change = (np.abs(running) + np.abs(total[group] - running)) * length
    # backwards, the ticks before the first event count too; forwards, i = K + 1 does not exist
    sums = np.add.reduceat(change, start) + np.abs(total) * tick[start]
    moved = np.zeros(cells, np.int64)
    moved[cell[start]] = sums
    return moved
