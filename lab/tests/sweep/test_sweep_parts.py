"""Parts of a sweep: axes, points, intervals, frames of peers, the file of records."""

from __future__ import annotations

import itertools
import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator.config import ModelConfig, SensorConfig
from evs.msgs import EvsError
from evs_lab.evaluation import models
from evs_lab.sweep import axes
from evs_lab.sweep import sweep as sweep_module
from evs_lab.sweep.errors import ErrorSettings, instant_indices, times_of
from evs_lab.sweep.frame_methods import FrameMethod, frame_method, interpolate, quantise
from evs_lab.sweep.pixels import events_of, metered_sensor
from evs_lab.sweep.points import SweepPoint, configured, differences, preset_of, sweep_point
from evs_lab.sweep.record import CAMERAS, Accuracy, ConfidenceInterval, Speed, SweepRecord
from evs_lab.sweep.speed import STUDENT, SpeedSettings, confidence_interval, order
from evs_lab.sweep.store import SweepHeader, SweepStore, read_sweep
from reference.alarm import not_waited_for
from reference.judged import light_of_steps

PRESETS = tuple(axes.DEFAULT)


# axes and points


def test_each_point_differs_from_its_preset_in_what_it_says_and_nothing_else() -> None:
    found = axes.points(PRESETS, tuple(axes.AXES))
    for point in found:
        base = preset_of(point.preset)
        assert differences(base, point.config) == dict(point.settings)
        assert point.axis == "" or point.settings or point.kind == "frames"
    names = [(p.preset, p.axis, p.value) for p in found]
    assert len(set(names)) == len(names)
    assert {p.axis for p in found} == {"", *axes.AXES}
    assert {p.kind for p in found} == {"ours", "frames", "paper"}


@pytest.mark.parametrize(
    ("spp", "antialiasing", "wanted", "at_edges"),
    [
        (1, "fixed", [4, 16], [4]),
        (4, "fixed", [1, 16, 64], [4, 16]),
        (64, "fixed", [4, 16, 256, 1024], [64, 256]),
        (1024, "fixed", [64, 256, 2048], [1024]),
        (16, "adaptive", [1, 4, 16, 64], [4]),
    ],
)
def test_samples_of_paths_go_around_the_presets(
    tmp_path: Path, spp: int, antialiasing: str, wanted: list[int], at_edges: list[int]
) -> None:
    file = tmp_path / "mine.toml"
    render = f'renderer = "path"\nspp = {spp}\nantialiasing = "{antialiasing}"'
    file.write_text(f"[render]\n{render}\n")
    own, *others = axes.points([str(file)], ["samples"])
    assert own == SweepPoint(str(file))
    found = [(p.config.render.antialiasing, p.config.render.spp) for p in others]
    assert [spp for where, spp in found if where == "fixed"] == wanted
    assert [spp for where, spp in found if where == "adaptive"] == at_edges


def test_hybrid_stands_beside_the_presets_and_has_samples_of_its_own(tmp_path: Path) -> None:
    for preset in ("fast", "balanced"):
        beside = {p.config.render.renderer for p in axes.points([preset]) if p.axis == "renderer"}
        assert "hybrid" in beside | {preset_of(preset).render.renderer}
    file = tmp_path / "mine.toml"
    file.write_text('[render]\nrenderer = "hybrid"\nspp = 4\nantialiasing = "fixed"\n')
    own, *others = axes.points([str(file)], ["samples"])
    assert own == SweepPoint(str(file))
    found = {p.value: (p.config.render.antialiasing, p.config.render.spp) for p in others}
    assert found == {
        "hybrid 1": ("fixed", 1),
        "hybrid 16": ("fixed", 16),
        "hybrid 64": ("fixed", 64),
        "hybrid 4 at edges": ("adaptive", 4),
    }
    # it has no noise to vary, so these are for path with as many samples
    for axis in ("seeds", "cycle", "network", "frames"):
        _, *others = axes.points([str(file)], [axis])
        lights = {(p.config.render.renderer, p.config.render.spp) for p in others}
        assert lights == {("path", 4)}


def test_the_axes_of_a_preset_of_hard_light(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("[render]\nspp = 1\n")
    found = axes.points([str(file)], ["samples", "tick", "frames"])
    direct = {p.config.render.samples for p in found if p.axis in ("", "samples")}
    assert direct == {1, 2, 4, 8, 16}
    ticks = {p.config.scene.tick_us for p in found if p.axis in ("", "tick")}
    assert ticks == {250, 500, 1000, 2000, 4000, 10000}
    fps = {p.config.scene.tick_us for p in found if p.kind == "frames"}
    assert fps == {16667, 10000, 4000, 2000, 1000}
    # nothing of paths applies to it
    with pytest.raises(EvsError, match="no value of seeds, network differs"):
        axes.points([str(file)], ["seeds", "network"])


@settings(max_examples=30, deadline=None)
@given(
    st.sampled_from(PRESETS),
    st.fixed_dictionaries(
        {},
        optional={
            "render.spp": st.integers(1, 64),
            "scene.tick_us": st.integers(250, 20000),
            "threads": st.integers(0, 64),
            "sensor.cutoff_hz": st.floats(0.0, 1e6),
            "render.incremental": st.booleans(),
            "sensor.filter": st.sampled_from(["exact", "euler"]),
        },
    ),
)
def test_settings_of_a_point_come_back(
    preset: str, changes: dict[str, str | int | float | bool]
) -> None:
    point = sweep_point(preset, "some", "value", changes)
    base = preset_of(preset)
    assert configured(base, dict(point.settings)) == point.config == configured(base, changes)
    kept = dict(point.settings)
    assert {k: v for k, v in changes.items() if k not in kept} == {
        k: v for k, v in changes.items() if differences(base, configured(base, {k: v})) == {}
    }


@pytest.mark.parametrize(
    ("presets", "along", "says"),
    [
        (("swift",), (), "no pipeline file 'swift'"),
        (("fast", "fast"), (), "a preset is given twice"),
        (("fast",), ("tick", "tick"), "a axis is given twice|an axis is given twice"),
        (("fast",), ("sample",), "no axis 'sample'; there is: samples"),
        ((), (), "no preset is asked for"),
    ],
)
def test_points_that_cannot_be(presets: tuple[str, ...], along: tuple[str, ...], says: str) -> None:
    with pytest.raises(EvsError, match=says) as found:
        axes.points(presets, along)
    assert "\n" not in str(found.value)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"render.spp": 100}, "render.spp is 100"),
        ({"render.seeds": "fresh"}, "render.seeds is fresh, but direct has only fixed"),
        ({"model.chunk": 8}, "model.chunk is 8"),
        ({"publish": "tcp://127.0.0.1:1"}, "at publish: a sweep changes only"),
        ({"render.sp": 1}, "unknown key"),
    ],
)
def test_settings_that_make_no_sense(changes: dict[str, str | int], says: str) -> None:
    with pytest.raises(EvsError, match=says):
        sweep_point("fast", "some", "value", changes)


@pytest.mark.parametrize(
    "make",
    [
        lambda: ErrorSettings(ticks=20),
        lambda: ErrorSettings(pixels=0),
        lambda: ErrorSettings(reference_spp=7),
        lambda: SpeedSettings(seconds=0.0),
        lambda: SpeedSettings(repeats=0),
    ],
)
def test_numbers_without_sense(make: object) -> None:
    with pytest.raises(EvsError, match=r"give|cannot be halved"):
        make()  # type: ignore[operator]


# intervals


def test_an_interval_of_many_is_of_order_statistics() -> None:
    # coverage 1 - 2 P(Binomial(n, 1/2) < k), by hand: n = 6: 1 - 2/64; n = 9: 1 - 2 (1 + 9)/512;
    # n = 20: 1 - 2 (1 + 20 + 190 + 1140 + 4845)/2^20
    assert [order(n) for n in (6, 8, 9, 20)] == [1, 1, 2, 6]
    found = confidence_interval([5.0, 1.0, 3.0, 2.0, 6.0, 4.0])
    assert (found.median, found.low, found.high, found.n) == (3.5, 1.0, 6.0, 6)
    found = confidence_interval([float(v) for v in range(1, 21)])
    assert (found.low, found.high) == (6.0, 15.0)


def test_an_interval_covers_the_median_as_often_as_it_says() -> None:
    rng = np.random.default_rng(3)
    for n, coverage in ((6, 1 - 2 / 64), (11, 1 - 2 * (1 + 11) / 2**11)):
        drawn = np.exp(rng.standard_normal((4000, n)))
        hits = sum(found.low <= 1.0 <= found.high for found in map(confidence_interval, drawn))
        # within 5 sigma of a binomial
        assert abs(hits - 4000 * coverage) < 5 * math.sqrt(4000 * coverage * (1 - coverage))


def test_an_interval_of_few_is_students() -> None:
    # logarithms -a, 0, a: standard deviation a
    found = confidence_interval([2.0 * math.exp(a) for a in (-0.1, 0.0, 0.1)])
    factor = math.exp(STUDENT[3] * 0.1 / math.sqrt(3))
    assert found.n == 3
    assert found.median == pytest.approx(2.0)
    assert found.low == pytest.approx(2.0 / factor)
    assert found.high == pytest.approx(2.0 * factor)
    # what took no time has no logarithm
    found = confidence_interval([0.0, 0.5])
    assert found.high - found.median == pytest.approx(STUDENT[2] * 0.25, rel=1e-9)
    assert found.low == 0.0
    lone = confidence_interval([7.0])
    assert lone.median == 7.0
    assert math.isnan(lone.low)
    assert math.isnan(lone.high)


@given(st.lists(st.just(0.0) | st.floats(1e-9, 1e9), min_size=2, max_size=30))
def test_an_interval_holds_its_median(values: list[float]) -> None:
    found = confidence_interval(values)
    assert 0.0 <= found.low <= found.median <= found.high
    assert found.n == len(values)


# frames of peers


def test_ways_of_frames() -> None:
    assert frame_method("ESIM, 60 FPS") == FrameMethod(False)
    assert frame_method("v2e, 1000 FPS, 8 bit sRGB") == FrameMethod(True, "8 bit sRGB")
    for wrong in ("frames", "ESIM, 60 FPS, 9 bit"):
        with pytest.raises(EvsError, match="is no way of frames"):
            frame_method(wrong)
    assert all(
        frame_method(p.value) for p in axes.points(["fast"], ["frames"]) if p.kind == "frames"
    )


def test_light_of_eight_bits() -> None:
    light = np.array([0.0, 0.1, 0.5, 1.0, 3.0], np.float32)
    assert quantise(light, "") is light
    assert quantise(light, "8 bit") == pytest.approx([0, 26 / 255, 128 / 255, 1, 1])
    # sRGB's own fixed points: 0.0031308 ends the linear part, half light is 188 of 255
    assert quantise(light, "8 bit sRGB")[2] == pytest.approx(188 / 255)
    assert quantise(np.array([0.0031308], np.float32), "8 bit sRGB")[0] == pytest.approx(10 / 255)


def test_pictures_between_two_frames() -> None:
    first, second = np.array([[0.0, 1.0], [4.0, 3.0]], np.float32)
    found = interpolate(first, second, 500, 2500)
    assert [t for t, _ in found] == [1000, 2000, 2500]
    assert found[0][1] == pytest.approx([1.0, 1.5])
    assert found[1][1] == pytest.approx([3.0, 2.5])
    assert found[2][1] is second


def test_the_way_of_esim_finds_crossings_of_linear_log_light() -> None:
    # log light rises by 0.2001 a ms for 8 ms: a frame each 4 ms sees a straight line, so the
    # crossings are where every ms sees them
    light = light_of_steps(np.arange(9)[:, None] * np.ones((1, 3)))
    every = events_of(light, range(0, 9000, 1000), ModelConfig(), models.SENSOR)
    frames = events_of(
        light[::4],
        range(0, 9000, 4000),
        ModelConfig(),
        models.SENSOR,
        frame_method("ESIM, 250 FPS"),
    )
    assert len(every) == 3 * 8
    assert np.array_equal(frames["x"][np.argsort(frames["t"], kind="stable")], every["x"])
    assert np.abs(np.sort(frames["t"]) - np.sort(every["t"])).max() <= 1
    # v2e's blends of frames are linear in the light instead: as many events, at other times
    blended = events_of(
        light[::4], range(0, 9000, 4000), ModelConfig(), models.SENSOR, frame_method("v2e, 250 FPS")
    )
    assert len(blended) == len(every)
    assert np.abs(np.sort(blended["t"]) - np.sort(every["t"])).max() > 20


def test_instants_of_frames_are_the_nearest_shots() -> None:
    assert instant_indices(1000, 5000) == [0, 4, 8, 12, 16, 20]
    assert instant_indices(250, 1000) == [0, 1, 2, 3, 4]
    found = times_of(instant_indices(16667, 100_000))
    assert found[:3] == [0, 16750, 33250]
    assert found[-1] >= 100_000
    assert np.abs(np.array(found) - 16667 * np.arange(len(found))).max() <= 125
    with pytest.raises(EvsError, match="measured from 250 us on"):
        instant_indices(100, 1000)


@settings(max_examples=40)
@given(st.integers(250, 20000), st.integers(1000, 200_000))
def test_instants_reach_the_end(tick_us: int, end_us: int) -> None:
    found = times_of(instant_indices(tick_us, end_us))
    assert found[0] == 0
    assert all(a < b for a, b in itertools.pairwise(found))
    assert end_us <= found[-1] <= end_us + tick_us + 250


def test_the_sensor_that_errors_have() -> None:
    preset = SensorConfig()
    assert metered_sensor(preset, preset) == models.SENSOR
    asked = SensorConfig(cutoff_hz=300.0, filter="euler", leak_rate_hz=9.0)
    found = metered_sensor(asked, preset)
    assert (found.cutoff_hz, found.filter, found.leak_rate_hz) == (300.0, "euler", None)


# the file


def record(value: str, **given: object) -> SweepRecord:
    return SweepRecord("s", "still", "fast", "tick", value, {}, **given)  # type: ignore[arg-type]


HEADER = SweepHeader({"pixels": 8, "seed": 0}, {"machine": "one"})


def test_a_store_goes_on_where_it_was(tmp_path: Path) -> None:
    file = tmp_path / "new" / "sweep.jsonl"
    store = SweepStore(file, HEADER)
    error = Accuracy(*[0.5] * 10)
    for value in ("1 ms", "2 ms"):
        store.add(record(value, error=error))
    again = SweepStore(file, SweepHeader(HEADER.settings, {"machine": "another"}))
    assert again.records == store.records == [record(v, error=error) for v in ("1 ms", "2 ms")]
    assert again.header.about == {"machine": "one"}
    assert read_sweep(file) == (HEADER, store.records)
    # JSON, line by line
    assert len([json.loads(line) for line in file.read_text().splitlines()]) == 3


@pytest.mark.parametrize("torn", [1, 40])
def test_a_torn_last_line_is_written_over(tmp_path: Path, torn: int) -> None:
    file = tmp_path / "sweep.jsonl"
    store = SweepStore(file, HEADER)
    for value in ("1 ms", "2 ms"):
        store.add(record(value))
    file.write_bytes(file.read_bytes()[:-torn])
    again = SweepStore(file, HEADER)
    assert again.records == [record("1 ms")]
    again.add(record("3 ms"))
    assert SweepStore(file, HEADER).records == [record("1 ms"), record("3 ms")]


def test_a_file_of_another_sweep_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "sweep.jsonl"
    SweepStore(file, HEADER)
    with pytest.raises(EvsError, match=r"of another sweep \(pixels 8 there, 9 here\): give anoth"):
        SweepStore(file, SweepHeader({"pixels": 9, "seed": 0}, {}))
    other = tmp_path / "other.jsonl"
    for text in ("hello\n", '{"a": 1}\n', "[]\n", "\n"):
        other.write_text(text)
        with pytest.raises(EvsError, match="is no file of a sweep"):
            SweepStore(other, HEADER)
        assert other.read_text() == text
    bad = file.read_text() + '{"scene": 1}\n'
    file.write_text(bad)
    with pytest.raises(EvsError, match="line 2: no record of a sweep"):
        SweepStore(file, HEADER)


def test_records_of_two_versions_do_not_stand_in_one_file(tmp_path: Path) -> None:
    def header(evs: str, numpy: str = "2") -> SweepHeader:
        return SweepHeader(
            HEADER.settings, {"versions": {"evs": evs, "mujoco": "4", "numpy": numpy}}
        )

    file = tmp_path / "sweep.jsonl"
    SweepStore(file, header("1.0"))
    SweepStore(file, header("1.0", numpy="3"))
    with pytest.raises(EvsError, match=r"another sweep \(evs 1\.0 there, 1\.1 here\)"):
        SweepStore(file, header("1.1"))


def test_a_store_on_a_full_disk_says_so() -> None:
    with pytest.raises(EvsError, match=r"cannot write ./dev/full"):
        SweepStore(Path("/dev/full/sweep.jsonl"), HEADER)


def test_timings_of_two_machines_do_not_stand_in_one_file(tmp_path: Path) -> None:
    file = tmp_path / "sweep.jsonl"
    store = SweepStore(file, HEADER)
    store.add(record("1 ms", error=Accuracy(*[0.5] * 10)))
    # errors may be of any machine
    store.begin_timings({"machine": "two"})
    assert SweepStore(file, HEADER).header.about == {"machine": "two"}
    assert SweepStore(file, HEADER).records == store.records
    one = ConfidenceInterval(1.0, 1.0, 1.0, 6)
    store.add(record("1 ms", speed=Speed(one, one, one, {}, 1.0, 1)))
    store.begin_timings({"machine": "two"})
    with pytest.raises(EvsError, match=r"another machine \(two; here: one\): give another --json"):
        store.begin_timings({"machine": "one"})


def test_points_that_this_machine_cannot_draw_are_told_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def missing() -> None:
        raise EvsError("the raster renderer needs pyrender")

    monkeypatch.setattr(sweep_module, "_draw_once", missing)
    told: list[str] = []
    points = [
        SweepPoint("fast"),
        sweep_point("fast", "renderer", "raster 4", {"render.renderer": "raster", "render.spp": 4}),
        sweep_point("fast", "renderer", "raster 1", {"render.renderer": "raster", "render.spp": 1}),
    ]
    assert sweep_module.feasible(points, told.append) == points[:1]
    assert told == ["fast, renderer raster 4 is left out: the raster renderer needs pyrender"]


def test_motions_are_those_of_the_evaluation() -> None:
    from evs_lab.evaluation.clip import MOTIONS

    assert CAMERAS == MOTIONS


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.jsonl")
    with not_waited_for(), pytest.raises(EvsError, match="pipe or a device"):
        read_sweep(tmp_path / "a.jsonl")
