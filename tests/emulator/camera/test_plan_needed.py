"""A scene that needs a code path has it on, and comes out differently where it is forced off, or
the same where the path only saves time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evs.emulator.base.features import FEATURES, NAMES, UNFORCED, Switches
from evs.emulator.config import PlanConfig
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.sensor import SensorParameters
from evs.msgs import EvsError
from reference.networks import random_network
from reference.planned import NEEDS, told

TICKS = 12
FASTER = {"hierarchy", "light_reach"}
"""What they leave out can change nothing."""


def test_every_code_path_has_a_film_that_needs_it() -> None:
    assert {*NEEDS} == {*NAMES} - {"cold_tiles"}  # below


@pytest.mark.parametrize("name", NEEDS)
def test_what_is_needed_is_on_and_missed_where_it_is_off(name: str, tmp_path: Path) -> None:
    film = NEEDS[name]
    whole, without = film.world(tmp_path), film.world(tmp_path, off=[name])
    given, left = told(whole, TICKS), told(without, TICKS)
    features = [world.cameras[0].features[name] for world in (whole, without)]
    # the picture is traced anew where something moved, never as a whole: there it is off
    assert features == [name != "full_retrace", False]
    assert (given != left) == (name not in FASTER)
    (decision,) = [x for x in without.cameras[0].plan.decisions if x.feature.name == name]
    assert decision.forced
    assert "[plan]" in decision.why


def test_the_network_has_its_own() -> None:
    """A biased network makes events where nothing moves: leaving cold tiles out loses them."""
    sensor = SensorParameters("test", 24, 16, 0.2, 0.2, dark_lux=0.1)
    still = np.full((40, 16, 24), 0.5, np.float32)
    biased = random_network(9, biased=True)
    counts = []
    for switches in (UNFORCED, Switches(off=frozenset({"cold_tiles"}))):
        model = EvsNetModel(sensor, biased, threads=1, switches=switches)
        state, events = model.init(0), 0
        for k, frame in enumerate(still):
            made, state = model.step(frame, state, 1000 * k, 1000 * k + 1000)
            events += len(made)
        counts.append(events)
        assert model.features["cold_tiles"] == (switches is UNFORCED)
    assert counts[0] > counts[1]


def test_names_that_are_none_and_what_cannot_run_idle_are_refused() -> None:
    for key in ("on", "off"):
        with pytest.raises(EvsError, match=f"at plan.{key}: no code path 'foq'; there is: fog"):
            Switches.of(PlanConfig(**{key: ("foq",)}))
    with pytest.raises(EvsError, match="'fog' is in plan\\.off too"):
        Switches.of(PlanConfig(on=("fog",), off=("fog",)))
    for feature in FEATURES:
        config = PlanConfig(on=(feature.name,))
        if feature.idle:
            with pytest.raises(EvsError, match="cannot be on where nothing needs it"):
                Switches.of(config)
        else:
            assert Switches.of(config).on == {feature.name}


def test_everything_is_all_that_can_run_idle_but_what_is_off() -> None:
    switches = Switches.of(PlanConfig(everything=True, off=("fog", "lens")))
    assert switches.on == {x.name for x in FEATURES if not x.idle} - {"fog"}
    assert switches.off == {"fog", "lens"}
