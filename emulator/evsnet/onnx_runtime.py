"""The network by onnxruntime: on every machine and accelerator that it runs on.

One session computes BLOCK pixels at a time, always that many (the last block is filled up with
pixels at rest), so that its working set stays in the cache and every sum is made by the same code:
onnxruntime chooses kernels by an image's width, and at one width T = 1 and T = 32 give the same
bits (a test). What the session reads and writes lies in buffers that are bound once for each T.

What could lead to denormals is taken out of X: ours has no feedback that could decay into them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.dense import DenseRuntime
from evs.emulator.evsnet.graph_network import GraphNetwork, Network
from evs.emulator.evsnet.onnx_graph import streaming_graph
from evs.emulator.evsnet.session import one_line, open_session, state_shapes
from evs.emulator.evsnet.state import NetworkState, check_arrays
from evs.emulator.sensor.parameters import SensorParameters
from evs.msgs import EvsError

BLOCK = 256
"""P, pixels of one run"""
LEAST_X = np.float32(2.0**-60)
"""a smaller |X| is taken as 0"""


@dataclass(frozen=True, eq=False)
class _Bound:
    """What a session reads and writes for one T."""

    x: F32
    """[1, 1, T, BLOCK]"""
    current: F32
    binding: Any


class OnnxRuntime(DenseRuntime):
    """Runtime `onnxruntime`. Keeps its FIFOs in blocks: fifo0, ... (blocks, channels, 6, BLOCK)."""

    name = "onnxruntime"

    def __init__(
        self,
        sensor: SensorParameters,
        weights: Network,
        provider: str = "cpu",
        threads: int = 0,
        most: int = 1,
    ) -> None:
        """Open a session.

        Args:
            sensor: The sensor, resolved.
            weights: The network.
            provider: A key of PROVIDERS.
            threads: Worker threads; 0: one per core.
            most: Events of a pixel in a tick.

        Raises:
            EvsError: No such provider, or no sound graph.
        """
        super().__init__(sensor, weights, most)
        graph = weights.graph if isinstance(weights, GraphNetwork) else streaming_graph(weights)
        self._session = open_session(graph, provider, threads)
        shapes = [(1, *shape, BLOCK) for shape in state_shapes(self._session)]
        self._before = [np.zeros(shape, np.float32) for shape in shapes]
        self._after = [np.zeros(shape, np.float32) for shape in shapes]
        self._bound: dict[int, _Bound] = {}

    @property
    def blocks(self) -> int:
        """Blocks that the sensor's pixels fill, the last one perhaps not to its end."""
        return -(-self.height * self.width // BLOCK)

    def own_arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """FIFOs full of what each convolution reads while light stands still."""
        return {
            f"fifo{i}": np.broadcast_to(
                held[..., np.newaxis], (self.blocks, *held.shape, BLOCK)
            ).copy()
            for i, held in enumerate(self.held)
        }

    def check(self, state: NetworkState) -> None:
        """Raise EvsError unless the FIFOs in the state are of this network and sensor."""
        shapes = [(self.blocks, *buffer.shape[1:]) for buffer in self._before]
        check_arrays(state, {f"fifo{i}": (np.float32, shape) for i, shape in enumerate(shapes)})

    def convolve(self, x: F32, fifos: list[F32]) -> tuple[F32, list[F32]]:
        """DenseRuntime.convolve, with the FIFOs in blocks; they are changed in place."""
        bound = self._bound.get(len(x)) or self._bind(len(x))
        current = np.empty_like(x)
        for block in range(self.blocks):
            first = block * BLOCK
            part = x[:, first : first + BLOCK]
            count = part.shape[1]
            bound.x[0, 0, :, :count] = np.where(np.abs(part) < LEAST_X, np.float32(0), part)
            bound.x[0, 0, :, count:] = 0
            for buffer, fifo in zip(self._before, fifos, strict=True):
                buffer[0] = fifo[block]
            self._run(bound)
            for buffer, fifo in zip(self._after, fifos, strict=True):
                fifo[block] = buffer[0]
            current[:, first : first + count] = bound.current[0, 0, :, :count]
        return current, fifos

    def _run(self, bound: _Bound) -> None:
        try:
            self._session.run_with_iobinding(bound.binding)
        except Exception as reason:  # onnxruntime's exceptions have no class in common
            raise EvsError(f"onnxruntime cannot run the network: {one_line(reason)}") from None

    def _bind(self, ticks: int) -> _Bound:
        """Buffers for chunks of so many ticks. The FIFOs' are common to all."""
        binding = self._session.io_binding()
        x, current = (np.zeros((1, 1, ticks, BLOCK), np.float32) for _ in range(2))
        inputs = {"x": x} | {f"state{i}": array for i, array in enumerate(self._before)}
        outputs = {"current": current} | {f"next{i}": array for i, array in enumerate(self._after)}
        for bind, arrays in ((binding.bind_input, inputs), (binding.bind_output, outputs)):
            for name, array in arrays.items():
                # in the machine's own memory; an accelerator's provider copies
                bind(name, "cpu", 0, np.float32, array.shape, array.ctypes.data)
        self._bound[ticks] = _Bound(x, current, binding)
        return self._bound[ticks]
