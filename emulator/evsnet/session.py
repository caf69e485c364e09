"""The door of onnxruntime: sessions, execution providers, and what a graph must look like.

Denormals are not flushed by onnxruntime's own option `session.set_denormal_as_zero`: it leaves the
mode on in the thread that makes the process's first session, for good.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from evs.msgs import EvsError, unknown

PROVIDERS: dict[str, tuple[str, dict[str, str]]] = {
    "cpu": ("CPUExecutionProvider", {}),
    # TF32 has 10 bits of fraction: currents would be 1e-3 off
    "cuda": ("CUDAExecutionProvider", {"use_tf32": "0"}),
    "tensorrt": ("TensorrtExecutionProvider", {}),
    "openvino": ("OpenVINOExecutionProvider", {}),
    "coreml": ("CoreMLExecutionProvider", {}),
}
"""our name of an execution provider -> (onnxruntime's, options)"""

MAX_STATES = 64
MAX_STATE_SIDE = 4096
"""of a state's channels and ticks"""


def load() -> Any:
    """Import onnxruntime, which has no wheel for every machine; EvsError where it is missing."""
    try:
        return import_module("onnxruntime")
    except ImportError:
        raise EvsError(
            "onnxruntime is not installed: pip install onnxruntime; without it, "
            "model.runtime=native runs the networks of evs"
        ) from None


def providers() -> list[str]:
    """Names of the execution providers that the onnxruntime on this machine has."""
    have = set(load().get_available_providers())
    return [name for name, (theirs, _) in PROVIDERS.items() if theirs in have]


def open_session(graph: bytes, provider: str = "cpu", threads: int = 0) -> Any:
    """Open an onnxruntime.InferenceSession.

    Args:
        graph: The ONNX file.
        provider: A key of PROVIDERS.
        threads: Worker threads; 0: one per core. Any number gives the same bytes.

    Raises:
        EvsError: No onnxruntime, no such provider, or no sound graph.
    """
    ort = load()
    available = providers()
    if provider not in available:
        raise unknown("execution provider", provider, available)
    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    options.execution_mode = ort.ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    options.log_severity_level = 4  # fatal ones; errors are raised
    # a thread that waits sleeps: the tracer needs the core
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        session = ort.InferenceSession(graph, options, providers=[PROVIDERS[provider]])
    except Exception as reason:  # onnxruntime's exceptions have no class in common
        raise EvsError(f"onnxruntime cannot load the network: {one_line(reason)}") from None
    if session.get_providers()[0] != PROVIDERS[provider][0]:
        raise EvsError(
            f"execution provider '{provider}' does not start on this machine: install what "
            "onnxruntime's page of it asks for, or use cpu"
        )
    return session


def state_shapes(session: Any) -> list[tuple[int, int]]:
    """(channels, ticks) of each state of a network's graph. Raises EvsError where it is none.

    Inputs are x [1, 1, T, P] and state0, state1, ... [1, channels, ticks, P]; outputs are current
    [1, 1, T, P] and next0, next1, ... as the states; all float32, T and P free.
    """
    inputs = {value.name: value for value in session.get_inputs()}
    outputs = {value.name: value for value in session.get_outputs()}
    count = len(inputs) - 1
    for kind, first, rest, found in (
        ("inputs", "x", "state", inputs),
        ("outputs", "current", "next", outputs),
    ):
        wanted = [first, *(f"{rest}{i}" for i in range(count))]
        if sorted(found) != sorted(wanted) or count > MAX_STATES:
            raise EvsError(
                f"the graph's {kind} are {_listed(found)}; a network with {max(count, 0)} states "
                f"has {_listed(wanted)}"
            )
        for value in found.values():
            if value.type != "tensor(float)":
                raise EvsError(f"the graph's {value.name} is {value.type}; it must be float32")
    for name, value in (("x", inputs["x"]), ("current", outputs["current"])):
        if not _fits(value.shape, [1, 1, None, None]):
            raise _misshapen(name, value.shape, "[1, 1, T, P] with T and P free")
    shapes = []
    for i in range(count):
        shape = inputs[f"state{i}"].shape
        sizes = shape[1:3] if len(shape) == 4 else []
        known = all(isinstance(size, int) and 0 < size <= MAX_STATE_SIDE for size in sizes)
        if not sizes or not known or not _fits(shape, [1, *sizes, None]):
            raise _misshapen(f"state{i}", shape, "[1, channels, ticks, P] with P free")
        if not _fits(outputs[f"next{i}"].shape, [1, *sizes, None]):
            raise _misshapen(f"next{i}", outputs[f"next{i}"].shape, f"as state{i}, {shape}")
        shapes.append((int(sizes[0]), int(sizes[1])))
    return shapes


def one_line(reason: Exception) -> str:
    """The message of an exception, without line breaks."""
    return " ".join(str(reason).split()) or type(reason).__name__


def _fits(shape: list[Any], wanted: list[int | None]) -> bool:
    """Whether sizes that are wanted are there (or left free by an exporter), and others free."""
    return len(shape) == len(wanted) and all(
        not isinstance(size, int) or size == want for size, want in zip(shape, wanted, strict=True)
    )


def _misshapen(name: str, shape: list[Any], wanted: str) -> EvsError:
    return EvsError(f"the graph's {name} is {_listed(shape)}; it must be {wanted}")


def _listed(names: Any) -> str:
    shown = [str(name) for name in names]
    return f"[{', '.join(shown[:12])}{', ...' if len(shown) > 12 else ''}]"
