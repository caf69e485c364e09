"""`evs record ADDRESS FILE`: record what a camera publishes."""

from __future__ import annotations

import argparse
import sys

from evs.launch.support.options import add_key_options
from evs.launch.support.reinvoke import command
from evs.msgs import EVENTS, EvsError

_QUEUE = 100 * EVENTS.queue
"""packets that may wait while the disk is busy: 100 s of them at 1 kHz"""

_GAPS_SHOWN = 5


def configure(parser: argparse.ArgumentParser) -> None:
    """The command line of `evs record`."""
    parser.usage = "evs record ADDRESS FILE [options]"
    parser.add_argument("address", metavar="ADDRESS", help="a publisher, e.g. tcp://127.0.0.1:5560")
    parser.add_argument(
        "file", metavar="FILE", help="the recording; its extension selects the format"
    )
    parser.add_argument(
        "--camera", default="", metavar="NAME", help="camera to record, if there are several"
    )
    parser.add_argument("--duration", type=float, metavar="S", help="simulated seconds to record")
    parser.add_argument(
        "--timeout", type=float, metavar="S", help="end after S seconds without a packet"
    )
    parser.add_argument("--force", action="store_true", help="replace an existing file")
    parser.add_argument(
        "--beside",
        action="store_true",
        help="if FILE exists, record to FILE-1 beside it, such as run-1.aedat4; evs launch adds "
        "this when it restarts a recorder",
    )
    add_key_options(parser)
    parser.epilog = (
        "Ends with the camera, --duration, --timeout or Ctrl-C; the file is always complete. Exit\n"
        "code 1 if packets were lost; the losses are printed and written to FILE.report.json."
    )


def run(args: argparse.Namespace) -> int:
    """Record, and print a summary; 1 if packets were lost."""
    from evs.drivers.bus import subscribe
    from evs.drivers.files.paths import check_new, free_number, numbered_path
    from evs.drivers.run.stop_signals import stop_signals
    from evs.drivers.run.stream_recorder import StreamRecorder

    for option in ("duration", "timeout"):
        value = getattr(args, option)
        if value is not None and not value > 0:
            raise EvsError(f"--{option} {value} is not possible: give more than 0 seconds")
    if args.beside:
        args.file = numbered_path(args.file, free_number([args.file]))
    elif not args.force:
        check_new([args.file])
    listening = subscribe(
        args.address,
        args.camera,
        queue=_QUEUE,
        frames=True,
        imu=True,
        camera_info=True,
        server_key=args.server_key,
        key=args.key,
    )
    with listening as stream, stop_signals() as stopped:
        recorder = StreamRecorder(stream, args.file, warn=_warn)
        print(f"recording {stream.address} to {args.file} (Ctrl-C ends)", file=sys.stderr)
        recorded = recorder.run(stopped, args.duration, args.timeout)
    counts = f"{recorded.packets:,} packets, {recorded.events:,} events"
    counts += f", {recorded.frames:,} frames" if recorded.frames else ""
    counts += f", {recorded.imu_samples:,} IMU samples" if recorded.imu_samples else ""
    print(f"{recorded.file}: {counts}, {recorded.lost:,} packets lost; {recorded.ended}")
    for gap in recorded.gaps[:_GAPS_SHOWN]:
        print(f"  lost: {gap}")
    if len(recorded.gaps) > _GAPS_SHOWN:
        print(f"  ... and in other places: {recorded.file}.report.json has them")
    if not recorded.lost:
        print(f"  {command('info', recorded.file)}")
    return 1 if recorded.lost else 0


def _warn(line: str) -> None:
    print(f"evs: warning: {line}", file=sys.stderr)
