"""Which terms the pixels have. A term that is off has no state, no loop and no random number."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from evs.emulator.base import features
from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.sensor.parameters import SensorParameters

TERMS = {term.name: keys for term, keys in features.TERMS.items()}
"""term -> the parameters that are 0 where it is off, as they are declared"""


def reduced(sensor: SensorParameters, switches: Switches) -> SensorParameters:
    """The sensor without the terms that are forced off."""
    keys = [key for name, keys in TERMS.items() if name in switches.off for key in keys]
    zeros: dict[str, Any] = dict.fromkeys(keys, 0.0)
    return replace(sensor, **zeros) if zeros else sensor


def terms_of(
    sensor: SensorParameters,
    average: bool = False,
    causes: bool = False,
    switches: Switches = UNFORCED,
) -> frozenset[str]:
    """The terms that the sensor needs, or that are forced on.

    Args:
        sensor: The sensor, resolved.
        average: Whether there is a running mean in front of the pixels.
        causes: Whether events say why they came about.
        switches: What is forced.

    Returns:
        Names of base.features.FEATURES, and `hot_pixels` where the defects leak.
    """
    needed: dict[str, object] = {
        name: any(getattr(sensor, key) for key in keys) for name, keys in TERMS.items()
    }
    needed |= {"refractory": sensor.refractory_us, "running_mean": average, "causes": causes}
    on = {name for name, need in needed.items() if switches.decide(name, need)}
    hot = sensor.has_hot_pixels or "defects" in switches.on
    return frozenset(on | ({"hot_pixels"} if hot else set()))
