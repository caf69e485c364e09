"""The chips of event cameras: their sizes, and how AEDAT2 files pack their addresses.

AEDAT2 does not describe its addresses: each of jAER's chip classes has a layout of its own. jAER
counts y from below, so a class that does not turn y has it from the bottom in the file. Sources:
jAER's chip classes, and v2e's writer, which uses those of DAVIS346, DAVIS240 and DVS640.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

Bits = npt.NDArray[np.int64]
"""(n,) addresses, or parts of them"""

APS, IMU, EXTERNAL = "APS words", "IMU words", "external input events"
SYNC = "sync words"

_DAVIS_WORDS: tuple[tuple[str, int, int | None], ...] = (
    (IMU, 0x8000_0C00, 0x8000_0C00),
    (APS, 0x8000_0000, 0x8000_0000),
    (EXTERNAL, 0x400, 0x400),
)


@dataclass(frozen=True)
class Chip:
    """One chip; by default its addresses are a DAVIS's."""

    name: str
    """as `chip` takes it, and the stream's `sensor`"""
    width: int
    height: int
    classes: str
    """regular expression of its names in headers, those of jAER's classes; in any case"""
    x_shift: int = 12
    x_bits: int = 10
    y_shift: int = 22
    y_bits: int = 9
    p_shift: int = 11
    x_from_right: bool = True
    y_from_bottom: bool = True
    on: int = 1
    """value of the polarity's bit of an ON event"""
    other_words: tuple[tuple[str, int, int | None], ...] = _DAVIS_WORDS
    """(kind, mask, value; None: any of its bits) of words other than events; the first counts"""
    is_davis: bool = True
    """whether it has a DAVIS's frames and IMU samples"""

    @property
    def used(self) -> int:
        """The bits that an event may have."""
        if self.is_davis:
            return (1 << 31) - 1
        x, y = (1 << self.x_bits) - 1, (1 << self.y_bits) - 1
        return x << self.x_shift | y << self.y_shift | 1 << self.p_shift

    def fields(self, address: Bits, width: int, height: int) -> tuple[Bits, Bits, Bits]:
        """The events of addresses, (n,), of a sensor of this size.

        Returns:
            (n,) x and y from the upper left, -1 where they lie outside; (n,) p.
        """
        x = address >> self.x_shift & (1 << self.x_bits) - 1
        y = address >> self.y_shift & (1 << self.y_bits) - 1
        outside = (x >= width) | (y >= height) | (address & ~self.used != 0)
        x = width - 1 - x if self.x_from_right else x
        y = height - 1 - y if self.y_from_bottom else y
        p = (address >> self.p_shift & 1) == self.on
        return np.where(outside, -1, x), np.where(outside, -1, y), p.astype(np.int64)

    def kinds(self, address: Bits) -> dict[str, npt.NDArray[np.bool_]]:
        """Kind of words other than events -> (n,) which of the addresses, (n,), are of it."""
        free, found = np.ones(len(address), np.bool_), {}
        for kind, mask, value in self.other_words:
            masked = address & mask
            found[kind] = free & (masked != 0 if value is None else masked == value)
            free &= ~found[kind]
        return found


_DAVIS = Chip("davis346", 346, 260, r"davis346(?!\w*stereo)\w*")
_DVS128 = Chip(
    name="dvs128",
    width=128,
    height=128,
    classes=r"dvs128|tmpdiff128",
    x_shift=1,
    x_bits=7,
    y_shift=8,
    y_bits=7,
    p_shift=0,
    on=0,
    # what is no bit of an event: the external input, or the other eye of a stereo pair
    other_words=((SYNC, 0xFFFF_8000, None),),
    is_davis=False,
)
_DVS640 = Chip(
    name="dvs640",
    width=640,
    height=480,
    classes=r"dvs640",
    x_shift=1,
    y_shift=11,
    y_bits=10,
    p_shift=0,
    other_words=(),
    is_davis=False,
)
_IMX636 = Chip(
    name="imx636",
    width=1280,
    height=720,
    classes=r"propheseeimx636hd",
    x_shift=0,
    x_bits=11,
    y_shift=11,
    y_bits=11,
    p_shift=22,
    x_from_right=False,
    y_from_bottom=False,
    other_words=(),
    is_davis=False,
)

CHIPS = (
    _DAVIS,
    replace(
        _DAVIS, name="davis240", width=240, height=180, classes=r"davis240[abc]?|dvs240|sbret10"
    ),
    replace(_DAVIS, name="davis640", width=640, height=480, classes=r"davis640\w*"),
    replace(_DAVIS, name="davis208", width=208, height=192, classes=r"davis208\w*color"),
    replace(_DAVIS, name="davis208pp", width=208, height=192, classes=r"davis208\w*", on=0),
    replace(_DAVIS, name="davis128", width=128, height=128, classes=r"davis128(color)?"),
    replace(_DAVIS, name="scidvs", width=112, height=126, classes=r"scidvs"),
    _DVS128,
    _DVS640,
    replace(
        _DVS640,
        name="dvs1280",
        width=1280,
        height=720,
        classes=r"dvs1280x720\w*",
        x_bits=11,
        y_shift=12,
    ),
    replace(
        _DAVIS,
        name="dvxplorer",
        width=640,
        height=480,
        classes=r"dvxplorer\w*",
        x_from_right=False,
        y_from_bottom=False,
        is_davis=False,
    ),
    replace(
        _IMX636,
        name="s5krc1s",
        width=960,
        height=720,
        classes=r"nrvs5krc1s",
        x_bits=10,
        y_shift=10,
        y_bits=10,
        p_shift=20,
    ),
    _IMX636,
)
"""Every chip whose addresses are known."""

CHIP_NAMES = tuple(chip.name for chip in CHIPS)


def chip_named(text: str) -> Chip | None:
    """The chip of a name in a header or on a command line; None: it is not known.

    Args:
        text: A chip's name, or a class of jAER with or without its package. A number, as in a
            source, may come before it, and a serial number after it.
    """
    for word in re.split(r"[\W_]+", text.strip().rpartition(".")[2]):
        for chip in CHIPS:
            if word.lower() == chip.name or re.fullmatch(chip.classes, word, re.IGNORECASE):
                return chip
    return None
