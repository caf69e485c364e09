"""The table of runtimes; `native` is native.py and core/evsnet. Events differ by rounding only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.graph_network import GraphNetwork, Network
from evs.emulator.evsnet.state import NetworkState
from evs.emulator.sensor.parameters import SensorParameters
from evs.msgs import Events, EvsError, unknown
from evs.msgs.registry import load


@dataclass(frozen=True)
class RuntimeRow:
    """One runtime."""

    target: str
    """"module:Class", imported at first use"""
    options: tuple[str, ...] = ()
    """what its constructor takes after sensor and weights: of provider, threads, isa and sparse"""
    any_graph: bool = False
    """runs networks of other designs than ours too"""


RUNTIMES = {
    # our C++ kernel, which steps only what moves
    "native": RuntimeRow(
        "evs.emulator.evsnet.native:NativeRuntime", options=("threads", "isa", "sparse")
    ),
    # on whatever its execution providers run
    "onnxruntime": RuntimeRow(
        "evs.emulator.evsnet.onnx_runtime:OnnxRuntime",
        options=("provider", "threads"),
        any_graph=True,
    ),
    # plain NumPy, slow, the oracle of both
    "reference": RuntimeRow("evs.emulator.evsnet.reference:ReferenceRuntime"),
}
"""model.runtime -> its row"""


class Runtime(Protocol):
    """One network on one sensor: light into events, chunk by chunk.

    All that it remembers is in the state; a runtime serves any number of states.
    """

    name: str
    """a key of RUNTIMES"""

    def own_arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """The arrays that it keeps in a state beside the common ones: as after endless rest.

        Floats in them are always finite.
        """

    def check(self, state: NetworkState) -> None:
        """Raise EvsError unless these arrays in the state are of this network and sensor."""

    def step(
        self, luminance: F32, state: NetworkState, begin_us: int, currents: F32 | None = None
    ) -> list[Events]:
        """Step a chunk of ticks; tick i is (begin_us + i tick_us, begin_us + (i + 1) tick_us].

        Args:
            luminance: (ticks, h, w) float32, contiguous, 1 or more ticks of weights.tick_us.
            state: It has been checked. Its arrays, counters and `ticks` move on in place.
            begin_us: Where the first tick begins, us.
            currents: (ticks, h, w) float32, filled where it is given: for tests.

        Returns:
            One array of events a tick.
        """


def make_runtime(
    name: str,
    sensor: SensorParameters,
    weights: Network,
    *,
    provider: str = "cpu",
    threads: int = 0,
    isa: str = "auto",
    sparse: bool = True,
    most: int = 1,
) -> Runtime:
    """The runtime of that name; only then is it imported.

    Args:
        name: A key of RUNTIMES.
        sensor: The sensor, resolved.
        weights: The network.
        provider: The execution provider of onnxruntime.
        threads: Worker threads; 0: one per core.
        isa: Instruction set of native.
        sparse: Whether native leaves out pixels without current.
        most: Events of a pixel in a tick, see bilif.most_events.

    Raises:
        EvsError: No such runtime, or it cannot run the network.
    """
    if name not in RUNTIMES:
        raise unknown("runtime", name, RUNTIMES)
    row = RUNTIMES[name]
    if "provider" not in row.options and provider != "cpu":
        raise EvsError(f"provider '{provider}' is for runtime onnxruntime; runtime {name} has none")
    if not row.any_graph and isinstance(weights, GraphNetwork):
        raise EvsError(
            f"network '{weights.name}' is of another design than ours; only runtime onnxruntime "
            f"runs it: give model.runtime=onnxruntime, not {name}"
        )
    options = {"provider": provider, "threads": threads, "isa": isa, "sparse": sparse}
    given = {option: options[option] for option in row.options}
    made: Runtime = load(row.target)(sensor, weights, most=most, **given)
    return made
