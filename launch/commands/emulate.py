"""`evs emulate`: read the pipeline, connect world and sinks, run, report."""

from __future__ import annotations

import argparse
import gc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from evs.drivers.run import config as pipeline
from evs.emulator.config import decoding
from evs.launch.support import options
from evs.launch.support.reinvoke import command

OPTIONS = {
    "scene": ("scene.file", "FILE", "MJCF or MJB file of the world"),
    "camera": ("scene.camera", "NAME", "camera of the model to look through"),
    "sensor": ("sensor.preset", "NAME", "sensor preset"),
    "size": options.SIZE,
    "renderer": ("render.renderer", "NAME", "how light is computed"),
    "spp": ("render.spp", "N", "samples per pixel"),
    "seeds": ("render.seeds", "WAY", "where the samples come from"),
    "model": ("model.name", "NAME", "event model"),
    "duration": ("duration_s", "S", "simulated seconds"),
    "pace": ("pace", "PACE", "free, realtime, or lockstep with controllers"),
    "record": ("record", "FILE", "record to a file; its extension selects the format"),
    "report": ("report", "FILE", "write the run report (JSON)"),
    "force": ("overwrite", "", "replace existing recordings"),
    "publish": ("publish", "ADDRESS", "publish on ZeroMQ, as in tcp://127.0.0.1:5560"),
    "wait-for": (
        "publish_wait_for",
        "N",
        "wait for N subscribers of --publish before the first tick",
    ),
    "control": ("publish_control", "ADDRESS", "control port of --publish (evs topics)"),
    "key": ("publish_key", "FILE", "secret key of --publish, made by evs keygen"),
    "allow": (
        "publish_allow",
        "KEYS",
        "public keys that may subscribe to --publish: files, folders",
    ),
    "worker": ("worker", "", "run every sink in its own process, so that no sink slows a tick"),
    "insecure": ("publish_insecure", "", "let other machines subscribe to --publish without a key"),
    "model-everything": ("plan.everything", "", "also run code paths that the scene does not need"),
    "threads": ("threads", "N", "worker threads; 0: one per core"),
    "seed": ("seed", "N", "random seed"),
}
"""option -> (the key it is short for, placeholder, one line). Defaults stand with the keys."""

LEAST_WAY = 1e-3
"""m or rad: a joint that went less did not move"""

STOPPED = {"interrupted": 130, "terminated": 143}
"""how a run ended -> exit code, as shells count signals"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments. All stay text here; the configuration knows their types."""
    parser.usage = "evs emulate [SCENE.xml] [PIPELINE.toml] [key=value ...] [options]"
    options.add_pipeline_options(parser, OPTIONS)
    parser.add_argument(
        "--view",
        action="store_true",
        help="show the run in a browser, with sliders for the sensor's parameters",
    )
    parser.add_argument(
        "--quiet", action="store_true", help="print nothing but warnings and errors"
    )


def epilog() -> str:
    """What help says below the options."""
    return options.keys_text()


def run(args: argparse.Namespace) -> int:
    """Run the pipeline; the exit code."""
    # here, so that --help is quick
    from evs.drivers.clock import Pacer, StopWatch
    from evs.drivers.run.report import check_targets, report_beside
    from evs.drivers.run.run import depth_of, tick_count
    from evs.drivers.run.run import run as run_loop
    from evs.emulator.simulation.pipelined import pipelined
    from evs.emulator.simulation.world import World
    from evs.launch.support import terminal
    from evs.launch.support.report_writer import ReportWriter
    from evs.launch.support.web_view import page_of_run

    config = pipeline.load(*options.parse_pipeline(args, OPTIONS))
    with page_of_run(args.view) as pages:
        config = replace(config, sink=(*config.sink, *pages))
        if config.is_closed:
            from evs.launch.support.serve_loop import serve

            return serve(config, args.quiet)
        tables = pipeline.settled(config.sinks(), config.beside)
        recordings = [table.file for table in tables if table.file]
        targets = [report_beside(file) for file in recordings]
        if config.report:
            targets.append(Path(config.report))
        # recorders check the folders of their files themselves
        check_targets(targets[len(recordings) :])
        ticks = tick_count(config.duration_s, config.scene.tick_us)
        sinks = [pipeline.make_sink(table) for table in tables]
        watch = StopWatch()
        write_reports = ReportWriter(targets)
        whole = World.from_config(config, meter=watch)
        # nothing answers the events: physics and light may run some ticks ahead
        with (
            pipelined(whole, ticks, watch, depth_of(config)) as world,
            terminal.progress(ticks, args.quiet) as moved,
            _frozen(),
        ):
            start = world.data.qpos.copy()
            report = run_loop(
                world,
                sinks,
                config.duration_s,
                watch,
                Pacer(pipeline.PACES[config.pace], catch_up_s=config.realtime.catch_up_s),
                moved,
                begun=lambda: terminal.notes(world.chosen, args.quiet),
                warn=terminal.warn,
                on_report=write_reports,
                config=decoding.to_plain(config),
            )
            way = abs(world.data.qpos - start).max(initial=0.0)
            usual = config.scene.control in ("auto", "zero", "keyframe")
            stood = usual and len(world.data.ctrl) > 0 and way < LEAST_WAY
        # nobody else is to subscribe to these
        own = [page.address for page in pages]
        addresses = [
            table.address
            for table in tables
            if table.address and table.type == "zmq" and table.address not in own
        ]
        terminal.summary(report, args.quiet, next_commands(args, recordings, addresses, stood))
        # a recording that stopped is not a success, although a warning was printed
        stopped = any(sink.get("error") for sink in report.sinks)
        return STOPPED.get(report.ended.split()[0], 2 if stopped or write_reports.failures else 0)


@contextmanager
def _frozen() -> Iterator[None]:
    """Freeze existing objects, so that the garbage collector skips them."""
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def next_commands(
    args: argparse.Namespace, recordings: list[str], addresses: list[str], stood: bool = False
) -> list[str]:
    """What to try after this run; each works as it stands.

    Args:
        args: Of this run.
        recordings: The files that it wrote.
        addresses: Where it published.
        stood: Whether the robot has motors, and nothing moved.
    """
    if recordings and not stood:
        file = recordings[0]
        film = str(Path(file).with_suffix(".gif"))
        return [command("info", file), command("view", file, "-o", film)]
    texts = ((option, getattr(args, option)) for option in OPTIONS)
    chosen = [
        word
        for option, text in texts
        if text
        for word in ((f"--{option}", text) if OPTIONS[option][1] else (f"--{option}",))
    ]
    random = ["scene.control=random"] if stood else []
    this_run = command("emulate", args.words, random, chosen)
    note = "  # nothing moved: random controls move the robot" if stood else ""
    if recordings:
        return [f"{this_run}{'' if args.force else ' --force'}{note}"]
    # port 0 is another one each time
    reachable = [address for address in addresses if not address.endswith(":0")]
    listen = [f"{command('echo', reachable[0], '--hz')} & {this_run}"] if reachable else []
    return [*listen, f"{this_run} --record {_free('run.aedat4')}{note}"]


def _free(name: str) -> str:
    """A name of the kind that no file has: run.aedat4, run-2.aedat4, ..."""
    path, number = Path(name), 2
    while path.exists():
        path, number = Path(name).with_stem(f"{Path(name).stem}-{number}"), number + 1
    return str(path)
