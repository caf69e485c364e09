"""`evs topics CONTROL`: list the topics of a camera and their subscribers, or stop its run."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from evs.emulator.config import decoding
from evs.launch.support.options import add_key_options
from evs.msgs import EvsError

if TYPE_CHECKING:
    from evs.drivers.bus import Described


def configure(parser: argparse.ArgumentParser) -> None:
    """The command line of `evs topics`."""
    parser.add_argument(
        "control", metavar="CONTROL", help="a control port, as in evs emulate --control CONTROL"
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--json", action="store_true", help="print everything as JSON")
    what.add_argument(
        "--status", action="store_true", help="print the totals of each camera as JSON"
    )
    what.add_argument("--camera-info", action="store_true", help="print the calibrations as JSON")
    what.add_argument(
        "--parameters",
        action="store_true",
        help="print the adjustable parameters of each sensor as JSON",
    )
    what.add_argument(
        "--set",
        nargs="+",
        metavar="KEY=VALUE",
        help="change parameters from the next tick on, as in pos_thres=0.3 biases.bias_diff_on=20",
    )
    what.add_argument("--stop", action="store_true", help="ask the camera to end its run")
    parser.add_argument(
        "--timeout",
        type=float,
        default=5.0,
        metavar="S",
        help="seconds to wait (default: %(default)s)",
    )
    parser.add_argument(
        "--camera", default="", metavar="NAME", help="camera of --set, if there are several"
    )
    add_key_options(parser)


def run(args: argparse.Namespace) -> int:
    """Send the request and print the answer."""
    from evs.drivers.bus import discover, request

    with_keys: dict[str, Any] = {
        "timeout_s": args.timeout,
        "server_key": args.server_key,
        "key": args.key,
    }
    if args.stop:
        request(args.control, "stop", **with_keys)
        print("it stops")
    elif args.set:
        wanted = {"camera": args.camera, "values": _values(args.set)}
        answer = request(args.control, "set", wanted, **with_keys)
        print(json.dumps(answer["cameras"], indent=2))
    elif args.parameters:
        print(json.dumps(request(args.control, "parameters", **with_keys)["cameras"], indent=2))
    elif args.status or args.camera_info:
        name = "status" if args.status else "camera_info"
        print(json.dumps(request(args.control, name, **with_keys)["cameras"], indent=2))
    else:
        found = discover(args.control, **with_keys)
        print(json.dumps(asdict(found), indent=2) if args.json else _table(found))
    return 0


def _values(words: list[str]) -> dict[str, float]:
    """The numbers of KEY=VALUE; whole ones are integers. Raises EvsError."""
    found: dict[str, float] = {}
    for key, text in map(decoding.split_word, words):
        try:
            found[key] = int(text) if text.lstrip("+-").isdigit() else float(text)
        except ValueError:
            raise EvsError(f"{key}={text}: give a number") from None
    return found


def _table(found: Described) -> str:
    """A line for each topic of each camera, then where they are."""
    rows: list[tuple[str, ...]] = [("topic", "message", "rate", "queue", "listeners")]
    for topic in found.topics:
        facts = [str(topic[key]) for key in ("message", "rate", "queue")]
        if not topic["per_camera"]:
            rows.append((f"{topic['name']}/", *facts, ""))
            continue
        for camera in found.cameras:
            listeners = str(camera["subscribers"].get(topic["name"], 0))
            rows.append((f"{topic['name']}/{camera['camera']}", *facts, listeners))
    wide = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, wide, strict=True)).rstrip()
        for row in rows
    ]
    for camera in found.cameras:
        size = f"{camera['width']} x {camera['height']}"
        lines.append(f"camera {camera['camera']}: {camera['sensor']}, {size} px")
    lines.append(f"packets {found.address}")
    if found.latest:
        lines.append(f"newest state {found.latest}")
    return "\n".join(lines)
