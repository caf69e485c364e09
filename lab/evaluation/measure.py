"""Measure the events of one model on the light of one clip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.msgs import Events
from evs_lab.evaluation.clip import TICK_US, Clip
from evs_lab.metrics import (
    Matching,
    Window,
    compare_rate_maps,
    count_map,
    match_events,
    mean_emd,
    measure_timing,
)

TOLERANCE_US = 3000
TOLERANCE_PX = 1
"""on the patch; pixels that are spread over the image have no neighbours"""

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Measures:
    """Numbers of one stream. They are sums, so that clips can be pooled. NaN: not defined."""

    pixels: int
    """pixels that are spread over the image"""
    seconds: float
    emd: float
    """events per pixel: the paper's equation (9), its mean over the pixels"""
    on: int
    off: int
    """events"""
    reference_on: int
    reference_off: int
    """events of converged light"""
    pairs: int
    """one-to-one pairs on the same pixel within 3 ms, as many as there can be"""
    static_px: int
    """pixels whose converged light stands still"""
    static_events: int
    """events on them: all false"""
    delay_us: float
    """median over the pairs of stamp less stamp of the reference"""
    timing_us: float
    """median over the pairs of its size"""
    rmse_hz: float
    """root of the mean square of the difference of the pixels' event rates"""
    kl_nats: float
    """Kullback-Leibler divergence of where the events fall"""
    correlation: float
    """Pearson's, of the event rates of the pixels"""
    patch_px: int
    """pixels of the patch"""
    patch_emd: float
    """as emd, of the patch"""
    patch_events: int
    patch_reference: int
    patch_pairs: int
    """within 3 ms and one pixel"""
    ms_per_tick: float
    """of the model alone, all pixels"""


def measure(
    events: Events,
    reference: Events,
    clip: Clip,
    static: Mask,
    t_begin_us: int,
    t_end_us: int,
    ms_per_tick: float = 0.0,
) -> Measures:
    """Measure the events of all pixels of a clip in (t_begin_us, t_end_us].

    Args:
        events: x is the number of the pixel, y 0.
        reference: x is the number of the pixel, y 0.
        clip: the clip.
        static: (n,), pixels whose converged light stands still.
        t_begin_us: begin of the window.
        t_end_us: end of the window.
        ms_per_tick: cost of the model.

    Raises:
        EvsError: the events are not valid.
    """
    window = Window(clip.sampled, 1, t_begin_us, t_end_us)
    patch = Window(clip.patch_px, clip.patch_px, t_begin_us, t_end_us)
    spread, spread_reference = (_spread(part, clip, window) for part in (events, reference))
    found = match_events(spread, spread_reference, TOLERANCE_US, 0)
    timing = measure_timing(spread, spread_reference, found)
    counts, wanted = count_map(spread, window), count_map(spread_reference, window)
    maps = compare_rate_maps(counts, wanted, window.duration_s)
    square, square_reference = (_square(part, clip, patch) for part in (events, reference))
    near: Matching = match_events(square, square_reference, TOLERANCE_US, TOLERANCE_PX)
    still = static[: clip.sampled]
    on, reference_on = (int(np.count_nonzero(p["p"] == 1)) for p in (spread, spread_reference))
    return Measures(
        pixels=window.pixels,
        seconds=window.duration_s,
        emd=mean_emd(spread, spread_reference, window, TICK_US),
        on=on,
        off=len(spread) - on,
        reference_on=reference_on,
        reference_off=len(spread_reference) - reference_on,
        pairs=found.pairs,
        static_px=int(np.count_nonzero(still)),
        static_events=int(counts[0, still].sum()),
        delay_us=timing.median_us,
        timing_us=timing.median_abs_us,
        rmse_hz=maps.rmse_hz,
        kl_nats=maps.kl_nats,
        correlation=maps.correlation,
        patch_px=patch.pixels,
        patch_emd=mean_emd(square, square_reference, patch, TICK_US),
        patch_events=near.events,
        patch_reference=near.references,
        patch_pairs=near.pairs,
        ms_per_tick=ms_per_tick,
    )


def _spread(events: Events, clip: Clip, window: Window) -> Events:
    """The events of the pixels that are spread over the image."""
    return window.cut(events[events["x"] < clip.sampled])


def _square(events: Events, clip: Clip, window: Window) -> Events:
    """The events of the patch, with their positions in it."""
    inside = events[events["x"] >= clip.sampled].copy()
    number = inside["x"].astype(np.int64) - clip.sampled
    inside["x"], inside["y"] = number % clip.patch_px, number // clip.patch_px
    return window.cut(inside)
