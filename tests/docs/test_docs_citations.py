"""What comments, docstrings and pages cite is there: tests, pages, source files."""

from __future__ import annotations

import io
import re
import tokenize
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = (
    "msgs",
    "emulator",
    "drivers",
    "tools",
    "examples",
    "launch",
    "config",
    "docs",
    "tests",
    "lab",
)

CITED = re.compile(
    r"(?<![\w/.:*{}$<>=-])((?:[\w.-]+/)*[\w-]+\.(?:py|md|inl|h|cpp|sh|xml|toml))\b(?![\w*/(])"
)
"""a path, or the end of one, as prose names a file"""

LINK = re.compile(r"\]\([^)]*\)")
"""test_docs_pages.py follows these"""

# their authors', not ours
FOREIGN = {
    "davis_common.h": "libcaer",
    "davis.h": "libcaer",
    "gen41_erc.cpp": "OpenEB",
    "genx320_erc.h": "OpenEB",
    "imx636_bias_settings.h": "OpenEB",
    "genx320_bias_settings.h": "OpenEB",
    "EGL/egl.h": "EGL",
    "eglext.h": "EGL",
    "Python.h": "Python",
    "ctypes.py": "a user's, with the name of a module of Python",
}

# what a user makes, writes or calls so
EXAMPLES = {
    *("all.md", "out/pencil.md", "steer.py", "test_balance.py", "mine.toml", "tuned.toml"),
    *("cart.xml", "robot.xml", "robot.toml", "sensor.toml", "config/sensors/imx647.toml"),
}
NAMELESS = ("NAME.", "FILE.")


@cache
def endings() -> set[str]:
    """Every path of the tree, and its ends from each folder on."""
    files = [path for room in ROOMS for path in (ROOT / room).rglob("*") if path.is_file()]
    files += [path for path in [*ROOT.iterdir(), *(ROOT / ".ci").iterdir()] if path.is_file()]
    found = set()
    for path in files:
        parts = path.relative_to(ROOT).parts
        found |= {"/".join(parts[k:]) for k in range(len(parts))}
    return found


def missing(text: str) -> list[str]:
    """The files that a text cites and that are nowhere."""
    names = dict.fromkeys(CITED.findall(text))
    known = endings() | EXAMPLES | set(FOREIGN)
    return [
        name
        for name in names
        if re.sub(r"^(evs/|(\.\./)+)", "", name) not in known and not name.startswith(NAMELESS)
    ]


def said_in_python(source: str) -> Iterator[str]:
    """Comments and docstrings, those of values included."""
    before = tokenize.NEWLINE
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        begins = before in (tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)
        if token.type == tokenize.COMMENT or (token.type == tokenize.STRING and begins):
            yield token.string
        if token.type not in (tokenize.COMMENT, tokenize.NL):
            before = token.type


def said_in_native(source: str) -> Iterator[str]:
    """Comments to the end of a line."""
    for line in source.splitlines():
        yield line.partition("//")[2]


def said_in_toml(source: str) -> Iterator[str]:
    """Comments."""
    for line in source.splitlines():
        yield line.partition("#")[2]


def said_in_page(source: str) -> Iterator[str]:
    """Everything but programs and what they print."""
    yield LINK.sub("", re.sub(r"^```.*?^```", "", source, flags=re.DOTALL | re.MULTILINE))


SAID: dict[str, Callable[[str], Iterator[str]]] = {
    ".py": said_in_python,
    **dict.fromkeys((".cpp", ".h", ".inl"), said_in_native),
    ".toml": said_in_toml,
    ".md": said_in_page,
}


def cited_in_vain(path: Path) -> list[str]:
    """The files that comments, docstrings or prose of a file cite and that are nowhere."""
    source = path.read_text(encoding="utf-8")
    # most files cite nothing that has to be looked for
    return missing("\n".join(SAID[path.suffix](source))) if missing(source) else []


@pytest.mark.parametrize("suffix", SAID)
def test_what_the_files_cite_is_there(suffix: str) -> None:
    paths = [path for room in ROOMS for path in (ROOT / room).rglob(f"*{suffix}")]
    paths += ROOT.glob(f"*{suffix}")
    # written by evs sweep and evs evaluate
    paths = [path for path in paths if ROOT / "lab/docs/measured" not in path.parents]
    wrong = {str(path.relative_to(ROOT)): names for path in paths if (names := cited_in_vain(path))}
    assert wrong == {}


PAGES = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "lab/docs").rglob("*.md")),
]


def test_the_functions_of_tests_that_pages_cite_are_there() -> None:
    defined = {
        name
        for folder in ("tests", "lab/tests")
        for path in (ROOT / folder).rglob("test_*.py")
        for name in re.findall(r"^ *def (test_\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    cited = {
        name
        for page in PAGES
        for name in re.findall(r"`(test_\w+)`", "".join(said_in_page(page.read_text())))
    }
    assert cited
    assert cited <= defined


def test_the_modules_that_pages_cite_are_there() -> None:
    cited = {
        name
        for page in PAGES
        for name in re.findall(r"\bevs\.((?:emulator|drivers|tools)\.[a-z_]+)", page.read_text())
    }
    assert cited
    places = {name: ROOT / name.replace(".", "/") for name in cited}
    assert [
        name
        for name, place in places.items()
        if not (place.is_dir() or place.with_suffix(".py").is_file())
    ] == []


@pytest.mark.parametrize(
    "text",
    [
        "as in lab/tests/bench/test_of_nothing.py",
        "`.venv/bin/pytest -m bench lab/tests/bench/test_of_nothing.py -k one`",
        "see strands.py.",
        "data/README.md says so",
    ],
)
def test_a_citation_of_nothing_is_found(text: str) -> None:
    assert missing(text)


def test_what_is_there_and_what_is_no_file_is_passed() -> None:
    assert (
        missing("tests/docs/test_docs_pages.py, docs/test_docs_pages.py, test_docs_pages.py") == []
    )
    assert missing("evs/emulator/config/schema.py, np.pyx, https://a.b/c.py, name.python") == []
    quoted = 'x = "see strands.py"  # see nothing.py\n"""see that.py"""\n'
    assert missing("\n".join(said_in_python(quoted))) == ["nothing.py", "that.py"]
    assert missing("\n".join(said_in_native('f("a.inl");  // see b.inl'))) == ["b.inl"]
