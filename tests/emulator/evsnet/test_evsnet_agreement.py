"""The runtimes of a network agree with the reference, and each is reproducible to the byte."""

from __future__ import annotations

import dataclasses
import math
from functools import cache
from io import BytesIO

import numpy as np
import pytest

from evs.emulator.evsnet.graph_network import Network
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.network_files import MEMBER, families, load_network, network_names
from evs.emulator.evsnet.state import NetworkState
from evs.emulator.sensor import SensorParameters
from reference.agreement import Run, compare, run
from reference.flickering import HEIGHT, WIDTH, mixed_light
from reference.networks import random_network

pytestmark = pytest.mark.statistical

RUNTIMES = ("native", "onnxruntime")
"""those beside the reference"""
EVERY = ("reference", *RUNTIMES)
SENSOR = SensorParameters("test", WIDTH, HEIGHT, 0.2, 0.25, dark_lux=0.1)
TICKS = 240
ROUNDING = 4e-6
"""of a sum of 56 products in floats, through seven layers"""


def one_of_each(names: list[str]) -> list[str]:
    """The networks that are in no family, and the families: members have one design."""
    return [*families(names), *(name for name in names if not MEMBER.fullmatch(name))]


NETWORKS = {
    "causal, 8": random_network(11, 8),
    "causal, 4": random_network(12, 4),
    "centred, 8, biased": random_network(13, 8, biased=True, look_ahead=3),
    "centred, 4": random_network(14, 4, look_ahead=3),
    "ahead by 7, 5, 2 blocks, biased": random_network(15, 5, 2, biased=True, look_ahead=1),
    "16, 1 block": random_network(16, 16, 1),
    # and those that come with evs, one of each family
    **{name: load_network(name, 4) for name in one_of_each(network_names())},
}


SLOW = ("centred, 4", "ahead by 7, 5, 2 blocks, biased", "16, 1 block")


MANY = ("causal, 8", "centred, 8, biased", "evsnet_c8")
"""networks whose pixels also fire many events per tick"""


@pytest.fixture(
    scope="module",
    params=[
        *(pytest.param((name, "one"), id=name, marks=[pytest.mark.slow] if name in SLOW else [])
          for name in NETWORKS),
        *(pytest.param((name, "many"), id=f"{name}, many") for name in MANY),
    ]
)  # fmt: skip
def case(request: pytest.FixtureRequest) -> tuple[Network, str]:
    """A network, and the events of a pixel per tick."""
    name, events_per_tick = request.param
    return NETWORKS[name], events_per_tick


def model(
    case: tuple[Network, str], runtime: str, sensor: SensorParameters = SENSOR, threads: int = 0
) -> EvsNetModel:
    weights, events_per_tick = case
    return EvsNetModel(
        sensor, weights, runtime=runtime, threads=threads, events_per_tick=events_per_tick
    )


def same(one: Run, other: Run) -> bool:
    """Same bytes of currents, events and state."""
    joined = [[events.tobytes() for events in run.events] for run in (one, other)]
    return (
        one.currents.tobytes() == other.currents.tobytes()
        and joined[0] == joined[1]
        and one.state == other.state
    )


@pytest.fixture(scope="module")
def expected(case: tuple[Network, str]) -> Run:
    """What the reference makes of TICKS ticks."""
    return run(model(case, "reference"), mixed_light(TICKS))


@pytest.mark.parametrize("runtime", RUNTIMES)
def test_a_runtime_agrees_with_the_reference(
    case: tuple[Network, str], expected: Run, runtime: str
) -> None:
    found = compare(
        model(case, "reference"), expected, run(model(case, runtime), mixed_light(TICKS))
    )
    assert found.events > 5_000
    assert found.current_error < ROUNDING
    assert found.untied == 0
    assert found.ties <= found.expected_ties + 4 * math.sqrt(found.expected_ties) + 1
    assert found.misplaced == 0


@pytest.mark.parametrize("runtime", EVERY)
def test_any_cut_gives_the_same_bytes(case: tuple[Network, str], runtime: str) -> None:
    light = mixed_light(70)
    one = model(case, runtime)
    whole = run(one, light, cut=32)
    assert sum(map(len, whole.events)) > 1_000
    for cut in (1, 5, 8, 16, 31):
        assert same(run(one, light, cut=cut), whole), cut


@pytest.mark.parametrize("runtime", RUNTIMES)
def test_any_number_of_threads_gives_the_same_bytes(
    case: tuple[Network, str], runtime: str
) -> None:
    light = mixed_light(70)
    one = run(model(case, runtime, threads=1), light)
    for threads in (0, 2, 3):
        assert same(run(model(case, runtime, threads=threads), light), one), threads


@pytest.mark.parametrize("runtime", EVERY)
def test_a_pixel_is_the_same_wherever_it_stands(case: tuple[Network, str], runtime: str) -> None:
    light = mixed_light(40)
    whole = run(model(case, runtime), light).currents
    # one row, a few pixels, one: other blocks, lanes and fillings
    for rows, columns in (((7, 8), (0, 40)), ((20, 23), (30, 33)), ((30, 31), (39, 40))):
        part = (slice(None), slice(*rows), slice(*columns))
        height, width = light[part].shape[1:]
        sensor = dataclasses.replace(SENSOR, width=width, height=height)
        found = run(model(case, runtime, sensor), light[part]).currents
        assert found.tobytes() == whole[part].tobytes()


@pytest.mark.parametrize("runtime", EVERY)
def test_a_stream_goes_on_from_where_it_was_saved(case: tuple[Network, str], runtime: str) -> None:
    light = mixed_light(60)
    one = model(case, runtime)
    whole, _ = one.step_chunk(light, one.init(3), 0, 1000)
    first, state = one.step_chunk(light[:23], one.init(3), 0, 1000)
    with BytesIO() as file:
        np.savez(file, **state.save())
        file.seek(0)
        with np.load(file) as saved:
            restored = NetworkState.restore(saved)
    assert restored == state
    # the first goes on too: what one state steps does not show in the other
    one.step_chunk(light[23:] * np.float32(2), state, 23_000, 1000)
    again = model(case, runtime)
    second, _ = again.step_chunk(light[23:], restored, 23_000, 1000)
    assert b"".join(e.tobytes() for e in first + second) == b"".join(e.tobytes() for e in whole)


@cache
def long_run(seed: int, channels: int, biased: bool, look_ahead: int) -> tuple[EvsNetModel, Run]:
    """The reference with random weights, and what it makes of 320 ticks."""
    weights = random_network(100 + seed, channels, biased=biased, look_ahead=look_ahead)
    reference = EvsNetModel(SENSOR, weights, runtime="reference")
    return reference, run(reference, mixed_light(320, seed))


@pytest.mark.slow
@pytest.mark.parametrize("runtime", RUNTIMES)
def test_over_many_networks_only_ties_differ(runtime: str) -> None:
    found = []
    for seed in range(2):
        light = mixed_light(320, seed)
        for channels, biased, look_ahead in (
            (8, False, 0),
            (4, False, 0),
            (8, True, 3),
            (4, True, 3),
        ):
            reference, expected = long_run(seed, channels, biased, look_ahead)
            other = EvsNetModel(SENSOR, reference.weights, runtime=runtime)
            found.append(compare(reference, expected, run(other, light)))
    assert max(one.current_error for one in found) < ROUNDING
    assert sum(one.untied + one.misplaced for one in found) == 0
    # there are ties among a million events
    events = sum(one.events for one in found)
    assert events > 1_000_000
    assert 0 < sum(one.unpaired for one in found) < 1e-4 * events
