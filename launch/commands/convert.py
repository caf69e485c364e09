"""`evs convert IN OUT`: a recording of one format into a file of another."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Callable

from evs.launch.support.options import add_single_option
from evs.launch.support.reinvoke import command

HELP = "write a recording in another format: IN and OUT go by their endings"

EPILOG = """\
examples:
  evs convert run.aedat4 run.csv
  evs convert run.aedat4 run.aedat --events-only     drop frames and IMU, which .aedat cannot hold
  evs convert davis.aedat run.aedat4 --compression zstd

OUT appears when it is complete. If OUT cannot hold all data of IN, the command stops before it
writes anything.

formats:
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """The command line of `evs convert`."""
    parser.add_argument("source", metavar="IN", help="a recording")
    parser.add_argument(
        "target", metavar="OUT", help="the file to write; its ending selects the format"
    )
    parser.add_argument(
        "--format", metavar="NAME", help="the format, if the ending does not select it"
    )
    parser.add_argument(
        "--compression", metavar="NAME", help="lz4, zstd or none, for formats with compression"
    )
    parser.add_argument(
        "--encoding", metavar="NAME", help="encoding in ROS bags: evt3, libcaer, mono or dvs"
    )
    parser.add_argument(
        "--events-only",
        action="store_true",
        help="leave out frames, IMU, triggers and labels that OUT cannot hold",
    )
    parser.add_argument(
        "--start",
        choices=("shift", "keep"),
        default="shift",
        help="if OUT cannot hold the stamps (Unix time): shift (default): start its clock at the "
        "first stamp and record the offset in its header; keep: stop with an error",
    )
    parser.add_argument("--force", action="store_true", help="replace OUT if it exists")
    add_single_option(parser)
    parser.add_argument(
        "--quiet", action="store_true", help="print nothing but warnings and errors"
    )
    parser.epilog = EPILOG + "\n".join(_formats())


def run(args: argparse.Namespace) -> int:
    """Convert, and print a summary."""
    from evs.drivers.files import convert, to_write
    from evs.drivers.files.paths import check_new
    from evs.launch.support import terminal

    wanted = {"compression": args.compression, "encoding": args.encoding}
    options = {key: value for key, value in wanted.items() if value is not None}
    steps = 1000
    to_write(args.target, args.format)
    if not args.force:
        check_new([args.target])
    with terminal.bar("converting", steps, args.quiet) as moved:
        done = convert(
            args.source,
            args.target,
            args.format,
            events_only=args.events_only,
            single=args.single,
            keep_start=args.start == "keep",
            progress=_step_by_step(moved, steps),
            **options,
        )
    if args.quiet:
        return 0
    counts = [("events", done.events), ("frames", done.frames)]
    counts += [("IMU samples", done.imu_samples), ("triggers", done.triggers)]
    counted = ", ".join(f"{count:,} {what}" for what, count in counts if count or what == "events")
    several = f" in {len(done.files)} files" if len(done.files) > 1 else ""
    print(f"{args.target}: {counted}, {done.size / 1e6:.2f} MB{several}")
    if done.start_us is not None:
        print(f"start: its clock begins at {done.start_us} us; its header holds this offset")
    if done.left_out:
        left = ", ".join(f"{count:,} {what}" for what, count in done.left_out.items())
        print(f"left out: {left}")
    print(f"next:\n  {command('info', args.target)}")
    return 0


def _step_by_step(moved: Callable[[int, str], None], steps: int) -> Callable[[float], None]:
    """A callback that moves a bar by a share, only when it reaches another step."""
    shown = -1

    def move(share: float) -> None:
        nonlocal shown
        step = int(steps * share)
        if step != shown:
            moved(step, "")
            shown = step

    return move


def _formats() -> list[str]:
    """What there is, a line or two each."""
    from evs.drivers.files import FORMATS

    lines = []
    for one in FORMATS:
        holds = one.capabilities
        facts = [name for name in ("frames", "imu", "triggers", "labels") if getattr(holds, name)]
        facts += [f"{holds.width} x {holds.height} px at most"] if holds.height < 1 << 15 else []
        facts += [f"stamps from {holds.first_us} us"] if holds.first_us >= 0 else []
        facts += [f"extra {one.extra}"] if one.extra else []
        ends = ", ".join(one.suffixes + tuple(f"({also})" for also in one.shared_suffixes))
        description = one.title + (f" ({', '.join(facts)})" if facts else "")
        lead = f"  {one.name:8s} {ends:18s} "
        lines += textwrap.wrap(
            description, 100, initial_indent=lead, subsequent_indent=" " * len(lead)
        )
    return lines
