"""Event intensity: events of a pixel in 1/60 s, of our pipelines and of other people's simulators.

A park by day before a camera that pans and circles, 1 kHz. The reference is the noise-free pixel on
light of many samples. Other simulators get that same light; our pipelines for few samples trace
their own. v2e and DVS-Voltmeter run in a venv (speed/v2e.py, speed/voltmeter.py); without it
their rows are missing. V2CE needs a trained network and is left out.
lab/docs/simulators.md shows what
`.venv/bin/pytest -m bench -s lab/tests/bench/test_simulators_study.py` prints and draws.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import evs
from evs.drivers.pictures import events_between, upscale, write_png
from evs.drivers.pictures.chart import INK_RGB, RGB, Chart, Scale, Series, draw_charts
from evs.drivers.pictures.text_lines import legend_line, paste, side_by_side, text_line
from evs.emulator.base.scene import F32
from evs.emulator.config import ModelConfig, RenderConfig
from evs.msgs import Events, join_events
from evs.msgs.pictures import PAPER, U8, event_frame, to_srgb8
from reference.esim import EVENT, esim
from reference.hand_held import hand_held
from reference.intensity import (
    MANY,
    binned,
    counts_of,
    earth_mover,
    frame_times_us,
    histogram,
    tenths,
    total_variation,
)
from reference.reconstruction import F64
from speed.elsewhere import AbsentError
from speed.v2e import v2e_events
from speed.voltmeter import voltmeter_events

CHECKOUT = Path(__file__).parents[3]
PICTURE = CHECKOUT / "lab/docs/img/simulators.png"
CHARTS = CHECKOUT / "lab/docs/img/event_intensity.png"

SCENE, WIDTH, HEIGHT, TICK_US = "park", 128, 96, 1000
PAN_PX_S, CIRCLE_PX = 60.0, 12.0
EDGES_US = frame_times_us(19)[6:]
"""of the voxels: 0.1 s to 0.3 s; before, networks and filters settle"""
TICKS = 322
"""the network of the paper is 21 ms late"""
EXPOSURE_DN = 60.0
"""30 % of the pixels of the film lie below"""
HALF_SPP = 32
"""samples a pixel of each half of the reference's light"""

THRESHOLD, SEED = 0.2, 1
BOTH: dict[str, Any] = {"pos_thres": THRESHOLD, "neg_thres": THRESHOLD}
V2E_ALIKE: dict[str, Any] = {**BOTH, "sigma_thres": 0.0, "cutoff_hz": 0, "leak_rate_hz": 0}
V2E_DEFAULTS: dict[str, Any] = {
    **BOTH,
    "sigma_thres": 0.03,
    "cutoff_hz": 300.0,
    "leak_rate_hz": 0.01,
    "shot_noise_rate_hz": 0.001,
    "refractory_period_s": 5e-4,
}
"""of its command; those of the class differ"""

REFERENCE, SILENCE, HALF = "reference", "no events", "evs, half of the light"
Row = Callable[[Path], Events]
"""a folder for files -> events, without a delay"""


@cache
def traced(spp: int, seeds: str, seed: int) -> F32:
    """(TICKS + 1, HEIGHT, WIDTH) luminance of the film, by path."""
    render = RenderConfig(renderer="path", spp=spp, bounces=1, seeds=seeds)
    size = WIDTH, HEIGHT
    return np.stack([*hand_held(SCENE, size, TICKS, render, seed, PAN_PX_S, CIRCLE_PX)])


@cache
def exposure() -> float:
    """DN for one unit of luminance."""
    light = traced(HALF_SPP, "fixed", 1)[::50]
    return EXPOSURE_DN / float(np.quantile(light, 0.3))


def light_of(spp: int, seeds: str = "fixed", seed: int = 3) -> F32:
    """The film in DN."""
    return traced(spp, seeds, seed) * np.float32(exposure())


@cache
def converged() -> F32:
    """The film in DN, of both halves of the samples."""
    return (light_of(HALF_SPP, seed=1) + light_of(HALF_SPP, seed=2)) / np.float32(2)


def as_coded(dn: F32) -> npt.NDArray[np.uint8]:
    """8-bit sRGB, as a film has it; 255 DN is white and where it ends."""
    return to_srgb8(dn.reshape(-1, WIDTH), 1 / 255).reshape(dn.shape)


def frames(fps: int) -> tuple[list[int], F32]:
    """Times (us) and light of the film in 1000 or 60 FPS."""
    every = [TICK_US * k for k in range(TICKS + 1)]
    times_us = every if fps == 1000 else [t for t in frame_times_us(26) if t <= every[-1]]
    return times_us, converged()[[t // TICK_US for t in times_us]]


def ours(
    preset: str = "ideal",
    model: str | ModelConfig = "plain",
    light: Callable[[], F32] = converged,
    late_us: int = 0,
    **keys: Any,
) -> Row:
    """A row of evs, on light of its own or on that of the reference."""

    def row(_: Path) -> Events:
        pixels = evs.Pixels(
            preset, (WIDTH, HEIGHT), model=model, unit="dn", seed=SEED, threads=2, **BOTH, **keys
        )
        parts = [pixels.observe(frame, TICK_US * k) for k, frame in enumerate(light())]
        events = join_events([*parts, pixels.finish()])
        events["t"] -= late_us + pixels.info.latency_us
        return events

    return row


def ours_at_60(_: Path) -> Events:
    """The noise-free pixel of evs on 60 FPS."""
    pixels = evs.Pixels("ideal", (WIDTH, HEIGHT), unit="dn", threads=2, **BOTH)
    parts = [pixels.observe(frame, t) for t, frame in zip(*frames(60), strict=True)]
    return join_events([*parts, pixels.finish()])


def of_v2e(fps: int, coded: bool, options: dict[str, Any]) -> Row:
    """A row of v2e, on linear floats, or on 8 bits as a film has them."""

    def row(folder: Path) -> Events:
        times_us, dn = frames(fps)
        film = as_coded(dn) if coded else dn
        t, x, y, p = v2e_events(folder, film, {"seed": SEED, **options}, times_us).T
        return np.rec.fromarrays([np.rint(1e6 * t), x, y, p > 0], dtype=EVENT)

    return row


def of_voltmeter(fps: int, coded: bool) -> Row:
    """A row of DVS-Voltmeter, on linear floats, or on 8 bits as a film has them."""

    def row(folder: Path) -> Events:
        times_us, dn = frames(fps)
        found = voltmeter_events(folder, as_coded(dn) if coded else dn, times_us, SEED)
        return np.rec.fromarrays(list(found.T), dtype=EVENT)

    return row


def of_esim(_: Path) -> Events:
    """The row of ESIM, without a spread of thresholds."""
    return esim((frame / 255 for frame in converged()), TICK_US, THRESHOLD, 0.0, SEED)


def network(name: str) -> ModelConfig:
    """A network of config/networks as an event model."""
    return ModelConfig(name="evsnet", network=name)


OURS: dict[str, Row] = {
    SILENCE: lambda _: np.empty(0, EVENT),
    HALF: ours(light=lambda: light_of(HALF_SPP, seed=1)),
    "evs, lin-log 20": ours(log="linlog", linlog_dn=20.0),
    "evs, davis346": ours("davis346"),
}
PIPELINES: dict[str, Row] = {
    "evs, plain, cycle of 4 x 4": ours(light=lambda: light_of(4, "cycle"), late_us=1500),
    "evs, plain, 4 fixed": ours(light=lambda: light_of(4)),
    "evs, adaptive, 4 fixed": ours(model="adaptive", light=lambda: light_of(4)),
    "evs, plain, 4 fresh": ours(light=lambda: light_of(4, "fresh")),
    "evs, evsnet_c8, 4 fresh": ours(
        model=network("evsnet_c8_4spp"), light=lambda: light_of(4, "fresh")
    ),
    "evs, paper's network, 64 fresh": ours(
        model=network("paper"), light=lambda: light_of(64, "fresh")
    ),
}
OTHERS: dict[str, Row] = {
    "ESIM": of_esim,
    "v2e": of_v2e(1000, False, V2E_ALIKE),
    "v2e, defaults": of_v2e(1000, False, V2E_DEFAULTS),
    "v2e, defaults, 8 bits": of_v2e(1000, True, V2E_DEFAULTS),
    "v2e, 60 FPS": of_v2e(60, False, V2E_ALIKE),
    "v2e, defaults, 60 FPS, 8 bits": of_v2e(60, True, V2E_DEFAULTS),
    "DVS-Voltmeter": of_voltmeter(1000, False),
    "DVS-Voltmeter, 8 bits": of_voltmeter(1000, True),
    "DVS-Voltmeter, 60 FPS, 8 bits": of_voltmeter(60, True),
    "evs, ideal, 60 FPS": ours_at_60,
}
ROWS = {**OURS, **OTHERS, **PIPELINES}

FULL = 5
"""events of a pixel that are drawn in full colour"""

COLUMNS = [
    "events per pixel and second",
    f"voxels with {MANY} or more, %",
    "total variation",
    "earth mover, events",
    "wrong count, events",
    "fullest tenth of 1 ms, %",
    "fullest tenth of 1/60 s, %",
]
PANELS: dict[tuple[str, float], dict[str, tuple[RGB, str]]] = {
    ("Simulators on the light of the reference", 1e-4): {
        "evs, davis346": ((0, 140, 100), "o"),
        "ESIM": ((225, 130, 0), "s"),
        "v2e": ((190, 40, 60), "D"),
        "v2e, defaults, 60 FPS, 8 bits": ((230, 120, 150), "^"),
        "DVS-Voltmeter": ((90, 60, 160), "circle"),
        "DVS-Voltmeter, 60 FPS, 8 bits": ((30, 100, 170), "o"),
    },
    ("Pipelines of evs on light of few samples", 5e-3): {
        "evs, plain, cycle of 4 x 4": ((0, 140, 100), "o"),
        "evs, plain, 4 fixed": ((225, 130, 0), "s"),
        "evs, adaptive, 4 fixed": ((190, 40, 60), "D"),
        "evs, plain, 4 fresh": ((130, 130, 130), "^"),
        "evs, evsnet_c8, 4 fresh": ((90, 60, 160), "circle"),
        "evs, paper's network, 64 fresh": ((30, 100, 170), "o"),
    },
}


def measured(events: Events, reference: Events) -> list[float]:
    """A value for each of COLUMNS."""
    size = HEIGHT, WIDTH
    counts, true = (counts_of(some, size, EDGES_US) for some in (events, reference))
    shares, wanted = histogram(counts), histogram(true)
    ticks_us = range(EDGES_US[0], EDGES_US[-1] + 1, TICK_US)
    stamps = events["t"].astype(np.int64)
    return [
        float(counts.mean()) * (len(EDGES_US) - 1) / (1e-6 * (EDGES_US[-1] - EDGES_US[0])),
        100 * float(binned(shares)[MANY]),
        total_variation(shares, wanted),
        earth_mover(shares, wanted),
        float(np.abs(counts - true).mean()),
        100 * float(tenths(stamps, ticks_us).max()),
        100 * float(tenths(stamps, EDGES_US).max()),
    ]


def page(streams: dict[str, Events], begin_us: int, end_us: int) -> U8:
    """The light, and the events of every row from one time to another, in a grid with captions."""
    factor, across, gap, size_px = 2, 5, 8, 15
    light = to_srgb8(converged()[(begin_us + end_us) // 2 // TICK_US], 1 / 255)
    pictures = {"the light, sRGB": np.repeat(light[:, :, np.newaxis], 3, axis=2)}
    for name, events in streams.items():
        if name not in (SILENCE, HALF):
            ordered = events[np.argsort(events["t"], kind="stable")]
            pictures[name] = shaded(events_between(ordered, begin_us, end_us))
    strip = round(1.4 * size_px) + gap
    width, height = factor * WIDTH + gap, factor * HEIGHT + strip
    lines = -(-len(pictures) // across)
    drawn = np.full((lines * height + strip, across * width - gap, 3), PAPER, np.uint8)
    for k, (name, picture) in enumerate(pictures.items()):
        left, top = k % across * width, k // across * height
        paste(drawn, framed(upscale(picture, factor)), left, top)
        caption = text_line(name, size_px).picture[:, : width - gap]
        paste(drawn, caption, left, top + factor * HEIGHT + 2)
    words = f"pale: one event in {(end_us - begin_us) / 1000:g} ms, full: {FULL} and more"
    legend = side_by_side(legend_line(size_px), text_line(words, size_px), 3 * gap)
    paste(drawn, legend.picture, 0, lines * height)
    return drawn


def shaded(events: Events) -> U8:
    """The colour of each pixel's last event, the paler the fewer events it has."""
    colours = event_frame(events, WIDTH, HEIGHT).astype(np.float64)
    pixel = events["y"].astype(np.int64) * WIDTH + events["x"]
    counts = np.bincount(pixel, minlength=HEIGHT * WIDTH).reshape(HEIGHT, WIDTH, 1)
    strength = np.minimum(counts, FULL) / FULL
    return np.asarray(np.rint(PAPER + strength * (colours - PAPER)), np.uint8)


def framed(picture: U8) -> U8:
    """With a line around it, as paper has no edge on paper."""
    found = picture.copy()
    found[[0, -1]] = found[:, [0, -1]] = 208
    return found


def charts(shares: dict[str, F64]) -> U8:
    """The histograms: a panel for other simulators, one for our pipelines."""
    bins = [float(k) for k in range(MANY + 1)]
    panels = []
    for (title, low), chosen in PANELS.items():
        rows = {REFERENCE: (INK_RGB, "o"), **chosen}
        series = []
        for k, (name, (colour, mark)) in enumerate(rows.items()):
            # beside each other, so that none hides another
            x = [at + 0.08 * (k - (len(rows) - 1) / 2) for at in bins]
            heights, label = list(binned(shares[name])), name.removeprefix("evs, ")
            series.append(Series(x, heights, colour, label, mark=mark))
        below = f"events of a pixel in 1/60 s; {MANY}: {MANY} and more"
        scale = Scale(-0.5, MANY + 0.5, shown=tuple(bins))
        heading = f"{title}: share of all pixels and voxels"
        panels.append(Chart(heading, scale, Scale(low, 1.0, log=True), below, series))
    return draw_charts(panels, 1, (1080, 440))


@pytest.mark.bench
@pytest.mark.slow
def test_event_intensity_beside_other_simulators(tmp_path: Path) -> None:
    streams = {REFERENCE: ours()(tmp_path)}
    below = [f"{100 * np.mean(converged() < dn):.1f} % below {dn} DN" for dn in (1, 2.7, 20, 255)]
    print(f"\n{SCENE}: {', '.join(below)}", flush=True)
    for name, row in ROWS.items():
        try:
            streams[name] = row(tmp_path)
        except AbsentError as absent:
            print(f"{name}: {absent}")
    table = {name: measured(some, streams[REFERENCE]) for name, some in streams.items()}
    print(f"\n| | {' | '.join(COLUMNS)} |\n|{'---|' * (len(COLUMNS) + 1)}")
    for name, (rate, many, *distances, tick, frame) in table.items():
        cells = [f"{rate:.1f}", f"{many:.2f}", *(f"{value:.3f}" for value in distances)]
        stamps = [f"{share:.0f}" if share == share else "" for share in (tick, frame)]
        print(f"| {name} | {' | '.join([*cells, *stamps])} |")
    size = HEIGHT, WIDTH
    shares = {name: histogram(counts_of(some, size, EDGES_US)) for name, some in streams.items()}
    bins = [*map(str, range(MANY)), f"{MANY}+"]
    print(f"\n| % of the voxels | {' | '.join(bins)} |\n|{'---|' * (len(bins) + 1)}")
    for name, found in shares.items():
        print(f"| {name} | {' | '.join(f'{100 * share:.2f}' for share in binned(found))} |")
    if len(streams) == len(ROWS) + 1:
        middle = len(EDGES_US) // 2
        write_png(PICTURE, page(streams, *EDGES_US[middle : middle + 2]))
        write_png(CHARTS, charts(shares))
        print(f"\n{PICTURE.name} and {CHARTS.name} are drawn")
    # the light has converged where its halves agree better than what is to be compared
    floor = table[HALF]
    for name in (SILENCE, "evs, plain, 4 fresh"):
        assert all(value > 2 * low for value, low in zip(table[name][2:5], floor[2:5], strict=True))
