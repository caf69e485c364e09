"""Runtime onnxruntime: providers, blocks, what it leaves alone."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import onnxruntime
import pytest

from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.onnx_graph import streaming_graph
from evs.emulator.evsnet.onnx_runtime import BLOCK, OnnxRuntime
from evs.emulator.evsnet.session import PROVIDERS, open_session
from evs.emulator.sensor import SensorParameters
from evs.msgs import EvsError
from reference.agreement import run
from reference.networks import random_network

SMALL = SensorParameters("small", 20, 15, 0.2, 0.2)
"""300 px: a full block and 44 px"""


def light(ticks: int, sensor: SensorParameters = SMALL, seed: int = 0) -> np.ndarray:
    walk = np.random.default_rng(seed).normal(0, 0.1, (ticks, sensor.height, sensor.width))
    return np.exp(np.cumsum(walk, axis=0) - 1).astype(np.float32)


def model(seed: int = 1, **options: object) -> EvsNetModel:
    weights = random_network(seed, 4)
    return EvsNetModel(SMALL, weights, runtime="onnxruntime", **options)  # type: ignore[arg-type]


def test_each_provider_is_one_that_onnxruntime_knows() -> None:
    known = set(onnxruntime.get_all_providers())
    assert {theirs for theirs, _ in PROVIDERS.values()} <= known
    assert list(PROVIDERS) == ["cpu", "cuda", "tensorrt", "openvino", "coreml"]


@pytest.mark.parametrize("provider", ["cuba", "CPU", "", "CPUExecutionProvider"])
def test_an_unknown_provider_is_refused_with_what_there_is(provider: str) -> None:
    with pytest.raises(EvsError, match=r"^no execution provider '.*'; there is: .*\bcpu"):
        model(provider=provider)


def test_a_provider_that_this_build_lacks_is_refused_with_what_there_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CPUExecutionProvider"])
    for provider in ("cuda", "tensorrt", "openvino", "coreml"):
        with pytest.raises(EvsError, match=f"^no execution provider '{provider}'; there is: cpu$"):
            model(provider=provider)


def test_a_provider_that_does_not_start_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    # onnxruntime falls back to the CPU with a warning where a driver is missing
    available = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    session = onnxruntime.InferenceSession
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: available)
    monkeypatch.setattr(
        onnxruntime,
        "InferenceSession",
        lambda graph, options, providers: session(graph, options, ["CPUExecutionProvider"]),
    )
    with pytest.raises(EvsError, match="'cuda' does not start on this machine"):
        model(provider="cuda")


@pytest.mark.parametrize("graph", [b"", b"x", b"\x08\x08", None])
def test_a_damaged_graph_is_one_clear_line(graph: bytes | None) -> None:
    sound = streaming_graph(random_network(1, 2, 1))
    with pytest.raises(EvsError, match=r"^onnxruntime cannot load the network: [^\n]+$"):
        open_session(sound[: len(sound) // 2] if graph is None else graph)


def test_onnxruntime_is_imported_with_the_first_session_only() -> None:
    program = (
        "import sys, evs, evs.emulator.evsnet.model, evs.emulator.evsnet.onnx_runtime\n"
        "from evs.emulator.evsnet import session\n"
        "assert 'onnxruntime' not in sys.modules\n"
        "session.providers()\n"
        "assert 'onnxruntime' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)


def test_float_arithmetic_outside_keeps_its_denormals() -> None:
    tiny = np.full(8, 1e-40, np.float32)
    found = model(threads=2)
    found.step_chunk(light(4), found.init(1), 0, 1000)
    assert np.all(tiny * np.float32(1) == tiny)


def test_a_change_too_small_to_matter_is_none() -> None:
    network = random_network(1, 4)
    runtime = OnnxRuntime(SMALL, network)
    x = np.zeros((9, 300), np.float32)
    x[4, ::3] = 2.0**-61
    x[4, 1::3] = -(2.0**-61)
    x[4, 2::3] = 2.0**-59
    fifos = list(runtime.own_arrays().values())
    current, _ = runtime.convolve(x, fifos)
    assert not np.any(current[:, 0::3])
    assert not np.any(current[:, 1::3])
    assert np.any(current[:, 2::3])


@pytest.mark.parametrize("channels", [1, 2, 3, 7, 8, 12, 16, 24, 64])
def test_no_width_of_a_network_makes_chunks_matter(channels: int) -> None:
    network = random_network(channels, channels, 2, biased=True, look_ahead=1)
    found = EvsNetModel(SMALL, network, runtime="onnxruntime", threads=1)
    whole = run(found, light(33), cut=32)
    assert whole.currents.std() > 0.01
    for cut in (1, 3, 8, 16):
        assert run(found, light(33), cut=cut).currents.tobytes() == whole.currents.tobytes()


def test_one_runtime_serves_several_streams_in_turns() -> None:
    found = model()
    lights = [light(24, seed=seed) for seed in (1, 2)]
    alone = [found.step_chunk(one, found.init(7), 0, 1000)[0] for one in lights]
    states = [found.init(7), found.init(7)]
    turns: list[list[bytes]] = [[], []]
    for first in range(0, 24, 6):
        for i in (0, 1):
            part = lights[i][first : first + 6]
            events, states[i] = found.step_chunk(part, states[i], first * 1000, 1000)
            turns[i] += [e.tobytes() for e in events]
    assert turns == [[e.tobytes() for e in one] for one in alone]


def test_the_fifos_are_in_blocks_and_the_filling_stays_at_rest() -> None:
    network = random_network(3, 4, biased=True)
    found = EvsNetModel(SMALL, network, runtime="onnxruntime")
    _, state = found.step_chunk(light(40), found.init(1), 0, 1000)
    rest = network.rest()
    for i, held in enumerate(rest):
        fifo = state.arrays[f"fifo{i}"]
        assert fifo.shape == (2, len(held), 6, BLOCK)
        filling = fifo[1, :, :, 44:]
        np.testing.assert_allclose(
            filling, np.broadcast_to(held[:, None, None], filling.shape), atol=1e-5
        )
        assert np.ptp(fifo[0]) > 0.1


def test_a_state_of_another_sensor_or_layout_is_refused() -> None:
    found = model()
    state = found.init(1)
    state.arrays["fifo2"] = state.arrays["fifo2"][:1]
    with pytest.raises(EvsError, match=r"fifo2 is float32 \(1, 4, 6, 256\), not .*call init again"):
        found.step_chunk(light(1), state, 0, 1000)
    state = found.init(1)
    del state.arrays["fifo6"]
    with pytest.raises(EvsError, match="lacks array 'fifo6'; call init again"):
        found.step_chunk(light(1), state, 0, 1000)
