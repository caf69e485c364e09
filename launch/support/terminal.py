"""The output of commands: progress on stderr, summaries on stdout. Only it imports rich."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich.box import ROUNDED
from rich.console import Console
from rich.markup import escape
from rich.panel import Panel
from rich.progress import (
    BarColumn,
    ProgressColumn,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bar
from rich.table import Table
from rich.text import Text

from evs.drivers.run.report import COMPLETE, Progress, Report

REDRAW_S = 0.1
"""the bar is redrawn no more often"""

STAGE_COLOURS = {
    "world": "cyan",
    "render": "yellow",
    "sensor": "magenta",
    "pack": "blue",
    "sink": "green",
}


@contextmanager
def progress(ticks: int, quiet: bool = False) -> Iterator[Callable[[Progress], None] | None]:
    """Draw a progress bar on stderr while the block runs, if that is a terminal.

    Args:
        ticks: of the run.
        quiet: draw nothing.

    Yields:
        A callback that moves the bar; None: there is no bar.
    """
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    with Bar(*_columns(), console=console, transient=True) as bar:
        task = bar.add_task("emulating", total=ticks, detail="")
        drawn_s = -REDRAW_S

        def move(where: Progress) -> None:
            nonlocal drawn_s
            if where.wall_seconds - drawn_s < REDRAW_S and where.tick < where.ticks:
                return
            drawn_s = where.wall_seconds
            detail = f"{where.sim_seconds:7.3f} s  {_rate(where)}  {_factor(where)}"
            bar.update(task, completed=where.tick, detail=detail)

        yield move


@contextmanager
def bar(what: str, total: int, quiet: bool = False) -> Iterator[Callable[[int, str], None]]:
    """Draw a plain progress bar on stderr while the block runs, if that is a terminal.

    Args:
        what: label of the bar.
        total: number of steps.
        quiet: draw nothing.

    Yields:
        A callback that moves the bar: (steps done, detail).
    """
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda _done, _told: None
        return
    with Bar(*_columns(), console=console, transient=True) as drawn:
        task = drawn.add_task(what, total=total, detail="")
        yield lambda done, detail: drawn.update(task, completed=done, detail=detail)


def _columns() -> tuple[ProgressColumn, ...]:
    return (
        TextColumn("[bold]{task.description}"),
        BarColumn(bar_width=None),
        TaskProgressColumn(),
        TextColumn("{task.fields[detail]}"),
        TimeRemainingColumn(),
    )


def notes(lines: Sequence[str], quiet: bool = False) -> None:
    """Print the lines with which a run begins, on stderr."""
    for line in () if quiet else lines:
        print(f"evs: {line}", file=sys.stderr, flush=True)


def warn(line: str) -> None:
    """Print a warning, one line on stderr."""
    console = Console(stderr=True, soft_wrap=True, highlight=False)
    console.print(f"[bold yellow]evs: warning:[/] {escape(line)}")


def summary(report: Report, quiet: bool = False, next_commands: Sequence[str] = ()) -> None:
    """Print a run in a few lines on stdout: events, speed, ms per stage, packets, next commands."""
    if quiet:
        return
    console = Console(highlight=False)
    if console.is_terminal:
        body = Table.grid(padding=(0, 0))
        for part in (_facts(report), Text(), _stages(report)):
            body.add_row(part)
        good = report.ended == COMPLETE
        title = "run complete" if good else report.ended
        console.print(
            Panel(body, title=escape(title), border_style="green" if good else "red", expand=False)
        )
    else:
        # plain lines that a script can cut: one fact a line
        for name, value in facts(report):
            print(f"{name:17s} {value}")
        for stage, times in report.stage_ms.items():
            print(f"{stage + '_ms':17s} {times.median:.3f} median, {times.p99:.3f} p99")
    if next_commands:
        console.print("[bold]next:[/]" if console.is_terminal else "next:")
        for command in next_commands:
            console.print(f"  {escape(command)}", soft_wrap=True)


def table(
    title: str, headings: Sequence[str], rows: Sequence[Sequence[str]], lines: bool = True
) -> None:
    """Rows under headings, on stdout; all columns but the first and the last stand to the right.

    Args:
        title: of the table.
        headings: of the columns.
        rows: their cells.
        lines: on a terminal one is drawn before each row that has a name, and no row is wrapped.
    """
    console = Console(highlight=False)
    if not console.is_terminal:
        # columns that a script can cut, as wide as they must be
        widths = [max(len(row[k]) for row in (headings, *rows)) for k in range(len(headings))]
        print(title)
        for row in (headings, *rows):
            cells = [row[0].ljust(widths[0])]
            cells += [
                cell.rjust(width) for cell, width in zip(row[1:-1], widths[1:-1], strict=True)
            ]
            print("  ".join([*cells, row[-1]]).rstrip())
        return
    shown = Table(box=ROUNDED, border_style="dim", header_style="bold", title=escape(title))
    for k, heading in enumerate(headings):
        number = 0 < k < len(headings) - 1
        shown.add_column(
            heading, justify="right" if number else "left", no_wrap=not k or (lines and not number)
        )
    for k, row in enumerate(rows):
        # a line before each new name
        if k and row[0] and lines:
            shown.add_section()
        shown.add_row(*(escape(cell) for cell in row))
    console.print(shown)


def facts(report: Report) -> list[tuple[str, str]]:
    """(name, value) of everything in the summary but the stages."""
    rate = report.events / report.sim_seconds if report.sim_seconds else 0.0
    lines = [
        ("ended", report.ended),
        ("simulated", f"{report.sim_seconds:.6g} s in {report.ticks:,} ticks"),
        ("wall clock", f"{report.wall_seconds:.3g} s"),
        ("real-time factor", f"{report.real_time_factor:.3g}"),
        ("events", f"{report.events:,} ({_si(rate)} events per simulated second)"),
        ("events dropped", _dropped(report)),
        *([("values replaced", f"{report.clamps:,}")] if report.clamps else []),
        ("packets", f"{report.packets:,}"),
        ("physics", report.substeps),
        ("pixels traced", f"{100 * report.traced_fraction:.3g} %"),
    ]
    if report.loop:
        loop = report.loop
        waits = loop["decision_ms"]
        steps, episodes, controllers = (
            f"{loop[key]:,} {key if loop[key] != 1 else key[:-1]}"
            for key in ("steps", "episodes", "controllers")
        )
        lines.append(("loop", f"{steps} in {episodes}, {controllers}"))
        waited = ", ".join(f"{waits[key]:.3g} ms {key}" for key in ("median", "p99"))
        lines.append(("decisions", waited))
    if report.pace:
        late_ms = report.pace["late_ms"]
        detail = ", ".join(f"{late_ms[key]:.3g} ms {key}" for key in ("median", "p99", "worst"))
        slipped = report.pace["slipped_s"]
        lines.append(("late", detail + (f"; slipped {slipped:.3g} s" if slipped else "")))
    for sink in report.sinks:
        # what is zero, empty or False needs no words
        known = {key: value for key, value in sink.items() if key != "type" and value}
        detail = ", ".join(f"{key.replace('_', ' ')} {value}" for key, value in known.items())
        lines.append((str(sink.get("type", "sink")), detail))
    return lines


def _dropped(report: Report) -> str:
    """How many events were lost, and why: the readouts' causes, the most frequent first."""
    causes = Counter[str]()
    for camera in report.cameras:
        causes.update(camera.get("events_dropped", {}))
    queues = report.events_dropped - causes.total()
    if queues > 0:
        causes["a sink's queue"] = queues
    detail = ", ".join(f"{cause} {count:,}" for cause, count in causes.most_common() if count)
    return f"{report.events_dropped:,}" + (f" ({detail})" if detail else "")


def _facts(report: Report) -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim")
    table.add_column(overflow="fold")
    for name, value in facts(report)[1:]:
        table.add_row(name, escape(value))
    return table


def _stages(report: Report) -> Table:
    """ms per tick and stage, with a bar for each stage's share of the sum of the medians."""
    table = Table(box=ROUNDED, border_style="dim", header_style="bold")
    table.add_column("stage")
    table.add_column("median ms", justify="right")
    table.add_column("p99 ms", justify="right")
    table.add_column("share of the tick")
    total = sum(times.median for times in report.stage_ms.values()) or 1.0
    for stage, times in report.stage_ms.items():
        share = times.median / total
        bar = Text("█" * round(24 * share), style=STAGE_COLOURS.get(stage, "white"))
        bar.append(f" {100 * share:.0f} %", style="dim")
        table.add_row(stage, f"{times.median:.3f}", f"{times.p99:.3f}", bar)
    return table


def _rate(where: Progress) -> str:
    """Events per simulated second so far."""
    rate = where.events / where.sim_seconds if where.sim_seconds else 0.0
    return f"{_si(rate)}ev/s"


def _factor(where: Progress) -> str:
    factor = where.sim_seconds / where.wall_seconds if where.wall_seconds else 0.0
    return f"{factor:.2f}x real time"


def _si(value: float) -> str:
    """A number with k, M or G."""
    for limit, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= limit:
            return f"{value / limit:.3g} {letter}"
    return f"{value:.3g} "
