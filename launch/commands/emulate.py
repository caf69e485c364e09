"""`evs emulate`: reads the pipeline, wires world and sinks, runs, reports."""

from __future__ import annotations

import argparse
import gc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from evs.drivers import settings
from evs.drivers.run import config as pipeline
from evs.launch.support import pipeline_options
from evs.launch.support.reinvoke import command

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
    "pace": ("pace", "PACE", "free, realtime, or lockstep with controllers"),
    "record": ("record", "FILE", "record to a file; its ending says the format"),
    "report": ("report", "FILE", "write the run report (JSON)"),
    "force": ("overwrite", "", "replace recordings that are there"),
    "publish": ("publish", "ADDRESS", "publish on ZeroMQ, as in tcp://127.0.0.1:5560"),
    "wait-for": ("publish_wait_for", "N", "begin when N subscribers of --publish are there"),
    "control": ("publish_control", "ADDRESS", "control port of --publish (evs topics)"),
    "key": ("publish_key", "FILE", "secret key of --publish, made by evs keygen"),
    "allow": ("publish_allow", "KEYS", "public keys that may listen to --publish: files, folders"),
    "aside": ("aside", "", "every sink in a process of its own, so that it slows no tick"),
    "insecure": ("publish_insecure", "", "let other machines listen to --publish without a key"),
    "model-everything": ("plan.everything", "", "run what the scene does not need, too: evs plan"),
    "threads": ("threads", "N", "worker threads; 0: one a core"),
    "seed": ("seed", "N", "every random number follows from it"),
}
"""option -> (the key it is short for, placeholder, one line). Defaults stand with the keys."""

STOPPED = {"interrupted": 130, "terminated": 143}
"""how a run ended -> exit code, as shells count signals"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments. All stay text here; the configuration knows their types."""
    parser.usage = "evs emulate [SCENE.xml] [PIPELINE.toml] [key=value ...] [options]"
    pipeline_options.add_pipeline_options(parser, OPTIONS)
    parser.add_argument(
        "--quiet", action="store_true", help="print nothing but warnings and errors"
    )
    parser.epilog = pipeline_options.keys_text()


def run(args: argparse.Namespace) -> int:
    """Run the pipeline; the exit code."""
    config = pipeline.load(*pipeline_options.parse_pipeline(args, OPTIONS))
    if config.is_closed:
        from evs.launch.support.serve_loop import serve

        return serve(config, args.quiet)
    return _emulate(config, args)


def _emulate(config: pipeline.PipelineConfig, args: argparse.Namespace) -> int:
    # here, so that --help is quick
    from evs.drivers.clock import Pacer, StopWatch
    from evs.drivers.run.open_loop import open_world
    from evs.drivers.run.paces import PACES
    from evs.drivers.run.report import check_targets, report_beside
    from evs.drivers.run.run import run as run_loop
    from evs.drivers.run.run import tick_count
    from evs.launch.support import terminal
    from evs.launch.support.report_writer import ReportWriter

    tables = pipeline.settled(config.sinks(), config.beside)
    recordings = [table.file for table in tables if table.file]
    targets = [report_beside(file) for file in recordings]
    if config.report:
        targets.append(Path(config.report))
    # the folder of a recording is its recorder's to look at
    check_targets(targets[len(recordings) :])
    ticks = tick_count(config.duration_s, config.scene.tick_us)
    sinks = [pipeline.make_sink(table) for table in tables]
    watch = StopWatch()
    write_reports = ReportWriter(targets)
    with (
        open_world(config, watch) as world,
        terminal.progress(ticks, args.quiet) as moved,
        _frozen(),
    ):
        report = run_loop(
            world,
            sinks,
            config.duration_s,
            watch,
            Pacer(PACES[config.pace], catch_up_s=config.realtime.catch_up_s),
            moved,
            begun=lambda: terminal.notes(world.chosen, args.quiet),
            warn=terminal.warn,
            on_report=write_reports,
            config=settings.to_plain(config),
        )
    addresses = [table.address for table in tables if table.address and table.type == "zmq"]
    terminal.summary(report, args.quiet, next_commands(args, recordings, addresses))
    # a recording that stopped has been warned of, but it is not what was asked for
    stopped = any(said.get("error") for said in report.sinks)
    return STOPPED.get(report.ended.split()[0], 2 if stopped or write_reports.failures else 0)


@contextmanager
def _frozen() -> Iterator[None]:
    """What is there already stays, so that the garbage collector need not go through it."""
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def next_commands(
    args: argparse.Namespace, recordings: list[str], addresses: list[str]
) -> list[str]:
    """What to try after this run; each works as it stands."""
    if recordings:
        file = recordings[0]
        film = str(Path(file).with_suffix(".gif"))
        return [command("info", file), command("view", file, "-o", film)]
    texts = ((option, getattr(args, option)) for option in OPTIONS)
    given = [
        word
        for option, text in texts
        if text
        for word in ((f"--{option}", text) if OPTIONS[option][1] else (f"--{option}",))
    ]
    this_run = command("emulate", args.words, given)
    # port 0 is another one each time
    heard = [address for address in addresses if not address.endswith(":0")]
    listen = [f"{command('echo', heard[0], '--hz')} & {this_run}"] if heard else []
    return [*listen, f"{this_run} --record run.aedat4"]
