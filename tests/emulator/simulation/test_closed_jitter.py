"""Jitter and losses of a loop's links: their distributions, against bounds from the variance.

Seeds are fixed; each bound is five standard deviations of what is estimated (p < 6e-7).
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
import scipy

from evs.emulator import ClosedLoop
from evs.emulator.config import SensorConfig
from evs.emulator.config.schema import DelayConfig
from evs.emulator.sensor.random import Term
from evs.emulator.simulation.delayed_links import Link, LinkNoise

pytestmark = pytest.mark.statistical
SENT = 20_000
TERMS = (Term.TRANSPORT, Term.CONTROL)


def delays_of(term, link, delay_us, jitter_us, gap_us):
    """Return how long each message took on a link, us, (SENT,) float64.

    Args:
        term: The term of the link's random numbers.
        link: The number of the link.
        delay_us: The declared delay.
        jitter_us: The standard deviation of the delay.
        gap_us: The time between two messages.
    """
    made = Link(delay_us, jitter_us, LinkNoise(12, term, link))
    for number in range(SENT):
        assert made.send(number, number * gap_us)
    return np.array([one.arrives_us - one.sent_us for one in made.waiting], np.float64)


@pytest.mark.parametrize("term", TERMS)
@pytest.mark.parametrize("jitter_us", [3.0, 800.0])
def test_delays_are_normal_around_the_declared_one(term, jitter_us):
    took = delays_of(term, 0, 50_000, jitter_us, gap_us=100_000)
    # rounding to whole us adds 1/12
    variance = jitter_us**2 + 1 / 12
    assert abs(took.mean() - 50_000) < 5 * math.sqrt(variance / SENT)
    assert abs(took.var() - variance) < 5 * variance * math.sqrt(2 / SENT)
    # the distribution is normal, apart from rounding
    spread = took + np.random.default_rng(1).uniform(-0.5, 0.5, SENT)
    assert scipy.stats.kstest(spread, "norm", (50_000, jitter_us)).pvalue > 1e-6
    # neighbours are independent
    same = np.corrcoef(took[1:], took[:-1])[0, 1]
    assert abs(same) < 5 / math.sqrt(SENT)


def test_no_delay_is_under_zero_and_the_rest_is_half_a_normal():
    took = delays_of(Term.TRANSPORT, 0, 0, 1000.0, gap_us=100_000)
    assert took.min() == 0
    assert abs((took == 0).mean() - 0.5) < 5 * 0.5 / math.sqrt(SENT)
    # E max(0, N) = sigma / sqrt(2 pi)
    mean, variance = 1000 / math.sqrt(2 * math.pi), 1000**2 * (0.5 - 0.5 / math.pi)
    assert abs(took.mean() - mean) < 5 * math.sqrt(variance / SENT)


def test_links_know_nothing_of_each_other():
    took = [delays_of(Term.TRANSPORT, link, 50_000, 800.0, 100_000) for link in (0, 1, 3)]
    took.append(delays_of(Term.CONTROL, 0, 50_000, 800.0, 100_000))
    correlations = np.corrcoef(took)[np.triu_indices(4, 1)]
    assert np.abs(correlations).max() < 5 / math.sqrt(SENT)


STILL = """
<mujoco>
  <option timestep=".0001"/>
  <worldbody><light pos="0 0 3"/><camera name="a" pos="0 0 3"/><camera name="b" pos="0 0 4"/>
    <geom type="plane" size="1 1 1"/></worldbody>
</mujoco>
"""


def test_a_loop_hands_packets_out_as_late_as_the_jitter_says():
    # decisions every 100 us; a packet is one decision late where its jitter is over 0
    ticks, tick_us = 4000, 100
    loop = ClosedLoop(
        mujoco.MjModel.from_xml_string(STILL), ("a", "b"), tick_us=tick_us,
        sensor=SensorConfig("ideal", width=2, height=2),
        delays=DelayConfig(transport_us=5000, transport_jitter_us=20.0, drop_share=0.1),
    )  # fmt: skip
    loop.reset(seed=3)
    late: dict[str, list[int]] = {"a": [], "b": []}
    for _ in range(ticks):
        seen = loop.step()
        for packet in seen.packets:
            late[packet.camera].append((seen.t_us - packet.time_end_us - 5000) // tick_us)
    for name, decisions in late.items():
        count = len(decisions)
        # packets that are still on their way count as neither
        sent = count + loop.dropped[name]
        assert ticks - 53 <= sent <= ticks
        assert abs(loop.dropped[name] - 0.1 * ticks) < 5 * math.sqrt(ticks * 0.09)
        assert set(decisions) == {0, 1}
        # late means round(20 N) > 0: a jitter below half a microsecond does not count
        share = scipy.stats.norm.sf(0.5 / 20)
        assert abs(np.mean(decisions) - share) < 5 * math.sqrt(share * (1 - share) / count)
    both = min(map(len, late.values()))
    assert both > 0.8 * ticks
