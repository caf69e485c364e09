"""Measures of hand-made streams, and how takes become a row."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evs.emulator.evsnet import network_files
from evs.emulator.evsnet.export import export
from evs.emulator.evsnet.model import EvsNetModel
from evs.msgs import Events, join_events, make_events
from evs_lab.evaluation import models
from evs_lab.evaluation.aggregate import VALUES, aggregate, aggregate_rows
from evs_lab.evaluation.clip import Clip, make_clip
from evs_lab.evaluation.evaluate import stands_still
from evs_lab.evaluation.measure import Measures, measure
from evs_lab.evaluation.scenes import scene_setup
from evs_lab.evaluation.table import (
    claims_by_scene,
    emd_by_scene,
    finite,
    markdown,
    overview,
    table,
)
from reference.judged import cell, light_of_steps, measures, written
from reference.networks import random_network

END_US = 10_000
SAMPLED, PATCH = 6, 4


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    setup = scene_setup(str(written(tmp_path_factory.mktemp("scene"))))
    return make_clip(setup, "still", 5, sampled=SAMPLED, patch_px=PATCH, size=(32, 24))


def stream(*rows: tuple[int, int, int]) -> Events:
    """Events of (t, pixel, polarity)."""
    t, x, p = np.array(sorted(rows), np.int64).reshape(-1, 3).T
    return make_events(t, x, np.zeros(len(t)), p)


def judge(clip: Clip, events: Events, reference: Events, static: list[int]) -> Measures:
    mask = np.zeros(SAMPLED + PATCH**2, np.bool_)
    mask[static] = True
    return measure(events, reference, clip, mask, 0, END_US, 2.0)


def test_sampled_pixels(clip: Clip) -> None:
    reference = stream((2000, 0, 1), (5000, 1, 0), (7000, 2, 1), (0, 5, 1))
    # 1.5 ms late; 4 ms late: no pair; on the neighbour: no pair; a false one on a still pixel
    events = stream((3500, 0, 1), (9000, 1, 0), (7000, 3, 1), (8000, 4, 0), (8000, 4, 0),
                    (10_001, 4, 0))  # fmt: skip
    found = judge(clip, events, reference, [4, 5, SAMPLED])
    assert (found.pixels, found.seconds, found.ms_per_tick) == (6, 0.01, 2.0)
    assert (found.on, found.off, found.reference_on, found.reference_off) == (2, 3, 2, 1)
    assert found.pairs == 1
    assert (found.static_px, found.static_events) == (2, 2)
    assert (found.delay_us, found.timing_us) == (1500.0, 1500.0)
    # ticks moved by pairs in order, 2 and 4 of K = 10; a lone event costs (K + 1) / 2K
    assert found.emd == pytest.approx((2 / 10 + 4 / 10 + 4 * 11 / 20) / 6)
    # counts 1 1 0 1 2 0 against 1 1 1 0 0 0
    assert found.rmse_hz == pytest.approx(100 * math.sqrt(6 / 6))
    assert found.patch_events == found.patch_reference == 0


def test_the_patch_knows_neighbours(clip: Clip) -> None:
    def at(x: int, y: int) -> int:
        return SAMPLED + PATCH * y + x

    reference = stream((2000, at(1, 1), 1), (2000, at(3, 0), 1), (2000, at(0, 3), 0))
    # diagonal neighbour; next in the row of numbers but far in the patch; two to the right
    events = stream((2500, at(2, 2), 1), (2000, at(0, 1), 1), (2000, at(2, 3), 0))
    found = judge(clip, events, reference, [])
    assert (found.patch_px, found.patch_reference, found.patch_events) == (16, 3, 3)
    assert found.patch_pairs == 1
    assert found.patch_emd == pytest.approx(6 * 11 / 20 / 16)
    assert (found.on, found.off, found.pairs, found.reference_on) == (0, 0, 0, 0)
    assert math.isnan(found.delay_us)


@pytest.mark.parametrize("events_per_tick", ["one", "many"])
def test_a_model_sees_each_pixel_alone_and_its_latency_is_taken_off(events_per_tick: str) -> None:
    steps = np.zeros((60, 3), np.int64)
    steps[20:, 0], steps[30:, 1], steps[30:, 2] = 1, -2, 0
    light = light_of_steps(steps)
    found = models.reference_events(light)
    assert set(found["x"].tolist()) == {0, 1}
    on, off = (found[found["x"] == x] for x in (0, 1))
    assert on["p"].tolist() == [1]
    assert off["p"].tolist() == [0, 0]
    # tick k ends at k ms
    assert 19_000 < on["t"][0] <= 20_000
    assert ((off["t"] > 29_000) & (off["t"] <= 30_000)).all()

    weights = random_network(5, 4, look_ahead=3)
    rule = {"events_per_tick": events_per_tick}
    tested = models.network(weights, models.RuntimeOptions(1, "reference", **rule), "mine")
    assert (tested.name, tested.latency_ticks) == ("mine", 21)
    out = models.run(tested, light)
    assert out.ms_per_tick > 0
    sensor = replace(models.sensor_of(3), width=3, height=1)
    model = EvsNetModel(sensor, weights, runtime="reference", initial="zero", **rule)
    raw, _ = model.step_chunk(light[:, np.newaxis], model.init(0), -1000, 1000)
    wanted = join_events(raw)
    assert len(wanted) > 0
    wanted["t"] -= 21_000
    assert out.events.tobytes() == wanted.tobytes()


def test_pixels_keep_their_numbers() -> None:
    """Whatever tile a pixel stands in: pixel n goes up in tick n + 1, all others stand still."""
    count = 37
    steps = np.zeros((count + 2, count), np.int64)
    for pixel in range(count):
        steps[pixel + 1 :, pixel] = 1
    sensor = models.sensor_of(count)
    assert (sensor.width, sensor.height) == (12, 4)
    found = models.reference_events(light_of_steps(steps))
    assert found["x"].tolist() == list(range(count))
    assert ((found["t"] + 999) // 1000).tolist() == list(range(1, count + 1))
    assert not found["y"].any()


def test_pixels_that_stand_still() -> None:
    light = np.full((5, 4), 0.5, np.float32)
    light[:, 1] *= np.exp(np.linspace(0, 0.04, 5)).astype(np.float32)
    light[:, 2] *= np.exp(np.linspace(0, 0.06, 5)).astype(np.float32)
    light[:, 3] = [0, 1e-4, 0, 0, 0]
    assert stands_still(light).tolist() == [True, True, False, True]


def test_pooled_values_are_shares_of_sums() -> None:
    busy = measures(on=300, off=100, reference_on=200, reference_off=200, pairs=300,
                    static_px=100, static_events=40, delay_us=500.0, emd=3.0)  # fmt: skip
    calm = measures(on=0, off=0, reference_on=0, reference_off=0, pairs=0, static_px=900,
                    static_events=10, delay_us=math.nan, emd=1.0)  # fmt: skip
    found = aggregate([busy, calm])
    told = {name: value.mean for name, value in found.items()}
    assert told["emd"] == 2.0
    assert (told["count_on"], told["count_off"], told["count"]) == (1.5, 0.5, 1.0)
    assert (told["recall"], told["precision"]) == (0.75, 0.75)
    assert told["static_hz"] == 0.05
    assert told["spurious_hz"] == 100 / 2000
    assert told["delay_us"] == 500.0
    assert told["ms_per_tick"] == pytest.approx(89_960 / 2024)
    assert found["emd"].spread == pytest.approx(math.sqrt(2))
    assert math.isnan(found["count_on"].spread)
    assert found["static_hz"].spread == pytest.approx((0.4 - 10 / 900) / math.sqrt(2))
    assert set(found) == set(VALUES)
    assert all(math.isnan(value.spread) for value in aggregate([busy]).values())


def test_rows_and_their_words() -> None:
    cells = [
        cell("plain", emd=1.0, scene="one"),
        cell("plain", emd=2.0, scene="two"),
        cell("plain", 16, emd=0.5, scene="one"),
        cell("nothing", 0, "fixed", light="none", on=0, off=0, pairs=0, scene="one"),
    ]
    rows = aggregate_rows(cells)
    assert [(row.model, row.spp, row.scenes) for row in rows] == [
        ("plain", 4, 2), ("plain", 16, 1), ("nothing", 0, 1)]  # fmt: skip
    lines = table(rows)
    assert len(lines) == 5
    assert len({line.count("|") for line in lines}) == 1
    assert lines[2].startswith("| still | 4 spp fresh | plain | 1.500 ± 0.707 | 1.00 ± 0.00 |")
    assert lines[3].startswith("| still | 16 spp fresh | plain | 0.500 | 1.00 |")
    assert lines[4].startswith("| still | none | nothing | 0.100 | 0.00 | 0.00 | 0 | 0 | 0.00 | - ")


def test_the_overview() -> None:
    cells = [
        cell("nothing", 0, "fixed", light="none", on=0, off=0, pairs=0),
        cell("plain", emd=1.0, pairs=150, static_events=1234),
        cell("adaptive", emd=0.5, pairs=150, on=50, static_px=0),
        cell("plain", 4, "fixed", light="direct", on=0, off=0, pairs=0),
    ]
    assert overview(aggregate_rows(cells)) == [
        "| camera | light | plain | adaptive |",
        "|---|---|---|---|",
        "| still | 4 spp fresh | 1.000, 0.75 / 0.75, 2.5 | 0.500, 0.75 / 1.00, - |",
        "| still | direct, 4 spp | 0.100, 0.00 / -, 0 | - |",
    ]


def test_each_scene_has_a_cell() -> None:
    cells = [
        cell("nothing", 0, "fixed", light="none", emd=1.0, scene="one"),
        cell("nothing", 0, "fixed", light="none", emd=0.4, scene="two"),
        cell("plain", emd=6.0, scene="one"),
        cell("plain", emd=3.0, scene="two"),
        cell("evsnet_c8", emd=0.9, scene="one"),
        cell("evsnet_c8", emd=0.5, scene="two"),
        cell("adaptive", emd=0.3, scene="two"),
    ]
    assert emd_by_scene(cells) == [
        "| camera | light | model | one | two |",
        "|---|---|---|---:|---:|",
        "| still | none | nothing | 1.000 | 0.400 |",
        "| still | 4 spp fresh | plain | 6.000 † | 3.000 † |",
        "| still | 4 spp fresh | evsnet_c8 | 0.900 | 0.500 † |",
        "| still | 4 spp fresh | adaptive | - | 0.300 |",
    ]
    heading, _, first, *rest = claims_by_scene(cells)
    assert heading == "| claim | one | two |"
    assert first == (
        "| evsnet_c8, fresh 4 spp: EMD at least 5x below plain, and below silence | met | missed |"
    )
    assert all(line.count("|") == 4 for line in rest)


def test_json_has_no_nan() -> None:
    assert finite({"a": [math.nan, 1.0, {"b": math.inf}], "c": "x"}) == {
        "a": [None, 1.0, {"b": None}], "c": "x"}  # fmt: skip


def test_markdown_of_nothing_but_cells() -> None:
    from evs_lab.evaluation.table import Evaluation

    told = markdown(Evaluation("evs evaluate", {}, {}, [], [cell("plain")], ["no network 'x'"]))
    assert told.startswith("    evs evaluate\n")
    assert "- no network 'x'\n" in told


def test_what_stood_still_before_fills_the_window_of_a_network() -> None:
    """Light that goes on as it was gives what a longer film gives, membranes at zero between."""
    rng = np.random.default_rng(5)
    light = rng.gamma(8.0, 0.02, (110, 3)).astype(np.float32)
    for look_ahead in (0, 1):
        weights = random_network(6, 4, look_ahead=look_ahead)
        tested = models.network(weights, models.RuntimeOptions(1, "reference"))
        cold = models.run(tested, light[42:]).events
        found = models.run(tested, light[42:], light[:42]).events
        assert not np.array_equal(cold, found)
        sensor = replace(models.sensor_of(3), width=3, height=1)
        model = EvsNetModel(sensor, weights, runtime="reference", initial="zero")
        begin = 42 + weights.latency_ticks
        _, state = model.step_chunk(light[:begin, np.newaxis], model.init(0), -43_000, 1000)
        state.v[...] = 0
        raw, _ = model.step_chunk(light[begin:, np.newaxis], state, 1000 * (begin - 43), 1000)
        wanted = join_events(raw)
        wanted["t"] -= 1000 * weights.latency_ticks
        assert len(wanted) > 10
        assert np.array_equal(found, wanted)
    # pixels have no window
    (plain,), _ = models.models_under_test(("plain",), None, models.RuntimeOptions(1, "native"))
    known = models.run(plain, light[42:]).events
    assert np.array_equal(models.run(plain, light[42:], light[:42]).events, known)


def test_before_a_take_its_first_instant_stood_still() -> None:
    clip = make_clip(scene_setup("procedural/0"), "pan", 4, sampled=8, patch_px=8, size=(32, 24))
    before = clip.before(3)
    assert [shot[0].t_us for shot in before.instants] == [-3000, -2000, -1000]
    for snapshot, pose in before.instants:
        assert pose is clip.instants[0][1]
        assert np.array_equal(snapshot.geom_pos, clip.instants[0][0].geom_pos)
    assert before.fingerprint(3) != clip.fingerprint(3)
    # whatever comes later in it
    longer = make_clip(scene_setup("procedural/0"), "pan", 6, sampled=8, patch_px=8, size=(32, 24),
                  look_ticks=4)  # fmt: skip
    assert longer.before(3).fingerprint(3) == before.fingerprint(3)


def test_a_family_is_measured_by_the_member_for_the_light(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network_files, "_NETWORKS", tmp_path)
    for name, channels in (("net_1spp", 2), ("net_16spp", 4)):
        export(random_network(1, channels), tmp_path / f"{name}.onnx")
    options = models.RuntimeOptions(1, "reference")
    (family,), missing = models.models_under_test(("net",), None, options)
    assert not missing
    for spp, channels in ((1, 2), (64, 4), (0, 4)):
        chosen = family.at(spp)
        assert chosen.name == "net"
        model = chosen.make(models.sensor_of(1))
        assert model.weights.channels == channels  # type: ignore[attr-defined]
