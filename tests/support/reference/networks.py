"""Random networks whose currents are of the size that trained ones have."""

from __future__ import annotations

import numpy as np

from evs.emulator.evsnet import Block, Convolution, NetworkWeights
from evs.emulator.evsnet.network_files import load_network, network_names


def random_network(
    seed: int,
    channels: int = 8,
    blocks: int = 3,
    *,
    biased: bool = False,
    look_ahead: int = 0,
    tau_s: float = 0.5,
) -> NetworkWeights:
    """He's initialisation; look_ahead of every convolution, 3 is the paper's centred net."""
    rng = np.random.default_rng(seed)

    def draw(out: int, inputs: int) -> Convolution:
        weight = rng.normal(0.0, np.sqrt(2.0 / (7 * inputs)), (out, inputs, 7)).astype(np.float32)
        bias = rng.normal(0.0, 0.05, out).astype(np.float32) if biased else None
        return Convolution(weight, bias, look_ahead)

    return NetworkWeights(
        name=f"random{seed}",
        encoder=draw(channels, 1),
        blocks=tuple(
            Block(draw(channels, channels), draw(channels, channels)) for _ in range(blocks)
        ),
        last=rng.normal(0.0, 2.0 / np.sqrt(channels), channels).astype(np.float32),
        last_bias=0.01 if biased else 0.0,
        tau_s=tau_s,
    )


def through_network(
    gain: float = 1.0,
    blocks: int = 3,
    *,
    look_ahead: int = 0,
    threshold: float = 0.2,
    tau_s: float = 0.5,
) -> NetworkWeights:
    """The current is gain * X of the tick it belongs to: X and -X pass through as two channels."""

    def tap(weight: list[list[float]]) -> Convolution:
        filters = np.zeros((2, len(weight[0]), 7), np.float32)
        filters[:, :, 6 - look_ahead] = weight
        return Convolution(filters, None, look_ahead)

    silent = [[0.0, 0.0], [0.0, 0.0]]
    return NetworkWeights(
        name="through",
        encoder=tap([[1.0], [-1.0]]),
        blocks=tuple(Block(tap(silent), tap(silent)) for _ in range(blocks)),
        last=np.array([gain, -gain], np.float32),
        tau_s=tau_s,
        threshold=threshold,
    )


STILL = {
    "C = 8": random_network(1),
    "C = 4": random_network(2, 4),
    "centred": random_network(3, look_ahead=3),
}
"""silent by construction where light stands still"""
STRANGE = [float("nan"), float("inf"), float("-inf"), -1.0, 1e9, 3e38, 1e-40, -0.0, 0.0]
"""light that no scene should have"""


def shipped() -> dict[str, NetworkWeights]:
    """Networks that come with evs and are silent by construction."""
    found = {name: load_network(name) for name in network_names()}
    return {
        name: network
        for name, network in found.items()
        if isinstance(network, NetworkWeights) and network.is_still
    }
