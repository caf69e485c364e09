"""Where each value of a sensor file comes from: the comment behind it in the file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

# a comment begins at the first # outside quotes
_LINE = re.compile(r"""^(?P<code>(?:[^"'#]|"[^"]*"|'[^']*')*)(?:\#(?P<comment>.*))?$""")
_TABLE = re.compile(r"^\s*\[([\w.]+)\]")
_KEY = re.compile(r"^\s*(\w+)\s*=")


@dataclass(frozen=True)
class Sources:
    """The comments of a sensor file."""

    about: str
    """the comment at its head"""
    of: dict[str, str]
    """key, dotted for one inside a table (`readout.order`) -> where its value comes from; "" where
    there is no comment"""


def read_sources(path: Path) -> Sources:
    """The comments of a sensor file that is valid TOML.

    A comment belongs to the key before it, on the same line; a line with nothing but a comment
    that is indented goes on with it.
    """
    about: list[str] = []
    of: dict[str, str] = {}
    table, key = "", ""
    for line in path.read_text(encoding="utf-8").splitlines():
        found = _LINE.match(line)
        code, comment = (found["code"], found["comment"] or "") if found else (line, "")
        comment = comment.strip()
        if header := _TABLE.match(code):
            table, key = f"{header[1]}.", ""
        elif named := _KEY.match(code):
            key = table + named[1]
            of[key] = comment
        elif comment and not of and not table:
            about.append(comment)
        elif comment and key and line[0].isspace():
            of[key] = f"{of[key]} {comment}"
        else:
            key = ""
    return Sources(" ".join(about), of)
