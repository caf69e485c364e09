"""`evs info FILE`: describe a recording; `--repair` it; print its `--camera-info`."""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING

from evs.launch.support.options import add_reading_options, reading_options
from evs.launch.support.reinvoke import command

if TYPE_CHECKING:
    from evs.drivers.files import Summary
    from evs.msgs import StreamInfo


def configure(parser: argparse.ArgumentParser) -> None:
    """The command line of `evs info`."""
    from evs.drivers.files import endings

    parser.add_argument("file", metavar="FILE", help=f"a recording: {endings()}")
    parser.add_argument(
        "--repair",
        action="store_true",
        help="first remove a truncated tail in place; every complete packet is kept",
    )
    add_reading_options(parser)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print one JSON object instead of lines")
    form.add_argument(
        "--camera-info",
        action="store_true",
        help="print the camera's calibration instead, as YAML for ROS's camera_info_manager",
    )


def run(args: argparse.Namespace) -> int:
    """Repair if asked to, then print the summary."""
    from evs.drivers.files import calibration_yaml, parts, repair, stream_of, summary

    paths = [args.file] if args.single or not args.repair else parts(args.file)
    repaired = [repair(path) for path in paths] if args.repair else []
    if args.camera_info:
        print(calibration_yaml(stream_of(args.file, **reading_options(args))), end="")
        return 0
    found = summary(args.file, **reading_options(args))
    if args.json:
        data = dataclasses.asdict(found)
        data |= {"duration_s": found.duration_s, "rate_hz": found.rate_hz}
        if repaired:
            cut = sum(one.cut_bytes for one in repaired)
            data |= {"repaired": any(one.needed for one in repaired), "cut_bytes": cut}
        print(json.dumps(data, default=str))
        return 0
    for one in repaired:
        print(one)
    for name, value in _lines(found):
        print(f"{name:11s} {value}")
    return 0


def _lines(found: Summary) -> list[tuple[str, str]]:
    """(name, value) of each line."""
    from evs.drivers.files.formats import by_name
    from evs.drivers.files.multi_file import later_parts
    from evs.drivers.files.recording_file import stream_title

    stream = found.stream
    rate = "" if found.rate_hz is None else f", {found.rate_hz:,.0f} per second"
    table = f", data table {'present' if found.table else 'absent'}"
    versions = ", ".join(f"{name} {number}" for name, number in stream.versions.items())
    lines = [
        ("file", f"{found.path}, {found.size:,} bytes, compression {found.compression}"),
        ("format", by_name(found.format).title),
        ("resolution", f"{stream.width} x {stream.height} px"),
        ("camera", f"{stream.camera} (sensor {stream.sensor}, tick {stream.tick_us} us)"),
        ("events", f"{found.events:,} ({found.on:,} ON, {found.off:,} OFF){rate}"),
        ("time", f"{found.duration_s:.6f} s, from {found.first_us:,} to {found.last_us:,} us"),
        ("packets", f"{found.packets:,}{table if found.format == 'aedat4' else ''}"),
        *_beside(found),
        ("seed", str(stream.seed)),
        *_randomised(stream),
        ("versions", versions or "not given"),
    ]
    if found.read_as:
        lines.insert(2, ("read as", found.read_as))
    if found.files:
        lines.insert(1, ("files", f"{len(found.files)}, up to {found.files[-1]}"))
    later = [path for path in later_parts(Path(found.path)) if str(path) not in found.files]
    if later:
        more = f" and {len(later) - 1} more" if len(later) > 1 else ""
        lines.append(("goes on in", f"{later[0]}{more}"))
    if len(found.streams) > 1:
        first, *others = (stream_title(key, name) for key, name in found.streams.items())
        keys = list(found.streams)[1:]
        lines.append(("streams", f"{first} is read"))
        lines += [("", f"{one}: --stream {key}") for one, key in zip(others, keys, strict=True)]
    if found.left_out:
        text = ", ".join(f"{count:,} {what}" for what, count in found.left_out.items())
        lines.append(("left out", text))
    if found.damaged_packets:
        what = found.damaged_what
        lines.append(("damaged", f"{found.damaged_packets:,} {what} between whole ones"))
    if found.backwards:
        lines.append(("backwards", found.backwards))
    repair = command("info", "--repair", str(found.path))
    if found.broken_pointer:
        lines.append(("pointer", f"to a missing data table; {repair} removes it"))
    if found.unfinished:
        lines.append(("unfinished", f"other programs want the end that {repair} gives it"))
    if found.torn_at is not None:
        where = f"{found.torn_bytes:,} bytes at offset {found.torn_at:,}"
        lines.append(("torn", f"{where}; {repair} cuts them"))
    return lines


def _randomised(stream: StreamInfo) -> list[tuple[str, str]]:
    """A line for the values of a sensor and a scene that were drawn from ranges."""
    record = stream.config.get("randomised")
    tables = [record.get(name) for name in ("values", "scene")] if isinstance(record, dict) else []
    values = {key: one for table in tables if isinstance(table, dict) for key, one in table.items()}
    if not values:
        return []
    return [("randomised", ", ".join(f"{key} {value}" for key, value in values.items()))]


def _beside(found: Summary) -> list[tuple[str, str]]:
    """Lines on what a recording holds beside events; none for events alone."""
    lines = []
    for name, there, count, rate_hz, unit in (
        ("frames", found.stream.frames, found.frames, found.frame_rate_hz, "intensity frames"),
        ("imu", found.stream.imu, found.imu_samples, found.imu_rate_hz, "samples"),
    ):
        if there or count:
            rate = "" if rate_hz is None else f", {rate_hz:,.1f} per second"
            lines.append((name, f"{count:,} {unit}{rate}"))
    if found.stream.triggers or found.triggers:
        lines.append(("triggers", f"{found.triggers:,}"))
    return lines
