"""A DAVIS's frames and IMU samples, from the words of an AEDAT2 file.

A frame is every pixel's reset read and then its signal read; the light is their difference. It
begins where a pixel is reset that the frame before has reset already. Its exposure begins with the
last reset read, or, where signal reads come between them (rolling shutter), with the first.

An IMU sample is seven words: acceleration x y z, temperature, angular velocity x y z. The IMU is
turned by half a turn about y against the camera's axes (x right, y down, z forward). jAER does not
write the IMU's ranges into every file: read is what it sets (4 g, 500 degrees/s).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from evs.drivers.files.aedat2.layout import pixel_of
from evs.drivers.files.chips import Bits
from evs.msgs import DEGREE, STANDARD_GRAVITY, Frame, ImuSamples, empty_imu

G_PER_STEP = 1 / 8192
DEGREES_S_PER_STEP = 1 / 65.5
DEGREES_C_PER_STEP, DEGREES_C_AT_0 = 1 / 340, 35.0
"""Scales of an InvenSense MPU-6150, as jAER has them."""

_TURNED = np.array([-1.0, 1.0, -1.0])
_MAX_ADC, _WHITE = 1023, 65535
_RESET, _SIGNAL = 0, 1


@dataclass
class ImuAssembler:
    """Assembles IMU samples from words; words of incomplete samples are counted in `lost`."""

    lost: int = 0
    _kept: tuple[Bits, Bits] = (np.zeros(0, np.int64), np.zeros(0, np.int64))

    def feed(self, address: Bits, t_us: Bits) -> ImuSamples:
        """The sorted samples, (m,), that the next words, (n,), complete."""
        address = np.concatenate([self._kept[0], address])
        t_us = np.concatenate([self._kept[1], t_us])
        codes, count = address >> 28 & 7, len(address)
        whole = np.arange(max(0, count - 6))
        for code in range(7):
            whole = whole[codes[whole + code] == code]
        # what may go on in the next words
        begins = np.flatnonzero(codes[-6:] == 0) + max(0, count - 6)
        inside = begins[-1:] if len(begins) and begins[-1] + 7 > count else begins[:0]
        end = int(inside[0]) if len(inside) else count
        self._kept = address[end:], t_us[end:]
        self.lost += end - 7 * len(whole)
        values = (address[whole[:, np.newaxis] + np.arange(7)] >> 12).astype(np.int16)
        samples = empty_imu(len(whole))
        samples["t"] = t_us[whole]
        samples["acceleration"] = values[:, :3] * _TURNED * G_PER_STEP * STANDARD_GRAVITY
        samples["temperature"] = values[:, 3] * DEGREES_C_PER_STEP + DEGREES_C_AT_0
        samples["angular_velocity"] = values[:, 4:] * _TURNED * DEGREES_S_PER_STEP * DEGREE
        return samples[np.argsort(samples["t"], kind="stable")]

    def flush(self) -> None:
        """The end of the file: incomplete samples are lost."""
        self.lost += len(self._kept[0])


@dataclass
class FrameAssembler:
    """Assembles a DAVIS's frames from words; incomplete ones are counted in `torn`."""

    width: int
    height: int
    camera: str
    frames: int = 0
    torn: int = 0
    lost: int = 0
    """words outside the sensor, of an unknown read, or of a frame before the first"""
    _reads: Bits = field(init=False)
    """(2, h * w) reset and signal reads of the current frame, -1: not read yet"""
    _words: int = 0
    """words of the current frame"""
    _stamps: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._reads = np.full((2, self.height * self.width), -1, np.int64)

    def feed(self, address: Bits, t_us: Bits) -> Iterator[Frame]:
        """The frames that the next words, (n,), complete."""
        x, y = pixel_of(address)
        kind = address >> 10 & 3
        right = (x < self.width) & (y < self.height) & (kind <= _SIGNAL)
        self.lost += len(right) - int(np.count_nonzero(right))
        pixel = ((self.height - 1 - y) * self.width + x)[right]
        adc, kind, t_us = address[right] & _MAX_ADC, kind[right], t_us[right]
        begin = 0
        for end in self._begins(pixel, kind):
            part = slice(begin, end)
            # a frame that cannot be whole costs no more than a look
            if self._words + end - begin < self._reads.size:
                self._drop(end > begin)
            else:
                self._collect(pixel[part], adc[part], kind[part], t_us[part])
                yield from self._end()
            begin = end
        self._collect(pixel[begin:], adc[begin:], kind[begin:], t_us[begin:])
        if self._is_whole:
            yield from self._end()

    def flush(self) -> Iterator[Frame]:
        """The end of the file: the current frame, if it is complete."""
        yield from self._end()

    def _begins(self, pixel: Bits, kind: Bits) -> list[int]:
        """Where further frames begin: at a reset of a pixel that the current frame has reset."""
        resets = np.flatnonzero(kind == _RESET)
        places = pixel[resets]
        order = np.argsort(places, kind="stable")
        again = places[order[1:]] == places[order[:-1]]
        # where the same pixel was reset before, counted from 1; 0: earlier in the frame at hand
        before = np.where(self._reads[_RESET, places] >= 0, 0, -1)
        before[order[1:][again]] = resets[order[:-1][again]] + 1
        latest = np.maximum.accumulate(before)
        begins, begin = [], 0
        while (at := int(np.searchsorted(latest, begin))) < len(latest):
            begins.append(int(resets[at]))
            begin = begins[-1] + 1
        return begins

    def _collect(self, pixel: Bits, adc: Bits, kind: Bits, t_us: Bits) -> None:
        stamps_seen = self._stamps
        if "begin" not in stamps_seen:
            # signals of a frame that began before the file did
            first = int(np.argmax(kind == _RESET)) if (kind == _RESET).any() else len(kind)
            self.lost += first
            pixel, adc, kind, t_us = pixel[first:], adc[first:], kind[first:], t_us[first:]
        # a pixel's second read is of a frame whose begin is lost
        fresh = np.zeros(len(pixel), np.bool_)
        fresh[np.unique(kind * self._reads.shape[1] + pixel, return_index=True)[1]] = True
        fresh &= self._reads[kind, pixel] < 0
        self.lost += len(fresh) - int(np.count_nonzero(fresh))
        pixel, adc, kind, t_us = pixel[fresh], adc[fresh], kind[fresh], t_us[fresh]
        self._reads[kind, pixel] = adc
        self._words += len(pixel)
        resets, signals = np.flatnonzero(kind == _RESET), np.flatnonzero(kind == _SIGNAL)
        if len(resets):
            stamps_seen.setdefault("begin", int(t_us[resets[0]]))
            stamps_seen["last_reset"] = int(t_us[resets[-1]])
            between = len(signals) and signals[0] < resets[-1]
            if "exposed" in stamps_seen or between:
                stamps_seen["rolling"] = 1
        if len(signals):
            stamps_seen.setdefault("exposed", int(t_us[signals[0]]))
            stamps_seen["end"] = int(t_us[signals[-1]])

    @property
    def _is_whole(self) -> bool:
        return self._words >= self._reads.size and bool((self._reads >= 0).all())

    def _end(self) -> Iterator[Frame]:
        """Give out the current frame if it is complete, and start a new one."""
        if not self._is_whole:
            self._drop()
            return
        light = np.clip(self._reads[_RESET] - self._reads[_SIGNAL], 0, _MAX_ADC)
        pixels = ((light * _WHITE + _MAX_ADC // 2) // _MAX_ADC).astype(np.uint16)
        stamps_seen = self._stamps
        exposed = stamps_seen["begin"] if "rolling" in stamps_seen else stamps_seen["last_reset"]
        stamps = stamps_seen["begin"], exposed, stamps_seen["exposed"], stamps_seen["end"]
        self._drop(torn=list(stamps) != sorted(stamps))
        if list(stamps) == sorted(stamps):
            shaped = pixels.reshape(self.height, self.width)
            yield Frame(self.frames, *stamps, shaped, self.camera)
            self.frames += 1

    def _drop(self, torn: bool = False) -> None:
        """Start a new frame; count the current one as torn if it is incomplete, or `torn`."""
        if self._words:
            self.torn += torn or not self._is_whole
            self._reads[:] = -1
        else:
            self.torn += torn
        self._words, self._stamps = 0, {}
