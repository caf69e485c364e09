"""Errors and speeds of a sweep on one small scene, and `evs sweep` end to end."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evs.drivers.run.config import PipelineConfig
from evs.emulator.base.scene import F32
from evs.emulator.config import ModelConfig, RenderConfig
from evs.emulator.render import make_renderer
from evs.launch.main import main
from evs.msgs import EvsError, join_events
from evs_lab.evaluation import models
from evs_lab.evaluation.clip import MOTIONS, SIZE, make_clip
from evs_lab.evaluation.light_cache import LightCache
from evs_lab.evaluation.scenes import SceneSetup, scene_setup
from evs_lab.sweep import axes
from evs_lab.sweep.clip_renderer import ClipRenderer
from evs_lab.sweep.errors import ErrorMeter, ErrorSettings
from evs_lab.sweep.frame_methods import frame_method
from evs_lab.sweep.pareto_front import unmatched
from evs_lab.sweep.pixels import events_of
from evs_lab.sweep.points import SweepPoint, preset_of, sweep_point
from evs_lab.sweep.record import STAGES, SweepRecord
from evs_lab.sweep.store import read_sweep
from evs_lab.sweep.sweep_world import SweepWorld
from reference.judged import written

TINY = ErrorSettings(pixels=160, ticks=60, reference_spp=1024)
SMALL: list[str] = ["--pixels", "40", "--ticks", "30", "--reference-spp", "16", "--seconds", "0.02"]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> LightCache:
    return LightCache(tmp_path_factory.mktemp("light"))


@pytest.fixture(scope="module")
def error_meter(scene: Path, cache: LightCache) -> ErrorMeter:
    return ErrorMeter(scene_setup(str(scene)), "pan", TINY, cache)


def sweep_of(scene: Path, folder: Path, *words: str) -> tuple[list[str], Path]:
    """A command for errors alone, and the file of its records."""
    file = folder / "all.jsonl"
    where = ["--cache", str(folder), "--json", str(file)]
    base = ["sweep", str(scene), "--preset", "fast", "--camera", "still"]
    return [*base, *SMALL, *where, "--errors-only", "--quiet", *words], file


def on_axis(preset: str, axis: str) -> dict[str, SweepPoint]:
    return {p.value: p for p in axes.points([preset], [axis])}


# errors


def test_more_light_is_nearer_to_converged_light(error_meter: ErrorMeter) -> None:
    fast, balanced, reference = (
        error_meter.error(SweepPoint(name)) for name in ("fast", "balanced", "reference")
    )
    assert reference.emd < balanced.emd
    assert reference.emd < fast.emd
    assert reference.recall > fast.recall
    assert unmatched(reference.recall, reference.precision) < unmatched(
        balanced.recall, balanced.precision
    )
    # the reference tells them apart
    assert reference.emd_reference < fast.emd / 2
    assert reference.emd_reference > 0.0
    assert reference.recall_reference < 1.0


def test_fresh_noise_is_worse_than_fixed(error_meter: ErrorMeter) -> None:
    four: dict[str, str | int] = {"render.renderer": "path", "render.spp": 4, "model.name": "plain"}
    fixed, fresh = (
        error_meter.error(sweep_point("reference", "s", seeds, {**four, "render.seeds": seeds}))
        for seeds in ("fixed", "fresh")
    )
    assert fresh.emd > 3 * fixed.emd
    assert fresh.spurious_hz > 3 * fixed.spurious_hz
    assert fresh.count_ratio_on > fixed.count_ratio_on


def test_what_changes_no_byte_changes_no_error(error_meter: ErrorMeter) -> None:
    base = error_meter.error(SweepPoint("fast"))
    for axis in ("threads", "incremental"):
        for point in on_axis("fast", axis).values():
            assert error_meter.error(point) == base
    one, eight = (on_axis("balanced", "chunk")[f"{n}"] for n in ("1 tick", "8 ticks"))
    assert error_meter.error(one) == error_meter.error(eight)


def test_ticks_and_frames_are_laid_beside_the_same_reference(error_meter: ErrorMeter) -> None:
    # frames are lit by path, where the preset is hybrid
    by_path = {"model.name": "plain", "render.renderer": "path", "render.seeds": "fixed"}
    plain = error_meter.error(sweep_point("accurate", "s", "p", by_path))
    ticks = {v: error_meter.error(p) for v, p in on_axis("fast", "tick").items()}
    ways = {v: error_meter.error(p) for v, p in on_axis("accurate", "frames").items()}
    # a picture every ms is what a tick of a ms sees
    assert ways["ESIM, 1000 FPS"] == plain == ways["v2e, 1000 FPS"]
    few, more = ways["ESIM, 60 FPS"], ways["ESIM, 250 FPS"]
    assert few.recall < more.recall
    # 250 frames a second find nearly every event, but not its time
    assert few.emd > more.emd > 1.2 * plain.emd
    assert few.timing_ms > more.timing_ms > 3 * plain.timing_ms
    assert ways["v2e, 1000 FPS, 8 bit sRGB"].count_ratio_on < 0.6 * plain.count_ratio_on
    own = plain.emd_reference
    assert {error.emd_reference for error in (*ticks.values(), *ways.values())} == {own}
    assert ticks["10 ms"].recall < ticks["0.5 ms"].recall


def test_another_size_and_another_low_pass_have_references_of_their_own(
    error_meter: ErrorMeter,
) -> None:
    base = error_meter.error(SweepPoint("fast"))
    small = error_meter.error(on_axis("fast", "resolution")["173 x 130"])
    assert small.emd_reference != base.emd_reference
    filters = {v.split()[0]: p for v, p in on_axis("fast", "precision").items() if v}
    exact, euler = (error_meter.error(filters[name]) for name in ("exact", "euler"))
    assert exact.emd_reference == euler.emd_reference != base.emd_reference
    assert exact != euler


def test_light_is_traced_once(scene: Path, error_meter: ErrorMeter, cache: LightCache) -> None:
    before = error_meter.error(SweepPoint("balanced"))
    misses, hits = cache.misses, cache.hits
    again = ErrorMeter(scene_setup(str(scene)), "pan", TINY, cache, threads=1)
    assert again.error(SweepPoint("balanced")) == before
    assert cache.misses == misses
    assert cache.hits > hits


def test_cached_light_of_longer_ticks_is_traced_anew(scene: Path, tmp_path: Path) -> None:
    """It follows from the ticks before, so that of every instant is no part of it."""
    clip = make_clip(scene_setup(str(scene)), "pan", 40, sampled=160, patch_px=4, size=(64, 48))
    render = RenderConfig(renderer="hybrid", spp=1)
    renderer = ClipRenderer(clip, LightCache(tmp_path / "one"), 1)
    every, fourth = renderer.at(render, range(40)), renderer.at(render, range(0, 40, 4))
    assert np.array_equal(
        fourth, ClipRenderer(clip, LightCache(tmp_path / "two"), 1).at(render, range(0, 40, 4))
    )
    assert not np.array_equal(fourth, every[::4])


def test_a_network_is_for_ticks_of_a_ms(error_meter: ErrorMeter) -> None:
    point = sweep_point("balanced", "s", "v", {"model.name": "evsnet", "scene.tick_us": 500})
    with pytest.raises(EvsError, match="networks are for ticks of 1000 us, not 500"):
        error_meter.error(point)


@pytest.mark.slow
def test_pictures_of_opengl_have_an_error_too(error_meter: ErrorMeter) -> None:
    raster, direct = (
        error_meter.error(
            sweep_point("fast", "renderer", name, {"render.renderer": name, "render.spp": 4})
        )
        for name in ("raster", "direct")
    )
    # the same hard light but for shadows, so events come at the same edges
    assert raster.recall > 0.5 * direct.recall
    assert 0.5 < raster.count_ratio_on / direct.count_ratio_on < 2.0
    assert raster.emd_reference == direct.emd_reference


# the world that is timed


def pictures(setup: SceneSetup, motion: str, config: PipelineConfig, ticks: int) -> list[F32]:
    """What the film of errors shows at the same ticks, whole."""
    clip = make_clip(setup, motion, ticks, sampled=9, patch_px=8, tick_us=config.scene.tick_us)
    render = replace(config.render, bounces=setup.bounces)
    renderer = make_renderer(clip.scene, clip.camera, render, 1)
    return [renderer.render(*shot).copy() for shot in clip.instants]


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_timed_world_shows_what_errors_see(scene: Path, motion: str) -> None:
    setup, config = scene_setup(str(scene)), preset_of("fast")
    world = SweepWorld(setup, motion, config)
    wanted = pictures(setup, motion, config, 4)
    for picture in wanted[1:]:
        world.step()
        assert np.array_equal(world.cameras[0].luminance, picture)
    assert not np.array_equal(wanted[0], wanted[-1])


def test_a_camera_of_frames_gives_the_events_of_its_way(scene: Path) -> None:
    setup, method, base = scene_setup(str(scene)), frame_method("v2e, 250 FPS"), preset_of("fast")
    config = replace(base, scene=replace(base.scene, tick_us=4000), sensor=models.SENSOR)
    world = SweepWorld(setup, "pan", config, 0, method)
    begin_us = world.t_us
    seen = join_events([packet.events for _ in range(5) for packet in world.step()])
    rows, columns = np.mgrid[60:200, 100:250]
    y, x = rows.ravel(), columns.ravel()
    light = np.stack([picture[y, x] for picture in pictures(setup, "pan", config, 6)])
    alone = events_of(light, range(0, 24000, 4000), ModelConfig(), models.SENSOR, method)
    inside = seen[(seen["x"] >= 100) & (seen["x"] < 250) & (seen["y"] >= 60) & (seen["y"] < 200)]
    place = 150 * (inside["y"].astype(int) - 60) + inside["x"] - 100
    found = sorted(zip(inside["t"] - begin_us, place, inside["p"], strict=True))
    assert found == sorted(zip(alone["t"], alone["x"], alone["p"], strict=True))
    assert len(found) > 50
    # not bunched at frames: pictures between them carry events of their own
    assert len(np.unique(inside["t"] % 4000)) > 20


# the command


def test_a_tiny_sweep_end_to_end(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, words, page = tmp_path / "all.jsonl", tmp_path / "all.md", tmp_path / "all.png"
    line = ["sweep", str(scene), "--preset", "fast", "--axis", "threads", "--camera", "pan",
            *SMALL, "--cache", str(tmp_path / "cache"), "--json", str(file)]  # fmt: skip
    assert main([*line, "--errors-only"]) == 0
    _, found = read_sweep(file)
    assert all(one.error is not None and one.speed is None for one in found)
    assert main([*line, "--markdown", str(words), "--picture", str(page)]) == 0
    _, found = read_sweep(file)
    assert [one.value for one in found] == ["", "1 thread", "2 threads", "4 threads"]
    for one in found:
        assert one.speed is not None
        assert one.error is not None
        speed = one.speed
        assert speed.real_time_factor.n >= 3
        assert 0 < speed.real_time_factor.low <= speed.real_time_factor.median
        assert set(speed.stage_ms) == set(STAGES)
        assert 0 < speed.rays_per_tick <= SIZE[0] * SIZE[1]
        # the stages make up the tick, and a tick's wall clock is the inverse of the factor
        tick_ms = 1 / speed.real_time_factor.median
        assert 0.2 * tick_ms < sum(v.median for v in speed.stage_ms.values()) < 2 * tick_ms
        assert speed.cpu_s_per_s.median > 0
        assert speed.yardstick_ratio.median > 0
    assert "fast" in words.read_text()
    assert page.read_bytes()[:4] == b"\x89PNG"
    # nothing is left to measure: not a byte is added
    before = file.read_bytes()
    assert main([*line, "--quiet"]) == 0
    assert file.read_bytes() == before
    assert main([*line, "--repeats", "7"]) == 2
    assert "is of another sweep (repeats 6 there, 7 here)" in capsys.readouterr().err


def test_a_stopped_sweep_goes_on(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    line, file = sweep_of(scene, tmp_path, "--axis", "tick")
    measured: list[str] = []
    error = ErrorMeter.error

    def stopping(error_meter: ErrorMeter, point: SweepPoint) -> object:
        if len(measured) == 2:
            raise KeyboardInterrupt
        measured.append(point.value)
        return error(error_meter, point)

    monkeypatch.setattr(ErrorMeter, "error", stopping)
    assert main(line) == 130
    assert [one.value for one in read_sweep(file)[1]] == measured == ["", "0.25 ms"]

    def counting(error_meter: ErrorMeter, point: SweepPoint) -> object:
        measured.append(point.value)
        return error(error_meter, point)

    monkeypatch.setattr(ErrorMeter, "error", counting)
    assert main(line) == 0
    everything = ["", "0.25 ms", "0.5 ms", "2 ms", "4 ms", "10 ms"]
    assert measured == everything
    assert [one.value for one in read_sweep(file)[1]] == everything


def test_a_changed_scene_is_measured_again(scene: Path, tmp_path: Path) -> None:
    copy = tmp_path / "scene.xml"
    line, file = sweep_of(copy, tmp_path, "--axis", "incremental")
    copy.write_text(scene.read_text())
    assert main(line) == 0
    first = read_sweep(file)[1]
    copy.write_text(scene.read_text().replace('bulbradius=".2"', 'bulbradius=".4"'))
    assert main(line) == 0
    second = read_sweep(file)[1]
    assert [one.point for one in first] == [one.point for one in second]
    assert all(a.digest != b.digest for a, b in zip(first, second, strict=True))
    assert len(file.read_text().splitlines()) == 1 + 2 * len(first)


@pytest.mark.slow
def test_workers_give_the_same_errors(scene: Path, tmp_path: Path) -> None:
    found = []
    for workers in ("1", "2"):
        file = tmp_path / f"{workers}.jsonl"
        line = ["sweep", str(scene), "--preset", "fast", "--axis", "tick", *SMALL, "--quiet",
                "--errors-only", "--workers", workers, "--cache", str(tmp_path / workers),
                "--json", str(file)]  # fmt: skip
        assert main(line) == 0
        found.append({one.point: one for one in read_sweep(file)[1]})
    assert found[0] == found[1]
    assert len(found[0]) == 2 * 6


def test_a_point_that_fails_leaves_the_others(
    scene: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    error = ErrorMeter.error

    def failing(error_meter: ErrorMeter, point: SweepPoint) -> object:
        if point.value == "2 ms":
            raise EvsError("it flies apart; take another scene")
        return error(error_meter, point)

    monkeypatch.setattr(ErrorMeter, "error", failing)
    line, file = sweep_of(scene, tmp_path, "--axis", "tick")
    assert main(line) == 1
    assert [one.value for one in read_sweep(file)[1]] == ["", "0.25 ms", "0.5 ms", "4 ms", "10 ms"]
    said = capsys.readouterr().err
    assert "fast, tick 2 ms is left out: it flies apart" in said


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--preset", "swift"], "no pipeline file 'swift'"),
        (["--axis", "ticks"], "no axis 'ticks'; there is: tick"),
        (["--camera", "spin"], "no camera motion 'spin'"),
        (["--camera", ","], "--camera is empty"),
        (["--picture", "front.gif"], "end it in .png"),
        (["--errors-only", "--speed-only"], "leave nothing to do"),
        (["--repeats", "0"], "repeats is 0"),
        (["--json", "."], "a folder; give a file"),
        (["--workers", "0"], "workers is 0"),
        (["nowhere.xml"], "nowhere.xml"),
        (["gymnasium/unicorn"], "gymnasium/unicorn"),
    ],
)
def test_what_is_refused(
    words: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["sweep", "--quick", "--cache", str(tmp_path), *words]
    assert main(line) == 2
    said = capsys.readouterr().err.strip()
    assert says in said
    assert len(said.splitlines()) == 1


def test_help_names_every_axis(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["sweep", "--help"])
    told = " ".join(capsys.readouterr().out.split())
    assert f"every preset: {', '.join(axes.AXES)};" in told


def test_records_are_json(tmp_path: Path, scene: Path) -> None:
    line, file = sweep_of(scene, tmp_path, "--axis", "model")
    assert main(line) == 0
    head, *lines = file.read_text().splitlines()
    assert json.loads(head)["sweep"]["settings"]["pixels"] == 40
    found = [SweepRecord.from_json(line) for line in lines]
    assert [one.value for one in found] == ["", "adaptive", "evsnet"]
    assert dict(found[1].settings) == {"model.name": "adaptive"}
    assert all(one.error is not None and math.isfinite(one.error.emd) for one in found)


def test_a_cycle_that_is_too_late_is_refused(error_meter: ErrorMeter) -> None:
    late = {"render.renderer": "path", "render.seeds": "cycle"}
    late |= {"render.cycle_ticks": 16, "scene.tick_us": 4000}
    with pytest.raises(EvsError, match="is 30000 us late: errors are measured up to 24000 us"):
        error_meter.error(sweep_point("accurate", "s", "late", late))
