"""Which chip an AEDAT2 file is of, where its header does not say.

jAER did not state the chip at first, and v2e does not. The bits of the addresses tell the layouts
apart: those of a DVS128 end at bit 15, events of a DAVIS have nothing below bit 10. What they
cannot tell is the size of a DAVIS with events in a corner only, and such a file is refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evs.drivers.files.aedat2.layout import APS, CHIP, pixel_of
from evs.drivers.files.chips import CHIP_NAMES, Bits, Chip, chip_named
from evs.msgs import EvsError

_V2E = re.compile(r"\bv2e\b")
_DAVIS = ("davis240", "davis346")
"""those that addresses tell; at 640 x 480 px a DVXplorer's are the same, turned"""
_LOW, _DVS128_BITS = 0x3FF, 16
_REACHED = 0.9
"""share of each side that the addresses must reach, so that a DAVIS's size counts as found"""


@dataclass(frozen=True)
class Extent:
    """What the addresses of a file have in common."""

    every_bit: int = 0
    """the bits that any event has, where those with bit 31 are none"""
    x: int = 0
    """highest in the layout of a DAVIS, frames included"""
    y: int = 0

    @classmethod
    def of(cls, addresses: Iterable[Bits]) -> Extent:
        """Look at every word."""
        every_bit = x_most = y_most = 0
        for address in addresses:
            high = (address & APS) != 0
            every_bit |= int(np.bitwise_or.reduce(address[~high], initial=0))
            # an IMU's words have values where others have x and y
            x, y = pixel_of(address[~high | (address & 0xC00 != 0xC00)])
            x_most = max(x_most, int(x.max(initial=0)))
            y_most = max(y_most, int(y.max(initial=0)))
        return cls(every_bit, x_most, y_most)


def found_chip(path: Path, lines: Sequence[str], addresses: Iterable[Bits]) -> tuple[Chip, str]:
    """Find the chip of a file whose header does not state it.

    Args:
        path: The file; jAER's names begin with the chip's.
        lines: Its header.
        addresses: Its words.

    Returns:
        The chip, and why, in one line.

    Raises:
        EvsError: Nothing decides between several chips.
    """
    extent = Extent.of(addresses)
    named = chip_named(path.name.partition("-")[0]) if "-" in path.name else None
    chip, reason = None, ""
    if any(_V2E.search(line) for line in lines):
        chip, reason = _of_v2e(extent)
    elif named is not None:
        chip, reason = named, "the file's name begins with it, as jAER's do"
    elif extent.every_bit & _LOW and not extent.every_bit >> _DVS128_BITS:
        chip, reason = chip_named("dvs128"), "no address has more than 16 bits"
    elif not extent.every_bit & _LOW and (extent.every_bit or extent.x or extent.y):
        chip, reason = _davis(extent)
    if chip is None:
        raise EvsError(
            f"{path} does not state its chip (no line '{CHIP.strip()}'), and its addresses fit "
            f"several: add --chip NAME, one of {', '.join(CHIP_NAMES)}"
        )
    return chip, f"{chip.name}, since {reason}; --chip NAME selects another"


def _of_v2e(extent: Extent) -> tuple[Chip | None, str]:
    """v2e writes the addresses of three chips."""
    if extent.every_bit & _LOW:
        return chip_named("dvs640"), "v2e wrote it and its addresses have low bits"
    return _davis(extent)


def _davis(extent: Extent) -> tuple[Chip | None, str]:
    """The smallest DAVIS that has all addresses, if they reach most of it."""
    for chip in map(chip_named, _DAVIS):
        assert chip is not None
        if extent.x < chip.width and extent.y < chip.height:
            reached = extent.x >= _REACHED * chip.width and extent.y >= _REACHED * chip.height
            reason = f"its addresses are a DAVIS's and reach x {extent.x}, y {extent.y}"
            return (chip, reason) if reached else (None, "")
    return None, ""
