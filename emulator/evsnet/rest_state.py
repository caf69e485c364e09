"""What a graph does without light: the states that it comes to rest in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from evs.emulator.evsnet.graph_network import GraphNetwork
from evs.emulator.evsnet.session import one_line, open_session, state_shapes
from evs.msgs import EvsError

MAX_SETTLE_TICKS = 4096
"""ticks of X = 0 after which a network must have come to rest"""
_CHUNK, _PIXELS = 32, 256


def graph_network(graph: bytes, sidecar: Mapping[str, Any]) -> GraphNetwork:
    """Read the network of a graph whose weights have other names than ours.

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
    )
