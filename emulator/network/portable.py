"""The network by onnxruntime: on every machine and accelerator that it runs on.

One session computes BLOCK pixels at a time, always that many (the last block is filled up with
pixels at rest), so that its working set stays in the cache and every sum is made by the same code:
onnxruntime chooses kernels by an image's width, and at one width T = 1 and T = 32 give the same
bits (a test). What the session reads and writes lies in buffers that are bound once for each T.

Denormals are not flushed by onnxruntime's own option `session.set_denormal_as_zero`: it leaves the
mode on in the thread that made the first session, for good. What could lead to them is taken out of
X instead; the network has no feedback that could decay into them.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from evs.emulator.network.dense import DenseRuntime
from evs.emulator.network.graph import HELD, streaming_graph
from evs.emulator.network.state import NetworkState, check_arrays
from evs.emulator.network.weights import NetworkWeights
from evs.emulator.scene import F32
from evs.emulator.sensor.parameters import SensorParameters
from evs.msgs import EvsError, unknown

BLOCK = 256
"""P, pixels of one run"""
LEAST_X = np.float32(2.0**-60)
"""a smaller |X| is taken as 0"""

PROVIDERS: dict[str, tuple[str, dict[str, str]]] = {
    "cpu": ("CPUExecutionProvider", {}),
    # TF32 has 10 bits of fraction: currents would be 1e-3 off
    "cuda": ("CUDAExecutionProvider", {"use_tf32": "0"}),
    "tensorrt": ("TensorrtExecutionProvider", {}),
    "openvino": ("OpenVINOExecutionProvider", {}),
    "coreml": ("CoreMLExecutionProvider", {}),
}
"""our name of an execution provider -> (onnxruntime's, options)"""


def providers() -> list[str]:
    """Names of the execution providers that the onnxruntime on this machine has."""
    have = set(import_module("onnxruntime").get_available_providers())
    return [name for name, (theirs, _) in PROVIDERS.items() if theirs in have]


def open_session(graph: bytes, provider: str = "cpu", threads: int = 0) -> Any:
    """An onnxruntime.InferenceSession. Raises EvsError: no such provider, no sound graph.

    In: threads, 0 is one a core; any number gives the same bytes.
    """
    ort = import_module("onnxruntime")
    available = providers()
    if provider not in available:
        raise unknown("execution provider", provider, available)
    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    options.execution_mode = ort.ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    options.log_severity_level = 3  # errors
    # a thread that waits sleeps: the tracer needs the core
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        session = ort.InferenceSession(graph, options, providers=[PROVIDERS[provider]])
    except Exception as reason:  # onnxruntime's exceptions have no class in common
        raise EvsError(f"onnxruntime cannot load the network: {_one_line(reason)}") from None
    if session.get_providers()[0] != PROVIDERS[provider][0]:
        raise EvsError(
            f"execution provider '{provider}' does not start on this machine: install what "
            "onnxruntime's page of it asks for, or use cpu"
        )
    return session


@dataclass(frozen=True, eq=False)
class _Bound:
    """What a session reads and writes for one T."""

    x: F32
    """[1, 1, T, BLOCK]"""
    current: F32
    binding: Any


class PortableRuntime(DenseRuntime):
    """Runtime `onnxruntime`. Keeps its FIFOs in blocks: fifo0, ... (blocks, Cin, 6, BLOCK)."""

    name = "onnxruntime"

    def __init__(
        self,
        sensor: SensorParameters,
        weights: NetworkWeights,
        provider: str = "cpu",
        threads: int = 0,
    ) -> None:
        """In: provider, a name of PROVIDERS; threads, 0 is one a core. Raises EvsError."""
        super().__init__(sensor, weights)
        self._session = open_session(streaming_graph(weights), provider, threads)
        shapes = [(1, len(rest), HELD, BLOCK) for rest in weights.rest()]
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
                rest[:, np.newaxis, np.newaxis], (self.blocks, len(rest), HELD, BLOCK)
            ).copy()
            for i, rest in enumerate(self.weights.rest())
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
            self._session.run_with_iobinding(bound.binding)
            for buffer, fifo in zip(self._after, fifos, strict=True):
                fifo[block] = buffer[0]
            current[:, first : first + count] = bound.current[0, 0, :, :count]
        return current, fifos

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


def _one_line(reason: Exception) -> str:
    return " ".join(str(reason).split())
