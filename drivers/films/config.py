"""The configuration of a film's run: [sensor] and [model] as in a pipeline, and [film]."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from evs.emulator.base.small_files import read_small_text
from evs.emulator.camera.frame_light import UNITS
from evs.emulator.config import ModelConfig, SensorConfig, decoding
from evs.msgs import EvsError, unknown

FITS = ("crop", "stretch", "exact")
BETWEEN = ("log", "linear")
MOST_SUBSTEPS = 256

_MOST_TIMES = 1 << 26
"""bytes of a file of times: a few million lines"""


@dataclass(frozen=True)
class FilmConfig:
    """[film]: when its frames were taken, what their values mean, and how they fit the sensor."""

    fps: float | None = None
    """frames per second of the film, instead of its own time stamps, Hz; a folder needs it"""
    times: str = ""
    """a text file with the time of each frame, s, one per line, instead of fps"""
    slowdown: float = 1.0
    """how many times slower than reality the film runs (slow motion): times are divided by it;
    v2e's input_slowmotion_factor"""
    substeps: int = 1
    """steps from one frame to the next: 1, 2, 4 ... 256. Light changes in a straight line; no
    motion is invented"""
    between: str = "log"
    """what changes in a straight line in substeps: log | linear"""
    unit: str = "auto"
    """what the values in the frames mean: luminance | srgb | dn | lux; auto: srgb for 8 and 16
    bits, luminance for floats (EXR); dn treats sRGB values as light, as v2e does"""
    fit: str = "crop"
    """crop: the largest centred part with the sensor's aspect ratio | stretch: all of it | exact:
    reject frames of another size; each pixel takes the mean light of its area"""
    crop: tuple[int, ...] = ()
    """x y width height of the part of the frames to take, px; none: all of them"""


@dataclass(frozen=True)
class FilmRunConfig:
    """Top-level keys."""

    sensor: SensorConfig = field(default_factory=SensorConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    film: FilmConfig = field(default_factory=FilmConfig)
    name: str = "camera"
    """the camera's name in the recording"""
    seed: int = 0
    """seed of every random number of the sensor"""
    threads: int = 0
    """worker threads of the pixels; 0: one per core"""


def load_film_config(overrides: Iterable[tuple[str, str]] = ()) -> FilmRunConfig:
    """Load the configuration of a film's run.

    Args:
        overrides: (dotted key, text) of the command line.

    Raises:
        EvsError: An unknown key or a bad value, with the path to it.
    """
    config = decoding.override(FilmRunConfig(), overrides)
    check(config)
    return config


def check(config: FilmRunConfig) -> None:
    """Raise EvsError for values of [film] without sense; the sensor checks its own."""
    film = config.film
    for key, known in (("unit", UNITS), ("fit", FITS), ("between", BETWEEN)):
        if (value := getattr(film, key)) not in known:
            raise EvsError(f"at film.{key}: {unknown(key, value, known)}")
    if film.fps is not None and not 0 < film.fps <= 1e6:
        raise EvsError(f"at film.fps: {film.fps:g}; give more than 0, and 1e6 frames a second most")
    if film.fps is not None and film.times:
        raise EvsError("film.fps and film.times both give the times of the frames; give one")
    if not (math.isfinite(film.slowdown) and film.slowdown > 0):
        raise EvsError(f"at film.slowdown: {film.slowdown:g}; give more than 0")
    if film.substeps not in [1 << k for k in range(MOST_SUBSTEPS.bit_length())]:
        raise EvsError(
            f"at film.substeps: {film.substeps}; give a power of two, 1 ... {MOST_SUBSTEPS}"
        )
    if film.crop and len(film.crop) != 4:
        raise EvsError(f"at film.crop: {len(film.crop)} numbers; give x,y,width,height")
    if config.model.chunk > 1:
        raise EvsError(f"at model.chunk: {config.model.chunk}; leave it out for a film")
    if config.seed < 0:
        raise EvsError(f"at seed: {config.seed}; give 0 or more")


def read_times(file: str) -> list[float]:
    """The times of a text file, s: the last number of each line; # begins a comment.

    Raises:
        EvsError: It cannot be read, or a line has no number.
    """
    try:
        lines = read_small_text(Path(file), _MOST_TIMES).splitlines()
    except (OSError, UnicodeDecodeError) as reason:
        text = getattr(reason, "strerror", None) or "it is not text"
        raise EvsError(f"cannot read '{file}' (film.times): {text}") from None
    times = []
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            t_s = float(words[-1])
        except ValueError:
            t_s = math.nan
        if not math.isfinite(t_s) or abs(t_s) > 1e9:
            raise EvsError(f"'{file}', line {number}: {words[-1]} is no time; give seconds")
        times.append(t_s)
    return times
