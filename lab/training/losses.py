"""The paper's losses, equations 7 ... 11, and terms beside them.

All sequences are (K, P): ticks down, pixels across, one polarity each, whole numbers as float32.
Predicted ones have surrogate gradients; they are 0 or 1 unless a pixel may fire more often. A loss
is per pixel, (P,), in events; nothing is averaged here.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
from jax import Array, lax


def emd_forward(true: Array, spikes: Array) -> Array:
    """Equation 7: the mean over ticks of the distance of the running sums."""
    return jnp.mean(jnp.abs(_running(spikes - true)), 0)


def emd(true: Array, spikes: Array) -> Array:
    """Equation 8: the mean of equation 7 and of equation 7 of the reversed sequences."""
    running = _running(spikes - true)
    # the running sum from the end: the total less what is before the tick
    reversed_running = running[-1:] - running + (spikes - true)
    return 0.5 * (jnp.mean(jnp.abs(running), 0) + jnp.mean(jnp.abs(reversed_running), 0))


def emd_of_polarities(true: tuple[Array, Array], spikes: tuple[Array, Array]) -> Array:
    """Equation 9: equation 8 of ON and of OFF, added."""
    return emd(true[0], spikes[0]) + emd(true[1], spikes[1])


def count(true: tuple[Array, Array], spikes: tuple[Array, Array]) -> Array:
    """Equation 10: how far the number of events, both polarities together, is from the truth's."""
    return jnp.abs(sum(jnp.sum(s, 0) for s in spikes) - sum(jnp.sum(e, 0) for e in true))


def total(true: tuple[Array, Array], spikes: tuple[Array, Array], weight: float) -> Array:
    """Equation 11, the paper's loss: equation 9 + lambda * equation 10; weight is lambda."""
    return emd_of_polarities(true, spikes) + weight * count(true, spikes)


@dataclass(frozen=True)
class Terms:
    """Weights of the terms of a loss; zero leaves a term out."""

    count: float = 0.1
    """lambda of equation 11; the paper does not state its own"""
    relative_count: float = 0.0
    """extra or missing events of one polarity, per true event of the pixel"""
    calibration: float = 0.0
    """how fast the price of an event follows the count ratio of its variant (calibration.py)"""
    edge: float = 0.0
    """a pixel with n true events weighs edge / (edge + n), so that the few pixels with many events
    do not outweigh low contrast and stillness"""
    silence: float = 0.0
    """price of an event where the truth has none of its polarity within silence_ticks"""
    silence_ticks: int = 32


def objective(
    true: tuple[Array, Array], spikes: tuple[Array, Array], terms: Terms, price: Array
) -> Array:
    """The paper's loss and the chosen terms, (P,).

    Args:
        true: events of the reference.
        spikes: events of the network.
        terms: weights of the terms.
        price: (2, P), cost of an ON and an OFF event of a pixel, may be negative (calibration.py).
    """
    loss = total(true, spikes, terms.count)
    if terms.relative_count:
        loss += terms.relative_count * relative_count(true, spikes)
    if terms.silence:
        loss += terms.silence * unexplained(true, spikes, terms.silence_ticks)
    if terms.calibration:
        loss += price[0] * jnp.sum(spikes[0], 0) + price[1] * jnp.sum(spikes[1], 0)
    return loss * edge_weight(true, terms.edge)


def relative_count(true: tuple[Array, Array], spikes: tuple[Array, Array]) -> Array:
    """|n_S - n_E| / (n_E + 1) of each polarity, added."""
    found = [(jnp.sum(s, 0), jnp.sum(e, 0)) for s, e in zip(spikes, true, strict=True)]
    return sum((jnp.abs(n - m) / (m + 1) for n, m in found), start=jnp.zeros(()))


def edge_weight(true: tuple[Array, Array], edge: float) -> Array:
    """Edge / (edge + n) for a pixel with n true events; 1 for all where edge is 0."""
    events = jnp.sum(true[0], 0) + jnp.sum(true[1], 0)
    return edge / (edge + events) if edge else jnp.ones_like(events)


def unexplained(true: tuple[Array, Array], spikes: tuple[Array, Array], ticks: int) -> Array:
    """Events with no true one of their polarity at most so many ticks before or after."""
    window = (2 * ticks + 1, 1)
    found = jnp.zeros(true[0].shape[1])
    for e, s in zip(true, spikes, strict=True):
        near = lax.reduce_window(e, -jnp.inf, lax.max, window, (1, 1), ((ticks, ticks), (0, 0)))
        found += jnp.sum(jnp.where(near > 0, 0, s), 0)
    return found


def _running(sequence: Array) -> Array:
    return jnp.cumsum(sequence, 0)
