"""What other distributions add to evs: commands, and the stress cases of `evs doctor`.

A distribution adds commands by an entry point of the group `evs.commands` that leads to a table
like main.GROUPS; each command is the module of its name beside that table. evs-lab does so.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

from evs.msgs import EvsError

COMMANDS = "evs.commands"
"""entry points of tables of commands"""
DOCTOR = "evs.doctor"
"""entry points of modules with the functions `run_cases` and `write`"""

INSTALL = "which is not installed: pip install ./lab in a checkout of evs"


@dataclass(frozen=True)
class PluginCommand:
    """A command of another distribution."""

    heading: str
    """under which `evs --help` lists it"""
    what: str
    """what it does, in one line"""
    module: str


def plugin_commands() -> dict[str, PluginCommand]:
    """Name -> command of every installed distribution that has some."""
    # here, so that other commands begin sooner
    from importlib import metadata

    found = {}
    for entry in sorted(metadata.entry_points(group=COMMANDS), key=lambda entry: entry.name):
        for heading, group in entry.load().items():
            for name, what in group.items():
                found[name] = PluginCommand(heading, what, f"{entry.module}.{name}")
    return found


def stress_cases() -> ModuleType | None:
    """The module that runs the stress cases; None: no distribution has one."""
    from importlib import metadata

    for entry in metadata.entry_points(group=DOCTOR):
        module: ModuleType = entry.load()
        return module
    return None


def not_installed(what: str) -> EvsError:
    """The error of something that evs-lab would bring."""
    return EvsError(f"{what} is part of evs-lab, {INSTALL}")
