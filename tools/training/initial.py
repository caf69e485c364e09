"""The initial weights of a training."""

from __future__ import annotations

import math
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.weights import KERNEL_SIZE
from evs.tools.training.network import Architecture, Parameters

THRESHOLD = 0.2
"""log units: contrast threshold of the pixels that give the truth"""
SMALL = 0.03
"""of the filters beside the identity, as a share of He's"""


def identity(architecture: Architecture, seed: int, tau_s: float) -> Parameters:
    """A network whose current is about X / threshold: it starts as the `plain` pixel.

    One channel carries ReLU(X) and one ReLU(-X) past all blocks, the others and all residual sums
    start small and random. C is 2 or more.
    """
    rng = np.random.default_rng(seed)
    channels = architecture.channels
    # an odd network learns half of its channels; channel 0 brings its mirror
    learnt, carriers = (channels // 2, 1) if architecture.odd else (channels, 2)
    signs = np.array([1.0, -1.0], np.float32)[:carriers]

    def he(inputs: int, share: float) -> F32:
        scale = share * math.sqrt(2.0 / (KERNEL_SIZE * inputs))
        return rng.normal(0.0, scale, (learnt, inputs, KERNEL_SIZE)).astype(np.float32)

    encoder = he(1, 1.0)
    encoder[:carriers] = 0.0
    encoder[:carriers, 0, KERNEL_SIZE - 1 - architecture.look_ahead[0]] = signs
    blocks = [(he(channels, 1.0), he(channels, SMALL)) for _ in range(architecture.blocks)]
    last = rng.normal(0.0, SMALL / THRESHOLD, learnt).astype(np.float32)
    last[:carriers] = signs / THRESHOLD
    return _parameters(architecture, encoder, blocks, last, tau_s)


def uniform(architecture: Architecture, seed: int, tau_s: float) -> Parameters:
    """From scratch, as the paper: PyTorch's default, U(-1, 1) / sqrt(inputs), biases as well."""
    rng = np.random.default_rng(seed)
    channels = architecture.channels

    def draw(inputs: int, *shape: int) -> F32:
        reach = 1.0 / math.sqrt(inputs)
        return rng.uniform(-reach, reach, shape).astype(np.float32)

    encoder = draw(KERNEL_SIZE, channels, 1, KERNEL_SIZE)
    blocks = [
        tuple(draw(KERNEL_SIZE * channels, channels, channels, KERNEL_SIZE) for _ in range(2))
        for _ in range(architecture.blocks)
    ]
    found = _parameters(architecture, encoder, blocks, draw(channels, channels), tau_s)
    if architecture.biased:
        found["encoder"]["bias"] = jnp.asarray(draw(KERNEL_SIZE, channels))
        for block in found["blocks"]:
            for layer in block.values():
                layer["bias"] = jnp.asarray(draw(KERNEL_SIZE * channels, channels))
        found["last_bias"] = jnp.asarray(draw(channels, 1)[0])
    return found


def _parameters(
    architecture: Architecture,
    encoder: F32,
    blocks: Sequence[tuple[F32, ...]],
    last: F32,
    tau_s: float,
) -> Parameters:
    """Biases, where there are any, start at 0."""

    def layer(weight: F32) -> Parameters:
        if not architecture.biased:
            return {"weight": jnp.asarray(weight)}
        return {"weight": jnp.asarray(weight), "bias": jnp.zeros(weight.shape[0], jnp.float32)}

    found: Parameters = {
        "encoder": layer(encoder),
        "blocks": [{"first": layer(first), "second": layer(second)} for first, second in blocks],
        "last": jnp.asarray(last),
        "log_tau": jnp.asarray(math.log(tau_s), jnp.float32),
    }
    if architecture.biased:
        found["last_bias"] = jnp.zeros((), jnp.float32)
    return found


INITIAL = {"identity": identity, "uniform": uniform}
"""Name in a recipe -> function (architecture, seed, tau_s)."""
