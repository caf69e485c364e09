"""Check that all events of a run arrived: on the bus, at a subscriber and in a recording."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

from evs.drivers.run.report import COMPLETE, Report
from evs.msgs import EvsError

PATIENCE_S = 30.0
"""how long the process may take to end after the stream has ended"""

SILENCE_S = 60.0
"""after so long without a packet it ends by itself, so that no orphan remains"""


class Counter:
    """A subscriber in its own process that counts what arrives: `evs echo ADDRESS --quiet --json`.

    The process runs as long as the `with` block. If it died before an EvsError in the block, what
    ended it replaces that error: a publisher that waited in vain does not know the reason.
    """

    def __init__(self, address: str) -> None:
        self.address = address

    def __enter__(self) -> Counter:
        self._folder = tempfile.TemporaryDirectory()
        self._file = Path(self._folder.name) / "counted.json"
        self._complaints = Path(self._folder.name) / "complaints.txt"
        command = [sys.executable, "-P", "-m", "evs.launch.main", "echo", self.address, "--quiet"]
        with self._complaints.open("w") as complaints:
            self._process = subprocess.Popen(
                [*command, "--timeout", f"{SILENCE_S:g}", "--json", str(self._file)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=complaints,
                # Ctrl-C is for the publisher; this process ends when the stream does
                start_new_session=True,
            )
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if isinstance(error, EvsError):
                self._raise_if_failed()
        finally:
            self._process.kill()
            self._process.wait()
            self._folder.cleanup()

    def totals(self) -> dict[str, Any]:
        """Wait until it ends; return what it counted.

        Raises:
            EvsError: it failed, or does not end.
        """
        try:
            self._process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            raise EvsError(
                f"the subscriber of {self.address} does not end: try again with fewer programs "
                "running"
            ) from None
        self._raise_if_failed()
        counted: dict[str, Any] = json.loads(self._file.read_text(encoding="utf-8"))
        return counted

    def _raise_if_failed(self) -> None:
        code = self._process.poll()
        if code:
            lines = self._complaints.read_text(errors="replace").strip().splitlines()
            reason = lines[-1].removeprefix("evs: ") if lines else f"exit code {code}"
            raise EvsError(f"the subscriber's process failed: {reason}") from None


@dataclass(frozen=True)
class AuditedReport(Report):
    """The run report and what became of the events."""

    subscriber: dict[str, Any] = field(default_factory=dict)
    """what a subscriber counted, as `evs echo --json` writes it"""
    recording: dict[str, Any] = field(default_factory=dict)
    """`file` and the number of `events` that were read back from it"""
    faults: list[str] = field(default_factory=list)
    """what does not agree, one line each; empty if nothing was lost"""


def audit(report: Report, subscriber: Mapping[str, Any], recording: Mapping[str, Any]) -> list[str]:
    """Compare a run with its subscriber and its recording.

    Args:
        report: of a run with one zmq sink.
        subscriber: Subscription.totals() of a subscriber that was there from the first packet.
        recording: `file`, and the number of `events` that were read back from it.

    Returns:
        A line for each difference; empty if every event arrived everywhere.
    """
    sent = next((sink for sink in report.sinks if sink.get("type") == "zmq"), {})
    found = []
    if report.ended != COMPLETE:
        found.append(f"the run did not end by itself: {report.ended}")
    if not report.events:
        found.append("the sensor made no events")
    for what, made in (("packets", report.packets), ("events", report.events)):
        for who, got in (
            ("sent", sent.get(f"{what}_sent", 0)),
            ("received by the subscriber", subscriber.get(what, 0)),
        ):
            if got != made:
                found.append(f"{made:,} {what} were made, but {got:,} {who}")
    if subscriber.get("lost"):
        found.append(f"the subscriber lost {subscriber['lost']:,} packets")
    if not subscriber.get("ended"):
        found.append("the subscriber never heard that the stream ended")
    if recording.get("events") != report.events:
        found.append(
            f"{report.events:,} events were made, but {recording.get('events', 0):,} "
            f"read back from {recording.get('file')}"
        )
    return found


def audited(
    report: Report, subscriber: Mapping[str, Any], recording: Mapping[str, Any]
) -> AuditedReport:
    """The report with what `audit` finds."""
    fields = {name: getattr(report, name) for name in Report.__dataclass_fields__}
    faults = audit(report, subscriber, recording)
    return AuditedReport(
        **fields, subscriber=dict(subscriber), recording=dict(recording), faults=faults
    )
