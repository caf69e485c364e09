"""Latency does not depend on the length of the ticks."""

from __future__ import annotations

import pytest

from evs.emulator.config import SensorConfig
from evs.emulator.sensor import resolve_sensor
from evs_lab.characterise import Bench, measure_latency

TICKS_US = (10, 100, 1000)


@pytest.mark.statistical
@pytest.mark.parametrize("preset", ["davis346", "imx636", "dvxplorer", "dvs128", "genx320"])
def test_latency_of_a_preset_in_ticks_of_any_length(preset: str) -> None:
    """Light doubles to 2 klux in a microsecond, before a tick; -s prints the table of pixel.md."""
    bench = Bench(resolve_sensor(SensorConfig(preset=preset)), threads=1)
    found = [measure_latency(bench, 2000.0, pixels=2000, tick_us=us).mean_s[0] for us in TICKS_US]
    print(f"\n| {preset} | " + " | ".join(f"{1e6 * s:.0f} us" for s in found) + " |")
    assert found[1] == pytest.approx(found[0], rel=0.15)
    assert found[2] == pytest.approx(found[0], rel=0.15)
