"""A recorder that is killed while it goes from file to file loses nothing that it has written."""

from __future__ import annotations

import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from evs.drivers.files import read
from evs.drivers.files.integrity import TornTailWarning
from evs.drivers.files.multi_file import later_parts
from evs.msgs import join_events, make_events

pytestmark = pytest.mark.extremes

RECORD = """
import itertools, os, sys
import numpy as np
from evs.drivers.files.aedat4 import Aedat4Recorder
from evs.msgs import EventPacket, StreamInfo, TriggerPacket, make_events, make_triggers

sink = Aedat4Recorder(sys.argv[1], sys.argv[2], rotate_mb=0.01)
sink.open([StreamInfo(346, 260, triggers=True)])
for seq in itertools.count():
    x = np.random.default_rng(seq).integers(0, 260, 120)
    t = np.sort(x) + 1000 * seq + 1
    sink.write_triggers(TriggerPacket(seq, make_triggers([(1000 * seq + 1, 1)])))
    sink.write(EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 346, 260, make_events(t, x, x, 1)))
    # one write of less than a page to a pipe is never torn
    os.write(1, f"{seq + 1}\\n".encode())
"""


@pytest.mark.slow
@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_after_kill_9_every_packet_of_every_file_is_read(tmp_path: Path, compression: str) -> None:
    random = np.random.default_rng()
    for run in range(4):
        path = tmp_path / f"run{run}.aedat4"
        process = subprocess.Popen(
            [sys.executable, "-c", RECORD, path, compression], stdout=subprocess.PIPE
        )
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(random.uniform(0.02, 0.1))
        process.kill()
        told = int(process.stdout.read().decode().split()[-1])
        process.wait()
        process.stdout.close()
        parts = [path, *later_parts(path)]
        assert len(parts) > 1
        # a file that was created in the very moment has no header yet, and nothing was written
        if parts[-1].stat().st_size < 100:
            del parts[-1]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", TornTailWarning)
            recordings = [read(part, single=True) for part in parts]
        whole = join_events(recordings)
        count = len(whole) // 120
        assert told <= count <= told + 1
        for seq in (0, count // 2, count - 1):
            x = np.random.default_rng(seq).integers(0, 260, 120)
            wanted = make_events(np.sort(x) + 1000 * seq + 1, x, x, np.ones(120))
            assert whole[120 * seq : 120 * seq + 120].tobytes() == wanted.tobytes()
        triggers = np.concatenate([recording.triggers for recording in recordings])
        assert told <= len(triggers) <= told + 2
        assert (triggers["t"] == 1000 * np.arange(len(triggers)) + 1).all()
