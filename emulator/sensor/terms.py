"""Which terms the pixels have. A term that is off has no state, no loop and no random number."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.config.declaration import declaration
from evs.emulator.sensor.parameters import SensorParameters

IDLE_HIGHPASS = 1e-300
"""2 pi f in 1 / us of a high pass that is there and does nothing"""


def _parameters_of_terms() -> dict[str, tuple[str, ...]]:
    terms: dict[str, tuple[str, ...]] = {}
    for field in fields(SensorParameters):
        if (declared := declaration(field)) is not None and declared.term:
            terms[declared.term] = (*terms.get(declared.term, ()), field.name)
    return terms


TERMS = _parameters_of_terms()
"""term -> the parameters that are 0 where it is off, as they are declared"""


def reduced(sensor: SensorParameters, switches: Switches) -> SensorParameters:
    """The sensor without the terms that are forced off."""
    keys = [key for name, keys in TERMS.items() if name in switches.off for key in keys]
    zeros: dict[str, Any] = dict.fromkeys(keys, 0.0)
    return replace(sensor, **zeros) if zeros else sensor


@dataclass(frozen=True)
class SensorTerms:
    """Of a plain pixel; each name is one of base.features.FEATURES, except the last two."""

    threshold_spread: bool
    rate_spread: bool
    defects: bool
    low_pass: bool
    follower: bool
    high_pass: bool
    leak: bool
    parasitic_leak: bool
    shot_noise: bool
    photon_noise: bool
    refractory: bool
    refractory_spread: bool
    running_mean: bool
    causes: bool
    hot_pixels: bool
    """leak has a tail of warm and hot pixels"""
    idle_highpass: float
    """the high pass where its rate is 0: 2 pi f, 1 / us"""

    @property
    def skips(self) -> bool:
        """Whether anything happens with time in blocks that are skipped."""
        filters = self.low_pass or self.follower or self.high_pass
        return self.leaks or filters or self.refractory or self.running_mean

    @property
    def leaks(self) -> bool:
        """Whether any reference sinks."""
        return self.leak or self.parasitic_leak or self.hot_pixels

    @classmethod
    def of(
        cls,
        sensor: SensorParameters,
        average: bool = False,
        causes: bool = False,
        switches: Switches = UNFORCED,
    ) -> SensorTerms:
        """Those that the sensor needs, or that are forced on."""
        needed: dict[str, object] = {
            name: any(getattr(sensor, key) for key in keys) for name, keys in TERMS.items()
        }
        needed |= {"refractory": sensor.refractory_us, "running_mean": average, "causes": causes}
        on = {name: switches.decide(name, need) for name, need in needed.items()}
        return cls(
            **on,
            hot_pixels=sensor.has_hot_pixels or "defects" in switches.on,
            idle_highpass=IDLE_HIGHPASS if "high_pass" in switches.on else 0.0,
        )

    @property
    def features(self) -> dict[str, bool]:
        """Whether each is on, by its name."""
        names = (*TERMS, "running_mean", "causes")
        return {name: bool(getattr(self, name)) for name in names}
