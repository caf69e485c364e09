"""What a shell is offered after a command line, asked as bash asks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def offered(line: str, folder: Path) -> list[str]:
    """The completions of a command line with the cursor at its end."""
    answer = folder / "answer"
    environment = {
        **os.environ,
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(answer),
        "_ARGCOMPLETE_IFS": "\n",
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
        "COMP_TYPE": "9",
    }
    command = [sys.executable, "-m", "evs.launch.main"]
    done = subprocess.run(
        command, env=environment, cwd=folder, capture_output=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stderr
    return answer.read_text().split("\n")
