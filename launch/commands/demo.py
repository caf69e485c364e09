"""`evs demo`: the whole pipeline from end to end, and a check that nothing was lost."""

from __future__ import annotations

import argparse
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evs.drivers.run import config as pipeline
from evs.drivers.sink_config import Aedat4Sink, ZmqSink
from evs.emulator.config import decoding
from evs.launch.commands.emulate import STOPPED
from evs.launch.support.reinvoke import program
from evs.msgs import DEFAULT_ADDRESS, EvsError

if TYPE_CHECKING:
    from evs.drivers.files.reading import Recording
    from evs.drivers.pictures import LightLog
    from evs.drivers.run.report import Report
    from evs.tools.doctor.audit import AuditedReport

MAX_SECONDS = 20.0
"""The light of every frame is kept in memory for the pictures, and the GIF grows with it."""

FAST = (("render.renderer", "direct"),)
"""what --fast sets: hard light"""

WINDOW_US = 4000
"""duration of the events in the pictures, short for thin edges"""

SUBSCRIBER_S = 30.0
"""how long the second process may take to connect"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.usage = "evs demo [--out FOLDER] [--duration S] [--fast] [key=value ...]"
    parser.epilog = (
        "Writes events.aedat4, report.json, preview.png and events.gif. Exit code 1 if a packet\n"
        "was lost or the recording does not read back. Keys are those of `evs emulate --help`."
    )
    parser.add_argument("words", nargs="*", metavar="key=value", help="any key of the pipeline")
    parser.add_argument("--out", metavar="FOLDER", default="out/demo", help="default: %(default)s")
    parser.add_argument("--duration", metavar="S", help="simulated seconds; short for duration_s=")
    parser.add_argument(
        "--fast",
        action="store_true",
        help="direct light, without soft shadows or bounces",
    )


def run(args: argparse.Namespace) -> int:
    """Run, verify, draw, sum up. 0 if nothing was lost, 1 if something was, 130 after Ctrl-C."""
    # here, so that --help is quick
    from evs.drivers import files
    from evs.drivers.run.report import COMPLETE, write_report
    from evs.tools.doctor.audit import audited

    out = Path(args.out)
    recording, target = out / "events.aedat4", out / "report.json"
    config = _config(args, recording)
    _make_folder(out)
    report, light, counted = _emulate(config, target)
    if report.ended != COMPLETE:
        print(f"evs: the demo was {report.ended}; {recording} is whole", file=sys.stderr)
        return STOPPED.get(report.ended.split()[0], 1)
    events = files.read(recording)
    audit_report = audited(report, counted, {"file": str(recording), "events": len(events)})
    write_report(audit_report, target)
    pictures = _draw(events, light, config, out)
    _sum_up(audit_report, [recording, target, *pictures])
    for line in audit_report.faults:
        print(f"evs: the demo failed: {line}", file=sys.stderr)
    return 1 if audit_report.faults else 0


def _config(args: argparse.Namespace, recording: Path) -> pipeline.PipelineConfig:
    from evs.drivers.bus.address import free_address

    overrides = [decoding.split_word(word) for word in args.words]
    if args.duration is not None:
        overrides.append(("duration_s", args.duration))
    keys = [key for key, _ in overrides]
    if args.fast:
        overrides += [(key, text) for key, text in FAST if key not in keys]
    config = pipeline.load("demo", overrides)
    if config.duration_s > MAX_SECONDS:
        raise EvsError(
            f"the demo draws {MAX_SECONDS:g} s at most, not {config.duration_s:g} s: "
            "give a smaller --duration, or use evs emulate"
        )
    bus = ZmqSink(address=free_address(), wait_for=1, wait_s=SUBSCRIBER_S)
    file = Aedat4Sink(file=str(recording), overwrite=True)
    return replace(config, sink=(bus, file), record="", publish="", report="")


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as reason:
        raise EvsError(f"cannot make the folder {out}: {reason.strerror}; choose --out") from None


def _emulate(
    config: pipeline.PipelineConfig, target: Path
) -> tuple[Report, LightLog, dict[str, Any]]:
    """Run, with a second process that counts: (report, the light seen, its counts).

    However the run ends, its report is written to `target`.
    """
    from evs.drivers.clock import Pacer, StopWatch
    from evs.drivers.pictures import LightLog
    from evs.drivers.run.report import COMPLETE, write_report
    from evs.drivers.run.run import depth_of, tick_count
    from evs.drivers.run.run import run as run_loop
    from evs.emulator.simulation.pipelined import pipelined
    from evs.emulator.simulation.world import World
    from evs.launch.support import terminal
    from evs.tools.doctor.audit import Counter

    watch = StopWatch()
    light = LightLog.for_clip(config.scene.tick_us, lambda world: world.cameras[0].luminance)
    ticks = tick_count(config.duration_s, config.scene.tick_us)
    tables = config.sinks()
    whole = World.from_config(config, meter=watch)
    with (
        Counter(str(tables[0].address)) as counter,
        pipelined(whole, ticks, watch, depth_of(config)) as world,
        terminal.progress(ticks) as moved,
    ):
        report = run_loop(
            world,
            [pipeline.make_sink(table) for table in tables],
            config.duration_s,
            watch,
            Pacer(pipeline.PACES[config.pace], catch_up_s=config.realtime.catch_up_s),
            moved,
            [light],
            warn=terminal.warn,
            on_report=lambda report: write_report(report, target),
            config=decoding.to_plain(config),
        )
        counted = counter.totals() if report.ended == COMPLETE else {}
    return report, light, counted


def _draw(
    events: Recording, light: LightLog, config: pipeline.PipelineConfig, out: Path
) -> list[Path]:
    """The preview and the film."""
    from evs.drivers.pictures import (
        Playback,
        Shot,
        clip_frames,
        events_between,
        preview,
        write_gif,
        write_png,
    )

    stream = events.stream
    size = stream.width, stream.height
    shots = [
        Shot(t, WINDOW_US, events_between(events, t - WINDOW_US, t), light.at(t))
        for t in light.spread(3)
    ]
    title = f"{Path(config.scene.file).name} seen by {stream.sensor}"
    write_png(out / "preview.png", preview(shots, *size, title))
    playback = Playback(0, round(1e6 * config.duration_s), window_us=WINDOW_US)
    frames = clip_frames(events, *size, playback, background=light.at)
    write_gif(out / "events.gif", frames, playback)
    return [out / "preview.png", out / "events.gif"]


def _sum_up(report: AuditedReport, files: list[Path]) -> None:
    from evs.launch.support import terminal

    terminal.summary(report)
    subscriber = report.subscriber
    print(
        f"{'second process':17s} {subscriber['packets']:,} packets and "
        f"{subscriber['events']:,} events received, {subscriber['lost']:,} lost"
    )
    print(f"{'read back':17s} {report.recording['events']:,} events")
    for file in files:
        print(f"{'wrote':17s} {file} ({file.stat().st_size / 1e3:,.0f} kB)")
    print("next:")
    for command in next_commands(files[0], program()):
        print(f"  {command}")


def next_commands(recording: Path, program: str) -> list[str]:
    """What to try after the demo; each works as it stands."""
    file, folder = shlex.quote(str(recording)), recording.parent
    film, other = (shlex.quote(str(folder / name)) for name in ("slow.gif", "cart.aedat4"))
    robot = "evs:config/scenes/cartpole.xml scene.control=random"
    address = DEFAULT_ADDRESS
    return [
        f"{program} view {file} -o {film} --speed 0.1",
        f"{program} info {file}",
        f"{program} echo {address} --hz & {program} emulate demo --publish {address}",
        f"{program} emulate {robot} --record {other} --force  # or your own robot's file",
    ]
