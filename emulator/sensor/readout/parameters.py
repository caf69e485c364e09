"""ReadoutParameters: every number of a readout, checked."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from evs.emulator.sensor.ranges import check_ranges, check_whole
from evs.msgs import EvsError, unknown

ORDERS = ("ideal", "arbiter", "scan")
ERC_DROPS = ("time", "row", "column")
STAMPS = ("sent", "read")

# lowest and highest value that makes sense, both allowed
_WHOLE = {
    "row_ns": (0, 10**9),
    "column_ns": (0, 10**9),
    "scan_us": (1, 10**9),
    "erc_period_us": (1, 10**6),
    "fifo": (1, 2**31),
}
_REAL = {
    "jitter_ns": (0.0, 1e9),
    "erc_rate_mevs": (0.0, 8000.0),
    "bandwidth_mevs": (0.0, 8000.0),
}
_NAMES = {
    "order": ("order of readout", ORDERS),
    "erc_drop": ("way to drop", ERC_DROPS),
    "stamp": ("stamp", STAMPS),
}


@dataclass(frozen=True)
class ReadoutParameters:
    """[readout] of a sensor; nothing of it by default. Raises EvsError for values without sense.

    The way of an event: region of interest and mask, the latency of its pixel (sensor.latency_us),
    `order`, event rate control, link. What is dropped on the way is counted by cause.
    """

    order: str = "ideal"
    """ideal: every event at its own time | arbiter: rows in turn, as they ask (DAVIS)
    scan: all rows at fixed times (DVXplorer)"""
    row_ns: int = 0
    """arbiter: time of a row access, ns; its end is the stamp of everything the row then holds"""
    column_ns: int = 0
    """arbiter: time that each event of the row takes after that, ns"""
    jitter_ns: float = 0.0
    """arbiter: standard deviation of the row access, ns"""
    scan_us: int = 200
    """scan: time between two scans, us; stamps are multiples of it; a pixel gives one event each"""
    erc_rate_mevs: float = 0.0
    """event rate control: most events that pass, Mev/s; 0: off"""
    erc_period_us: int = 200
    """its reference period, us, in which events are counted (OpenEB's default)"""
    erc_drop: str = "time"
    """what it drops. time: evenly among all events | row, column: all events of some lines"""
    bandwidth_mevs: float = 0.0
    """most events that leave by the link, Mev/s; 0: unlimited"""
    fifo: int = 65536
    """events that may wait for the link; what comes then is dropped"""
    stamp: str = "sent"
    """sent: the stamp says when an event leaves by the link | read: when it was read before that,
    and its packet is that of this stamp: the link then only drops"""
    roi: tuple[int, ...] = ()
    """region of interest: x y width height of a rectangle, px; any number of them; none: all"""
    mask: tuple[int, ...] = ()
    """x y of each pixel that is switched off, one after the other"""
    mask_file: str = field(default="", metadata={"file": True})
    """a text file of such pixels, one x y a line"""

    def __post_init__(self) -> None:
        self._check_numbers()
        for key, (what, known) in _NAMES.items():
            if getattr(self, key) not in known:
                raise unknown(f"{what} (sensor.readout.{key})", str(getattr(self, key)), known)
        for key, each, form in (("roi", 4, "x y width height"), ("mask", 2, "x y")):
            values = getattr(self, key)
            if not isinstance(values, tuple) or not all(map(_is_whole, values)):
                raise EvsError(f"sensor.readout.{key} is {values!r}; give whole numbers")
            if len(values) % each:
                raise EvsError(
                    f"sensor.readout.{key} has {len(values)} numbers; give {form}, and again {form}"
                )
        if not isinstance(self.mask_file, str):
            raise EvsError(f"sensor.readout.mask_file is {self.mask_file!r}; give a file")

    def _check_numbers(self) -> None:
        for key, (least, most) in _WHOLE.items():
            check_whole("sensor.readout", self, key)
            value = getattr(self, key)
            if not least <= value <= most:
                raise EvsError(f"sensor.readout.{key} is {value}; give {least} ... {most}")
        check_ranges("sensor.readout", self, _REAL)
        if 0 < self.bandwidth_mevs < 1e-6:
            raise EvsError(
                f"sensor.readout.bandwidth_mevs is {self.bandwidth_mevs:g}; "
                "give 0 (unlimited) or 1e-06 (an event a second) and more"
            )
        if self.erc_rate_mevs > 0 and self.erc_target == 0:
            raise EvsError(
                f"sensor.readout.erc_rate_mevs is {self.erc_rate_mevs:g}: not one event each "
                f"{self.erc_period_us} us; raise it or erc_period_us"
            )

    @property
    def erc_target(self) -> int:
        """Events that event rate control lets through in a period; 0: it is off."""
        # Mev/s times us; what is whole in decimal stays so
        return math.floor(round(self.erc_rate_mevs * self.erc_period_us, 6))

    @property
    def link_rate(self) -> int:
        """Events that leave by the link in a second at most; 0: unlimited."""
        return round(self.bandwidth_mevs * 1e6)

    @property
    def is_ideal(self) -> bool:
        """Whether every event passes at its own time."""
        limits = self.erc_rate_mevs > 0 or self.bandwidth_mevs > 0
        return self.order == "ideal" and not (limits or self.roi or self.mask or self.mask_file)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)
