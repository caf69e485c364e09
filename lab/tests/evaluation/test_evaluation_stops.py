"""`evs evaluate` as a process: Ctrl-C ends it, and what was traced until then stays."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from reference.judged import written

pytestmark = pytest.mark.integration


@pytest.mark.slow
def test_ctrl_c_keeps_what_was_traced(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    words = ["--scenes", str(written(tmp_path)), "--models", "plain", "--cameras", "pan"]
    # the halves take a moment, what follows takes minutes
    much = ["--reference-spp", "2", "--spp", "4096", "--ticks", "40", "--pixels", "2000"]
    program = [sys.executable, "-m", "evs.launch.main", "evaluate", *words, *much]
    run = subprocess.Popen(
        [*program, "--cache", str(cache)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    waited_until = time.monotonic() + 120
    while len(list(cache.glob("*.npz"))) < 2 and time.monotonic() < waited_until:
        time.sleep(0.1)
    run.send_signal(signal.SIGINT)
    out, err = run.communicate(timeout=60)
    assert (run.returncode, out, err) == (130, "", "")
    files = sorted(path.name for path in cache.iterdir())
    assert len(files) == 2
    for name in files:
        assert name.endswith(".npz")
        with np.load(cache / name) as archive:
            assert archive["light"].shape == (40, 2000 + 32 * 32)
