"""`evs convert IN OUT`: a recording into another format, or a film into events."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from evs.launch.support.options import (
    add_pipeline_options,
    add_reading_options,
    parse_pipeline,
    reading_options,
)
from evs.launch.support.reinvoke import command
from evs.msgs import EvsError

if TYPE_CHECKING:
    from evs.drivers.files.formats import ReadOptions

EPILOG = """\
examples:
  evs convert run.aedat4 run.csv
  evs convert run.aedat4 run.aedat --events-only     drop frames and IMU, which .aedat cannot hold
  evs convert davis.aedat run.aedat4 --compression zstd
  evs convert film.mp4 run.aedat4 --sensor davis346 sensor.pos_thres=0.3
  evs convert frames/ run.aedat4 --fps 1000          PNG, JPEG, TIFF or EXR, in the order of names

If IN is a recording, OUT appears when it is complete. If OUT cannot hold all data of IN, the
command stops before it writes anything. If IN is a film, OUT grows with it: after Ctrl-C it holds
all events so far, and OUT.report.json describes the run.

evs does not know what moved between two frames of a film: the light of each pixel changes in a
straight line. --substeps makes the lines finer for slow pixels, but invents no motion. For that,
give frames from an interpolator that follows motion, as a folder with --fps.

keys of films: sensor.KEY and model.KEY as in `evs emulate`, name, and
{film_keys}
formats:
"""

OPTIONS = {
    "fps": ("film.fps", "HZ", "films: frames per second, not the film's own times"),
    "slowdown": ("film.slowdown", "N", "films: how many times slower than reality they run"),
    "substeps": ("film.substeps", "N", "films: steps from frame to frame; no motion is invented"),
    "between": ("film.between", "LINE", "films: what changes linearly in substeps: log or linear"),
    "unit": (
        "film.unit",
        "UNIT",
        "light of films: auto, srgb, luminance, dn or lux; time of tables: s, ms, us or ns",
    ),
    "fit": ("film.fit", "WAY", "films: crop, stretch or exact"),
    "crop": ("film.crop", "X,Y,W,H", "films: the part to take, px"),
    "sensor": ("sensor.preset", "NAME", "films: sensor preset"),
    "model": ("model.name", "NAME", "films: event model"),
    "seed": ("seed", "N", "films: random seed"),
    "threads": ("threads", "N", "films: worker threads; 0: one per core"),
}
"""option -> (the key it is short for, placeholder, one line). Only films have them."""

_RECORDINGS_ONLY = {
    "events_only": "--events-only",
    "single": "--single",
    "columns": "--columns",
    "stream": "--stream",
    "chip": "--chip",
    "start": "--start",
}


STOPPED = {"interrupted": 130, "terminated": 143}
"""how a run ended -> exit code, as shells count signals"""

_STEPS = 1000
"""of the progress bar"""


def configure(parser: argparse.ArgumentParser) -> None:
    """The command line of `evs convert`."""
    from evs.msgs.codecs import PAYLOADS

    names = ", ".join(f"{name} ({codec.about})" for name, codec in PAYLOADS.items())
    parser.add_argument("source", metavar="IN", help="a recording, a film or a folder of frames")
    parser.add_argument(
        "target", metavar="OUT", help="the file to write; its extension selects the format"
    )
    parser.add_argument(
        "--format", metavar="NAME", help="the format, if the ending does not select it"
    )
    parser.add_argument(
        "--compression", metavar="NAME", help="lz4, zstd or none, for formats with compression"
    )
    parser.add_argument(
        "--encoding",
        metavar="NAME",
        help=f"encoding in ROS bags: {names} or dvs (dvs_msgs)",
    )
    parser.add_argument(
        "--events-only",
        action="store_true",
        help="leave out frames, IMU, triggers and labels that OUT cannot hold",
    )
    parser.add_argument(
        "--start",
        choices=("shift", "keep"),
        help="if OUT cannot hold the stamps (Unix time): shift (default): start its clock at the "
        "first stamp and record the offset in its header; keep: stop with an error",
    )
    parser.add_argument("--force", action="store_true", help="replace OUT if it exists")
    add_reading_options(parser, unit=False)
    parser.add_argument(
        "--quiet", action="store_true", help="print nothing but warnings and errors"
    )
    add_pipeline_options(parser, OPTIONS, ("key=value", "keys of films, as sensor.pos_thres=0.3"))


def epilog() -> str:
    """What help says below the options."""
    return EPILOG.replace("{film_keys}", _film_keys()) + "\n".join(_formats())


def run(args: argparse.Namespace) -> int:
    """Convert, and print a summary."""
    from evs.drivers.files import to_write
    from evs.drivers.files.paths import check_new
    from evs.drivers.films.source import is_film

    wanted = {"compression": args.compression, "encoding": args.encoding}
    options = {key: value for key, value in wanted.items() if value is not None}
    to_write(args.target, args.format)
    if not args.force:
        check_new([args.target])
    film = is_film(args.source)
    reading = reading_options(args)
    if not film:
        args.unit = None
    stray, overrides = parse_pipeline(args, OPTIONS)
    if stray is not None:
        raise EvsError(f"'{stray}' is not key=value, as in sensor.pos_thres=0.3")
    if film:
        return _film(args, options, overrides)
    if overrides:
        raise EvsError(
            f"{overrides[0][0]} is for films and folders of frames; '{args.source}' is a recording"
        )
    return _recording(args, options, reading)


def _film(
    args: argparse.Namespace, options: dict[str, str], overrides: list[tuple[str, str]]
) -> int:
    """Turn a film into events."""
    from evs.drivers.files import recorder_for, to_write
    from evs.drivers.films.config import load_film_config
    from evs.drivers.films.run import check_holds, emulate_film
    from evs.drivers.run.report import check_targets, report_beside
    from evs.launch.support import terminal
    from evs.launch.support.report_writer import ReportWriter

    for attribute, option in _RECORDINGS_ONLY.items():
        if getattr(args, attribute):
            raise EvsError(f"{option} is for recordings; '{args.source}' is a film")
    config = load_film_config(overrides)
    kind = to_write(args.target, args.format)
    check_holds(config, args.target, kind)
    report_file = report_beside(args.target)
    check_targets([report_file])
    sink = recorder_for(args.target, kind=kind.name, **options)
    write_reports = ReportWriter([report_file])
    with terminal.bar("converting", _STEPS, args.quiet) as moved:
        report = emulate_film(
            args.source,
            [sink],
            config,
            progress=_step_by_step(moved, _STEPS),
            warn=terminal.warn,
            on_report=write_reports,
        )
    view = str(Path(args.target).with_suffix(".gif"))
    next_commands = [command("info", args.target), command("view", args.target, "-o", view)]
    terminal.summary(report, args.quiet, next_commands)
    stopped = any(sink.get("error") for sink in report.sinks)
    return STOPPED.get(report.ended.split()[0], 2 if stopped or write_reports.failures else 0)


def _recording(args: argparse.Namespace, options: dict[str, str], reading: ReadOptions) -> int:
    """Write a recording in another format."""
    from evs.drivers.files import convert
    from evs.launch.support import terminal

    with terminal.bar("converting", _STEPS, args.quiet) as moved:
        done = convert(
            args.source,
            args.target,
            args.format,
            events_only=args.events_only,
            reading=reading,
            keep_start=args.start == "keep",
            progress=_step_by_step(moved, _STEPS),
            **options,
        )
    if args.quiet:
        return 0
    counts = [("events", done.events), ("frames", done.frames)]
    counts += [("IMU samples", done.imu_samples), ("triggers", done.triggers)]
    counted = ", ".join(f"{count:,} {what}" for what, count in counts if count or what == "events")
    several = f" in {len(done.files)} files" if len(done.files) > 1 else ""
    print(f"{args.target}: {counted}, {done.size / 1e6:.2f} MB{several}")
    if done.read_as:
        print(f"read as: {done.read_as}")
    if done.start_us is not None:
        print(f"start: its clock begins at {done.start_us} us; its header holds this offset")
    if done.left_out:
        left = ", ".join(f"{count:,} {what}" for what, count in done.left_out.items())
        print(f"left out: {left}")
    print(f"next:\n  {command('info', args.target)}")
    return 0


def _step_by_step(moved: Callable[[int, str], None], steps: int) -> Callable[[float], None]:
    """A callback that moves a bar by a share, only when it reaches another step."""
    shown = -1

    def move(share: float) -> None:
        nonlocal shown
        step = int(steps * share)
        if step != shown:
            moved(step, "")
            shown = step

    return move


def _film_keys() -> str:
    """The keys of [film], a line or two each."""
    from evs.drivers.films.config import FilmConfig
    from evs.drivers.run.config_reference import describe

    (table,) = describe(FilmConfig)
    lines = []
    for key in table.keys:
        lines.append(f"  film.{key.name}={key.default}")
        lines += textwrap.wrap(key.doc, 92, initial_indent=" " * 6, subsequent_indent=" " * 6)
    return "\n".join(lines) + "\n"


def _formats() -> list[str]:
    """What there is, a line or two each."""
    from evs.drivers.files import FORMATS

    lines = []
    for one in FORMATS:
        holds = one.capabilities
        facts = [name for name in ("frames", "imu", "triggers", "labels") if getattr(holds, name)]
        facts += [f"{holds.width} x {holds.height} px at most"] if holds.height < 1 << 15 else []
        facts += [f"stamps from {holds.first_us} us"] if holds.first_us >= 0 else []
        facts += [f"extra {one.extra}"] if one.extra else []
        facts = facts if one.recorder else ["read only"]
        ends = ", ".join(one.suffixes + tuple(f"({also})" for also in one.shared_suffixes))
        description = one.title + (f" ({', '.join(facts)})" if facts else "")
        lead = f"  {one.name:10s} {ends:18s} "
        lines += textwrap.wrap(
            description, 100, initial_indent=lead, subsequent_indent=" " * len(lead)
        )
    return lines
