"""What `evs demo` is made of: the audit, the light log, its words; without running it."""

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers.pictures import LightLog
from evs.drivers.run.config import load
from evs.drivers.run.report import Report
from evs.emulator import World
from evs.launch.commands import demo
from evs.launch.main import main
from evs.launch.support import reinvoke
from evs.msgs.pictures import to_srgb8
from evs.tools.doctor.audit import audit, audited

GOOD = Report(
    packets=20,
    events=500,
    sinks=[{"type": "zmq", "packets_sent": 20, "events_sent": 500}, {"type": "aedat4"}],
)
HEARD = {"packets": 20, "events": 500, "lost": 0, "ended": True}
KEPT = {"file": "events.aedat4", "events": 500}


def test_nothing_lost_is_no_fault() -> None:
    assert audit(GOOD, HEARD, KEPT) == []


@pytest.mark.parametrize(
    ("report", "heard", "kept", "fault"),
    [
        ({"ended": "interrupted at 0.1 s"}, {}, {}, "did not end by itself: interrupted at 0.1 s"),
        ({}, {"packets": 19}, {}, "20 packets were made, but 19 received by the subscriber"),
        ({}, {"events": 499}, {}, "500 events were made, but 499 received by the subscriber"),
        ({}, {"lost": 1}, {}, "the subscriber lost 1 packets"),
        ({}, {"ended": False}, {}, "never heard that the stream ended"),
        ({}, {}, {"events": 501}, "500 events were made, but 501 read back from events.aedat4"),
        (
            {"sinks": [{"type": "zmq", "packets_sent": 20, "events_sent": 7}]},
            {},
            {},
            "500 events were made, but 7 sent",
        ),
        (
            {"sinks": [{"type": "zmq", "packets_sent": 7, "events_sent": 500}]},
            {},
            {},
            "20 packets were made, but 7 sent",
        ),
    ],
)
def test_each_loss_is_one_fault(
    report: dict[str, Any], heard: dict[str, Any], kept: dict[str, Any], fault: str
) -> None:
    found = audit(replace(GOOD, **report), HEARD | heard, KEPT | kept)
    assert len(found) == 1
    assert fault in found[0]


def test_a_demo_without_events_or_sinks_or_counts_is_no_success() -> None:
    assert "the sensor made no events" in audit(Report(), {"ended": True}, {"events": 0})
    assert len(audit(replace(GOOD, sinks=[]), HEARD, KEPT)) == 2
    assert audit(GOOD, {}, {}) != []


def test_the_report_tells_all() -> None:
    told = json.loads(audited(GOOD, HEARD | {"lost": 3}, KEPT).to_json())
    assert told["packets"] == 20
    assert told["subscriber"]["lost"] == 3
    assert told["recording"] == KEPT
    assert told["faults"] == ["the subscriber lost 3 packets"]


# the light log


def log_of(ticks: int, every: int) -> LightLog:
    """A run of 1 ms ticks in which the light of a 1 x 2 sensor grows."""
    log = LightLog(every, lambda world: world.light)
    for tick in range(1, ticks + 1):
        light = np.array([[tick / 100, 0.0]], np.float32)
        log(tick, argparse.Namespace(t_us=1000 * tick, light=light), ())
    return log


def test_the_first_and_every_tenth_tick_is_kept() -> None:
    log = log_of(35, 10)
    assert log.times_us == [1000, 10_000, 20_000, 30_000]


def test_one_exposure_holds_for_all() -> None:
    log = log_of(20, 10)
    # the first picture's bright part, 0.01, was exposed to 0.8
    for picture, tick in zip(log.pictures, (1, 10, 20), strict=True):
        wanted = to_srgb8(np.array([[tick / 100, 0.0]], np.float32), 80.0)
        np.testing.assert_allclose(picture.astype(int), wanted.astype(int), atol=1)


def test_the_latest_picture_not_after_a_time() -> None:
    log = log_of(30, 10)
    for t_us, place in ((0, 0), (1000, 0), (9999, 0), (10_000, 1), (29_999, 2), (10**9, 3)):
        assert log.at(t_us) is log.pictures[place]
    assert LightLog(10, lambda world: world).at(0) is None


def test_spread_takes_quarters_and_never_one_twice() -> None:
    assert log_of(2000, 10).spread(3) == [500_000, 1_000_000, 1_500_000]
    assert log_of(5, 10).spread(3) == [1000]
    assert log_of(10, 10).spread(3) == [1000, 10_000]
    assert LightLog(10, lambda world: world).spread(3) == []


@pytest.mark.parametrize(("tick_us", "kept"), [(1000, 10), (250, 40), (50_000, 1)])
def test_a_picture_for_every_frame_of_the_film(tick_us: int, kept: int) -> None:
    log = LightLog.for_clip(tick_us, lambda world: np.zeros((1, 1), np.float32))
    for tick in range(1, 2 * kept + 1):
        log(tick, argparse.Namespace(t_us=tick * tick_us), ())
    assert log.times_us[-2:] == [kept * tick_us, 2 * kept * tick_us]


# the words


def test_its_scene_comes_with_evs_and_needs_no_other_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # what `make demo` does not install is not there
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.setitem(sys.modules, "dm_control", None)
    given = argparse.Namespace(words=[], duration=None, fast=False)
    config = demo._config(given, tmp_path / "events.aedat4")
    world = World(config.scene)
    start = world.data.qpos.copy()
    for _ in range(1000):
        world.step()
    # every joint moves; a state that breaks down would have raised an error
    assert np.isfinite(world.data.qpos).all()
    assert np.abs(world.data.qpos - start).min() > 1e-4
    # it stays in the picture, on its feet
    assert -1.2 < world.data.body("pelvis").xpos[0] < 1.2
    assert world.data.body("pelvis").xpos[2] > 0.7


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--duration", "21"], "draws 20 s at most, not 21 s"),
        (["--duration", "soon"], "duration_s"),
        (["--duration", "-1"], "duration_s"),
        (["sensor.preset=davis"], "no sensor"),
        (["render.sp=4"], "spp"),
        (["--nonsense"], "--nonsense"),
    ],
)
def test_bad_words_are_one_line(
    tmp_path: Path, words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", "--out", str(tmp_path / "demo"), *words]) == 2
    said = capsys.readouterr()
    assert message in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""


def test_a_folder_that_cannot_be_made_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["demo", "--out", str(tmp_path / "file" / "demo")]) == 2
    assert "choose --out" in capsys.readouterr().err


def test_fast_gives_way_to_what_is_said() -> None:
    given = argparse.Namespace(words=["render.spp=9"], duration=None, fast=True)
    config = demo._config(given, Path("events.aedat4"))
    assert (config.render.spp, config.render.renderer, config.model.name) == (9, "direct", "plain")
    given = argparse.Namespace(words=["model.name=adaptive"], duration="2", fast=True)
    config = demo._config(given, Path("events.aedat4"))
    assert (config.model.name, config.render.renderer) == ("adaptive", "direct")
    assert config.duration_s == 2.0


def test_the_demo_has_the_light_and_pixels_of_balanced() -> None:
    given = argparse.Namespace(words=[], duration=None, fast=False)
    config = demo._config(given, Path("events.aedat4"))
    balanced = load("balanced", [("scene.file", "robot.xml")])
    assert (config.render, config.model) == (balanced.render, balanced.model)
    assert (config.render.renderer, config.render.samples) == ("hybrid", 4)


def test_next_commands_quote_what_a_shell_would_split() -> None:
    commands = demo.next_commands(Path("my demo/events.aedat4"), "evs")
    assert commands[0].startswith("evs view 'my demo/events.aedat4' -o 'my demo/slow.gif'")
    assert [command.split()[1] for command in commands] == ["view", "info", "echo", "emulate"]


def test_the_program_is_called_as_it_was(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = tmp_path / "evs"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.setattr("sys.argv", [str(program)])
    monkeypatch.delenv("UV", raising=False)
    monkeypatch.setenv("PATH", "")
    assert reinvoke.program() == str(program)
    assert reinvoke.command("info", "my run.npz") == f"{program} info 'my run.npz'"
    monkeypatch.setenv("PATH", str(tmp_path))
    assert reinvoke.program() == "evs"
    monkeypatch.setenv("UV", "/usr/bin/uv")
    assert reinvoke.program() == str(program)
    monkeypatch.setattr("sys.argv", ["main.py"])
    assert reinvoke.program().endswith("-m evs")
