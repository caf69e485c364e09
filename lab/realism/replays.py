"""The second half of a recording with frames, beside sensors in the light of its frames."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.config import SensorConfig
from evs.emulator.sensor import resolve_sensor
from evs.msgs import Events, EvsError, Frame
from evs.msgs.event import EVENT_DTYPE
from evs_lab.fit import FittedCamera, Light, Observed, fit_camera, replayed, sensor_toml
from evs_lab.fit.frames import FEWEST_FRAMES, frame_light
from evs_lab.fit.observed import Mask
from evs_lab.fit.replay import MOST_S
from evs_lab.realism.paired import Likeness, Region, likeness

LEAST_DN = 4.0
"""mean of a pixel's frames, of white 255: darker ones show no light that could be replayed"""


@dataclass(frozen=True)
class Replay:
    """A sensor in the light of the recording."""

    name: str
    events: Events
    """(n,) EVENT_DTYPE, times as the recording's"""
    like: Likeness


@dataclass(frozen=True)
class Replays:
    """A recording and the sensors beside it."""

    seen: Observed
    region: Region
    fitted: FittedCamera
    """from the first half"""
    rows: tuple[Replay, ...]
    """the recording itself first"""


def replay_all(
    seen: Observed,
    sensors: Sequence[str],
    rows: tuple[int, int] | None = None,
    white_lux: float | None = None,
    seed: int = 0,
    moved: Callable[[str], object] | None = None,
) -> Replays:
    """Fit the first half, then compare sensors on the second.

    Args:
        seen: A recording with intensity frames.
        sensors: Presets or sensor files; the first is the base of the fit.
        rows: First and last row of the sensor that are compared; None: all.
        white_lux: Illuminance of white in the frames; None: from exposure and sensor.
        seed: Of noise and mismatch.
        moved: Called with the name of each sensor before it is replayed.

    Raises:
        EvsError: The recording has too few frames or is too long, or there are no such rows or
            sensors.
    """
    frames = frame_light(seen)
    if len(frames.mid_us) < 2 * FEWEST_FRAMES:
        raise EvsError(
            f"{seen.source} has {len(frames.mid_us)} intensity frames of {seen.width} x "
            f"{seen.height} px; a replay takes {2 * FEWEST_FRAMES}. Give a second recording to "
            "compare without frames"
        )
    if seen.seconds > MOST_S:
        raise EvsError(
            f"{seen.source} is {seen.seconds:.0f} s long; a replay takes at most {MOST_S:.0f} s. "
            "Give a shorter part of it"
        )
    first_us, last_us = (round(float(frames.mid_us[k])) for k in (0, -1))
    middle_us = (first_us + last_us) // 2
    fitted = fit_camera([Light(_until(seen, middle_us))], resolve_sensor(SensorConfig(sensors[0])))
    light = Light(seen, lux=white_lux, dark_dn=fitted.lights[0].dark_dn)
    region = Region(
        _pixels(seen, frames.dn.mean(axis=0).reshape(seen.height, seen.width), rows),
        middle_us,
        last_us,
    )
    found = [Replay("the recording", seen.events, likeness(seen.events, seen.events, region))]
    with tempfile.TemporaryDirectory() as folder:
        for name, config in _sensors(fitted, sensors, Path(folder)):
            if moved is not None:
                moved(name)
            events = np.zeros(0, EVENT_DTYPE)
            if config is not None and (replay := replayed(light, config, seed)) is not None:
                events = replay.events.copy()
                events["t"] += first_us
            found.append(Replay(name, events, likeness(events, seen.events, region)))
    return Replays(seen, region, fitted, tuple(found))


def _sensors(
    fitted: FittedCamera, sensors: Sequence[str], folder: Path
) -> Iterator[tuple[str, SensorConfig | None]]:
    """(name, sensor); None: one that sees nothing."""
    for name in sensors:
        yield name, SensorConfig(name)
    told = fitted.told
    if "pos_thres" in told and "neg_thres" in told:
        path = folder / "fitted.toml"
        path.write_text(sensor_toml(fitted, sensors[0]), encoding="utf-8")
        yield f"{Path(sensors[0]).stem}, fitted", SensorConfig(str(path))
    for name in ("ideal", "v2e"):
        if name not in sensors:
            yield name, SensorConfig(name)
    if "pos_thres" in told and "neg_thres" in told:
        on, off = told["pos_thres"].number, told["neg_thres"].number
        yield "ideal, fitted thresholds", SensorConfig("ideal", pos_thres=on, neg_thres=off)
    yield "no events", None


def _until(seen: Observed, t_us: int) -> Observed:
    """The recording as far as a time."""

    def before(one: Frame) -> bool:
        return (one.exposure_begin_us + one.exposure_end_us) // 2 <= t_us

    events = seen.events[seen.events["t"] <= t_us]
    return replace(seen, events=events, frames=tuple(one for one in seen.frames if before(one)))


def _pixels(seen: Observed, mean_dn: F32, rows: tuple[int, int] | None) -> Mask:
    """(height, width) those that are compared."""
    first, last = rows or (0, seen.height - 1)
    if not 0 <= first <= last < seen.height:
        raise EvsError(
            f"rows {first} to {last} are not on a sensor of {seen.height} rows; give two of "
            f"0 ... {seen.height - 1}"
        )
    chosen = mean_dn >= LEAST_DN
    chosen[:first] = False
    chosen[last + 1 :] = False
    if not chosen.any():
        raise EvsError(
            f"the frames of {seen.source} are black where they are compared (below {LEAST_DN:g} "
            "DN of 255); give other rows"
        )
    return np.asarray(chosen)
