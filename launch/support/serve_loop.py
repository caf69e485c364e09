"""Serve a closed loop to controllers in other processes: address, summary, report, exit code."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evs.drivers.lockstep import serve as served
from evs.drivers.run import config as pipeline
from evs.drivers.run.report import check_targets
from evs.emulator.config import decoding
from evs.launch.support import terminal
from evs.launch.support.reinvoke import command
from evs.launch.support.report_writer import ReportWriter

if TYPE_CHECKING:
    from evs.emulator import ClosedLoop
    from evs.emulator.base.protocols import Meter


def serve(
    config: pipeline.PipelineConfig,
    quiet: bool,
    make_loop: Callable[[Meter], ClosedLoop] | None = None,
    reported_config: Mapping[str, Any] | None = None,
) -> int:
    """Serve until a controller or a signal ends it; return the exit code.

    Args:
        config: the configuration.
        quiet: print only warnings.
        make_loop: See lockstep.serve.
        reported_config: the configuration that the report shows for a loop that is not the
            configuration's.
    """
    targets = [Path(config.report)] if config.report else []
    check_targets(targets)
    write_reports = ReportWriter(targets)

    def ready(address: str) -> None:
        if not quiet:
            print(
                f'evs: the loop waits for evs.connect("{address}") (Ctrl-C ends)',
                file=sys.stderr,
                flush=True,
            )

    report, files = served.serve(
        config,
        make_loop=make_loop,
        warn=terminal.warn,
        begun=lambda lines: terminal.notes(lines, quiet),
        ready=ready,
        on_report=write_reports,
        report_config=decoding.to_plain(config) if reported_config is None else reported_config,
    )
    terminal.summary(report, quiet, [command("info", file) for file in files[:1]])
    stopped = any(sink.get("error") for sink in report.sinks)
    # a server that was stopped has done its job
    return 2 if stopped or write_reports.failures else 0
