"""The statistics of `evs realism` beside plain loops, and on streams whose answer is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from evs.msgs import EvsError, Frame
from evs.msgs.event import EVENT_DTYPE
from evs_lab.fit import Observed
from evs_lab.realism import unpaired
from evs_lab.realism.compare import compare
from evs_lab.realism.paired import Region, likeness
from evs_lab.realism.replays import replay_all
from evs_lab.realism.unpaired import QUANTITIES, Statistics, distance, pieces

WIDTH, HEIGHT = 24, 16


def stream(seed: int, count: int, seconds: float, name: str = "random") -> Observed:
    """Events of a Poisson process, in bunches of a few stamps."""
    random = np.random.default_rng(seed)
    events = np.zeros(count, EVENT_DTYPE)
    events["t"] = np.sort(random.integers(0, round(1e6 * seconds), count)) // 50 * 50
    events["x"], events["y"] = random.integers(0, WIDTH, count), random.integers(0, HEIGHT, count)
    events["p"] = random.integers(0, 2, count)
    return Observed(events, WIDTH, HEIGHT, name)


def test_statistics_are_those_of_plain_loops() -> None:
    seen = stream(1, 3000, 2.0)
    own = Statistics(seen, 0, 2.0)
    last: dict[tuple[int, int], tuple[int, int]] = {}
    runs: dict[tuple[int, int], int] = {}
    bursts, flips, supported, slots = [], [], [], set()
    for t, x, y, p in seen.events[["t", "x", "y", "p"]].tolist():
        before = last.get((x, y))
        if before is not None:
            flips.append(before[1] != p)
        if before is not None and before[1] == p and t - before[0] <= unpaired.BURST_US:
            runs[x, y] += 1
        else:
            bursts.append(runs.get((x, y), 0))
            runs[x, y] = 1
        last[x, y] = t, p
        slots.add((t // unpaired.NEAR_US, x, y))
    bursts = [n for n in [*bursts, *runs.values()] if n]
    for t, x, y in seen.events[["t", "x", "y"]].tolist():
        around = [(x + a, y + b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]
        supported.append(any((t // unpaired.NEAR_US, a, b) in slots for a, b in around))
    assert own.flips == pytest.approx(np.mean(flips))
    assert own.supported == pytest.approx(np.mean(supported))
    assert 0.02 < own.supported < 0.9
    wanted = np.histogram(bursts, unpaired.BURST_EDGES)[0] / len(bursts)
    np.testing.assert_allclose(own.bursts, wanted, atol=1e-12)
    assert own.bursts[0] < 1.0
    pairs = list(zip(seen.events[:-1], seen.events[1:], strict=True))
    same = [a["t"] == b["t"] for a, b in pairs]
    rows = [a["y"] == b["y"] for a, b in pairs if a["t"] == b["t"]]
    rising = [a["x"] < b["x"] for a, b in pairs if a["t"] == b["t"] and a["y"] == b["y"]]
    assert own.same_stamp == pytest.approx(np.mean(same))
    assert own.same_row == pytest.approx(np.mean(rows))
    assert own.ascending == pytest.approx(np.mean(rising))


def test_streams_of_one_kind_are_as_near_as_pieces_and_others_are_not() -> None:
    real, twin, other = stream(1, 20_000, 4.0), stream(2, 20_000, 4.0), stream(3, 40_000, 4.0)
    # ON only, one stamp a millisecond
    odd = other.events.copy()
    odd["p"], odd["t"] = 1, odd["t"] // 1000 * 1000
    seconds, rows = compare(real, [twin, Observed(odd, WIDTH, HEIGHT, "odd")])
    assert 1.9 < seconds <= 2.0
    by_key = {row.quantity.key: row for row in rows}
    for row in rows:
        assert row.distances[0] < 3.0 * row.floor + 0.02, row.quantity.key
    for key in ("rate_hz", "rates", "intervals", "on", "flips", "stamps", "same_stamp"):
        assert by_key[key].distances[1] > 5.0 * by_key[key].floor + 0.02, key
    assert by_key["rate_hz"].distances[1] == pytest.approx(math.log10(2.0), abs=0.02)
    # another recording of the camera gives the floor
    _, rows = compare(real, [twin], stream(4, 20_000, 4.0, "again"))
    assert all(row.floor < 0.1 for row in rows)


def test_a_recording_that_is_too_long_is_no_silent_sensor() -> None:
    few = stream(1, 2000, 301.0)
    white = np.full((HEIGHT, WIDTH), 200, np.uint8)
    frames = tuple(
        Frame(k, t_us, t_us, t_us + 1000, t_us + 1000, white)
        for k, t_us in enumerate(range(0, 301_000_000, 15_000_000))
    )
    with pytest.raises(EvsError, match="at most 300 s"):
        replay_all(replace(few, frames=frames), ["ideal"])


def test_a_shift_of_a_distribution_is_its_distance() -> None:
    whole = stream(5, 20_000, 2.0)
    slow = whole.events.copy()
    slow["t"] *= 10
    near, far = Statistics(whole, 0, 2.0), Statistics(Observed(slow, WIDTH, HEIGHT), 0, 20.0)
    by_key = {one.key: one for one in QUANTITIES}
    assert distance(by_key["intervals"], near, far) == pytest.approx(1.0, abs=0.02)
    assert distance(by_key["rate_hz"], near, far) == pytest.approx(1.0)
    assert distance(by_key["rates"], near, far) == 0.0
    assert len(pieces(whole, 0.499)) == 4


def test_likeness_is_that_of_dense_arrays() -> None:
    random = np.random.default_rng(9)
    region = Region(random.random((HEIGHT, WIDTH)) < 0.7, 100_000, 1_000_000)
    events, real = (stream(seed, 2000, 1.2).events for seed in (6, 7))
    # half of the real ones again, so that there is something to correlate
    events = np.sort(np.concatenate([events, real[::2]]), order="t")
    like = likeness(events, real, region)

    def dense(of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        counts, signed = np.zeros((HEIGHT, WIDTH)), np.zeros((18, HEIGHT, WIDTH))
        for t, x, y, p in of[["t", "x", "y", "p"]].tolist():
            if region.begin_us < t <= region.end_us:
                counts[y, x] += 1
                signed[(t - region.begin_us - 1) // 50_000, y, x] += 2 * p - 1
        return counts[region.pixels], signed[:, region.pixels].ravel()

    (a, of_a), (b, of_b) = dense(events), dense(real)
    assert like.events == a.sum()
    assert like.ratio == pytest.approx(a.sum() / b.sum())
    assert like.active == pytest.approx(np.mean(a > 0))
    assert like.totals == pytest.approx(np.corrcoef(a, b)[0, 1])
    assert like.signed == pytest.approx(np.corrcoef(of_a, of_b)[0, 1])
    assert 0.3 < like.signed < 0.9
    itself = likeness(real, real, region)
    assert (itself.ratio, itself.kl_nats) == (1.0, 0.0)
    assert itself.totals == pytest.approx(1.0)
    assert itself.signed == pytest.approx(1.0)
    nothing = likeness(real[:0], real, region).plain()
    assert nothing["ratio"] == nothing["active"] == 0.0
    assert nothing["on"] is nothing["totals"] is nothing["signed"] is None
