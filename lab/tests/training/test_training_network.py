"""The network in JAX: its sums, its spikes, its gradients."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from evs.emulator.evsnet import NetworkWeights
from evs.msgs import EvsError
from evs_lab.training import network
from evs_lab.training.network import (
    Architecture,
    bilif,
    convolve,
    currents,
    fires,
    spikes_of,
    stream,
)
from reference.networks import random_network

# one compilation each, where eager calls compile every operation
jit_currents = jax.jit(currents, static_argnums=(2, 3))
jit_stream = jax.jit(stream, static_argnums=(3, 4))


def plain_currents(weights: NetworkWeights, x: np.ndarray) -> np.ndarray:
    """(K,) of one pixel's (K,) X, tick by tick, as weights.py says it; float64."""
    before = weights.receptive_field - 1
    held = np.concatenate([np.zeros(before), x])[np.newaxis]

    def layer(convolution, ticks):  # type: ignore[no-untyped-def]
        count = ticks.shape[1] - 6
        rows = [ticks[:, k : k + 7] for k in range(count)]
        out = np.stack([np.einsum("oij,ij->o", convolution.weight, row) for row in rows], 1)
        return out if convolution.bias is None else out + convolution.bias[:, np.newaxis]

    held = np.maximum(layer(weights.encoder, held), 0)
    for block in weights.blocks:
        added = layer(block.second, np.maximum(layer(block.first, held), 0))
        # the sum takes h as it was look_ahead ticks ago
        late = held[:, 12 - block.look_ahead : held.shape[1] - block.look_ahead]
        held = np.maximum(late + added, 0)
    return np.asarray(weights.last @ held + weights.last_bias)


@pytest.mark.parametrize(("biased", "look_ahead"), [(False, 0), (True, 3), (False, 1)])
def test_currents_are_those_of_the_contract(biased: bool, look_ahead: int) -> None:
    weights = random_network(3, 4, 3, biased=biased, look_ahead=look_ahead)
    parameters, architecture = network.from_weights(weights)
    x = np.random.default_rng(1).normal(0, 0.3, (5, 70)).astype(np.float32)
    found = np.asarray(jit_currents(parameters, jnp.asarray(x), architecture))
    expected = np.stack([plain_currents(weights, row) for row in x])
    assert found.shape == x.shape
    assert np.abs(found - expected).max() < 1e-5 * max(1.0, np.abs(expected).max())


def test_currents_from_a_tick_on_are_those_of_all_ticks() -> None:
    """Padded with less light before, with none, and with light that is cut off."""
    weights = random_network(3, 4, 3, look_ahead=1)
    parameters, architecture = network.from_weights(weights)
    x = jnp.asarray(np.random.default_rng(1).normal(0, 0.3, (5, 70)), jnp.float32)
    every = np.asarray(jit_currents(parameters, x, architecture))
    assert architecture.receptive_field == 43
    for first in (1, 42, 69):
        found = np.asarray(jit_currents(parameters, x, architecture, first))
        assert found.shape == (5, 70 - first)
        assert np.abs(found - every[:, first:]).max() < 5e-6


@pytest.mark.parametrize("biased", [False, True])
def test_weights_go_to_parameters_and_back(biased: bool) -> None:
    weights = random_network(4, 3, 2, biased=biased, look_ahead=2, tau_s=0.3)
    back = network.to_weights(*network.from_weights(weights), weights.name)
    assert back.name == weights.name
    assert back.latency_ticks == weights.latency_ticks == 10
    assert back.tau_s == pytest.approx(weights.tau_s, rel=1e-6)
    assert back.last_bias == pytest.approx(weights.last_bias)
    assert np.array_equal(back.last, weights.last)
    for mine, theirs in zip(back.convolutions, weights.convolutions, strict=True):
        assert np.array_equal(mine.weight, theirs.weight)
        assert mine.look_ahead == theirs.look_ahead
        assert (mine.bias is None) == (theirs.bias is None)
        assert mine.bias is None or np.array_equal(mine.bias, theirs.bias)


@pytest.mark.parametrize(("inputs", "out", "ticks"), [(1, 8, 30), (8, 8, 23), (3, 2, 7)])
def test_the_convolution_and_its_gradients_are_the_library_s(
    inputs: int, out: int, ticks: int
) -> None:
    rng = np.random.default_rng(inputs)
    x = jnp.asarray(rng.normal(size=(4, ticks, inputs)), jnp.float32)
    weight = jnp.asarray(rng.normal(size=(out, inputs, 7)), jnp.float32)
    toward = jnp.asarray(rng.normal(size=(4, ticks - 6, out)), jnp.float32)

    def library(x: jax.Array, weight: jax.Array) -> jax.Array:
        names = ("NWC", "OIW", "NWC")
        return lax.conv_general_dilated(x, weight, (1,), "VALID", dimension_numbers=names)

    def both(function: Callable[..., jax.Array]) -> tuple[jax.Array, ...]:
        @jax.jit
        def value_and_gradients(x: jax.Array, weight: jax.Array) -> tuple[jax.Array, ...]:
            value, gradients = jax.vjp(function, x, weight)
            return value, *gradients(toward)

        found: tuple[jax.Array, ...] = value_and_gradients(x, weight)
        return found

    for mine, theirs in zip(both(convolve), both(library), strict=True):
        assert mine.shape == theirs.shape
        assert float(jnp.abs(mine - theirs).max()) < 1e-4


@pytest.mark.parametrize("most", [1, 2, 64])
def test_bilif_is_equations_2_and_3(most: int) -> None:
    rng = np.random.default_rng(2)
    current = rng.normal(0, 0.7, (200, 30)).astype(np.float32)
    current[50:60] = 40.0
    start = rng.uniform(-1, 1, 30).astype(np.float32)
    decay = np.float32(math.exp(-0.001 / 0.3))
    given = jnp.asarray(current), jnp.asarray(start), jnp.float32(decay)
    on, off = map(np.asarray, bilif(*given, most))
    v = start.astype(np.float64) / decay
    ties = 0
    for k in range(200):
        charged = np.clip(decay * v + current[k], -64, 64)
        spike = np.clip(np.trunc(charged), -most, most)
        near = np.abs(np.abs(charged) - np.clip(np.round(np.abs(charged)), 1, most)) < 1e-4
        ties += int(near.sum())
        told = on[k] - off[k]
        assert np.array_equal(told[~near], spike[~near])
        v = charged - told
    assert ties < 20
    assert on.sum() > 400
    told = {int(n) for n in np.unique([on, off])}
    assert told <= set(range(most + 1))
    assert max(told) == min(most, 40)


@pytest.mark.parametrize(
    ("over", "fired", "slope"), [(-0.5, 0, None), (0.0, 1, 1.0), (0.5, 1, None)]
)
def test_the_surrogate_is_the_arctangent(over: float, fired: int, slope: float | None) -> None:
    def sigma(u: float) -> float:
        return math.atan(math.pi / 2 * network.ALPHA * u) / math.pi + 0.5

    value, derivative = jax.value_and_grad(fires)(jnp.float32(over))
    assert float(value) == fired
    step = 1e-5
    expected = (sigma(over + step) - sigma(over - step)) / (2 * step)
    assert float(derivative) == pytest.approx(expected if slope is None else slope, rel=1e-4)


def test_the_surrogate_of_many_spikes_is_that_of_the_nearest_threshold() -> None:
    charged = np.array([-3.0, 0.2, 0.9, 1.0, 1.3, 1.7, 2.2, 62.6, 64.0, 70.0], np.float32)
    nearest = np.array([1, 1, 1, 1, 1, 2, 2, 63, 64, 64])
    values, slopes = jax.vmap(jax.value_and_grad(lambda v: spikes_of(v, 64)))(charged)
    assert np.array_equal(values, np.clip(np.floor(charged), 0, 64))
    expected = network.ALPHA / 2 / (1 + (math.pi / 2 * network.ALPHA * (charged - nearest)) ** 2)
    assert np.asarray(slopes) == pytest.approx(expected, rel=1e-4)


def test_spikes_have_equation_4_s_gradient_and_the_reset_takes_part() -> None:
    """One pixel, two ticks, by hand."""
    d, start, first, second = 0.9, 0.27, 0.5, 0.6

    def sums(i: jax.Array) -> jax.Array:
        on, off = bilif(i[:, None], jnp.asarray([start]), jnp.float32(d))
        return jnp.stack([(on - off)[0, 0], (on - off)[1, 0]])

    slopes = np.asarray(jax.jit(jax.jacobian(sums))(jnp.asarray([first, second])))

    def slope(charged: float) -> float:
        def derivative(u: float) -> float:
            return network.ALPHA / 2 / (1 + (math.pi / 2 * network.ALPHA * u) ** 2)

        return derivative(charged - 1) + derivative(-charged - 1)

    charged = start + first
    later = d * charged + second
    assert charged < 1 <= later
    assert slopes[0, 0] == pytest.approx(slope(charged), rel=1e-5)
    assert slopes[0, 1] == 0.0
    assert slopes[1, 1] == pytest.approx(slope(later), rel=1e-5)
    # through V = V' - S
    assert slopes[1, 0] == pytest.approx(slope(later) * d * (1 - slope(charged)), rel=1e-5)


def test_what_comes_later_changes_nothing() -> None:
    weights = random_network(5, 4)
    parameters, architecture = network.from_weights(weights)
    rng = np.random.default_rng(3)
    x = rng.normal(0, 0.3, (8, 90)).astype(np.float32)
    start = rng.uniform(-1, 1, 8).astype(np.float32)
    other = x.copy()
    other[:, 60:] = rng.normal(0, 0.3, (8, 30))
    both = [
        np.stack(jit_stream(parameters, jnp.asarray(v), start, architecture)) for v in (x, other)
    ]
    assert np.array_equal(both[0][:, :60], both[1][:, :60])
    assert not np.array_equal(both[0][:, 60:], both[1][:, 60:])


@pytest.mark.parametrize(("look_ahead", "odd"), [(0, False), (1, False), (3, True)])
def test_the_identity_starts_near_the_plain_pixel(look_ahead: int, odd: bool) -> None:
    architecture = Architecture(8, (look_ahead,) * 7, odd=odd)
    parameters = network.identity(architecture, 1, 0.5)
    # a pixel that is still but for one step of 5 thresholds
    x = np.zeros((1, 120), np.float32)
    x[0, 40] = 1.0
    found = np.asarray(jit_currents(parameters, jnp.asarray(x), architecture))[0]
    place = 40 + architecture.latency_ticks
    assert found[place] == pytest.approx(5.0, abs=1.0)
    assert np.abs(np.delete(found, place)).max() < 1.5
    silent = np.asarray(jit_currents(parameters, jnp.zeros((1, 120)), architecture))
    assert not silent.any()


def test_from_scratch_follows_the_seed_and_has_biases() -> None:
    architecture = Architecture(8, (3,) * 7, biased=True)
    first, again, other = (network.uniform(architecture, seed, 0.5) for seed in (1, 1, 2))
    assert jax.tree.all(jax.tree.map(lambda a, b: bool((a == b).all()), first, again))
    assert not jax.tree.all(jax.tree.map(lambda a, b: bool((a == b).all()), first, other))
    weights = network.to_weights(first, architecture, "scratch")
    assert weights.latency_ticks == 21
    assert not weights.is_still
    assert all(c.bias is not None and np.abs(c.bias).max() > 0 for c in weights.convolutions)


@pytest.mark.parametrize(
    ("ticks", "expected"),
    [(0, (0,) * 7), (3, (1, 1, 1, 0, 0, 0, 0)), (8, (2, 1, 1, 1, 1, 1, 1)), (21, (3,) * 7)],
)
def test_look_ahead_is_spread(ticks: int, expected: tuple[int, ...]) -> None:
    assert network.spread_look_ahead(ticks) == expected


def test_too_much_look_ahead_is_refused() -> None:
    with pytest.raises(EvsError, match="look-ahead is 22 ticks"):
        network.spread_look_ahead(22)


def test_a_network_of_nan_is_refused() -> None:
    architecture = Architecture(4)
    parameters = network.identity(architecture, 1, 0.5)
    parameters["last"] = parameters["last"] * float("nan")
    with pytest.raises(EvsError, match="NaN or Inf; train it again"):
        network.to_weights(parameters, architecture, "broken")


def test_tau_is_clamped() -> None:
    longest = network.decay_of(jnp.float32(math.log(1e6)), 1000)
    assert float(longest) == pytest.approx(math.exp(-0.001 / network.TAU_S[1]), rel=1e-6)
    architecture = dataclasses.replace(Architecture(4))
    parameters = network.identity(architecture, 1, 1e6)
    assert network.to_weights(parameters, architecture, "long").tau_s == network.TAU_S[1]


def test_an_odd_network_is_odd_and_exported_whole() -> None:
    architecture = Architecture(8, (1,) * 7, odd=True)
    parameters = network.identity(architecture, 3, 0.5)
    rng = np.random.default_rng(4)
    # away from the identity
    parameters = jax.tree.map(
        lambda part: part + rng.normal(0, 0.1, part.shape).astype(np.float32), parameters
    )
    x = jnp.asarray(rng.normal(0, 0.3, (4, 80)), jnp.float32)
    found = jit_currents(parameters, x, architecture)
    assert float(jnp.abs(found).max()) > 0.5
    assert float(jnp.abs(found + jit_currents(parameters, -x, architecture)).max()) < 1e-5
    weights = network.to_weights(parameters, architecture, "odd")
    assert weights.channels == 8
    mirrored, same = network.from_weights(weights)
    assert not same.odd
    assert float(jnp.abs(found - jit_currents(mirrored, x, same)).max()) < 1e-6
    with pytest.raises(EvsError, match="even number of channels"):
        Architecture(7, odd=True)
    with pytest.raises(EvsError, match="no biases"):
        Architecture(8, biased=True, odd=True)
