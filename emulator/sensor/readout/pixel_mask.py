"""Which pixels are read at all: region of interest and mask."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from evs.emulator.base.small_files import read_small_text
from evs.emulator.sensor.readout.parameters import ReadoutParameters
from evs.msgs import EvsError

KEPT = 255
"""In a map of fates; any other value is the place of the cause in state.CAUSES."""

_ROI, _MASK = 0, 1

_MOST_BYTES = 1 << 25
"""Of a mask file: three million pixels."""

U8 = npt.NDArray[np.uint8]


def draw_fates(readout: ReadoutParameters, width: int, height: int) -> U8 | None:
    """What becomes of each pixel's events, (height, width) uint8; None: all are kept.

    Raises EvsError for rectangles and pixels that are not on the sensor, and a bad mask file.
    """
    pixels = _masked(readout, width, height)
    if not readout.roi and not pixels:
        return None
    fates = np.full((height, width), _ROI if readout.roi else KEPT, np.uint8)
    numbers = iter(readout.roi)
    for x, y, wide, high in zip(numbers, numbers, numbers, numbers, strict=True):
        if wide < 1 or high < 1 or x < 0 or y < 0 or x + wide > width or y + high > height:
            raise EvsError(
                f"sensor.readout.roi {x} {y} {wide} {high} (x y width height) does not lie on the "
                f"{width} x {height} sensor"
            )
        fates[y : y + high, x : x + wide] = KEPT
    if pixels:
        x, y = np.array(pixels, np.int64).T
        fates[y, x] = np.where(fates[y, x] == KEPT, _MASK, fates[y, x])
    return fates


def _masked(readout: ReadoutParameters, width: int, height: int) -> list[tuple[int, int]]:
    """Every masked pixel (x, y)."""
    numbers = iter(readout.mask)
    pixels = list(zip(numbers, numbers, strict=True))
    places = ["sensor.readout.mask"] * len(pixels)
    if readout.mask_file:
        for place, pixel in _read(Path(readout.mask_file)):
            places.append(place)
            pixels.append(pixel)
    for place, (x, y) in zip(places, pixels, strict=True):
        if not (0 <= x < width and 0 <= y < height):
            raise EvsError(f"{place}: pixel {x} {y} is not on the {width} x {height} sensor")
    return pixels


def _read(path: Path) -> list[tuple[str, tuple[int, int]]]:
    """(where it stands, (x, y)) of each line of a mask file: "x y" or "x,y"; # begins a comment."""
    try:
        lines = read_small_text(path, _MOST_BYTES).splitlines()
    except FileNotFoundError:
        raise EvsError(f"no mask file '{path}' (sensor.readout.mask_file)") from None
    except UnicodeDecodeError:
        raise EvsError(f"mask file '{path}' is not text; give one x y per line") from None
    except OSError as reason:
        raise EvsError(f"cannot read mask file '{path}': {reason.strerror}") from None
    pixels = []
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        if len(words) != 2 or not all(word.isdecimal() and len(word) < 6 for word in words):
            raise EvsError(f"mask file '{path}', line {number}: give x y of a pixel")
        pixels.append((f"mask file '{path}', line {number}", (int(words[0]), int(words[1]))))
    return pixels
