"""`evs play FILE`: publish a recording, in real time, at another speed or at once."""

from __future__ import annotations

import argparse
import math
import sys
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING

from evs.launch.support.options import add_single_option
from evs.msgs import DEFAULT_ADDRESS, EvsError, Frame, ImuPacket, TriggerPacket

if TYPE_CHECKING:
    from evs.drivers.bus import Publisher

HELP = "publish a recording on the bus, as the camera did"


def configure(parser: argparse.ArgumentParser) -> None:
    """The command line of `evs play`."""
    from evs.drivers.files import endings

    parser.add_argument("file", metavar="FILE", help=f"a recording: {endings()}")
    parser.add_argument(
        "--address",
        default=DEFAULT_ADDRESS,
        metavar="ADDR",
        help="where to publish (default: %(default)s)",
    )
    add_single_option(parser)
    pace = parser.add_mutually_exclusive_group()
    pace.add_argument(
        "--speed",
        type=float,
        default=1.0,
        metavar="S",
        help="playback speed: 0.1 is ten times slower than recorded (default: %(default)s)",
    )
    pace.add_argument("--fast", action="store_true", help="play as fast as possible")
    parser.add_argument(
        "--wait-for",
        type=int,
        default=0,
        metavar="N",
        help="wait for N subscribers before the start",
    )
    parser.add_argument(
        "--wait", type=float, default=10.0, metavar="S", help="wait at most S seconds for them"
    )
    parser.add_argument("--control", default="", metavar="ADDR", help="control port (evs topics)")
    parser.add_argument("--key", default="", metavar="FILE", help="secret key to publish with")
    parser.add_argument(
        "--allow",
        action="append",
        default=[],
        metavar="KEY",
        help="public key of a client that may subscribe",
    )
    parser.add_argument(
        "--insecure", action="store_true", help="let other machines subscribe without a key"
    )


def run(args: argparse.Namespace) -> int:
    """Publish every packet at its time; Ctrl-C ends after the current one."""
    from evs.drivers import files
    from evs.drivers.bus import Publisher
    from evs.drivers.clock import Pacer
    from evs.drivers.run.stop_signals import stop_signals

    if not (math.isfinite(args.speed) and args.speed > 0):
        raise EvsError(f"--speed {args.speed} is not possible: give more than 0, or use --fast")
    stream = files.stream_of(args.file)
    publisher = Publisher(
        args.address,
        wait_for=args.wait_for,
        wait_s=args.wait,
        control=args.control,
        key=args.key,
        allow=args.allow,
        insecure=args.insecure,
    )
    pacer = Pacer(0.0 if args.fast else args.speed)
    with stop_signals() as stopped, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            publisher.open([stream])
            print(f"playing {args.file} on {args.address} (Ctrl-C ends)", file=sys.stderr)
            played = _play(args.file, args.single, pacer.wait_until, publisher, stopped)
        finally:
            report = publisher.close()
    for warning in caught:
        print(f"evs: warning: {warning.message}", file=sys.stderr)
    sent = ", ".join(f"{key} {value}" for key, value in report.items() if key != "type")
    print(f"{args.file}: {played}; {sent}")
    return 130 if stopped else 0


def _play(
    file: str,
    single: bool,
    wait_until: Callable[[int], None],
    publisher: Publisher,
    stopped: list[str],
) -> str:
    """Publish every message at its time; returns a summary."""
    from evs.drivers.files import messages

    count = events = frames = samples = triggers = 0
    for message in messages(file, single=single):
        if stopped or publisher.stop_wanted:
            break
        if isinstance(message, Frame):
            wait_until(message.end_us)
            publisher.write_frame(message)
            frames += 1
        elif isinstance(message, ImuPacket):
            wait_until(int(message.samples["t"][-1]))
            publisher.write_imu(message)
            samples += len(message)
        elif isinstance(message, TriggerPacket):
            # the bus has no topic for them
            triggers += len(message)
        else:
            wait_until(message.time_end_us)
            publisher.write(message)
            count += 1
            events += len(message)
    others = f", {frames:,} frames" if frames else ""
    others += f", {samples:,} IMU samples" if samples else ""
    others += f", {triggers:,} triggers left out (the bus has none)" if triggers else ""
    return f"{count:,} packets, {events:,} events{others}"
