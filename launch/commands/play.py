"""`evs play FILE`: publish a recording, in real time, at another speed or at once."""

from __future__ import annotations

import argparse
import math
import sys
import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from evs.launch.support.options import add_reading_options, reading_options
from evs.msgs import DEFAULT_ADDRESS, EvsError

if TYPE_CHECKING:
    from evs.drivers.sink_config import SinkConfig

EPILOG = """\
examples:
  evs play run.aedat4                                    on the bus, in real time
  evs play run.aedat4 --start 1 --stop 2 --rounds 0      one second, again and again
  evs play run.raw sink.0.type=ros2 sink.0.node=camera   as a ROS 2 camera
  evs play run.mcap sink.0.type=dv sink.0.address=tcp://127.0.0.1:7777 --speed 0.1"""


def configure(parser: argparse.ArgumentParser) -> None:
    """The command line of `evs play`."""
    from evs.drivers.files import endings

    parser.epilog = EPILOG
    parser.add_argument("file", metavar="FILE", help=f"a recording: {endings()}")
    parser.add_argument(
        "words",
        nargs="*",
        metavar="sink.N.key=value",
        help="sinks other than the bus, with the keys of [[sink]] (evs emulate --help)",
    )
    add_reading_options(parser)
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
        "--start",
        type=float,
        metavar="S",
        help="start, s after the first event (default: the first message)",
    )
    parser.add_argument(
        "--stop", type=float, metavar="S", help="end, s after the first event (default: the last)"
    )
    parser.add_argument(
        "--rounds",
        type=int,
        default=1,
        metavar="N",
        help="play it N times, with increasing time stamps; 0: until Ctrl-C (default: %(default)s)",
    )
    bus = parser.add_argument_group("the bus, without other sinks")
    bus.add_argument(
        "--address", metavar="ADDR", help=f"where to publish (default: {DEFAULT_ADDRESS})"
    )
    bus.add_argument(
        "--wait-for", type=int, metavar="N", help="wait for N subscribers before the start"
    )
    bus.add_argument(
        "--wait", type=float, metavar="S", help="wait at most S seconds for them (default: 10)"
    )
    bus.add_argument("--control", metavar="ADDR", help="control port (evs topics)")
    bus.add_argument("--key", metavar="FILE", help="secret key to publish with")
    bus.add_argument(
        "--allow", action="append", metavar="KEY", help="public key of a client that may subscribe"
    )
    bus.add_argument(
        "--insecure",
        action="store_const",
        const=True,
        help="let other machines subscribe without a key",
    )


def run(args: argparse.Namespace) -> int:
    """Play every message at its time; Ctrl-C ends after the current one."""
    from evs.drivers.clock import Pacer
    from evs.drivers.run.config import make_sink
    from evs.drivers.run.player import Player
    from evs.drivers.run.sink_set import SinkSet
    from evs.drivers.run.stop_signals import stop_signals
    from evs.emulator.base.protocols import NoMeter

    if not (math.isfinite(args.speed) and args.speed > 0):
        raise EvsError(f"--speed {args.speed} is not possible: give more than 0, or use --fast")
    tables = _sinks(args)
    made = [make_sink(table) for table in tables]
    sinks = SinkSet(made, NoMeter(), _warn)
    player = Player(
        args.file,
        sinks,
        Pacer(0.0 if args.fast else args.speed),
        start_us=_us("--start", args.start),
        stop_us=_us("--stop", args.stop),
        rounds=args.rounds,
        reading=reading_options(args),
    )
    where = ", ".join(table.address or table.file or table.type for table in tables)
    begun = f"playing {args.file} to {where} (Ctrl-C ends)"
    with stop_signals() as stopped, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            player.play(stopped, lambda: print(begun, file=sys.stderr))
        finally:
            failure = sinks.close()
    if failure is not None:
        raise failure
    # every round warns again
    for line in dict.fromkeys(str(warning.message) for warning in caught):
        _warn(line)
    sent = "; ".join(
        ", ".join(f"{key} {value}" for key, value in report.items() if key != "type")
        for report in sinks.reports
    )
    streams = frozenset[str]().union(*(sink.streams for sink in made))
    print(f"{args.file}: {_summary(player.played, streams)}; {sent}")
    return 130 if stopped else 0


def _warn(line: str) -> None:
    print(f"evs: warning: {line}", file=sys.stderr)


def _us(option: str, value_s: float | None) -> int | None:
    if value_s is None:
        return None
    if not math.isfinite(value_s):
        raise EvsError(f"{option} is {value_s:g}: give a number")
    return round(1e6 * value_s)


BUS = {
    "address": "address",
    "wait_for": "wait_for",
    "wait": "wait_s",
    "control": "control",
    "key": "key",
    "allow": "allow",
    "insecure": "insecure",
}
"""option -> key of the bus's table"""


def _sinks(args: argparse.Namespace) -> list[SinkConfig]:
    """The tables of the sinks. EvsError where one is not possible."""
    from evs.drivers.run.config import sinks_of
    from evs.drivers.sink_config import ZmqSink

    given = {
        key: value for option, key in BUS.items() if (value := getattr(args, option)) is not None
    }
    if args.words:
        if given:
            option = next(option for option, key in BUS.items() if key in given)
            raise EvsError(
                f"--{option.replace('_', '-')} is for the bus alone: give sink.N.{BUS[option]}=, "
                "with sink.N.type=zmq"
            )
        return sinks_of(args.words)
    if "allow" in given:
        given["allow"] = tuple(given["allow"])
    return [ZmqSink(**{"address": DEFAULT_ADDRESS, **given})]


def _summary(played: Mapping[str, int], streams: frozenset[Any]) -> str:
    """What was played, and what no sink wanted."""
    found = f"{played['packets']:,} packets, {played['events']:,} events"
    for kind, words in (("frames", "frames"), ("imu", "IMU samples"), ("triggers", "triggers")):
        if played[kind]:
            rest = "" if kind in streams else " left out (no sink takes them)"
            found += f", {played[kind]:,} {words}{rest}"
    return found
