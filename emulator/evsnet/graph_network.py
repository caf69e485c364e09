"""GraphNetwork: a network of another design, given by its ONNX graph and its sidecar.

The graph has the inputs and outputs of emulator/evsnet/onnx_graph.py, but its weights bear other
names, or it computes something else. Only runtime onnxruntime runs it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.bilif import most_events
from evs.emulator.evsnet.session import one_line, open_session, state_shapes
from evs.emulator.evsnet.weights import KERNEL_SIZE, NetworkWeights, check_numbers
from evs.msgs import EvsError

MAX_LATENCY_TICKS = 10_000


@dataclass(frozen=True, eq=False)
class GraphNetwork:
    """As much of a NetworkWeights as a graph holds. Raises EvsError where a number has no sense."""

    name: str
    graph: bytes
    """the ONNX model"""
    states: tuple[F32, ...]
    """of each state that it carries from call to call: (channels, ticks) float32 of a pixel whose
    light has stood still for ever"""
    current_at_rest: float
    """the current of such a pixel"""
    look_ahead: tuple[int, ...]
    """ticks; their sum is what its currents are late"""
    tau_s: float
    threshold: float
    linlog_dn: float
    tick_us: int
    spp: tuple[int, int]
    events_per_tick: str = "one"

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_numbers(self.name, self.tau_s, self.threshold, self.linlog_dn, self.tick_us, self.spp)
        most_events(self.events_per_tick)
        if not 0 <= self.latency_ticks <= MAX_LATENCY_TICKS or min(self.look_ahead, default=0) < 0:
            raise EvsError(
                f"network '{self.name}': look_ahead is {list(self.look_ahead)}; give ticks, "
                f"{MAX_LATENCY_TICKS} in all at most"
            )

    @property
    def channels(self) -> int:
        """C, of the widest state."""
        return max((int(state.shape[0]) for state in self.states), default=1)

    @property
    def receptive_field(self) -> int:
        """Ticks of X that one current depends on."""
        return 1 + sum(int(state.shape[1]) for state in self.states)

    @property
    def latency_ticks(self) -> int:
        """By how many ticks the current comes late."""
        return sum(self.look_ahead)

    @property
    def is_still(self) -> bool:
        """Whether still light gives a current of exactly 0."""
        return self.current_at_rest == 0.0


Network = NetworkWeights | GraphNetwork
"""What runtimes run."""


def held_at_rest(network: Network) -> tuple[F32, ...]:
    """What each of its FIFOs holds while light stands still: (channels, ticks) float32 each."""
    if isinstance(network, GraphNetwork):
        return network.states
    return tuple(np.repeat(rest[:, np.newaxis], KERNEL_SIZE - 1, axis=1) for rest in network.rest())


MAX_SETTLE_TICKS = 4096
"""ticks of X = 0 after which a network must have come to rest"""
_CHUNK, _PIXELS = 32, 256


def read_graph_network(graph: bytes, sidecar: Mapping[str, Any]) -> GraphNetwork:
    """Read the network of a graph whose weights have other names than ours.

    It is run without light until the states come to rest.

    Args:
        graph: The ONNX file.
        sidecar: Checked values of NAME.toml.

    Raises:
        EvsError: Inputs or outputs of another shape, a graph that does not run or does not come to
            rest, numbers without sense.
    """
    session = open_session(graph)
    shapes = state_shapes(session)
    states = [np.zeros((1, *shape, _PIXELS), np.float32) for shape in shapes]
    still = np.zeros((1, 1, _CHUNK, _PIXELS), np.float32)
    for _ in range(MAX_SETTLE_TICKS // _CHUNK):
        inputs = {"x": still} | {f"state{i}": state for i, state in enumerate(states)}
        names = ["current", *(f"next{i}" for i in range(len(states)))]
        try:
            current, *after = session.run(names, inputs)
        except Exception as reason:  # onnxruntime's exceptions have no class in common
            raise EvsError(f"onnxruntime cannot run the network: {one_line(reason)}") from None
        for name, found, given in zip(names, [current, *after], [still, *states], strict=True):
            if found.shape != given.shape or found.dtype != np.float32:
                raise EvsError(
                    f"the graph's {name} comes out as {found.dtype} {found.shape}; "
                    f"it must be float32 {given.shape}"
                )
            if not np.all(np.isfinite(found)):
                raise EvsError(f"the graph's {name} holds a NaN or Inf where light stands still")
        settled = all(np.array_equal(a, b) for a, b in zip(states, after, strict=True))
        states = after
        if settled and np.ptp(current) == 0:
            break
    else:
        raise EvsError(f"the graph is not at rest after {MAX_SETTLE_TICKS} ticks of still light")
    return GraphNetwork(
        name=sidecar["name"],
        graph=graph,
        states=tuple(np.ascontiguousarray(state[0, :, :, 0]) for state in states),
        current_at_rest=float(current[0, 0, 0, 0]),
        look_ahead=tuple(sidecar["look_ahead"]),
        tau_s=sidecar["tau_s"],
        threshold=sidecar["threshold"],
        linlog_dn=sidecar["linlog_dn"],
        tick_us=sidecar["tick_us"],
        spp=sidecar["spp"],
        events_per_tick=sidecar["events_per_tick"],
    )
