"""The table of stress cases as Markdown, and its place in lab/docs/extremes.md."""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from evs.msgs import EvsError
from evs_lab.stress.stress_case import CaseResult

BEGIN = "<!-- written by evs doctor --markdown from here -->"
END = "<!-- to here -->"
HEAD = "| case | scenario | bound | measured | messages and counts |\n|---|---|---|---|---|"


def measured(result: CaseResult) -> str:
    """The measurement with its limit: 0.263 thresholds, at most 1."""
    if result.measurement is None:
        return f"stopped by {result.error}"
    found = result.measurement
    value = f"{_number(found.value)} {found.unit}".rstrip()
    text = f"{value}, at most {_number(found.limit)}"
    if found.recovered:
        return text
    return f"{text}, and the stream or its report is wrong afterwards"


def table(every: Iterable[CaseResult]) -> str:
    """One table for each group, in the order given; no newline at the end."""
    parts: dict[str, list[str]] = {}
    for result in every:
        case = result.case
        mark = "" if result.holds else "**FAILS** "
        messages = "; ".join(result.measurement.messages) if result.measurement is not None else ""
        cells = (f"`{case.name}`", case.what, case.bound, mark + measured(result), messages)
        row = " | ".join(_cell(cell) for cell in cells)
        parts.setdefault(case.group, []).append(f"| {row} |")
    return "\n\n".join(
        f"### {group.capitalize()}\n\n" + "\n".join([HEAD, *rows]) for group, rows in parts.items()
    )


def write_table(path: str | Path, every: Iterable[CaseResult]) -> None:
    """Write the table to a new file, or between the lines BEGIN and END of an existing one.

    Raises:
        EvsError: the file cannot be written, or does not have both lines.
    """
    target = Path(path)
    new = f"{BEGIN}\n\n{table(every)}\n\n{END}\n"
    try:
        if target.is_file():
            old = target.read_text(encoding="utf-8")
            if old.count(BEGIN) != 1 or old.count(END) != 1:
                raise EvsError(f"{target} has no place for the table: give it a line {BEGIN} and a "
                               f"line {END}, or name a new file")  # fmt: skip
            before, after = old.split(BEGIN)[0], old.split(END + "\n")[-1]
            new = before + new + after
        target.write_text(new, encoding="utf-8")
    except OSError as reason:
        raise EvsError(f"cannot write '{target}': {reason.strerror}") from None


def rows_of(text: str) -> Iterator[tuple[str, str, str, str]]:
    """(group, name, what, bound) of each row of such tables."""
    group = ""
    for line in text.splitlines():
        if line.startswith("### "):
            group = line[4:].lower()
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)]
        if len(cells) == 7 and cells[1].startswith("`"):
            yield group, cells[1].strip("`"), plain(cells[2]), plain(cells[3])


def plain(cell: str) -> str:
    """The text of a cell."""
    return cell.replace("\\|", "|")


def _cell(text: str) -> str:
    folder = re.escape(tempfile.gettempdir())
    return re.sub(rf"{folder}/tmp\w+/", "", " ".join(text.split())).replace("|", "\\|")


def _number(value: float) -> str:
    if not math.isfinite(value):
        return str(value)
    return f"{value:,.0f}" if value == int(value) and abs(value) < 1e15 else f"{value:.3g}"
