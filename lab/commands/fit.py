"""`evs fit`: a sensor file of your own camera, from its recordings."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from evs.launch.support.options import add_reading_options, reading_options
from evs.msgs import EvsError

if TYPE_CHECKING:
    from evs.drivers.files.formats import ReadOptions
    from evs_lab.fit import FittedCamera, Light, Observed

BASE = "davis346"

HEADINGS = ("key", "value", "error", "from", "")

REPLAY_HEADINGS = ("in the same light", "events", "the fitted sensor's", "ON share",
                   "the fitted sensor's", "")  # fmt: skip

EXAMPLES = """\
examples:
  evs fit --dark cap.aedat4 --ramp ramp.aedat4 --contrast 4 -o mine.toml
  evs fit --dark cap.raw --lamp lamp.raw --contrast 8 --lux 500 --base imx636 --picture fit.png
  evs fit pan.aedat4                                        what can be fitted from any recording

A key that the recordings do not determine keeps the value of --base; the output gives the reason.
All recordings must be of one camera with the same settings. lab/docs/fit.md describes how to make
them."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.usage = "evs fit [RECORDING ...] [--dark FILE] [--ramp FILE --contrast C] [options]"
    add = parser.add_argument
    add(
        "recordings",
        nargs="*",
        metavar="RECORDING",
        help="any recording: readout, refractory period; with frames also thresholds",
    )
    add("--dark", metavar="FILE", help="lens cap on: noise, leak, hot pixels")
    add("--still", metavar="FILE", help="a view in which nothing moves; needs --still-lux")
    add("--still-lux", type=float, metavar="LUX", help="illuminance of the sensor in --still")
    add(
        "--ramp",
        metavar="FILE",
        help="light whose logarithm rises and falls evenly: thresholds, mismatch",
    )
    add("--lamp", metavar="FILE", help="a blinking lamp: thresholds, mismatch, bandwidth")
    add(
        "--contrast",
        type=float,
        metavar="C",
        help="brightest light of lamp or ramp, divided by the darkest",
    )
    add(
        "--period",
        type=float,
        metavar="S",
        help="seconds from one rise to the next (default: from the events)",
    )
    add("--lux", type=float, metavar="LUX", help="illuminance of the sensor in the bright lamp")
    add(
        "--base",
        metavar="SENSOR",
        default=BASE,
        help=f"sensor that has all other values: a preset or a .toml file ({BASE})",
    )
    add_reading_options(parser, single=False)
    add("-o", "--output", metavar="FILE.toml", help="write the sensor file")
    add("--picture", metavar="FILE.png", help="draw the recordings next to the fitted sensor")
    add("--json", nargs="?", const="-", metavar="FILE", help="write all numbers; -: to stdout")
    add("--quiet", action="store_true", help="print nothing but warnings and errors")
    parser.epilog = EXAMPLES


def run(args: argparse.Namespace) -> int:
    """Fit; the exit code."""
    # here, so that --help is quick
    from evs.drivers.pictures import write_png
    from evs.drivers.pictures.chart import check_chart_file
    from evs.drivers.run.report import check_targets, write_whole
    from evs.emulator.config import SensorConfig
    from evs.emulator.sensor import resolve_sensor
    from evs.launch.support import terminal
    from evs_lab.fit import CANNOT, fit_camera, sensor_toml
    from evs_lab.fit.picture import page

    output = _ending(args.output, "-o", ".toml")
    picture = None if args.picture is None else Path(args.picture)
    check_chart_file(picture)
    numbers = None if args.json in (None, "-") else Path(args.json)
    check_targets([path for path in (output, picture, numbers) if path is not None])
    base = resolve_sensor(SensorConfig(args.base))
    fitted = fit_camera(_lights(args), base)
    toml = sensor_toml(fitted, args.base)
    if output is not None:
        write_whole(toml, output)
    shown = args.json != "-" and not args.quiet
    pairs = _replays(fitted, toml) if shown or picture is not None else []
    if picture is not None:
        name = "fitted sensor" if output is None else output.stem
        heading = f"{name}: recordings (points), and the fitted sensor (lines)"
        beside = [(one.seen, replay, "the fitted sensor") for one, replay in pairs]
        write_png(picture, page(beside, heading), few_colours=True)
    text = json.dumps([one.plain() for one in fitted.estimates], indent=2, allow_nan=False)
    if numbers is not None:
        write_whole(text + "\n", numbers)
    if args.json == "-":
        print(text)
    if shown:
        terminal.table("the camera", HEADINGS, _rows(fitted))
        replays = [_replay_row(one, replay) for one, replay in pairs if replay is not None]
        if replays:
            print()
            terminal.table("the replay", REPLAY_HEADINGS, replays)
        lost = [one for one in fitted.estimates if not one.told]
        if lost:
            print(f"\n{CANNOT}:")
            for one in lost:
                print(f"  {one.key}: {one.reason} ({one.source})")
    return 0


def _ending(name: str | None, option: str, suffix: str) -> Path | None:
    if name is not None and not name.endswith(suffix):
        raise EvsError(f"{option} is '{name}': end it in {suffix}")
    return None if name is None else Path(name)


def _lights(args: argparse.Namespace) -> list[Light]:
    """The recordings, read."""
    from evs_lab.fit import Light

    if (args.still is None) != (args.still_lux is None):
        raise EvsError("--still and --still-lux belong together: give both, or neither")
    if args.contrast is None and (args.ramp or args.lamp):
        raise EvsError(
            "the contrast of the light is not known; give --contrast, the brightest light over "
            "the darkest"
        )
    lights = []
    reading = reading_options(args)
    if args.dark:
        lights.append(Light(_read(args.dark, reading), "dark", 0.0))
    if args.still:
        lights.append(Light(_read(args.still, reading), "still", args.still_lux))
    if args.ramp:
        lights.append(Light(_read(args.ramp, reading), "ramp", None, args.contrast, args.period))
    if args.lamp:
        lights.append(
            Light(_read(args.lamp, reading), "lamp", args.lux, args.contrast, args.period)
        )
    return lights + [Light(_read(name, reading)) for name in args.recordings]


def _read(name: str, reading: ReadOptions) -> Observed:
    from evs.drivers.files import read
    from evs_lab.fit import Observed

    return Observed.of(read(name, **reading), Path(name).name)


def _rows(fitted: FittedCamera) -> list[tuple[str, ...]]:
    from evs_lab.fit import rounded

    rows: list[tuple[str, ...]] = []
    for one in fitted.told.values():
        if isinstance(one.value, str):
            rows.append((one.key, one.value, "", one.source, one.note))
        else:
            value = rounded(one.value, one.error)
            rows.append((one.key, value, f"{one.error:.2g}", one.source, one.note))
    return rows


def _replays(fitted: FittedCamera, toml: str) -> list[tuple[Light, Observed | None]]:
    """The recordings, each with the events of the file's sensor in the same light."""
    import tempfile

    from evs_lab.fit import cut_to_frames, replayed

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fitted.toml"
        path.write_text(toml, encoding="utf-8")
        lights = [cut_to_frames(one) for one in fitted.lights]
        return [(one, replayed(one, str(path))) for one in lights]


def _replay_row(light: Light, replay: Observed) -> tuple[str, ...]:
    pair = (light.seen, replay)
    counts, shares = [f"{len(o.events):,}" for o in pair], [f"{o.on.mean():.2f}" for o in pair]
    return (light.seen.source, *counts, *shares, "")
