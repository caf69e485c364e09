"""Check that all events arrived: on the bus, at a subscriber and in a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from evs.drivers.run.report import COMPLETE, Report


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
    """What does not agree between a run, its subscriber and its recording, one line each.

    In: a report with one zmq sink; Subscription.totals() of a subscriber that was there from the
    first packet; `file`, `events` read back. Out: empty if every event arrived everywhere.
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
