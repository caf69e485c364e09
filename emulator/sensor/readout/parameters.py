"""ReadoutParameters: every number of a readout, checked."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Never

from evs.emulator.config.declaration import specialised
from evs.emulator.config.sensor import ReadoutKeys
from evs.emulator.sensor.ranges import check_declared, is_whole
from evs.msgs import EvsError


@dataclass(frozen=True)
@specialised
class ReadoutParameters(ReadoutKeys[Never]):
    """[readout] of a sensor; nothing of it by default. Raises EvsError for values without sense.

    The way of an event: region of interest and mask, the latency of its pixel (sensor.latency_us),
    `order`, event rate control, link. What is dropped on the way is counted by cause.
    """

    def __post_init__(self) -> None:
        check_declared("sensor.readout", self)
        for key, each, form in (("roi", 4, "x y width height"), ("mask", 2, "x y")):
            values = getattr(self, key)
            if not isinstance(values, tuple) or not all(map(is_whole, values)):
                raise EvsError(f"sensor.readout.{key} is {values!r}; give whole numbers")
            if len(values) % each:
                raise EvsError(
                    f"sensor.readout.{key} has {len(values)} numbers; give {form}, and again {form}"
                )
        if not isinstance(self.mask_file, str):
            raise EvsError(f"sensor.readout.mask_file is {self.mask_file!r}; give a file")
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
