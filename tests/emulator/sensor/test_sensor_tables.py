"""Nested tables of a sensor: from its file, from the configuration, and how they go wrong."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from evs.emulator.config.declaration import any_path, parameter
from evs.emulator.config.decoding import plain_config
from evs.emulator.sensor.presets import SensorFile, fill
from evs.msgs import EvsError


@dataclass(frozen=True)
class Lens:
    tint: float = 0.0


@dataclass(frozen=True)
class Bus:
    rate: float = 5.0
    places: tuple[int, ...] = ()
    list: str = parameter("", "a file of names", is_path=any_path)
    lens: Lens = field(default_factory=Lens)


@dataclass(frozen=True)
class Chip:
    name: str
    width: int
    bus: Bus = field(default_factory=Bus)


@dataclass(frozen=True)
class LensConfig:
    tint: float | None = None


@dataclass(frozen=True)
class BusConfig:
    rate: float | None = None
    places: tuple[int, ...] | None = None
    list: str | None = None
    lens: LensConfig = field(default_factory=LensConfig)


@dataclass(frozen=True)
class ChipConfig:
    width: int | None = None
    bus: BusConfig = field(default_factory=BusConfig)


def chip(values: dict[str, Any], config: ChipConfig | None = None) -> Chip:
    return fill(
        Chip, SensorFile(Path("/in/chip.toml"), values), config or ChipConfig(), name="chip"
    )


def refusal(values: dict[str, Any], config: ChipConfig | None = None) -> str:
    with pytest.raises(EvsError) as error:
        chip(values, config)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_a_table_without_values_has_its_defaults() -> None:
    assert chip({"width": 3}) == Chip("chip", 3, Bus())


def test_the_configuration_goes_before_the_file_key_by_key() -> None:
    values = {"width": 3, "bus": {"rate": 2.0, "places": [4, 5], "lens": {"tint": 1.5}}}
    assert chip(values) == Chip("chip", 3, Bus(2.0, (4, 5), lens=Lens(1.5)))
    config = ChipConfig(bus=BusConfig(rate=9.0, lens=LensConfig(tint=0.5)))
    assert chip(values, config) == Chip("chip", 3, Bus(9.0, (4, 5), lens=Lens(0.5)))


def test_files_of_the_file_lie_beside_it() -> None:
    assert chip({"width": 3, "bus": {"list": "a/b.txt"}}).bus.list == "/in/a/b.txt"
    assert chip({"width": 3, "bus": {"list": "/c.txt"}}).bus.list == "/c.txt"
    assert chip({"width": 3, "bus": {"list": ""}}).bus.list == ""
    given = ChipConfig(bus=BusConfig(list="here.txt"))
    assert chip({"width": 3, "bus": {"list": "a.txt"}}, given).bus.list == "here.txt"


def test_refusals() -> None:
    assert "no key of sensor file /in/chip.toml 'bus.rat'; there is: bus.rate" in refusal(
        {"width": 3, "bus": {"rat": 1}}
    )
    assert "no key of sensor file /in/chip.toml 'bos'; there is: bus" in refusal({"bos": {}})
    assert "bus is 4; make it a table [bus]" in refusal({"width": 3, "bus": 4})
    assert "bus.lens is 'x'; make it a table [bus.lens]" in refusal({"bus": {"lens": "x"}})
    assert "lacks width; add it, or sensor.width=" in refusal({})
    assert "'name'" in refusal({"width": 3, "name": "other"})


def test_a_nested_table_from_python_is_checked_and_made_plain() -> None:
    config = ChipConfig(bus=BusConfig(rate=7))
    assert plain_config(config, "sensor").bus == BusConfig(rate=7.0)
    with pytest.raises(EvsError, match=r"sensor\.bus\.rate is '7'; give a finite number or None"):
        plain_config(ChipConfig(bus=BusConfig(rate="7")), "sensor")  # type: ignore[arg-type]
    with pytest.raises(EvsError, match=r"sensor\.bus is None; give a BusConfig"):
        plain_config(ChipConfig(bus=None), "sensor")  # type: ignore[arg-type]
    with pytest.raises(EvsError, match=r"sensor\.bus\.places is 3; give whole numbers or None"):
        plain_config(ChipConfig(bus=BusConfig(places=3)), "sensor")  # type: ignore[arg-type]
