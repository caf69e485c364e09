"""Fit frames onto a sensor: which part of a frame, and the mean of its light in each pixel."""

from __future__ import annotations

import numpy as np

from evs.emulator.base.scene import F32
from evs.msgs import EvsError

Box = tuple[int, int, int, int]
"""x, y, width, height, px of the frame"""


def region(frame: tuple[int, int], sensor: tuple[int, int], fit: str, crop: Box | None) -> Box:
    """The part of a frame that a sensor sees.

    Args:
        frame: (height, width) of the frame, px.
        sensor: (height, width) of the sensor, px.
        fit: crop: the largest part in the middle with the sensor's aspect; stretch: everything;
            exact: the part has to have the sensor's size.
        crop: Take only this part of the frame, to begin with.

    Raises:
        EvsError: The part does not lie on the frame, or has another size than `exact` needs.
    """
    height, width = frame
    x, y, wide, high = crop or (0, 0, width, height)
    if x < 0 or y < 0 or wide < 1 or high < 1 or x + wide > width or y + high > height:
        raise EvsError(
            f"at film.crop: {x} {y} {wide} {high} (x y width height) does not lie on the "
            f"{width} x {height} frames"
        )
    rows, columns = sensor
    if fit == "exact" and (high, wide) != sensor:
        raise EvsError(
            f"the frames are {wide} x {high} px, the sensor is {columns} x {rows}: give "
            f"sensor.width={wide} sensor.height={high}, or --fit crop or stretch"
        )
    if fit == "crop":
        if wide * rows > high * columns:
            part = max(1, round(high * columns / rows))
            x, wide = x + (wide - part) // 2, part
        else:
            part = max(1, round(wide * rows / columns))
            y, high = y + (high - part) // 2, part
    return x, y, wide, high


def area_mean(light: F32, shape: tuple[int, int]) -> F32:
    """The mean light over the area of each pixel of a sensor.

    Args:
        light: (h, w) linear.
        shape: (height, width) of the sensor. A sensor with more pixels than the light repeats them.

    Returns:
        `shape` float32; the light itself where it has that shape already. The order of the sums is
        fixed: the bytes are the same on every machine.
    """
    if light.shape == shape:
        return light
    rows = np.ascontiguousarray(_mean_of_rows(light, shape[0]).T)
    return np.ascontiguousarray(_mean_of_rows(rows, shape[1]).T)


def _mean_of_rows(light: F32, count: int) -> F32:
    """(count, w): row i is the mean over the rows [i n / count, (i + 1) n / count)."""
    total = len(light)
    if total == count:
        return light
    # borders between the rows, in units of 1 / count of a row
    borders = np.arange(count + 1, dtype=np.int64) * total
    begin, end = borders[:-1], borders[1:]
    first = begin // count
    found = np.zeros((count, light.shape[1]), np.float32)
    for step in range(-(-total // count) + 1):
        row = first + step
        covered = np.minimum(end, (row + 1) * count) - np.maximum(begin, row * count)
        share = (np.maximum(covered, 0) / total).astype(np.float32)
        if not share.any():
            continue
        # a row with no share is replaced by one that has, so that its NaN stays where it belongs
        part = light[np.where(share > 0, row, first)]
        part *= share[:, np.newaxis]
        found += part
    return found
