"""Files made to cost a reader much: each is read in time and memory in proportion to its size."""

from __future__ import annotations

import struct
import subprocess
import sys
import zlib
from pathlib import Path

import pytest

from reference.memory import PEAK

pytestmark = pytest.mark.extremes

AEDAT2 = b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n"
AEDAT3 = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: DAVIS346\r\n#!END-HEADER\r\n"

READ = f"""{PEAK}
import warnings
import evs
from evs.msgs import EvsError
warnings.simplefilter("ignore")
evs.read(sys.argv[2])
before = peak_kib()
try:
    recording = evs.read(sys.argv[1])
    count = len(recording)
    assert (recording.frames, len(recording.imu)) == ((), 0)
except EvsError:
    count = -1
print(count, peak_kib() - before)
"""


def packet(number: int, overflow: int = 0) -> bytes:
    head = struct.pack("<hhiiiiii", 1, 1, 8, 4, overflow, number, number, number)
    return head + struct.pack("<Ii", 1, 5) * number


def packed_frame(width: int, height: int) -> bytes:
    """A frame of zeros as PNG, by hand: 1000 times smaller than what it states."""
    rows = zlib.compressobj(9)
    body = b"".join(rows.compress(bytes(1 + 2 * width)) for _ in range(height)) + rows.flush()
    picture = b"\x89PNG\r\n\x1a\n"
    sides = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    for name, data in ((b"IHDR", sides), (b"IDAT", body), (b"IEND", b"")):
        checked = name + data
        picture += struct.pack(">I", len(data)) + checked + struct.pack(">I", zlib.crc32(checked))
    frame = struct.pack("<I8i", 1 << 31 | 3, 1, 4, 2, 3, width, height, 0, 0)
    frame += struct.pack("<i", len(picture)) + picture
    size = 36 + 2 * width * height
    return struct.pack("<HhiiiIii", 0x8002, 1, size, 12, 0, len(frame), 1, 1) + frame


CASES = {
    # what a search for packets goes by, again and again
    "marks.aedat3": (AEDAT3 + b"\x08\0\0\0\x04\0\0\0" * 100_000, 0),
    "empty.aedat3": (AEDAT3 + packet(0) * 50_000, 0),
    # one tick that never ends
    "tick.aedat3": (AEDAT3 + packet(1) * 40_000, 40_000),
    # a clock that is set anew with every event
    "back.aedat3": (AEDAT3 + (packet(1) + packet(1, 1)) * 20_000, 40_000),
    "back.aedat": (AEDAT2 + struct.pack(">4i", 4096, 5_000_000, 4096, 0) * 40_000, 80_000),
    "back.csv": (b"t,x,y,p\n" + b"5000000,1,1,1\n1,1,1,1\n" * 20_000, 40_000),
    # a picture that states more than anybody has; where it is needed, it is packed
    "picture.aedat3": (AEDAT3.replace(b"RAW", b"Compressed"), 1),
    # one pixel that is reset for ever, and IMU words that never become a sample
    "reset.aedat": (AEDAT2 + struct.pack(">Ii", 1 << 31, 5) * 200_000, 0),
    "imu.aedat": (AEDAT2 + struct.pack(">Ii", 0x80000C00, 5) * 200_000, 0),
    # a header that does not end, and lines that are none
    "head.aedat": (AEDAT2 + b"#a\r\n" * 50_000, 0),
    "bad.csv": (b"1,2,3,1\n" + b"x\n" * 200_000, 1),
    "line.csv": (b"1,2,3,1\n" + b"1" * 9_000_000, 1),
    "wide.csv": (b"1,2,3,1" + b",5" * 2_000_000 + b"\n", -1),
    "tick.csv": (b"1,2,3,1\n" * 100_000, 100_000),
}


@pytest.mark.parametrize("name", CASES)
def test_a_crafted_file_costs_what_it_weighs(tmp_path: Path, name: str) -> None:
    data, count = CASES[name]
    path, small = tmp_path / name, tmp_path / f"small{Path(name).suffix}"
    if name == "picture.aedat3":
        data += packed_frame(16_000, 8_000) + packet(1)
    path.write_bytes(data)
    if name == "tick.csv":
        told = '{"width": 9, "height": 9, "tick_us": 4000000000000000000}'
        path.with_name("tick.csv.json").write_text(told)
    small.write_bytes(
        {".csv": b"1,1,1,1\n", ".aedat": AEDAT2, ".aedat3": AEDAT3 + packet(1)}[small.suffix]
    )
    words = [sys.executable, "-c", READ, str(path), str(small)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=True)
    found, grown_kib = map(int, done.stdout.split())
    assert found == count
    # twice the file, the events twice, and the readers' pieces
    assert grown_kib * 1024 < 2 * len(data) + 2 * 16 * max(count, 0) + 24e6
