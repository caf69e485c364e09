"""Sub-steps between two frames: straight lines of each pixel's light. No motion is invented.

What really happened between two frames is not in them. A pixel's light goes from its old value to
its new one in a straight line: an edge that moved by ten pixels fades out here and in there, and
does not travel across those between. Frames of an interpolator that follows motion, or of a faster
camera, are the way to more.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F32

LEAST_DN = 0.01
"""Of the light that is added where the line is straight in log light, so that black has a place."""


def between(
    before: F32, after: F32, steps: int, line: str, floor: float
) -> Iterator[npt.NDArray[np.float32]]:
    """The light at equal steps from one frame to the next.

    Args:
        before: (h, w) linear.
        after: (h, w) linear, the light of the last step.
        steps: A power of two.
        line: What goes in a straight line: `log`, the logarithm of light + floor; `linear`, light.
        floor: Light, such as that of the sensor's dark current.

    Yields:
        (h, w) float32, `steps` times.
    """
    if steps > 1:
        lifted = np.float64(floor) if line == "log" else np.float64(0.0)
        first, last = (light.astype(np.float64) + lifted for light in (before, after))
        yield from (
            (light - lifted).astype(np.float32) for light in _halved(first, last, steps, line)
        )
    yield after


def _halved(
    first: npt.NDArray[np.float64], last: npt.NDArray[np.float64], steps: int, line: str
) -> Iterator[npt.NDArray[np.float64]]:
    """What lies between the two, without them: halves of halves.

    A square root is exact to the last bit on every processor; a logarithm is not.
    """
    if steps == 1:
        return
    with np.errstate(invalid="ignore", over="ignore"):
        # negative light becomes NaN, which the pixels count
        middle = np.sqrt(first) * np.sqrt(last) if line == "log" else 0.5 * (first + last)
    yield from _halved(first, middle, steps // 2, line)
    yield middle
    yield from _halved(middle, last, steps // 2, line)
