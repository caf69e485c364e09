"""Parts of the site that are written from the code: the commands and the configuration keys.

A page holds a line `<!-- generated: NAME -->`, and the text takes its place when the page is read.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

from evs.drivers.run import config_reference
from evs.drivers.run.config import PipelineConfig
from evs.launch import main

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PLACE = re.compile(r"^<!-- generated: (\w+) -->$", re.MULTILINE)

KEYS_BEGIN = "Pipelines that come with evs"
"""how the list of all keys begins, which several commands print after their options"""


def escaped(text: str) -> str:
    """Plain text as Markdown shows it, in a cell of a table too."""
    return re.sub(r"([\\`*_{}\[\]<>#|$~])", r"\\\1", " ".join(text.split()))


def parsers(names: Iterable[str]) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """(words, parser) of the commands; subcommands behind theirs."""
    for name in names:
        parser = main.parser_of(name, main.module_of(name))
        yield f"evs {name}", parser
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                for word, inner in action.choices.items():
                    yield f"evs {name} {word}", inner


def usage_of(words: str, parser: argparse.ArgumentParser) -> str:
    """The command's shape on one line."""
    if parser.usage:
        return parser.usage
    shown = [action for action in parser._actions if action.help != argparse.SUPPRESS]
    places = [action for action in shown if not action.option_strings]
    parts = [words]
    for action in places:
        name = str(action.metavar or action.dest)
        optional = action.nargs in ("?", "*")
        parts.append(f"[{name}]" if optional else name)
    return " ".join([*parts, "[options]"])


def rows_of(parser: argparse.ArgumentParser) -> Iterator[str]:
    """A row of Markdown for each argument and option."""
    for action in parser._actions:
        if action.help == argparse.SUPPRESS or isinstance(action, argparse._HelpAction):
            continue
        if isinstance(action, argparse._SubParsersAction):
            continue
        value = "" if action.nargs == 0 else str(action.metavar or action.dest.upper())
        if action.choices is not None and not action.metavar:
            value = "{" + ",".join(map(str, action.choices)) + "}"
        names = " ".join([", ".join(action.option_strings), value]).strip()
        line = (action.help or "") % {**vars(action), "prog": parser.prog}
        yield f"| `{names}` | {escaped(line)} |"


def commands(names: Iterable[str] = main.COMMANDS) -> str:
    """A section for each command: what it does, its usage, its options, its examples."""
    keys = "configuration.md" if names is main.COMMANDS else "../../docs/reference/configuration.md"
    found = []
    for words, parser in parsers(names):
        depth = "##" if words.count(" ") == 1 else "###"
        about = escaped(parser.description or "")
        found += [f"{depth} {words}", "", f"{about[:1].upper()}{about[1:]}.", ""]
        found += ["```text", usage_of(words, parser), "```", ""]
        rows = list(rows_of(parser))
        if rows:
            found += ["| argument | meaning |", "|---|---|", *rows, ""]
        # some parsers make their epilog with their help
        parser.format_help()
        epilog = (parser.epilog or "").strip()
        epilog, begin, _ = epilog.partition(KEYS_BEGIN)
        if epilog.strip():
            found += ["```text", epilog.strip(), "```", ""]
        if begin:
            found += [f"Every key of the [configuration]({keys}) is accepted.", ""]
    return "\n".join(found)


def configuration() -> str:
    """A table of keys for each table of a pipeline file."""
    found = []
    for table in config_reference.describe(PipelineConfig):
        # an array has a table for each type of its items
        name = table.doc.partition(": ")[0] if table.name.endswith(".N") else f"[{table.name}]"
        found += [f"## {f'`{name}`' if table.name else 'Top level'}", ""]
        about = table.doc.partition(": ")[2] or table.doc
        if about and table.name:
            found += [escaped(about[0].upper() + about[1:]), ""]
        found += ["| key | default | meaning |", "|---|---|---|"]
        for key in table.keys:
            found.append(f"| `{key.name}` | `{key.default}` | {escaped(key.doc)} |")
        found.append("")
    return "\n".join(found)


TEXTS: dict[str, Callable[[], str]] = {
    "commands": commands,
    "lab_commands": lambda: commands(main.LAB),
    "configuration": configuration,
}


def filled(text: str) -> str:
    """A page with its generated parts in their places."""
    return PLACE.sub(lambda match: TEXTS[match[1]](), text)


SECTIONS = re.compile(r"(Args|Returns|Raises|Yields|Attributes|Examples?|Notes?|Warns):$")


def as_rst(lines: list[str]) -> list[str]:
    """A docstring as reStructuredText: indented programs are literal, and a bar is only a bar."""
    found: list[str] = []
    before, literal = "", False
    for line in lines:
        inside = line.startswith("    ")
        begins = inside and bool(found) and not found[-1] and not before.startswith(" ")
        if begins and not SECTIONS.match(before):
            found += ["::", ""]
            literal = True
        literal = literal and (inside or not line)
        found.append(line if literal else line.replace("|", "\\|"))
        before = line or before
    return found


class Docstrings:
    """Prepares docstrings for napoleon, which must not read `word: text` of a field as its type."""

    def __init__(self) -> None:
        self._fields: dict[str, list[str]] = {}

    def before(
        self, _app: object, kind: str, name: str, _thing: object, _options: object, lines: list[str]
    ) -> None:
        """Ahead of napoleon."""
        lines[:] = as_rst(lines)
        if kind in ("attribute", "data", "property"):
            self._fields[name] = list(lines)

    def after(
        self, _app: object, kind: str, name: str, _thing: object, _options: object, lines: list[str]
    ) -> None:
        """Behind napoleon."""
        if kind in ("attribute", "data", "property"):
            lines[:] = self._fields.pop(name, lines)


def setup(app: Sphinx) -> dict[str, bool]:
    """Fill a page when it is read; prepare docstrings."""

    def fill(_app: object, _name: str, source: list[str]) -> None:
        source[0] = filled(source[0])

    app.connect("source-read", fill)
    docstrings = Docstrings()
    app.connect("autodoc-process-docstring", docstrings.before, priority=100)
    app.connect("autodoc-process-docstring", docstrings.after, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
