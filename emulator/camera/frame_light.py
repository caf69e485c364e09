"""FrameLight: the numbers of a frame, whatever made it, into the linear light of a sensor.

Only additions, multiplications and divisions, in one order, so the bytes are the same on every
machine; no exponential or power of a library is called.
"""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator import _core
from evs.emulator.base.scene import F32, F64
from evs.emulator.config.sensor import BRIGHTEST_DN
from evs.emulator.sensor import SensorParameters
from evs.msgs import EvsError, unknown

UNITS = ("auto", "luminance", "srgb", "dn", "lux")
"""What the numbers of a frame may mean; `FrameLight` describes them."""

LUMA = (np.float32(0.2126), np.float32(0.7152), np.float32(0.0722))
"""BT.709 weights of linear red, green and blue"""

FULL_SCALE = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65535}
"""dtype of whole numbers -> the one that is white, where the unit is luminance or srgb"""

HOST_DEVICES = {1: "CPU", 3: "CUDA host memory", 11: "ROCm host memory"}
"""DLPack's types of devices whose memory this process can read"""


def srgb_to_linear(coded: npt.NDArray[Any]) -> F64:
    """Decode sRGB (IEC 61966-2-1).

    Args:
        coded: Values of 0 ... 1; larger ones become white, negative ones and NaN stay.

    Returns:
        Linear light, float64, of the same shape.
    """
    value = np.minimum(np.asarray(coded, np.float64), 1.0)
    base = np.where(value > 0.04045, (value + 0.055) / 1.055, 1.0)
    # x^2.4 = x^2 (x^(1/5))^2; Newton's steps for the root come from above and have converged to
    # the last bits after nine, since x is 0.09 or more
    root = np.ones_like(base)
    for _ in range(9):
        root = (4.0 * root + base / (root * root * (root * root))) / 5.0
    return np.where(value > 0.04045, base * base * (root * root), value / 12.92)


def frame_array(frame: Any) -> npt.NDArray[Any]:
    """A frame as a NumPy array, which shares its memory where it can.

    Args:
        frame: A NumPy array, anything with DLPack in this process's memory (a PyTorch tensor, a JAX
            array), or what numpy.asarray takes.

    Raises:
        EvsError: It is on another device, needs a gradient, or is no array.
    """
    if isinstance(frame, np.ndarray):
        return frame
    kind = type(frame).__name__
    try:
        if hasattr(frame, "__dlpack_device__") and hasattr(frame, "__dlpack__"):
            device, _ = frame.__dlpack_device__()
            if int(device) not in HOST_DEVICES:
                raise EvsError(
                    f"the frame, a {kind}, is in the memory of another device; copy it to this "
                    "one first, as tensor.cpu() does"
                )
            return np.from_dlpack(frame)
        return np.asarray(frame)
    except (BufferError, RuntimeError, TypeError, ValueError) as reason:
        message = " ".join(str(reason).split())
        raise EvsError(f"the frame, a {kind}, is no array that NumPy can read: {message}") from None


class FrameLight:
    """Turns frames of one size into linear light, 1 = white.

    The unit says what the numbers mean:

    - `luminance`: linear; 1.0 is white. Of uint8 and uint16, 255 and 65535 are white.
    - `srgb`: sRGB-coded; 1.0, 255 or 65535 is white. Coded light ends at white.
    - `dn`: linear; 255 is white, whatever the dtype. This is how v2e takes the grey values of a
      film, coded though they are.
    - `lux`: linear; the illuminance of the sensor.
    - `auto`: `srgb` for uint8 and uint16, `luminance` for floats.

    With `luminance` and `srgb`, the sensor's `exposure_dn` is the DN of white; with `dn` and `lux`
    it has no effect.
    """

    def __init__(self, shape: tuple[int, int], unit: str, sensor: SensorParameters) -> None:
        """Choose the unit.

        Args:
            shape: Height and width of the frames, px.
            unit: One of UNITS.
            sensor: Whose light it is, resolved.

        Raises:
            EvsError: No such unit.
        """
        if unit not in UNITS:
            raise unknown("unit of frames", str(unit), UNITS)
        self.unit, self._shape = unit, shape
        # luminance of one DN, and of one lux
        per_dn = 1.0 / float(sensor.exposure_dn)
        self._scale = {"dn": per_dn, "lux": per_dn / float(sensor.lux_per_dn)}
        self._tables: dict[np.dtype[Any], tuple[F32, F32]] = {}
        self._is_checked = False
        self.light = np.zeros(shape, np.float32)
        """(h, w) of the last frame"""

    def convert(self, frame: Any) -> F32:
        """Convert a frame.

        Args:
            frame: (h, w), (h, w, 1), (h, w, 3) RGB or (h, w, 4) RGBA; uint8, uint16 or a float, as
                `frame_array` takes it. Alpha has no effect.

        Returns:
            (h, w) float32 linear light, BT.709 weights; valid until the next call. Numbers that are
            no light (NaN, negative) stay what they are.

        Raises:
            EvsError: Another shape, another dtype.
        """
        array = frame_array(frame)
        height, width = self._shape
        if array.ndim == 3 and array.shape[2] == 1:
            array = array[:, :, 0]
        if array.shape[:2] != self._shape or array.ndim > 3 or array.shape[2:] not in _CHANNELS:
            raise EvsError(
                f"the frame is {array.shape}; give (height, width), or with 3 or 4 channels, of "
                f"{height} x {width}: set size=, or resize the frame"
            )
        if not array.dtype.isnative:
            array = array.astype(array.dtype.newbyteorder("="))
        if array.dtype in FULL_SCALE:
            self._look_up(array)
        elif array.dtype.kind == "f":
            self._calculate(array)
        else:
            raise EvsError(f"the frame is of dtype {array.dtype}; give uint8, uint16 or a float")
        if not self._is_checked:
            self._is_checked = True
            self._check_scale(array)
        return self.light

    def _check_scale(self, array: npt.NDArray[Any]) -> None:
        """Warn where the first frame, of floats, has hardly the unit that it should have."""
        if array.dtype.kind != "f":
            return
        with np.errstate(all="ignore"):
            mean, most = float(np.mean(array, dtype=np.float64)), float(np.max(array))
        wanted = ""
        if self.unit not in self._scale and BRIGHTEST_DN * self._scale["dn"] < mean < math.inf:
            wanted = "1.0 is white: if it is 255, give unit='dn', or frames of uint8"
        elif self.unit == "dn" and 0.0 < most <= 1.0:
            wanted = "255 is white: if it is 1.0, give unit='luminance'"
        if wanted:
            warnings.warn(f"the mean of the first frame is {mean:.3g}, and {wanted}", stacklevel=4)

    def _look_up(self, array: npt.NDArray[Any]) -> None:
        """The light of whole numbers, by a table for each channel."""
        if array.dtype not in self._tables:
            self._tables[array.dtype] = self._make_tables(array.dtype)
        grey, colour = self._tables[array.dtype]
        if not array.flags.aligned:
            array = array.copy()
        _core.light_of_numbers(array, grey if array.ndim == 2 else colour, self.light)

    def _make_tables(self, dtype: np.dtype[Any]) -> tuple[F32, F32]:
        """Light by number: (1, n) of grey and (3, n) of red, green and blue."""
        white = FULL_SCALE[dtype]
        numbers = np.arange(white + 1, dtype=np.float64)
        if self.unit in self._scale:
            light = numbers * self._scale[self.unit]
        elif self.unit == "luminance":
            light = numbers / white
        else:
            light = srgb_to_linear(numbers / white)
        grey = light.astype(np.float32)
        return grey[np.newaxis], np.stack([grey * weight for weight in LUMA])

    def _calculate(self, array: npt.NDArray[Any]) -> None:
        """The light of floats."""
        with np.errstate(over="ignore", invalid="ignore"):  # a float64 may be no float32
            if self.unit == "srgb":
                array = srgb_to_linear(array)
            linear = array.astype(np.float32, copy=False)
            if linear.ndim == 2:
                np.copyto(self.light, linear)
            else:
                red, green, blue = (
                    linear[:, :, place] * weight for place, weight in enumerate(LUMA)
                )
                np.add(red, green, out=self.light)
                self.light += blue
            if self.unit in self._scale:
                self.light *= np.float32(self._scale[self.unit])


_CHANNELS = ((), (3,), (4,))
"""What may stand behind height and width in a shape."""
