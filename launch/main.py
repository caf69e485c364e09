"""`evs`: find the command, run it, turn an EvsError into one line and exit code 2."""

from __future__ import annotations

import argparse
import errno
import importlib
import io
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

from evs import __version__
from evs.emulator.base.memory_limits import address_space_left
from evs.launch.support import plugins
from evs.msgs import EvsError, nearest_first, unknown

GROUPS = {
    "Run a camera": {
        "demo": "the whole pipeline: a robot, its events sent to another process, recorded, drawn",
        "emulate": "run a scene through the event camera: publish it, record it",
        "launch": "run cameras, recorders, viewers and controllers together, from one file",
        "loop": "closed-loop examples: balance a pencil or guard a goal with event cameras",
    },
    "See what it would do": {
        "plan": "what a scene requires: which code paths are on or off, and why",
        "render": "render luminance, colour, depth, normals, ids and optical flow to an .npz file",
        "sensors": "list the sensors, or every parameter of one with its source",
    },
    "Watch a running camera": {
        "echo": "show what a camera publishes: its packets, their rate or their bandwidth",
        "topics": "list what a camera publishes through its control port, or stop it",
        "record": "record what a camera publishes: events, frames and IMU",
    },
    "Recordings": {
        "view": (
            "draw a recording as a picture or film (.png, .gif, .mp4); --live: show a live camera"
        ),
        "info": "describe a recording and check whether it is complete; --repair cuts a torn end",
        "convert": (
            "write a recording in another format, or turn a film or a folder of frames into events"
        ),
        "play": "publish a recording on the bus, as the camera did",
    },
    "Data and training": {
        "dataset": "make a data set: events, RGB, depth, flow, segmentation, IMU, poses, causes",
    },
    "Set up": {
        "doctor": "check this machine: packages, processor, a trial run, and the extremes",
        "keygen": "make a key pair, which protects a camera on the network",
        "schema": (
            "print the JSON Schema of pipelines, which lets an editor complete and check them"
        ),
        "completion": "print the lines that make bash, zsh or fish complete evs commands",
    },
}
"""Heading -> command -> what it does, in one line.

A command is the module of its name in launch/commands; to add one, write it and list it here. The
module has configure(parser), which adds the arguments, and run(args), which returns the exit code.
epilog(), if any, makes what help says below the options, where that takes long.
SUBCOMMANDS = True: the first word is a command of its own. What several commands share is in
launch/support."""

COMMANDS = {name: what for group in GROUPS.values() for name, what in group.items()}

LAB = ("characterise", "evaluate", "fit", "realism", "sweep", "train", "tune")
"""Commands of evs-lab, a distribution of its own."""

ABOUT = """evs: an event camera for MuJoCo scenes.

It stands in for a real DVS, DAVIS or EVK camera, with the same topics, files and parameters.
The world in front of the lens is a MuJoCo model. Physics advances in ticks of 1 ms, rays are
traced in every tick, and each pixel reports only changes."""

EXAMPLES = """Examples:
  evs emulate humanoid.xml --record run.aedat4
      record one simulated second of a robot with a DAVIS346, to a file that DV opens
  evs emulate humanoid.xml --publish tcp://127.0.0.1:5560 --pace realtime --duration 60
      publish a live stream, as a camera does; `evs echo tcp://127.0.0.1:5560 --hz` subscribes
  evs view run.aedat4 -o run.gif
      look at a recording

`evs COMMAND --help` describes a command; `evs doctor` checks this machine."""


MORE_MEMORY = (
    "take a smaller sensor, fewer threads or higher thresholds, or raise the limit of this shell "
    "or container (ulimit -v)"
)
INSTALL = "install evs again, or raise the memory limit if there is one (ulimit -v)"
LEAST_BYTES = 220_000_000
"""of address space: what a small scene takes. With less, some library, or the C library itself,
aborts the process while it is loaded, each with another message."""
MOST_NUMBER = 2**31 - 1
"""The largest whole number of an option: threads, pixels, seeds, counts."""


class Parser(argparse.ArgumentParser):
    """An ArgumentParser whose errors are EvsErrors: one line that says how to get help."""

    def __init__(self, *args: Any, **options: Any) -> None:
        """See `ArgumentParser`; every `type=int` is bounded."""
        super().__init__(*args, **options)
        self.register("type", int, _whole_number)
        self.late_epilog: Callable[[], str] | None = None
        """Makes the epilog when help is printed, for one that takes long."""

    def format_help(self) -> str:
        """The help, with the epilog that is made only now."""
        if self.late_epilog is not None:
            self.epilog = self.late_epilog()
        return super().format_help()

    def error(self, message: str) -> NoReturn:
        """Raise an EvsError, with the nearest known option if one was misspelt."""
        word = message.removeprefix("unrecognized arguments: ").split(" ")[0].partition("=")[0]
        if word != message and word.startswith("--"):
            known = [name for name in self._option_string_actions if name.startswith("--")]
            message += f"; nearest: {nearest_first(word, known)[0]}"
        raise EvsError(f"{message} (try: {self.prog} --help)")


def _whole_number(text: str) -> int:
    """An integer that native code and numpy can hold."""
    value = int(text)
    if abs(value) > MOST_NUMBER:
        raise argparse.ArgumentTypeError(f"{text} is not within +-{MOST_NUMBER:,}")
    return value


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command line; the exit code: 0, 2 for errors of the user, 130 after Ctrl-C."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if sys.stderr is None:
        # `2>&-`: the next file that is opened must not receive messages
        sys.stderr = Path(os.devnull).open("w")  # noqa: SIM115 - as long as the process
    try:
        if "_ARGCOMPLETE" in os.environ and arguments is None:
            from evs.launch.support.completion import complete

            complete(commands(), lambda name: parser_of(name, module_of(name)))
        if sys.stdout is None:
            raise EvsError("standard output is closed (>&-): give it a place, as in >/dev/null")
        if isinstance(sys.stdout, io.TextIOWrapper):
            # a terminal that has no Greek letters shows the rest
            sys.stdout.reconfigure(errors="replace")
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            return _flushed(words)
    except EvsError as error:
        # libraries below may quote messages of many lines
        print("evs:", " ".join(str(error).split()), file=sys.stderr)
        return 2
    except MemoryError:
        print(f"evs: out of memory; {MORE_MEMORY}", file=sys.stderr)
        return 2
    except ImportError as reason:
        # a broken installation, or no memory left to map a library into
        message = " ".join(str(reason).split())
        print(f"evs: cannot load what it needs ({message}); {INSTALL}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # `evs ... | head`: nobody reads on
        _discard_output()
        return 141
    except OSError as reason:
        print("evs:", " ".join(_system_message(reason).split()), file=sys.stderr)
        if reason.filename is None and reason.errno == errno.ENOSPC:
            _discard_output()
        return 2


def _system_message(reason: OSError) -> str:
    """What the system refused, and the fix: a file of the user's, or no room on a disk."""
    from evs.emulator.base.small_files import out_of_reach

    if reason.errno == errno.ENOSPC:
        of = f"'{reason.filename}'" if reason.filename is not None else "its output"
        return f"cannot write {of}: {reason.strerror}; make room"
    if reason.filename is not None:
        # no right to its folder, a name too long
        return str(out_of_reach(reason.filename, reason))
    return f"the system refuses something that evs needs: {reason.strerror or reason}"


def _discard_output() -> None:
    """Discard standard output, so that the interpreter's last flush does not fail too."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def _show_warning(message: Warning | str, *_where: object, **_named: object) -> None:
    """Print a warning as one line; its place in the code does not help users."""
    print("evs: warning:", " ".join(str(message).split()), file=sys.stderr)


def _flushed(words: list[str]) -> int:
    """Run a command, and flush its output while a write error can still be reported."""
    code = _dispatch(words)
    sys.stdout.flush()
    return code


def _dispatch(words: list[str]) -> int:
    if not words or words[0] in ("-h", "--help", "help"):
        print(_help())
        return 0
    if words[0] in ("-V", "--version", "version"):
        print("evs", __version__)
        return 0
    name = words[0]
    if name not in COMMANDS and name not in (known := commands()):
        if name in LAB:
            raise plugins.not_installed(f"evs {name}")
        kind = "option" if name.startswith("-") else "command"
        raise EvsError(f"{unknown(kind, name, known)} (try: evs --help)")
    _check_room()
    _check_folder()
    module = module_of(name)
    parser = parser_of(name, module)
    # argparse cannot mix options with the arguments of commands that have commands of their own
    mixed = not getattr(module, "SUBCOMMANDS", False)
    parsed = (parser.parse_intermixed_args if mixed else parser.parse_args)(words[1:])
    code = module.run(parsed)
    return 0 if code is None else int(code)


def commands() -> dict[str, str]:
    """Name -> what it does, of the commands of evs and of the distributions that add some."""
    added = {name: command.what for name, command in plugins.plugin_commands().items()}
    return {**added, **COMMANDS}


def module_of(name: str) -> ModuleType:
    """The module of a command."""
    if name in COMMANDS:
        return importlib.import_module(f"evs.launch.commands.{name}")
    return importlib.import_module(plugins.plugin_commands()[name].module)


def _check_room() -> None:
    left = address_space_left()
    if left is not None and left < LEAST_BYTES:
        raise EvsError(
            f"{max(0, left) / 1e6:.0f} MB of memory are left to this process, which needs "
            f"{LEAST_BYTES / 1e6:.0f}; raise the limit of this shell or container (ulimit -v)"
        )


def _check_folder() -> None:
    try:
        Path.cwd()
    except OSError as reason:
        raise EvsError(
            f"the folder that this shell is in cannot be reached ({reason.strerror}): cd to another"
        ) from None


def parser_of(name: str, module: ModuleType) -> Parser:
    """The parser of a command and its module."""
    parser = Parser(
        prog=f"evs {name}",
        description=COMMANDS[name] if name in COMMANDS else commands()[name],
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    module.configure(parser)
    parser.late_epilog = getattr(module, "epilog", None)
    return parser


def _help() -> str:
    lines = [ABOUT, "", "Usage: evs COMMAND [arguments]"]
    groups = {heading: dict(group) for heading, group in GROUPS.items()}
    for name, command in plugins.plugin_commands().items():
        groups.setdefault(command.heading, {}).setdefault(name, command.what)
    for heading, group in groups.items():
        lines += ["", f"{heading}:", *(f"  {name:14s}{what}" for name, what in group.items())]
    return "\n".join([*lines, "", EXAMPLES])


if __name__ == "__main__":
    raise SystemExit(main())
