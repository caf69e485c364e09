"""`evs completion`: print the lines that make a shell complete evs commands."""

from __future__ import annotations

import argparse

EPILOG = """\
examples:
  evs completion bash > ~/.local/share/bash-completion/completions/evs
  evs completion zsh > ~/.zfunc/_evs                  a folder of fpath
  evs completion fish > ~/.config/fish/completions/evs.fish"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.epilog = EPILOG
    parser.add_argument(
        "shell", metavar="SHELL", choices=("bash", "zsh", "fish"), help="bash, zsh or fish"
    )


def run(args: argparse.Namespace) -> int:
    """Print them."""
    from evs.launch.support import completion

    print(completion.shell_code(args.shell))
    return 0
