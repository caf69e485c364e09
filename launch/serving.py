"""A closed loop for controllers elsewhere, as a program: address, summary, report, exit code."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evs.drivers import settings
from evs.drivers.lockstep import running
from evs.drivers.run import config as pipeline
from evs.drivers.run.report import check_targets
from evs.launch import terminal
from evs.launch.again import command
from evs.launch.report_writer import Keeper

if TYPE_CHECKING:
    from evs.emulator import Loop
    from evs.emulator.base.protocols import Meter


def serve(
    config: pipeline.PipelineConfig,
    quiet: bool,
    make_loop: Callable[[Meter], Loop] | None = None,
    said_config: Mapping[str, Any] | None = None,
) -> int:
    """Serve until it is told to end; the exit code.

    In: make_loop, as of running.serve; said_config, what the report says of a loop that is not the
    configuration's.
    """
    targets = [Path(config.report)] if config.report else []
    check_targets(targets)
    keep = Keeper(targets)

    def ready(address: str) -> None:
        if not quiet:
            print(
                f'evs: the loop waits for evs.connect("{address}") (Ctrl-C ends)',
                file=sys.stderr,
                flush=True,
            )

    report, files = running.serve(
        config,
        make_loop=make_loop,
        warn=terminal.warn,
        begun=lambda lines: terminal.notes(lines, quiet),
        ready=ready,
        on_report=keep,
        said_config=settings.to_plain(config) if said_config is None else said_config,
    )
    terminal.summary(report, quiet, [command("info", file) for file in files[:1]])
    stopped = any(said.get("error") for said in report.sinks)
    # whoever ends a server ends it well
    return 2 if stopped or keep.unkept else 0
