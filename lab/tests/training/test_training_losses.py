"""Equations 7 ... 11 against optimal transport, against hand-computed sequences, and the terms."""

from __future__ import annotations

import itertools

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from evs.msgs import EVENT_DTYPE
from evs_lab.metrics import Window, mean_emd
from evs_lab.training import losses
from evs_lab.training.losses import Terms

K = 12


def column(*values: float) -> jnp.ndarray:
    """(K, 1)."""
    return jnp.asarray(values, jnp.float32)[:, None]


def pulses(ticks: list[int], count: int = K) -> np.ndarray:
    """(count,) events in the ticks named, from 1; a tick may be named twice."""
    return np.bincount(np.array(ticks, int) - 1, minlength=count).astype(np.float32)


def transport(first: np.ndarray, second: np.ndarray) -> float:
    """Least sum of distances in ticks over all ways to pair equally many events."""
    a, b = (np.repeat(np.arange(len(part)), part.astype(int)) for part in (first, second))
    cost = np.abs(a[:, None] - b[None, :])
    rows, columns = linear_sum_assignment(cost)
    least = int(cost[rows, columns].sum())
    if len(a) <= 5:
        every = itertools.permutations(range(len(a)))
        assert least == min(sum(cost[i, j] for i, j in enumerate(p)) for p in every)
    return float(least)


@pytest.mark.parametrize("seed", range(20))
def test_equations_7_and_8_are_optimal_transport_where_counts_are_equal(seed: int) -> None:
    rng = np.random.default_rng(seed)
    events = int(rng.integers(1, 8))
    true = pulses(list(rng.integers(1, K + 1, events)))
    spikes = pulses(list(rng.permutation(K)[:events] + 1))
    expected = transport(true, spikes) / K
    one = losses.emd_forward(jnp.asarray(true)[:, None], jnp.asarray(spikes)[:, None])
    both = losses.emd(jnp.asarray(true)[:, None], jnp.asarray(spikes)[:, None])
    assert float(one[0]) == pytest.approx(expected, rel=1e-6)
    assert float(both[0]) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("seed", range(10))
def test_equation_8_moves_a_surplus_past_the_nearer_ends(seed: int) -> None:
    """Unequal counts: forwards the surplus goes to tick K + 1, backwards to tick 0."""
    rng = np.random.default_rng([seed, 8])
    true = pulses(list(rng.integers(1, K + 1, int(rng.integers(0, 4)))))
    spikes = pulses(list(rng.permutation(K)[: int(rng.integers(4, 8))] + 1))
    surplus = int(spikes.sum() - true.sum())
    ends = []
    for place in (K + 1, 0):
        # two ticks more, so that both ends exist
        a, b = (np.concatenate([[0.0], part, [0.0]]) for part in (true, spikes))
        a[place] += surplus
        ends.append(transport(a, b) / K)
    found = losses.emd(jnp.asarray(true)[:, None], jnp.asarray(spikes)[:, None])
    assert float(found[0]) == pytest.approx(np.mean(ends), rel=1e-6)


def test_hand_computed_sequences() -> None:
    true, spikes = column(0, 1, 0, 0), column(0, 0, 0, 1)
    # two ticks late: running sums differ in ticks 2 and 3
    assert float(losses.emd_forward(true, spikes)[0]) == 0.5
    assert float(losses.emd(true, spikes)[0]) == 0.5
    # one event too much in tick 3 of 4: 2 ticks from the end, 3 from the beginning
    extra = column(0, 1, 1, 0)
    assert float(losses.emd_forward(true, extra)[0]) == 0.5
    assert float(losses.emd(true, extra)[0]) == pytest.approx((2 / 4 + 3 / 4) / 2)
    nothing = column(0, 0, 0, 0)
    both = losses.emd_of_polarities((true, nothing), (spikes, extra))
    # OFF: events in ticks 2 and 3 where there are none: 3 + 2 of 4, and 2 + 3 of 4
    assert float(both[0]) == pytest.approx(0.5 + 1.25)
    assert float(losses.count((true, nothing), (spikes, extra))[0]) == 2.0
    assert float(losses.total((true, nothing), (spikes, extra), 0.3)[0]) == pytest.approx(2.35)


def test_the_loss_is_what_the_metrics_measure() -> None:
    rng = np.random.default_rng(5)
    pixels, ticks = 6, 40
    true = rng.poisson(0.05, (2, ticks, pixels))
    spikes = (rng.random((2, ticks, pixels)) < 0.05).astype(int)

    def events(counts: np.ndarray) -> np.ndarray:
        polarity, tick, pixel = np.nonzero(np.minimum(counts, 1))
        times = counts[polarity, tick, pixel]
        found = np.zeros(int(times.sum()), EVENT_DTYPE)
        found["t"] = np.repeat(1000 * (tick + 1), times)
        found["x"] = np.repeat(pixel, times)
        found["p"] = np.repeat(1 - polarity, times)
        return found

    window = Window(pixels, 1, 0, 1000 * ticks)
    on_off = [tuple(jnp.asarray(part, jnp.float32) for part in both) for both in (true, spikes)]
    found = losses.emd_of_polarities(*on_off)
    assert found.shape == (pixels,)
    assert float(found.mean()) == pytest.approx(
        mean_emd(events(spikes), events(true), window), rel=1e-6
    )


def test_terms_by_hand() -> None:
    nothing = jnp.zeros((8, 1))
    true = column(0, 1, 0, 0, 0, 0, 0, 1), nothing
    spikes = column(1, 1, 0, 0, 1, 0, 0, 0), column(0, 0, 1, 0, 0, 0, 0, 0)
    # ON: 3 for 2; OFF: 1 for 0
    assert float(losses.relative_count(true, spikes)[0]) == pytest.approx(1 / 3 + 1)
    assert float(losses.edge_weight(true, 6.0)[0]) == 0.75
    assert float(losses.edge_weight((nothing, nothing), 6.0)[0]) == 1.0
    assert float(losses.edge_weight(true, 0.0)[0]) == 1.0
    # within 1 tick of a true ON: ticks 1 and 2; the ON in tick 5 and the OFF are not explained
    assert float(losses.unexplained(true, spikes, 1)[0]) == 2.0
    assert float(losses.unexplained(true, spikes, 3)[0]) == 1.0


def test_the_objective_adds_what_is_asked_for() -> None:
    nothing = jnp.zeros((8, 1))
    true = column(0, 1, 0, 0, 0, 0, 0, 1), nothing
    spikes = column(1, 1, 0, 0, 1, 0, 0, 0), column(0, 0, 1, 0, 0, 0, 0, 0)
    price = jnp.asarray([[0.25], [-0.125]])
    paper = losses.total(true, spikes, 0.2)
    assert losses.objective(true, spikes, Terms(count=0.2), price) == paper
    terms = Terms(0.2, relative_count=0.5, calibration=1.0, edge=2.0, silence=0.1, silence_ticks=1)
    expected = (paper + 0.5 * (1 / 3 + 1) + 0.1 * 2 + 3 * 0.25 - 0.125) * 0.5
    assert float(losses.objective(true, spikes, terms, price)[0]) == pytest.approx(
        float(expected[0]), rel=1e-6
    )
