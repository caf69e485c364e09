"""Rendering: a world's light and ground truth at a list of instants, into one file of stacks."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.files.npz.frame_writer import FrameArray, NpzFrameWriter
from evs.drivers.run.report import COMPLETE, versions
from evs.drivers.run.run import MAX_SECONDS
from evs.drivers.run.stop_signals import stop_signals
from evs.emulator import View, World
from evs.emulator.config import RunConfig
from evs.emulator.world import versions as emulator_versions
from evs.msgs import EvsError, unknown

Frame = Mapping[str, npt.NDArray[Any]]

LIGHT = {"luminance": ("<f4", ()), "rgb": ("<f4", (3,))}
"""channel -> (dtype, shape of a pixel), from the renderer"""

TRUTH = {
    "depth": ("<f4", ()),
    "distance": ("<f4", ()),
    "normal": ("<f4", (3,)),
    "position": ("<f4", (3,)),
    "geom_id": ("<i4", ()),
    "body_id": ("<i4", ()),
    "flow": ("<f4", (2,)),
}
"""channel -> (dtype, shape of a pixel): the fields of GroundTruth"""

CHANNELS = (*LIGHT, *TRUTH)


@dataclass(frozen=True)
class Rendering:
    """The result of a rendering."""

    ended: str
    """complete, interrupted or terminated"""
    frames: int
    """in the file"""
    size: int
    """of the file, bytes"""
    last: Frame | None
    """the last frame's channels"""


def chosen_channels(text: str, renderer: str) -> tuple[str, ...]:
    """Return the channels of a comma-separated list, in the file's order.

    Args:
        text: The list; `all` is every channel that the renderer has.
        renderer: Name of the renderer.

    Raises:
        EvsError: A channel is unknown, or none is given.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    if words == ["all"]:
        return tuple(name for name in CHANNELS if name != "rgb" or renderer != "raster")
    for word in words:
        if word not in CHANNELS:
            raise unknown("channel", word, ["all", *CHANNELS])
    if not words:
        raise EvsError(f"no channel is given; there is: all, {', '.join(CHANNELS)}")
    return tuple(name for name in CHANNELS if name in words)


def instants(duration_s: float, fps: float | None, tick_us: int) -> range | list[int]:
    """Return the ticks to render, from 0 to the duration, which is included if a frame is due.

    Args:
        duration_s: Simulated time, s.
        fps: Frames per simulated second, each at the nearest tick; None: every tick.
        tick_us: Length of a tick, us.

    Raises:
        EvsError: There are fewer ticks than frames, or a value is impossible.
    """
    if not (math.isfinite(duration_s) and 0 <= duration_s <= MAX_SECONDS):
        raise EvsError(
            f"at duration_s: {duration_s:g} s is not possible; give 0 s (one frame) or more"
        )
    if tick_us < 1:
        raise EvsError(f"at scene.tick_us: {tick_us} is not a valid tick; give 1 us or more")
    # a hair's breadth over, so that 0.3 s at 10 fps has its last frame
    if fps is None:
        return range(int(duration_s * 1e6 / tick_us + 1e-6) + 1)
    if not (math.isfinite(fps) and fps > 0):
        raise EvsError(f"--fps is {fps:g}: give more than 0, or tick for every tick")
    if fps * tick_us > 1e6 * (1 + 1e-9):
        raise EvsError(
            f"--fps {fps:g} is more than the {1e6 / tick_us:g} ticks of a second: give tick for "
            "every tick, or a shorter scene.tick_us"
        )
    count = int(duration_s * fps + 1e-6) + 1
    return [round(frame * 1e6 / fps / tick_us) for frame in range(count)]


def check_target(out: str, inputs: Sequence[str]) -> Path:
    """Return the path of the file to write. EvsError if it does not end in .npz, or is an input."""
    path = Path(out).expanduser()
    if path.suffix.lower() != ".npz":
        raise EvsError(f"cannot render to '{out}': end it in .npz")
    for name in inputs:
        if name and path.exists() and Path(name).exists() and path.samefile(name):
            raise EvsError(f"'{out}' is an input of this run; render to another file")
    return path


def render(
    config: RunConfig,
    out: Path,
    channels: Sequence[str],
    ticks: Sequence[int],
    progress: Callable[[int, int], None] | None = None,
    plain_config: Mapping[str, Any] | None = None,
) -> Rendering:
    """Step the configured world to each of `ticks` and write what its camera sees there.

    Ctrl-C and SIGTERM end it between two frames; the frames until then are complete.

    Args:
        config: The world and its camera.
        out: The file to write.
        channels: Of the frames.
        ticks: When to render, ascending.
        progress: Called with (frames done, t_us) after each frame.
        plain_config: The configuration that is written into the file; `config` if None.

    Returns:
        What was rendered.

    Raises:
        EvsError: The world is unstable; the frames until then are complete.
    """
    world, view = World.with_view(config, rgb="rgb" in channels)
    size = view.height, view.width
    shapes = {name: (LIGHT | TRUTH)[name] for name in channels}
    stacks = {"t_us": FrameArray("<i8")} | {
        name: FrameArray(dtype, (*size, *pixel)) for name, (dtype, pixel) in shapes.items()
    }
    info = json.dumps(_info(config, view, plain_config or asdict(config)), default=str)
    writer = NpzFrameWriter(out, len(ticks), stacks, {"info": info})
    ended, frame = COMPLETE, None
    try:
        with stop_signals() as stopped:
            for done, tick in enumerate(ticks, 1):
                while world.tick < tick and not stopped:
                    world.step()
                if stopped:
                    ended = stopped[0]
                    break
                frame = _frame(view, channels)
                writer.write(frame)
                if progress is not None:
                    progress(done, view.t_us)
    except EvsError as error:
        raise EvsError(f"{error}; {out} has the {writer.written} frames until then") from error
    finally:
        bytes_written = writer.close()
    return Rendering(ended, writer.written, bytes_written, frame)


def _frame(view: View, channels: Sequence[str]) -> Frame:
    """Return the requested channels of the present; compute no others."""
    found: dict[str, Any] = {"t_us": np.int64(view.t_us)}
    if any(name in LIGHT for name in channels):
        found["luminance"], found["rgb"] = view.render()
    if any(name in TRUTH for name in channels):
        truth = view.ground_truth()
        found |= {name: getattr(truth, name) for name in TRUTH}
    return {name: np.asarray(found[name]) for name in ("t_us", *channels)}


def _info(config: RunConfig, view: View, plain_config: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "camera": view.name,
        "camera_info": view.camera_info,
        "tick_us": config.scene.tick_us,
        "seed": config.seed,
        "versions": {**versions(), **emulator_versions()},
        "config": dict(plain_config),
    }
