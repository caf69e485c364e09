"""Runtimes: what computes a network. All give the same events but for rounding."""

from __future__ import annotations

from importlib import import_module
from typing import Any, Protocol, cast

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.graph_network import GraphNetwork, Network
from evs.emulator.evsnet.state import NetworkState
from evs.emulator.sensor.parameters import SensorParameters
from evs.msgs import Events, EvsError, unknown

RUNTIMES = ("native", "onnxruntime", "reference")
"""native: the C++ kernel. onnxruntime: on whatever its execution providers run. reference: plain
NumPy, slow, the oracle of both"""


class Runtime(Protocol):
    """One network on one sensor: light into events, chunk by chunk.

    All that it remembers is in the state; a runtime serves any number of states.
    """

    name: str
    """as in RUNTIMES"""

    def own_arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """The arrays that it keeps in a state beside the common ones: as after endless rest.

        Floats in them are always finite.
        """

    def check(self, state: NetworkState) -> None:
        """Raise EvsError unless these arrays in the state are of this network and sensor."""

    def step(
        self, luminance: F32, state: NetworkState, begin_us: int, currents: F32 | None = None
    ) -> list[Events]:
        """One array of events for each tick of a chunk; tick i is (begin, begin + tick_us] + i.

        In: luminance (ticks, h, w) float32, contiguous, 1 or more ticks of weights.tick_us.
        In/out: state, which has been checked. Its arrays, counters and `ticks` move on.
        Out: currents (ticks, h, w) float32, filled where it is given: for tests.
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
) -> Runtime:
    """The runtime of that name. Only then is it imported. Raises EvsError.

    In: provider, for onnxruntime: its execution provider. threads: 0 is one a core. isa and
    sparse, for native: instruction set; whether pixels without current are left out.
    """
    if name not in RUNTIMES:
        raise unknown("runtime", name, RUNTIMES)
    if name != "onnxruntime" and provider != "cpu":
        raise EvsError(f"provider '{provider}' is for runtime onnxruntime; runtime {name} has none")
    if name != "onnxruntime" and isinstance(weights, GraphNetwork):
        raise EvsError(
            f"network '{weights.name}' is of another design than ours; only runtime onnxruntime "
            f"runs it: give model.runtime=onnxruntime, not {name}"
        )
    if name == "native":
        native = import_module("evs.emulator.evsnet.native")
        return cast(Runtime, native.NativeRuntime(sensor, weights, threads, isa, sparse))
    if name == "onnxruntime":
        portable = import_module("evs.emulator.evsnet.portable")
        return cast(Runtime, portable.PortableRuntime(sensor, weights, provider, threads))
    reference = import_module("evs.emulator.evsnet.reference")
    return cast(Runtime, reference.ReferenceRuntime(sensor, weights))
