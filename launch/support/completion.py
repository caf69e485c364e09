"""What a shell offers after `evs`. The only door to argcomplete, of the extra `completion`."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterable
from typing import Any

from evs.msgs import EvsError

REQUESTED = "_ARGCOMPLETE"
"""the environment variable of a shell that asks for completions"""


def shell_code(shell: str) -> str:
    """The lines that make a shell ask; EvsError where argcomplete is not installed."""
    try:
        from argcomplete.shell_integration import shellcode
    except ImportError:
        raise EvsError("argcomplete is not installed: pip install 'evs[completion]'") from None
    code: str = shellcode(["evs"], shell=shell)
    return code


def complete(commands: Iterable[str], parser_of: Callable[[str], argparse.ArgumentParser]) -> None:
    """Answer a shell's request, and end the process.

    Args:
        commands: The names of all commands.
        parser_of: The parser of one.
    """
    import argcomplete
    from argcomplete.lexers import split_line

    line = os.environ["COMP_LINE"]
    _, _, _, words, _ = split_line(line, int(os.environ["COMP_POINT"]))
    if len(words) < 2:
        parser = argparse.ArgumentParser(add_help=False)
        parser.add_argument("command", choices=list(commands))
    elif words[1] in commands:
        parser = parser_of(words[1])
        # the words of the command's own parser begin one later
        os.environ[REQUESTED] = str(int(os.environ[REQUESTED]) + 1)
    else:
        parser = argparse.ArgumentParser(add_help=False)
    argcomplete.autocomplete(parser)


def pipeline_words(prefix: str, **_more: Any) -> list[str]:
    """Completions of a pipeline's words: files, pipelines that come with evs, and keys with `=`."""
    from argcomplete.completers import FilesCompleter

    from evs.drivers.run import config
    from evs.emulator.config.decoding import key_names

    names = [*config.pipelines(), *(f"{key}=" for key in key_names(config.PipelineConfig))]
    found = [name for name in names if name.startswith(prefix) and ".N" not in name]
    return [*found, *FilesCompleter()(prefix)]
