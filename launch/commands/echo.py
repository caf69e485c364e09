"""`evs echo ADDRESS`: what a camera publishes, as `ros2 topic echo`, `hz` and `bw` show it."""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from evs.launch.support.options import add_key_options
from evs.msgs import EventPacket, EvsError

if TYPE_CHECKING:
    from evs.drivers.bus import Rate, Subscription

_SHOWN_EVENTS = 4
_LOOK_S = 1.0
"""how often the connection is checked"""


def configure(parser: argparse.ArgumentParser) -> None:
    """The command line of `evs echo`."""
    parser.add_argument("address", metavar="ADDRESS", help="a publisher, e.g. tcp://127.0.0.1:5560")
    parser.add_argument("--camera", default="", metavar="NAME", help="only this camera")
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--hz", action="store_true", help="print packets and events per second instead"
    )
    what.add_argument("--bw", action="store_true", help="print bytes per second instead")
    what.add_argument(
        "--quiet", action="store_true", help="print only the last line, with the totals"
    )
    parser.add_argument("--frames", action="store_true", help="show intensity frames too")
    parser.add_argument("--imu", action="store_true", help="show IMU samples too")
    parser.add_argument("--poses", action="store_true", help="show the camera's poses too")
    add_key_options(parser)
    parser.add_argument("--count", type=int, metavar="N", help="end after N packets")
    parser.add_argument(
        "--timeout", type=float, metavar="S", help="end after S seconds without a packet"
    )
    parser.add_argument("--json", metavar="FILE", help="write the totals to FILE at the end")


def run(args: argparse.Namespace) -> int:
    """Listen until the publisher ends, --count, --timeout or Ctrl-C; then print the totals."""
    from evs.drivers.bus import subscribe

    if args.count is not None and args.count < 1:
        raise EvsError(f"--count {args.count} is not possible: give 1 or more packets")
    if args.json and not Path(args.json).resolve().parent.is_dir():
        raise EvsError(f"cannot write '{args.json}': its folder does not exist, make it first")
    extra_topics = {"frames": args.frames, "imu": args.imu, "poses": args.poses}
    keys = {"server_key": args.server_key, "key": args.key}
    with subscribe(
        args.address, args.camera, timeout_s=args.timeout, **extra_topics, **keys
    ) as stream:
        with _endings():
            if not args.quiet:
                print(f"listening to {stream.address} (Ctrl-C ends)", file=sys.stderr)
            _listen(stream, args)
        # the counts are a run's result even if nobody reads our lines any more
        with _endings():
            print(_totals(stream), flush=True)
        if args.json:
            _write_json(args.json, stream)
        if stream.packets == 0 and not stream.ended and args.timeout is not None:
            raise EvsError(_nothing(stream, args.timeout))
    return 0


def _listen(stream: Subscription, args: argparse.Namespace) -> None:
    from evs.drivers.bus import Connection, Rates

    # two clocks: the next report is due, and nothing has come for too long
    reports, silence = Rates(), Rates(math.inf if args.timeout is None else args.timeout)
    connection = Connection(stream, _warn)
    periodic = args.hz or args.bw
    alone, first = Rates(_LOOK_S), True
    while not stream.ended:
        until_s = min(silence.remaining_s, reports.remaining_s if periodic else _LOOK_S)
        until_s = min(until_s, alone.remaining_s if first else until_s)
        packet = stream.receive(max(0.0, until_s))
        connection.update()
        if first and alone.remaining_s <= 0:
            first = False
            if stream.packets == 0 and not stream.connected:
                _print_message(
                    f"nobody answers at {stream.address} yet; it waits until a camera is there"
                )
        if packet is not None:
            silence.take()
            reports.add(len(packet), packet.events.nbytes)
            if not (periodic or args.quiet):
                for line in _lines_of_other_topics(stream):
                    print(line)
                print(_line(packet), flush=True)
        if periodic and reports.remaining_s <= 0:
            print((_hz if args.hz else _bw)(reports.take(), stream.lost), flush=True)
        if silence.remaining_s <= 0 or (args.count is not None and stream.packets >= args.count):
            break


def _warn(line: str) -> None:
    _print_message(f"warning: {line}")


def _print_message(line: str) -> None:
    print(f"evs: {line}", file=sys.stderr, flush=True)


def _line(packet: EventPacket) -> str:
    """One packet as one line: `t:(x,y)+` is an ON event at t us."""
    events = packet.events
    on = int(events["p"].sum())
    first = [
        f"{e['t']}:({e['x']},{e['y']}){'+' if e['p'] else '-'}" for e in events[:_SHOWN_EVENTS]
    ]
    more = " ..." if len(events) > _SHOWN_EVENTS else ""
    return (
        f"{packet.camera} seq {packet.seq}  t {packet.time_end_us / 1e6:.6f} s  "
        f"n {len(events)} (ON {on}, OFF {len(events) - on})  {' '.join(first)}{more}"
    ).rstrip()


def _lines_of_other_topics(stream: Subscription) -> Iterator[str]:
    """A line for each frame and each IMU sample that came with the last packet."""
    for frame in stream.frames:
        exposure_us = frame.exposure_end_us - frame.exposure_begin_us
        yield (
            f"{frame.camera} frame {frame.seq}  t {frame.exposure_begin_us / 1e6:.6f} s  "
            f"exposure {exposure_us} us  {frame.width}x{frame.height} {frame.pixels.dtype}  "
            f"mean {frame.pixels.mean():.1f}"
        )
    for pose in stream.poses:
        at, turn = (
            " ".join(f"{value:.4f}" for value in vector)
            for vector in (pose.position, pose.orientation)
        )
        yield f"{pose.camera} pose  t {pose.t_us / 1e6:.6f} s  at {at} m  quaternion {turn}"
    for packet in stream.imu:
        for sample in packet.samples:
            force, turn = (
                " ".join(f"{axis:.3f}" for axis in sample[key])
                for key in ("acceleration", "angular_velocity")
            )
            yield f"{packet.camera} imu  t {sample['t'] / 1e6:.6f} s  {force} m/s^2  {turn} rad/s"


def _hz(rate: Rate, lost: int) -> str:
    if not rate.packets:
        return f"no packets  lost {lost}"
    return (
        f"packets {rate.packets_hz:.1f}/s  events {rate.events_hz:.0f}/s  "
        f"apart {1e3 * rate.shortest_s:.2f} ... {1e3 * rate.longest_s:.2f} ms  lost {lost}"
    )


def _bw(rate: Rate, lost: int) -> str:
    if not rate.packets:
        return f"no packets  lost {lost}"
    mean = rate.bytes_hz / rate.packets_hz
    return f"{rate.bytes_hz / 1e6:.3f} MB/s  {rate.packets} packets of {mean:.0f} B  lost {lost}"


def _totals(stream: Subscription) -> str:
    parts = [f"packets {stream.packets}", f"events {stream.events}", f"lost {stream.lost}"]
    if stream.restarts:
        parts.append(f"restarts {stream.restarts}")
    for (topic, camera), gaps in stream.gaps.items():
        parts.append(f"{topic}/{camera} {gaps.count}, lost {gaps.lost}")
    if stream.bad_messages:
        parts.append(f"bad messages {stream.bad_messages}")
    return "  ".join(parts)


def _nothing(stream: Subscription, timeout_s: float) -> str:
    name = f", with a camera named '{stream.camera}'" if stream.camera else ""
    return (
        f"nothing came from {stream.address} within {timeout_s:g} s: "
        f"is a publisher running there{name}? (evs emulate starts one)"
    )


def _write_json(file: str, stream: Subscription) -> None:
    try:
        Path(file).write_text(json.dumps(stream.totals(), indent=2) + "\n", encoding="utf-8")
    except OSError as reason:
        raise EvsError(f"cannot write '{file}': {reason.strerror}") from None


@contextmanager
def _endings() -> Iterator[None]:
    """Ctrl-C, SIGTERM (`timeout 5 evs ...`) and a closed pipe (`| head`) only end the listening."""
    main = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGTERM, signal.default_int_handler) if main else None
    try:
        yield
    except KeyboardInterrupt:
        pass
    except BrokenPipeError:
        # nothing may fail again when Python flushes its output at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    finally:
        if main:
            signal.signal(signal.SIGTERM, before)
