"""Networks with a known response, and their response to the step target."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from evs.emulator import World
from evs.emulator.base.scene import F32
from evs.emulator.evsnet.weights import Block, Convolution, NetworkWeights
from evs.emulator.state import pack, unpack
from evs.msgs import EvsError
from evs.tools.stress.capture import Act
from evs.tools.stress.step_target import StepCapture, capture_step
from evs.tools.training.export import export

STEP = math.log(255.0)
"""log contrast of the step target, white to black"""
SENSOR = {"width": 16, "height": 12, "pos_thres": 0.2, "neg_thres": 0.2}
"""[sensor]: thresholds as the network's own, so that V_on = V_off = 1"""


def through(gain: float, tau_s: float = 0.5, blocks: int = 0) -> NetworkWeights:
    """A network whose current is gain X: X and -X go through as two channels."""

    def tap(weight: list[list[float]]) -> Convolution:
        filters = np.zeros((2, len(weight[0]), 7), np.float32)
        filters[:, :, 6] = weight
        return Convolution(filters)

    silent = tap([[0.0, 0.0], [0.0, 0.0]])
    return NetworkWeights(
        name="through",
        encoder=tap([[1.0], [-1.0]]),
        blocks=(Block(silent, silent),) * blocks,
        last=np.array([gain, -gain], np.float32),
        tau_s=tau_s,
    )


def scaled(weight: float, channels: int, blocks: int) -> NetworkWeights:
    """A network all of whose weights are this one."""

    def flat(inputs: int) -> Convolution:
        return Convolution(np.full((channels, inputs, 7), weight, np.float32))

    pair = Block(flat(channels), flat(channels))
    last = np.full(channels, weight, np.float32)
    return NetworkWeights("scaled", flat(1), (pair,) * blocks, last)


def capture_network(
    network: NetworkWeights,
    left: Callable[[int], float],
    ticks: int,
    watch: Act | None = None,
    exposure_dn: float = 255.0,
) -> StepCapture:
    """The step target seen by the network, read from its file; every membrane begins at 0."""
    with tempfile.TemporaryDirectory() as folder:
        path, _ = export(network, Path(folder) / "net.onnx")
        model = {"name": "evsnet", "network": str(path), "initial_state": "zero"}
        sensor = {**SENSOR, "exposure_dn": exposure_dn}
        return capture_step(left, ticks, {"sensor": sensor, "model": model}, watch=watch)


def membranes(world: World) -> F32:
    """(h, w) V of its one camera, each as of the pixel's last active tick."""
    return np.array(world.cameras[0].save()["pixels.state.v"], np.float32)


def later(world: World, ticks: int) -> None:
    """The world with a network that has lived so many quiet ticks more, by its saved state."""
    about, arrays = unpack(world.save())
    name = "cameras.0.pixels.state.ticks"
    arrays[name] = np.array(int(arrays[name]) + ticks, np.int64)
    world.restore(pack(about, arrays))


def refused(attempt: Callable[[], object]) -> str:
    """The line of its EvsError; empty where there is none, or where it has several lines."""
    try:
        attempt()
    except EvsError as error:
        return "" if "\n" in str(error) else str(error)
    return ""
