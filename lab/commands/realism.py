"""`evs realism`: a stream of events beside real recordings."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evs.launch.support.options import add_reading_options, reading_options
from evs.msgs import EvsError

if TYPE_CHECKING:
    from evs_lab.fit import Observed

SENSOR = "davis346"

EXAMPLES = """\
examples:
  evs realism street.aedat4                      sensors in the light of its frames
  evs realism real.raw simulated.raw             statistics of two streams
  evs realism real.raw mine.raw --again real2.raw --picture page.png
  evs realism dark.raw --still-lux 0 --sensor imx636

With one recording that has intensity frames, its first half is fitted and its second half is
compared with sensors in the light of the frames. With several, each is compared with the first in
statistics that do not need the same scene. lab/docs/realism.md describes all columns."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.usage = "evs realism REAL [STREAM ...] [options]"
    add = parser.add_argument
    add("real", metavar="REAL", help="a recording of a real camera")
    add("streams", nargs="*", metavar="STREAM", help="recordings that should be like it")
    add(
        "--sensor",
        action="append",
        default=[],
        metavar="SENSOR",
        help=f"preset or .toml file to compare; may be repeated; the first is fitted ({SENSOR})",
    )
    add(
        "--still-lux",
        type=float,
        metavar="LUX",
        help="compare the sensors in constant light instead",
    )
    add(
        "--white-lux",
        type=float,
        metavar="LUX",
        help="illuminance of white in the frames (default: what fills the sensor's wells)",
    )
    add(
        "--rows",
        type=int,
        nargs=2,
        metavar=("FIRST", "LAST"),
        help="compare only these rows of the sensor, both included, with frames",
    )
    add("--again", metavar="FILE", help="another recording of the same camera, for the floor")
    add("--seed", type=int, default=0, metavar="N", help="of the sensors' noise (0)")
    add_reading_options(parser, single=False)
    add("--picture", metavar="FILE.png", help="draw the comparison")
    add("--json", nargs="?", const="-", metavar="FILE", help="write all numbers; -: to stdout")
    add("--quiet", action="store_true", help="print nothing but warnings and errors")
    parser.epilog = EXAMPLES


def run(args: argparse.Namespace) -> int:
    """Compare; the exit code."""
    # here, so that --help is quick
    from evs.drivers.files import read
    from evs.drivers.pictures.chart import check_chart_file
    from evs.drivers.run.report import check_targets, write_whole
    from evs_lab.fit import Observed

    picture = None if args.picture is None else Path(args.picture)
    check_chart_file(picture)
    numbers = None if args.json in (None, "-") else Path(args.json)
    check_targets([path for path in (numbers, picture) if path is not None])
    _check(args)
    reading = reading_options(args)

    def recording(name: str) -> Observed:
        return Observed.of(read(name, **reading), Path(name).name)

    real = recording(args.real)
    if args.streams or args.still_lux is not None:
        streams = [recording(name) for name in args.streams]
        again = None if args.again is None else recording(args.again)
        plain = _unpaired(args, real, streams, again, picture)
    else:
        plain = _paired(args, real, picture)
    text = json.dumps(plain, indent=2, allow_nan=False)
    if numbers is not None:
        write_whole(text + "\n", numbers)
    if args.json == "-":
        print(text)
    return 0


def _check(args: argparse.Namespace) -> None:
    by_frames = not args.streams and args.still_lux is None
    if by_frames and args.again is not None:
        raise EvsError("--again is for streams that are compared without frames; leave it out")
    if not by_frames and (args.rows is not None or args.white_lux is not None):
        raise EvsError("--rows and --white-lux are for one recording with frames; leave them out")
    if args.streams and args.sensor:
        raise EvsError("give recordings to compare, or --sensor, not both")
    for option in ("still_lux", "white_lux"):
        value = getattr(args, option)
        if value is not None and not 0.0 <= value <= 1e9:
            raise EvsError(f"--{option.replace('_', '-')} is {value:g}; give 0 ... 1e9 lux")


def _paired(args: argparse.Namespace, real: Observed, picture: Path | None) -> dict[str, Any]:
    """Sensors in the light of the frames."""
    from evs.drivers.pictures import write_png
    from evs.launch.support import terminal
    from evs_lab.realism.page import replay_page
    from evs_lab.realism.replays import replay_all

    sensors = args.sensor or [SENSOR]
    done = 0
    with terminal.bar("replaying", len(sensors) + 5, args.quiet) as moved:

        def next_step(name: str) -> None:
            nonlocal done
            moved(done, name)
            done += 1

        found = replay_all(
            real, sensors, args.rows and tuple(args.rows), args.white_lux, args.seed, next_step
        )
    if picture is not None:
        write_png(picture, replay_page(found), few_colours=True)
    seconds = 1e-6 * (found.region.end_us - found.region.begin_us)
    pixels = int(found.region.pixels.sum())
    if not args.quiet and args.json != "-":
        rows = []
        for row in found.rows:
            like = row.like
            rows.append(
                (row.name, f"{like.events:,}", f"{like.ratio:.2f}")
                + tuple(
                    "" if value != value else f"{value:.3f}"
                    for value in (like.on, like.active, like.totals, like.signed, like.kl_nats)
                )
            )
        title = f"{real.source}: the last {seconds:.2f} s, {pixels:,} pixels"
        headings = (
            "", "events", "of real", "ON", "active", "totals", "signed, 50 ms", "KL"
        )  # fmt: skip
        terminal.table(title, headings, rows)
        told = found.fitted.told
        fitted = [
            f"{key} {told[key].number:.3f} +- {told[key].error:.3f}"
            for key in ("pos_thres", "neg_thres")
            if key in told
        ]
        print(f"\nfitted to the first half: {', '.join(fitted) or 'nothing'}")
        for key in ("pos_thres", "neg_thres"):
            if key not in told:
                print(f"  {key}: {found.fitted[key].reason}")
    return {
        "recording": real.source,
        "seconds": seconds,
        "pixels": pixels,
        "fitted": [one.plain() for one in found.fitted.estimates],
        "dark_dn": found.fitted.lights[0].dark_dn,
        "rows": [{"sensor": row.name, **row.like.plain()} for row in found.rows],
    }


def _unpaired(
    args: argparse.Namespace,
    real: Observed,
    streams: list[Observed],
    again: Observed | None,
    picture: Path | None,
) -> dict[str, Any]:
    """Statistics of streams."""
    from evs.drivers.pictures import write_png
    from evs.launch.support import terminal
    from evs_lab.fit.picture import page
    from evs_lab.realism.compare import compare

    if args.still_lux is not None:
        streams = [*streams, *_still(real, args.sensor or [SENSOR], args.still_lux, args.seed)]
    seconds, rows = compare(real, streams, again)
    names = [one.source for one in streams]
    if picture is not None:
        pairs = [(real, one, one.source) for one in streams]
        heading = f"{real.source} (points), and streams beside it (lines)"
        write_png(picture, page(pairs, heading), few_colours=True)
    if not args.quiet and args.json != "-":
        headings = ["", real.source, "floor"]
        for name in names:
            headings += [name, "apart"]
        table = []
        for row in rows:
            cells = [row.quantity.name, _cell(row.values[0]), _cell(row.floor)]
            for value, apart in zip(row.values[1:], row.distances, strict=True):
                unit = f" {row.quantity.unit}" if row.quantity.unit else ""
                cells += [_cell(value), f"{_cell(apart)}{unit}" if apart == apart else ""]
            table.append(tuple(cells))
        terminal.table(f"pieces of {seconds:.3g} s", tuple(headings), table)
    return {
        "recording": real.source,
        "streams": names,
        "seconds": seconds,
        "rows": [row.plain() for row in rows],
    }


def _still(real: Observed, sensors: list[str], lux: float, seed: int) -> list[Observed]:
    """Sensors of the recording's size in constant light, for as long."""
    from dataclasses import replace

    from evs.emulator.config import SensorConfig
    from evs_lab.fit import Light, replayed

    found = []
    for name in sensors:
        seen = replayed(Light(real, "still", lux), SensorConfig(name), seed)
        if seen is None:
            raise EvsError(
                f"{name} has no events in constant light of {lux:g} lux, or the recording is "
                "longer than 300 s; give another sensor or light, or cut the recording"
            )
        found.append(replace(seen, source=f"{Path(name).stem}, {lux:g} lux"))
    return found


def _cell(value: float) -> str:
    return "" if value != value else f"{value:.3g}"
