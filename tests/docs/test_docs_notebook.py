"""The notebook of the site: its outputs are those of its cells, and it is a valid notebook."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs").rglob("*.ipynb"))
# zlib's bytes depend on its version
IMAGE = re.compile(r"data:image/png;base64,[\w+/=]+")


@pytest.fixture(scope="module")
def notebooks() -> ModuleType:
    spec = importlib.util.spec_from_file_location("notebooks", ROOT / "docs/_ext/notebooks.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def without_images(notebook: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(IMAGE.sub("", json.dumps(notebook)))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_has_the_outputs_of_its_cells(path: Path, notebooks: ModuleType) -> None:
    kept = json.loads(path.read_text())
    assert without_images(notebooks.executed(kept)) == without_images(kept)
    assert len({cell["id"] for cell in kept["cells"]}) == len(kept["cells"])
    shown = json.dumps(kept)
    assert len(IMAGE.findall(shown)) >= 2
    page = notebooks.as_markdown(kept)
    assert page.startswith("# ")
    assert page.count("```{raw} html\n<div") >= 2


def test_there_is_one() -> None:
    assert NOTEBOOKS
