"""Pictures from events alone: our pixels beside v2e's and ESIM's, in bright and in dark exposures.

Two rooms of the data set before a hand-held camera, 1 kHz. Every row gets the same linear light,
except the one that gets it in 8 bits, as a film codes it. Events become pictures by the
complementary filter without frames, with the mean threshold, which all rows share. v2e runs in its
own venv (speed/v2e.py); without it its rows are missing.
lab/docs/reconstruction.md shows what
`.venv/bin/pytest -m bench -s lab/tests/bench/test_reconstruction_study.py` prints and draws.
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
from evs.drivers.pictures import write_png
from evs.drivers.pictures.text_lines import paste, text_line
from evs.emulator.base.scene import F32
from evs.emulator.config import RenderConfig
from evs.msgs import Events, join_events
from evs.msgs.pictures import U8
from evs_lab.reconstruction import CUTOFF_RAD_S, complementary_filter
from reference.esim import EVENT, esim
from reference.hand_held import hand_held
from reference.reconstruction import F64, fit, of_light
from speed.elsewhere import AbsentError
from speed.v2e import v2e_events

CHECKOUT = Path(__file__).parents[3]
OUT = CHECKOUT / "lab/docs/img/reconstruction.png"
WIDTH, HEIGHT, TICKS, TICK_US = 200, 150, 700, 1000
SCENES = ["playroom", "kitchen"]
EXPOSURES = {"bright": 60.0, "dark": 10.0, "night": 2.0}
"""DN below which 30 % of the pixels of the film lie"""
PAN_PX_S, CIRCLE_PX = 30.0, 6.0
"""slow enough that a spread of thresholds does not drown everything else"""
TIMES_US = list(range(300_000, 1000 * TICKS + 1, 50_000))
OTHERS_RAD_S = (2.0, 20.0)
FLOOR_DN = 0.5
"""Light below is as good as black: half a step of 8 bits."""
DARK_DN = 0.1 * 255 / 1000
"""the other floor: dark_lux of the rows of evs"""

THRESHOLD, SPREAD, SEED = 0.2, 0.03, 1
BOTH: dict[str, Any] = {"pos_thres": THRESHOLD, "neg_thres": THRESHOLD}
V2E_DEFAULTS: dict[str, Any] = {
    **BOTH,
    "sigma_thres": SPREAD,
    "cutoff_hz": 300.0,
    "leak_rate_hz": 0.01,
    "shot_noise_rate_hz": 0.001,
    "refractory_period_s": 5e-4,
}
"""of its command; those of the class differ"""

DRAWN = ["playroom, bright", "playroom, night"]
SILENCE = "silence"
Row = Callable[[F32, Path], Events]
"""(ticks + 1, h, w) DN, a folder for files -> events"""


@cache
def film(scene: str) -> F32:
    """(TICKS + 1, HEIGHT, WIDTH) luminance."""
    render = RenderConfig(spp=4, antialiasing="fixed", bounces=1)
    size = WIDTH, HEIGHT
    return np.stack([*hand_held(scene, size, TICKS, render, SEED, PAN_PX_S, CIRCLE_PX)])


def ours(preset: str, **keys: Any) -> Row:
    """A row of evs: a preset and what differs from it."""

    def row(dn: F32, _: Path) -> Events:
        pixels = evs.Pixels(preset, (WIDTH, HEIGHT), unit="dn", seed=SEED, threads=2, **keys)
        parts = [pixels.observe(frame, TICK_US * k) for k, frame in enumerate(dn)]
        return join_events([*parts, pixels.finish()])

    return row


def of_v2e(coded: bool, **options: Any) -> Row:
    """A row of v2e, on linear floats, or on 8 bits as a film has them."""

    def row(dn: F32, folder: Path) -> Events:
        found = v2e_events(folder, as_coded(dn) if coded else dn, {"seed": SEED, **options})
        t, x, y, p = found.T
        return np.rec.fromarrays([np.rint(1e6 * t), x, y, p > 0], dtype=EVENT)

    return row


def as_coded(dn: F32) -> npt.NDArray[np.uint8]:
    """8-bit sRGB; 255 DN is white and where it ends."""
    light = np.clip(dn / 255, 0, 1)
    value = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(255 * value), np.uint8)


def alike(spread: float) -> dict[str, Row]:
    """The rows that differ in nothing but the emulator and its log map."""
    terms = {**BOTH, "sigma_thres": spread}
    evs_terms = {**terms, "dark_lux": 0.1}
    words = f"spread {spread:g}: " if spread else ""
    return {
        f"{words}evs, ln": ours("ideal", log="ln", **evs_terms),
        f"{words}evs, lin-log 2.7": ours("ideal", log="linlog", **evs_terms),
        f"{words}evs, lin-log 20": ours("ideal", log="linlog", linlog_dn=20.0, **evs_terms),
        f"{words}v2e": of_v2e(False, cutoff_hz=0, leak_rate_hz=0, **terms),
        f"{words}ESIM": lambda dn, _: esim((f / 255 for f in dn), TICK_US, THRESHOLD, spread, SEED),
    }


ROWS: dict[str, Row] = {
    SILENCE: lambda _dn, _folder: np.empty(0, EVENT),
    **alike(0.0),
    **alike(SPREAD),
    "evs, davis346": ours("davis346"),
    "evs, preset v2e": ours("v2e"),
    "evs, preset v2e, ln": ours("v2e", log="ln", dark_lux=0.1),
    "v2e, its defaults": of_v2e(False, **V2E_DEFAULTS),
    "v2e, its defaults, 8-bit sRGB": of_v2e(True, **V2E_DEFAULTS),
}


class Case:
    """One film at one exposure: its true pictures."""

    def __init__(self, scene: str, exposure: str) -> None:
        light = film(scene)
        level = EXPOSURES[exposure] / float(np.quantile(light[::50], 0.3))
        self.name = f"{scene}, {exposure}"
        self.dn: F32 = light * np.float32(level)
        log = np.log(np.maximum(self.dn.astype(np.float64), FLOOR_DN))
        shown = np.array(TIMES_US) // TICK_US
        self.truth: F64 = log[shown]
        self.deep: F64 = np.log(self.dn[shown].astype(np.float64) + DARK_DN)
        self.filtered = of_light(log, TICK_US, TIMES_US, CUTOFF_RAD_S)

    def words(self) -> str:
        """How dark it is."""
        shares = [
            f"{100 * np.mean(self.dn < dn):.1f} % below {dn:g} DN" for dn in (0.5, 2.7, 10, 20)
        ]
        return f"{self.name}: " + ", ".join(
            [*shares, f"{100 * np.mean(self.dn > 255):.1f} % over 255"]
        )


def shown(picture: F64, truth: F64) -> U8:
    """Log light from the truth's 1 % (black) to its 99 % (white): (h, w, 3) grey."""
    low, high = np.quantile(truth, [0.01, 0.99])
    grey = np.rint(255 * np.clip((picture - low) / (high - low), 0, 1)).astype(np.uint8)
    return np.repeat(grey[:, :, np.newaxis], 3, axis=2)


def judged(case: Case, events: Events) -> tuple[list[str], U8]:
    """The row's cell in each of TABLES, and its picture in the middle of the times."""
    size = HEIGHT, WIDTH
    made = complementary_filter(events, size, TIMES_US, THRESHOLD, CUTOFF_RAD_S)
    fits = [fit(*pair) for pair in zip(made, case.truth, strict=True)]
    errors = np.sqrt(np.mean((made - case.filtered) ** 2, axis=(1, 2)))
    columns = [[f.correlation for f in fits], [f.ssim for f in fits], [f.mse for f in fits], errors]
    cells = [f"{np.mean(c):.3f} ± {np.std(c):.3f}" for c in columns]
    for cutoff in OTHERS_RAD_S:
        again = complementary_filter(events, size, TIMES_US, THRESHOLD, cutoff)
        found = [fit(*pair).correlation for pair in zip(again, case.truth, strict=True)]
        cells.append(f"{np.mean(found):.3f}")
    found = [fit(*pair).correlation for pair in zip(made, case.deep, strict=True)]
    cells.append(f"{np.mean(found):.3f}")
    rate = len(events) / (WIDTH * HEIGHT * 1e-6 * TICK_US * TICKS)
    middle = len(TIMES_US) // 2
    return [f"{rate:.1f}", *cells], shown(fits[middle].picture, case.truth[middle])


TABLES = ["events per pixel and second", "correlation", "SSIM", "MSE", "error of the high pass"]
TABLES += [f"correlation, cutoff {cutoff:g}/s" for cutoff in OTHERS_RAD_S]
TABLES += [f"correlation, floor {DARK_DN:.2g} DN"]


def page(cases: dict[str, dict[str, U8]]) -> U8:
    """The pictures of each case in a grid of its own, with captions."""
    size_px, gap, across = 12, 6, 6
    strip = round(1.4 * size_px) + gap
    down = [-(-len(pictures) // across) for pictures in cases.values()]
    height = sum(down) * (HEIGHT + strip) + len(cases) * strip
    drawn = np.full((height, across * (WIDTH + gap), 3), 255, np.uint8)
    top = 0
    for (case, pictures), rows in zip(cases.items(), down, strict=True):
        paste(drawn, text_line(case, size_px + 4).picture[:strip], 0, top)
        top += strip
        for k, (name, picture) in enumerate(pictures.items()):
            left, line = k % across * (WIDTH + gap), top + k // across * (HEIGHT + strip)
            paste(drawn, picture, left, line)
            paste(drawn, text_line(name, size_px).picture[:, :WIDTH], left, line + HEIGHT)
        top += rows * (HEIGHT + strip)
    return drawn


@pytest.mark.bench
@pytest.mark.slow
def test_pictures_from_events_beside_v2e_and_esim(tmp_path: Path) -> None:
    cells: dict[str, dict[str, list[str]]] = {name: {} for name in ROWS}
    drawn: dict[str, dict[str, U8]] = {}
    for case in (Case(scene, exposure) for scene in SCENES for exposure in EXPOSURES):
        print(case.words(), flush=True)
        middle = case.truth[len(TIMES_US) // 2]
        pictures = {"true log light": shown(middle, middle)}
        for name, row in ROWS.items():
            try:
                cells[name][case.name], pictures[name] = judged(case, row(case.dn, tmp_path))
            except AbsentError as absent:
                print(f"{name}: {absent}")
        if case.name in DRAWN:
            drawn[case.name] = pictures
    names = [f"{scene}, {exposure}" for scene in SCENES for exposure in EXPOSURES]
    for k, title in enumerate(TABLES):
        print(f"\n| {title} | {' | '.join(names)} |\n|{'---|' * (len(names) + 1)}")
        for name, found in cells.items():
            if found:
                print(f"| {name} | {' | '.join(found[case][k] for case in names)} |")
    if all(len(pictures) == len(ROWS) + 1 for pictures in drawn.values()):
        write_png(OUT, page(drawn))
        print(f"\n{OUT.name}: {', '.join(drawn)}")
    # what draws no line between the rows is no judge of them
    for name, found in cells.items():
        if found and name.startswith("evs"):
            assert float(found["playroom, bright"][1].split()[0]) > 0.3
