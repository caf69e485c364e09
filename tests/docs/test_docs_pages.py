"""The pages: the README stays short, links lead somewhere, figures are written with a zero."""

from __future__ import annotations

import importlib.util
import os
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from evs.drivers.run import config_reference as keys
from evs.drivers.run.config import PipelineConfig
from evs.launch.main import COMMANDS
from evs.launch.main import LAB as LAB_COMMANDS

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
README = ROOT / "README.md"

# written by evs sweep and evs evaluate
LAB = ROOT / "lab/docs"
WRITTEN = LAB / "measured"
PAGES = sorted([*DOCS.rglob("*.md"), *LAB.rglob("*.md")])
PAGES = [page for page in PAGES if WRITTEN not in page.parents]
# its tables hold what users are shown, as it is printed
PRINTED = LAB / "extremes.md"

MOST_LINES = 200
MOST_WORDS = 1500

# 12 % and 5.5 but not 0.5 without its zero
NO_ZERO = re.compile(r"(?:^|[\s(|,/*+-])\.\d")

NAMED = re.compile(
    r"(?<![\w/.:-])((?:tests|drivers|emulator|tools|examples|launch|msgs|config|docs|lab)/[\w./*-]+)"
)
"""a file of this tree, as a page names it"""


def name_of(page: Path) -> str:
    """From the top of the checkout."""
    return str(page.relative_to(ROOT))


def prose(page: Path) -> str:
    """A page without its programs."""
    return re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)


def links_of(page: Path) -> list[str]:
    """The targets in this tree that a page links to or shows."""
    found = re.findall(r"\]\(([^)\s]+)\)", re.sub(r"`[^`\n]*`", "", prose(page)))
    return [link for link in found if "://" not in link and not link.startswith("#")]


def generated() -> ModuleType:
    """The module of the site that writes the commands and the keys."""
    spec = importlib.util.spec_from_file_location("generated", DOCS / "_ext/generated.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["generated"] = module
    spec.loader.exec_module(module)
    return module


def test_the_readme_is_short() -> None:
    text = README.read_text()
    assert len(text.splitlines()) <= MOST_LINES
    assert len(text.split()) <= MOST_WORDS


@pytest.mark.parametrize("page", [README, *PAGES, ROOT / "CHANGELOG.md"], ids=name_of)
def test_decimals_have_a_zero(page: Path) -> None:
    text = re.sub(r"`[^`]*`", "", prose(page))
    if page == PRINTED:
        text = text.partition("<!--")[0]
    assert [match[0] for match in NO_ZERO.finditer(text)] == []


def test_a_decimal_without_a_zero_is_found() -> None:
    assert NO_ZERO.search("a share of .5")
    assert NO_ZERO.search("| 1.2 | .35 |")
    assert not NO_ZERO.search("0.5, 12.5 and run.aedat4 ... .npz")


@pytest.mark.parametrize("page", [README, *PAGES], ids=name_of)
def test_links_and_pictures_are_there(page: Path) -> None:
    missing = [
        link for link in links_of(page) if not (page.parent / link.partition("#")[0]).exists()
    ]
    assert missing == []


@pytest.mark.parametrize("page", [README, *PAGES], ids=name_of)
def test_files_that_a_page_names_are_there(page: Path) -> None:
    text = re.sub(r"^```text.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"<!-- written.*<!-- to here -->", "", text, flags=re.DOTALL)
    missing = [
        name for name in dict.fromkeys(NAMED.findall(text)) if not list(ROOT.glob(name.rstrip(".")))
    ]
    assert missing == []


def test_every_page_is_in_the_site() -> None:
    listed = {DOCS / "index.md"}
    for page in PAGES:
        for block in re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(), re.DOTALL):
            lines = [line for line in block.splitlines() if line and not line.startswith(":")]
            files = [Path(os.path.normpath(page.parent / f"{line}.ipynb")) for line in lines]
            listed |= {file if file.exists() else file.with_suffix(".md") for file in files}
    assert {*PAGES, *DOCS.rglob("*.ipynb")} == listed


def test_every_picture_is_shown() -> None:
    shown = {(page.parent / link).resolve() for page in [README, *PAGES] for link in links_of(page)}
    folders = (DOCS / "img", LAB / "img")
    pictures = {path for folder in folders for path in folder.rglob("*") if path.is_file()}
    assert pictures <= shown


def test_commands_and_keys_are_generated_in_full() -> None:
    module = generated()
    text = module.filled((DOCS / "reference/cli.md").read_text())
    for name in COMMANDS:
        assert f"\n## evs {name}\n" in text
    assert "`--publish ADDRESS`" in text
    text = module.filled((DOCS / "reference/configuration.md").read_text())
    for table in keys.describe(PipelineConfig):
        for key in table.keys:
            assert f"| `{key.name}` |" in text
    text = module.filled((LAB / "commands.md").read_text())
    for name in LAB_COMMANDS:
        assert f"\n## evs {name}\n" in text
    assert "\n### evs train fit\n" in text
    assert "<!-- generated" not in text


def test_packages_hold_no_pages_of_their_own() -> None:
    found = [
        name_of(page)
        for folder in ("msgs", "emulator", "drivers", "tools", "examples", "launch", "config")
        for page in (ROOT / folder).rglob("*.md")
    ]
    assert found == []
