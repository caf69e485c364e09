"""What the tutorial says of the closed loop works as it is written."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.integration


def test_the_tutorials_example_works_as_written():
    root = Path(__file__).parents[3]
    text = (root / "docs/tutorials/closed_loop.md").read_text().split("## In one process")[1]
    example = text.split("```python\n")[1].split("```")[0]
    # of its ten seconds half a one
    command = [sys.executable, "-c", example.replace("max_s=10.0", "max_s=0.5")]
    said = subprocess.run(command, cwd=root, check=True, capture_output=True, text=True)
    assert said.stdout == "500000 0.5 s are over\n"
