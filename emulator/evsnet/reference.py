"""The network in plain NumPy: slow, easy to read, the oracle of the other runtimes.

Sums are elementwise float32, tap by tap and channel by channel, never by BLAS: the same bytes on
every machine and for every cut of the stream.
"""

from __future__ import annotations

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.dense import DenseRuntime
from evs.emulator.evsnet.weights import KERNEL_SIZE, Convolution, NetworkWeights
from evs.emulator.sensor.parameters import SensorParameters

BLOCK = 4096
"""pixels computed together: what 32 ticks of them need stays small"""


class ReferenceRuntime(DenseRuntime):
    """Runtime `reference`."""

    name = "reference"

    def __init__(self, sensor: SensorParameters, weights: NetworkWeights, most: int = 1) -> None:
        """Raises EvsError where the network's numbers make no sense on this sensor."""
        super().__init__(sensor, weights, most)
        self.weights = weights

    def convolve(self, x: F32, fifos: list[F32]) -> tuple[F32, list[F32]]:
        """DenseRuntime.convolve; the FIFOs are changed in place."""
        current = np.empty_like(x)
        for first in range(0, x.shape[1], BLOCK):
            part = slice(first, first + BLOCK)
            current[:, part] = currents(self.weights, x[:, part], [f[:, :, part] for f in fifos])
        return current, fifos


def currents(weights: NetworkWeights, x: F32, fifos: list[F32]) -> F32:
    """Compute the currents.

    Args:
        weights: The network.
        x: (ticks, pixels).
        fifos: Of each convolution what it read in the last 6 ticks, (channels, 6, pixels), changed
            in place.

    Returns:
        (ticks, pixels).
    """
    ticks = len(x)
    queues = iter(fifos)

    def read(value: F32) -> F32:
        """(channels, 6 + ticks, pixels): the ticks before, then these."""
        queue = next(queues)
        line = np.concatenate([queue, value], axis=1)
        queue[:] = line[:, ticks:]
        return line

    h = relu(convolution(weights.encoder, read(x[np.newaxis])))
    for block in weights.blocks:
        line = read(h)
        middle = relu(convolution(block.first, line))
        change = convolution(block.second, read(middle))
        # the sum is late by what the block looks ahead, and so is the h in it
        start = KERNEL_SIZE - 1 - block.look_ahead
        h = relu(line[:, start : start + ticks] + change)
    out = np.zeros_like(x)
    for weight, channel in zip(weights.last, h, strict=True):
        out += weight * channel
    return out + np.float32(weights.last_bias)


def convolution(c: Convolution, line: F32) -> F32:
    """Valid: (channels in, 6 + ticks, pixels) to (channels out, ticks, pixels)."""
    outputs, inputs, _ = c.weight.shape
    ticks = line.shape[1] - (KERNEL_SIZE - 1)
    total = np.zeros((outputs, ticks, line.shape[2]), np.float32)
    for j in range(KERNEL_SIZE):
        for i in range(inputs):
            total += c.weight[:, i, j, np.newaxis, np.newaxis] * line[i, j : j + ticks]
    if c.bias is not None:
        total += c.bias[:, np.newaxis, np.newaxis]
    return total


def relu(value: F32) -> F32:
    """max(value, 0); never -0."""
    return np.where(value > 0, value, np.float32(0))
