"""`evs launch FILE.toml [NAME:=VALUE]`: start several programs, as a ROS launch file does."""

from __future__ import annotations

import argparse
import shlex
import sys
import threading


def configure(parser: argparse.ArgumentParser) -> None:
    """The command line of `evs launch`."""
    parser.usage = "evs launch FILE.toml [NAME:=VALUE ...] [--show]"
    parser.epilog = (
        "Subscribers start before their publishers, and a camera waits for them. One Ctrl-C\n"
        "stops every node, publishers first; a second one kills the remaining nodes. The exit\n"
        "code is that of the worst node. config/launch/stereo.toml shows every key; evs launch\n"
        "stereo runs it. pencil, goalie, cartpole: closed loops; controller: a loop with your own\n"
        "program; ros2: a camera for ROS 2."
    )
    parser.add_argument(
        "file", metavar="FILE.toml", help="a launch file, or the name of one that comes with evs"
    )
    parser.add_argument(
        "given", nargs="*", default=[], metavar="NAME:=VALUE", help="an argument of the file"
    )
    parser.add_argument(
        "--show", action="store_true", help="print the commands in order and run nothing"
    )


def run(args: argparse.Namespace) -> int:
    """Run the plan; the worst node's exit code."""
    from evs.drivers.run.launcher.plan import read_plan
    from evs.drivers.run.launcher.supervise import Launch, check_programs

    plan = read_plan(args.file, args.given)
    if args.show:
        for name, value in plan.arguments.items():
            print(f"{name} := {value}")
        for node in plan.nodes:
            print(f"{node.name}: {shlex.join(node.run)}")
        return 0
    check_programs(plan)
    one_line = threading.Lock()

    def print_output(name: str, line: str) -> None:
        with one_line:
            print(f"[{name}] {line}", flush=True)

    def print_message(line: str) -> None:
        with one_line:
            print(f"launch: {line}", file=sys.stderr, flush=True)

    return Launch(plan, print_output, print_message).run()
