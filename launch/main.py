"""`evs`: find the command, run it, turn an EvsError into one line and exit code 2."""

from __future__ import annotations

import argparse
import errno
import importlib
import os
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import NoReturn

from evs import __version__
from evs.emulator.base.memory_limits import address_space_left
from evs.msgs import EvsError, nearest_first, unknown

COMMANDS = {
    "demo": "evs.launch.commands.demo",
    "emulate": "evs.launch.commands.emulate",
    "plan": "evs.launch.commands.plan",
    "render": "evs.launch.commands.render",
    "sensors": "evs.launch.commands.sensors",
    "view": "evs.launch.commands.view",
    "echo": "evs.launch.commands.echo",
    "record": "evs.launch.commands.record",
    "topics": "evs.launch.commands.topics",
    "launch": "evs.launch.commands.launch",
    "loop": "evs.launch.commands.loop",
    "play": "evs.launch.commands.play",
    "info": "evs.launch.commands.info",
    "keygen": "evs.launch.commands.keygen",
    "convert": "evs.launch.commands.convert",
    "characterise": "evs.launch.commands.characterise",
    "fit": "evs.launch.commands.fit",
    "evaluate": "evs.launch.commands.evaluate",
    "sweep": "evs.launch.commands.sweep",
    "tune": "evs.launch.commands.tune",
    "train": "evs.launch.commands.train",
    "dataset": "evs.launch.commands.dataset",
    "doctor": "evs.launch.commands.doctor",
}
"""Command -> module. To add a command, write a module in launch/commands and list it here.

A module has HELP (one line), configure(parser), which adds the arguments, and run(args), which
returns the exit code. SUBCOMMANDS = True: the first word is a command of its own. What several
commands share is in launch/support."""

ABOUT = """evs: an event camera for MuJoCo scenes.

It takes the place of a real DVS, DAVIS or EVK camera: the same topics, files and parameters,
but the world in front of the lens is a MuJoCo model. Physics runs in ticks of 1 ms, rays are
traced for every tick, and each pixel reports only changes."""

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
LEAST_BYTES = 150_000_000
"""of address space: a small scene takes 100 MB. With less, some library, or the C library itself,
aborts the process while it is loaded, each with another message."""


class Parser(argparse.ArgumentParser):
    """An ArgumentParser whose errors are EvsErrors: one line that says how to get help."""

    def error(self, message: str) -> NoReturn:
        """Raise an EvsError, with the nearest known option if one was misspelt."""
        word = message.removeprefix("unrecognized arguments: ").split(" ")[0].partition("=")[0]
        if word != message and word.startswith("--"):
            known = [name for name in self._option_string_actions if name.startswith("--")]
            message += f"; nearest: {nearest_first(word, known)[0]}"
        raise EvsError(f"{message} (try: {self.prog} --help)")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command line; the exit code: 0, 2 for errors of the user, 130 after Ctrl-C."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if sys.stderr is None:
        # `2>&-`: the next file that is opened must not receive messages
        sys.stderr = Path(os.devnull).open("w")  # noqa: SIM115 - as long as the process
    try:
        if sys.stdout is None:
            raise EvsError("standard output is closed (>&-): give it a place, as in >/dev/null")
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
        if reason.errno != errno.ENOSPC or reason.filename is not None:
            raise
        # `evs ... > FILE` where there is no room
        _discard_output()
        print(f"evs: cannot write its output: {reason.strerror}; make room", file=sys.stderr)
        return 2


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
    if name not in COMMANDS:
        kind = "option" if name.startswith("-") else "command"
        raise EvsError(f"{unknown(kind, name, COMMANDS)} (try: evs --help)")
    _check_room()
    module = importlib.import_module(COMMANDS[name])
    parser = _parser(name, module)
    # argparse cannot mix options with the arguments of commands that have commands of their own
    mixed = not getattr(module, "SUBCOMMANDS", False)
    parsed = (parser.parse_intermixed_args if mixed else parser.parse_args)(words[1:])
    code = module.run(parsed)
    return 0 if code is None else int(code)


def _check_room() -> None:
    left = address_space_left()
    if left is not None and left < LEAST_BYTES:
        raise EvsError(
            f"{max(0, left) / 1e6:.0f} MB of memory are left to this process, which needs "
            f"{LEAST_BYTES / 1e6:.0f}; raise the limit of this shell or container (ulimit -v)"
        )


def _parser(name: str, module: ModuleType) -> Parser:
    parser = Parser(
        prog=f"evs {name}",
        description=module.HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    module.configure(parser)
    return parser


def _help() -> str:
    lines = [ABOUT, "", "Usage: evs COMMAND [arguments]", "", "Commands:"]
    for name, where in COMMANDS.items():
        lines.append(f"  {name:14s}{importlib.import_module(where).HELP}")
    return "\n".join([*lines, "", EXAMPLES])


if __name__ == "__main__":
    raise SystemExit(main())
