"""`evs emulate`: reads the pipeline, wires world and sinks, runs, reports."""

from __future__ import annotations

import argparse
import textwrap
from pathlib import Path

from evs.drivers.pipeline import config as pipeline
from evs.drivers.pipeline import keys, settings
from evs.launch.again import command
from evs.msgs import EvsError

HELP = "run a scene through the event camera: publish it, record it"

OPTIONS = {
    "scene": ("scene.file", "FILE", "MJCF or MJB file of the world"),
    "camera": ("scene.camera", "NAME", "camera of the model to look through"),
    "sensor": ("sensor.preset", "NAME", "sensor preset"),
    "renderer": ("render.renderer", "NAME", "how light is computed"),
    "spp": ("render.spp", "N", "samples per pixel"),
    "seeds": ("render.seeds", "WAY", "where the samples come from"),
    "model": ("model.name", "NAME", "event model"),
    "duration": ("duration_s", "S", "simulated seconds"),
    "pace": ("pace", "PACE", "free or realtime"),
    "record": ("record", "FILE", "record to a file ending in .aedat4 or .npz"),
    "report": ("report", "FILE", "write the run report (JSON)"),
    "publish": ("publish", "ADDRESS", "publish on ZeroMQ, as in tcp://127.0.0.1:5560"),
    "threads": ("threads", "N", "worker threads; 0: one a core"),
    "seed": ("seed", "N", "every random number follows from it"),
}
"""option -> (the key it is short for, placeholder, one line). Defaults stand with the keys."""

STOPPED = {"interrupted": 130, "terminated": 143}
"""how a run ended -> exit code, as shells count signals"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments. All stay text here; the configuration knows their types."""
    parser.usage = "evs emulate [PIPELINE.toml] [key=value ...] [options]"
    parser.add_argument(
        "words",
        nargs="*",
        metavar="PIPELINE.toml, key=value",
        help="a pipeline file (or the name of one that comes with evs), then any keys",
    )
    for option, (key, placeholder, line) in OPTIONS.items():
        parser.add_argument(
            f"--{option}", metavar=placeholder, help=f"{line}; short for {key}=", dest=option
        )
    parser.add_argument(
        "--quiet", action="store_true", help="print nothing but warnings and errors"
    )
    parser.epilog = _keys_text()


def run(args: argparse.Namespace) -> int:
    """Run the pipeline; the exit code."""
    config = pipeline.load(*_given(args))
    return _emulate(config, args)


def _given(args: argparse.Namespace) -> tuple[str | None, list[tuple[str, str]]]:
    """The pipeline file, if any, and (key, text) of everything else on the command line."""
    files = [word for word in args.words if "=" not in word]
    if len(files) > 1:
        raise EvsError(f"two pipelines, '{files[0]}' and '{files[1]}'; give one, then key=value")
    overrides = [settings.split_word(word) for word in args.words if "=" in word]
    words = dict(overrides)
    for option, (key, _, _) in OPTIONS.items():
        text = getattr(args, option)
        if text is not None and words.get(key, text) != text:
            raise EvsError(
                f"--{option} {text} and {key}={words[key]} are one key; give one of them"
            )
        if text is not None:
            overrides.append((key, text))
    return (files[0] if files else None), overrides


def _emulate(config: pipeline.PipelineConfig, args: argparse.Namespace) -> int:
    # here, so that --help is quick
    from evs.drivers.pace import Pacer, StopWatch
    from evs.drivers.pipeline.report import Report, check_targets, report_beside, write_report
    from evs.drivers.pipeline.run import run as run_loop
    from evs.drivers.pipeline.run import tick_count
    from evs.emulator import World
    from evs.launch import terminal

    tables = config.sinks()
    recordings = [table.file for table in tables if table.file]
    targets = [report_beside(file) for file in recordings]
    if config.report:
        targets.append(Path(config.report))
    # the folder of a recording is its recorder's to look at
    check_targets(targets[len(recordings) :])
    ticks = tick_count(config.duration_s, config.scene.tick_us)
    sinks = [pipeline.make_sink(table) for table in tables]
    watch = StopWatch()
    world = World.from_config(config.emulation(), meter=watch)

    def keep(report: Report) -> None:
        for target in targets:
            write_report(report, target)

    with terminal.progress(ticks, args.quiet) as moved:
        report = run_loop(
            world,
            sinks,
            config.duration_s,
            watch,
            Pacer(pipeline.PACES[config.pace]),
            moved,
            warn=terminal.warn,
            on_report=keep,
            config=settings.to_plain(config),
        )
    addresses = [table.address for table in tables if table.address]
    terminal.summary(report, args.quiet, next_commands(args, recordings, addresses))
    return STOPPED.get(report.ended.split()[0], 0)


def next_commands(
    args: argparse.Namespace, recordings: list[str], addresses: list[str]
) -> list[str]:
    """What to try after this run; each works as it stands."""
    if recordings:
        file = recordings[0]
        film = str(Path(file).with_suffix(".gif"))
        return [command("info", file), command("view", file, "-o", film)]
    options = ((option, getattr(args, option)) for option in OPTIONS)
    given = [word for option, text in options if text for word in (f"--{option}", text)]
    this_run = command("emulate", args.words, given)
    # port 0 is another one each time
    heard = [address for address in addresses if not address.endswith(":0")]
    listen = [f"{command('echo', heard[0], '--hz')} & {this_run}"] if heard else []
    return [*listen, f"{this_run} --record run.aedat4"]


def _keys_text() -> str:
    """Every configuration key with its default and meaning, from the classes themselves."""
    lines = [
        "Configuration: defaults < PIPELINE.toml < the command line. A key is set in the file,",
        "under its table, or here as key=value. Paths in a file are relative to that file, others",
        "to the working directory; package:path is a file inside an installed Python package.",
    ]
    for table in keys.describe(pipeline.PipelineConfig):
        lines += ["", f"[{table.name}]" if table.name else "top level"]
        if table.doc and table.name:
            lines[-1] += f"  {table.doc.partition(': ')[2] or table.doc}"
        for key in table.keys:
            lines.append(f"  {key.name}={key.default}")
            lines += textwrap.wrap(key.doc, 92, initial_indent=" " * 6, subsequent_indent=" " * 6)
    return "\n".join(lines)
