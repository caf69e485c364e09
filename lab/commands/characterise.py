"""`evs characterise`: measure a sensor as its makers do, and compare with its parameters."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from evs.emulator.config import RunConfig, decoding
from evs.msgs import EvsError

KEYS = ("sensor", "seed", "threads")
"""First parts of the configuration keys that mean something here."""

EXAMPLES = """\
examples:
  evs characterise davis346                                 the table
  evs characterise davis346 --picture davis346.png          and one page of charts
  evs characterise mine.toml sensor.cutoff_hz=200 --json    your own sensor, for a program

SENSOR is a preset (config/sensors) or a .toml file of the same form; key=value changes single keys
as in evs emulate. Everything is measured from events, under a lamp of 0.001 ... 100,000 lux.
Bandwidth is measured with low thresholds and without noise, to isolate the filter. The column
`set` holds the values that the parameters promise."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.usage = "evs characterise SENSOR [key=value ...] [options]"
    add = parser.add_argument
    add("words", nargs="+", metavar="SENSOR, key=value", help="the sensor, then any keys")
    add(
        "--json",
        nargs="?",
        const="-",
        metavar="FILE",
        help="write all numbers as JSON; -: to stdout",
    )
    add("--picture", metavar="FILE.png", help="draw one page of charts")
    add("--pixels", type=int, metavar="N", help="measure at most N pixels (100,000)")
    add(
        "--seed",
        metavar="N",
        help="random seed; short for seed=",
    )
    add("--threads", metavar="N", help="worker threads; 0: one per core; short for threads=")
    add("--quiet", action="store_true", help="print nothing but warnings and errors")
    parser.epilog = EXAMPLES


def run(args: argparse.Namespace) -> int:
    """Measure; the exit code."""
    config = _config(args)
    # here, so that --help is quick
    from evs.drivers.pictures import write_png
    from evs.drivers.pictures.chart import check_chart_file
    from evs.drivers.run.report import check_targets, write_whole
    from evs.emulator.sensor import resolve_sensor
    from evs.launch.support import terminal
    from evs_lab import characterise as bench
    from evs_lab.characterise.chart_page import characterisation_page
    from evs_lab.characterise.quantity import HEADINGS, table_rows

    picture = None if args.picture is None else Path(args.picture)
    check_chart_file(picture)
    numbers = None if args.json in (None, "-") else Path(args.json)
    check_targets([path for path in (numbers, picture) if path is not None])
    sensor = resolve_sensor(config.sensor)
    done = 0
    with terminal.bar("measuring", bench.STEPS, args.quiet) as moved:

        def next_step(what: str) -> None:
            nonlocal done
            moved(done, what)
            done += 1

        found = bench.characterise(
            sensor,
            config.seed,
            config.threads,
            bench.PIXELS if args.pixels is None else args.pixels,
            next_step,
        )
    if picture is not None:
        write_png(picture, characterisation_page(found), few_colours=True)
    text = json.dumps(found.plain(), indent=2, allow_nan=False)
    if numbers is not None:
        write_whole(text + "\n", numbers)
    if args.json == "-":
        print(text)
    elif not args.quiet:
        terminal.table(
            f"{sensor.name}: {found.pixels:,} pixels",
            HEADINGS,
            table_rows(found.results()),
        )
    return 0


def _config(args: argparse.Namespace) -> RunConfig:
    sensors = [word for word in args.words if "=" not in word]
    if len(sensors) != 1:
        names = ", ".join(f"'{name}'" for name in sensors) or "none"
        raise EvsError(f"one sensor is measured at a time, given: {names} (try: --help)")
    overrides = [("sensor.preset", sensors[0])]
    overrides += [decoding.split_word(word) for word in args.words if "=" in word]
    overrides += [(key, text) for key in ("seed", "threads") if (text := getattr(args, key))]
    for key, _ in overrides:
        if key.partition(".")[0] not in KEYS:
            raise EvsError(f"{key} has no meaning for a sensor alone; give keys of sensor")
    config = decoding.override(RunConfig(), overrides)
    if config.seed < 0:
        raise EvsError(f"at seed: {config.seed}; give 0 or more")
    return config
