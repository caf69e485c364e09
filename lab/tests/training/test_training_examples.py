"""Batches: what they hold, and that they follow from the step alone."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest

from evs.msgs import EvsError
from evs_lab.training import training_examples as module
from evs_lab.training.calibration import MOST_PRICE, Calibration
from evs_lab.training.network import Architecture
from evs_lab.training.recipes import RECIPES, Recipe, recipe_named
from evs_lab.training.settings import Variant
from evs_lab.training.shards import Shards
from evs_lab.training.training_examples import (
    TrainingExamples,
    differences,
    louder,
    prepare,
    sample_held_out,
    true_membranes,
)
from evs_lab.training.training_loop import LINLOG_DN
from evs_lab.training.validation import plain_events
from reference.shards import synthetic_data

VARIANTS = (Variant(4, "fixed"), Variant(4, "fresh"))
RECIPE = Recipe("small", variants=VARIANTS, batch=64, warm_ticks=4)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine scenes of 24 pixels, 60 ticks: numbers 0 and 8 are held out."""
    return synthetic_data(tmp_path_factory.mktemp("data") / "d", 9, 24, 60)


def test_x_is_equation_1() -> None:
    light = np.array([[0.1, 0.2, 0.002, 0.0, 1e9, 1e9]], np.float32)
    dn = 255.0 * light.astype(np.float64)
    log = np.where(dn >= np.e, np.log(np.maximum(dn, 1e-300)), dn / np.e)
    expected = np.clip(np.diff(log, axis=1), -20, 20)
    found = differences(light, np.e)
    assert found.dtype == np.float32
    assert found[0, 0] == 0.0
    assert np.abs(found[:, 1:] - expected).max() < 2e-6
    assert found[0, 4] == 20.0


def test_a_prepared_shard_has_pixels_first_and_knows_the_live_ones(folder: Path) -> None:
    shard = Shards(folder)[1]
    held = prepare(shard, RECIPE, LINLOG_DN)
    light = shard.variant(4, "fresh")
    assert held.x.shape == (2, 24, 60)
    assert held.counts.shape == (24, 2, 60)
    assert np.array_equal(held.x[1, 5], differences(light[:, 5].copy(), LINLOG_DN))
    assert np.array_equal(held.counts[7, 1], shard.counts[1, :, 7])
    # a third of the pixels stands still; fresh noise is never still
    assert set(held.live[0]) == {p for p in range(24) if held.x[0, p].any()}
    assert len(held.live[0]) <= 16
    assert len(held.live[1]) == 24
    biased = dataclasses.replace(RECIPE, architecture=Architecture(8, biased=True))
    assert len(prepare(shard, biased, LINLOG_DN).live[0]) == 24
    noisy = dataclasses.replace(RECIPE, noisy_truth=True)
    told = prepare(shard, noisy, LINLOG_DN).counts
    assert np.array_equal(told[3, 0], shard.noisy_counts[0, :, 3])


@pytest.mark.parametrize("tick", [0, 1, 20, 59])
def test_membranes_stand_where_the_true_pixels_do(folder: Path, tick: int) -> None:
    """From there on the ideal pixel gives the events that the shard says."""
    shard = Shards(folder)[1]
    start = true_membranes(shard, tick, LINLOG_DN)
    assert np.abs(start).max() < 1
    x = differences(np.ascontiguousarray(shard.truth.T), LINLOG_DN)
    found = plain_events(x[:, tick:], start).transpose(1, 2, 0)
    wanted = shard.counts[:, tick:]
    assert wanted.sum() > 0 or tick == 59
    # float32 may put a crossing into the next tick
    assert np.abs(np.cumsum(found.astype(int) - wanted, 1)).max() <= 1
    assert np.count_nonzero(found != wanted) <= 2


def test_pixels_that_no_network_can_follow_are_left_out(folder: Path) -> None:
    shard = Shards(folder)[1]
    counts = shard.counts.copy()
    counts[:, :, 9:13] = 0
    counts[0, 1:, 9] = 2
    counts[1, 10:20, 10] = 4
    counts[1, 10:20, 11] = 3
    counts[0, 3, 12] = 90
    shard = dataclasses.replace(shard, counts=counts)
    assert counts[:, :, 9].sum() > module.MOST_EVENTS
    # those of 10 and 12 share their ticks
    for recipe, left_out in ((RECIPE, {9, 10, 12}), (RECIPE.with_events_per_tick("many"), {9})):
        held = prepare(shard, recipe, LINLOG_DN)
        assert set(range(24)) - set(held.live[1]) == left_out


def test_a_batch_follows_from_seed_and_step(folder: Path) -> None:
    first, second = (TrainingExamples(folder, RECIPE, 1, LINLOG_DN) for _ in range(2))
    assert [int(path.stem) for path in first.held_out] == [0, 8]
    early = [first.batch(step) for step in range(4)]
    late = second.batch(3)
    assert late.x.shape == (2, 32, 60)
    assert late.start.shape == (2, 32)
    assert late.counts.shape == (2, 2, 60, 32)
    assert late.variant.shape == (2,)
    for name in ("x", "start", "counts", "variant"):
        assert np.array_equal(getattr(early[3], name), getattr(late, name))
    assert not np.array_equal(early[2].x, late.x)
    assert not np.array_equal(TrainingExamples(folder, RECIPE, 2, LINLOG_DN).batch(3).x, late.x)


def test_a_batch_holds_pixels_of_the_training_scenes_with_their_truth(folder: Path) -> None:
    examples = TrainingExamples(folder, RECIPE, 1, LINLOG_DN)
    batch = examples.batch(0)
    scenes = [prepare(shard, RECIPE, LINLOG_DN) for shard in Shards(folder)]
    seen = set()
    for group, variant in enumerate(batch.variant):
        for pixel in range(32):
            places = [
                (number, row)
                for number, scene in enumerate(scenes)
                for row in np.flatnonzero(scene.start == batch.start[group, pixel])
            ]
            assert len(places) == 1
            number, row = places[0]
            assert number not in (0, 8)
            assert np.array_equal(batch.x[group, pixel], scenes[number].x[variant, row])
            assert np.array_equal(batch.counts[group, :, :, pixel], scenes[number].counts[row])
            seen.add(number)
    assert len(seen) > 4


def test_the_noise_of_each_pixel_is_taken_so_many_times(folder: Path) -> None:
    rng = np.random.default_rng(6)
    true = rng.normal(0, 0.1, (4000, 5)).astype(np.float32)
    x = true + rng.normal(0, 0.05, (2, 4000, 5)).astype(np.float32)
    x[:, :7] = true[:7]
    found = louder(x, true, (0.5, 4.0), rng)
    assert found.dtype == np.float32
    assert np.array_equal(found[:, :7], x[:, :7])
    factor = (found - true)[:, 7:] / (x - true)[:, 7:]
    # one factor a pixel, for all its ticks and variants
    assert np.abs(factor - factor[:1, :, :1]).max() < 1e-3 * np.abs(factor).max()
    logs = np.log(factor[0, :, 0]) / np.log(2)
    assert -1 <= logs.min() < -0.99 < 1.99 < logs.max() <= 2.001
    # log-uniform over three octaves
    assert abs(logs.mean() - 0.5) < 4 * 3 / np.sqrt(12 * len(logs))
    assert np.abs(louder(true + 15, true - 5, (4.0, 4.0), rng)).max() == 20

    noisy = dataclasses.replace(RECIPE, noise=(2.0, 2.0))
    plain, loud = (TrainingExamples(folder, one, 1, LINLOG_DN).batch(0) for one in (RECIPE, noisy))
    assert np.array_equal(plain.counts[0], loud.counts[0])
    truth = np.concatenate([prepare(s, noisy, LINLOG_DN).true_x for s in Shards(folder)])
    starts = np.concatenate([prepare(s, noisy, LINLOG_DN).start for s in Shards(folder)])
    for place in range(32):
        pixel = np.flatnonzero(starts == plain.start[0, place])[0]
        once = plain.x[0, place] - truth[pixel]
        assert np.abs(loud.x[0, place] - truth[pixel] - 2 * once).max() < 1e-5


def test_shares_choose_the_variants(folder: Path) -> None:
    only = dataclasses.replace(RECIPE, shares=(0.0, 1.0))
    examples = TrainingExamples(folder, only, 1, LINLOG_DN)
    assert {int(v) for step in range(10) for v in examples.batch(step).variant} == {1}


def test_more_scenes_than_memory_take_turns(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "ROUND_STEPS", 1)
    one = 24 * 60 * (4 * 2 + 2)
    examples = TrainingExamples(folder, RECIPE, 1, LINLOG_DN, memory_bytes=3 * one)
    seen: dict[Path, int] = {}
    for step in range(7):
        examples.batch(step)
        # a turn may begin with the scene that the last one ended with
        assert 2 <= len(examples._loaded) <= 3
        for path in examples._loaded:
            seen[path] = seen.get(path, 0) + 1
    assert set(seen) == set(examples.training)
    assert set(seen.values()) <= {2, 3}
    again = TrainingExamples(folder, RECIPE, 1, LINLOG_DN, memory_bytes=3 * one)
    assert np.array_equal(again.batch(5).x, examples.batch(5).x)


def test_validation_pixels_are_of_the_held_out_scenes(folder: Path) -> None:
    examples = TrainingExamples(folder, RECIPE, 1, LINLOG_DN)
    sample = sample_held_out(examples, VARIANTS, 20)
    assert sample.x.shape == (2, 20, 60)
    held = [prepare(Shards(folder)[place], RECIPE, LINLOG_DN).start for place in (0, 8)]
    assert set(sample.start.tolist()) <= set(np.concatenate(held).tolist())


def test_bad_data_is_told_in_one_line(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(EvsError, match="evs train data"):
        TrainingExamples(tmp_path, RECIPE, 1, LINLOG_DN)
    few = tmp_path / "few"
    shutil.copytree(folder, few)
    for number in (0, 8):
        (few / f"{number:05d}.npz").unlink()
    with pytest.raises(EvsError, match="7 scenes; two are needed"):
        TrainingExamples(few, RECIPE, 1, LINLOG_DN)
    late = RECIPE.with_look_ahead(21)
    with pytest.raises(EvsError, match="60 ticks, too few"):
        TrainingExamples(folder, dataclasses.replace(late, warm_ticks=40), 1, LINLOG_DN)
    paper = dataclasses.replace(recipe_named("paper"), warm_ticks=4)
    with pytest.raises(EvsError, match="no light of 64 spp"):
        TrainingExamples(folder, paper, 1, LINLOG_DN).batch(0)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"batch": 100}, "multiple of 32"),
        ({"steps": 0}, "steps is 0"),
        ({"initial": "zeros"}, "start of a network 'zeros'"),
        ({"shares": (1.0,)}, "2 variants"),
        ({"noise": (2.0, 1.0)}, "noise is"),
        ({"noise": (0.0, 1.0)}, "noise is"),
        ({"shares": (0.0, 0.0)}, "2 variants"),
    ],
)
def test_recipes_are_checked(changes: dict[str, object], says: str) -> None:
    with pytest.raises(EvsError, match=says):
        dataclasses.replace(RECIPE, **changes)  # type: ignore[arg-type]


def test_the_recipes() -> None:
    paper = RECIPES["paper"]
    assert paper.architecture.latency_ticks == 21
    assert paper.architecture.receptive_field == 43
    assert paper.architecture.biased
    assert paper.variants == (Variant(64, "fresh"),)
    extras = (paper.terms.relative_count, paper.terms.calibration, paper.terms.edge)
    assert (*extras, paper.terms.silence) == (0.0,) * 4
    for name, channels in (("evsnet_c8", 8), ("evsnet_c4", 4)):
        ours = recipe_named(name)
        assert ours.architecture == Architecture(channels, odd=True)
        assert ours.spp == (1, 64)
        member = ours.of_spp(16)
        assert (member.name, member.spp) == (f"{name}_16spp", (16, 16))
        assert member.variants == (Variant(16, "fresh"),)
        assert member.architecture == ours.architecture
    with pytest.raises(EvsError, match="no recipe 'evsnet_c9'; there is: evsnet_c4"):
        recipe_named("evsnet_c9")


def test_the_price_of_an_event_follows_the_count() -> None:
    state = Calibration.start(3)
    variant = np.array([0, 2], np.int32)
    loss = np.array([4.0, 0.25])
    for _ in range(50):
        state.update(variant, loss, np.array([[20.0, 5.0]] * 2), np.array([[10.0, 10.0]] * 2), 0.01)
    price = state.prices()
    assert price[0, 0] > 0 > price[0, 1]
    assert np.abs(price).max() <= np.float32(MOST_PRICE)
    # the variant that was not seen pays nothing
    assert not price[1].any()
    # roots of 4 and 0.25: four times the weight
    weights = state.weights()
    assert weights[2] == pytest.approx(4 * weights[0])
    assert weights[1] == 1.0
    # counts that agree leave the price where it is, once the old ones are forgotten
    agree = np.full((2, 2), 10.0)
    for _ in range(3000):
        state.update(variant, loss, agree, agree, 0.01)
    settled = state.integral.copy()
    state.update(variant, loss, agree, agree, 0.01)
    assert np.allclose(state.integral, settled, atol=1e-9)
