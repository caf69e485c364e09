"""AEDAT2's bytes: header lines, then 8 bytes a word: big-endian u32 address, i32 time stamp (us).

AEDAT1 has u16 addresses, those of a DVS128. What the bits of an address mean depends on the chip:
`chips.CHIPS` has the layouts of events. A DAVIS's other words have bit 31 set; bits 11-10 say 0: a
pixel's reset read, 1: its signal read (30-22 y, 21-12 x from the left, 9-0 the ADC's value), 3: a
value of the IMU (30-28 which, 27-12 the value).

Source: iniVation's description of the format, and jAER's chip classes.
"""

from __future__ import annotations

import numpy as np

from evs.drivers.files.chips import Bits

MAGIC, MAGIC_1 = b"#!AER-DAT2", b"#!AER-DAT1"
END = "#End Of ASCII Header"
EVS_LINE = "# evs "
CHIP = "# AEChip: "
"""start of the line that names the camera; jAER's header lists other cameras' preferences too"""
MAX_WIDTH, MAX_HEIGHT = 1 << 10, 1 << 9
SPAN_US = 1 << 31

WORD = np.dtype([("address", ">u4"), ("stamp", ">i4")])
WORD_1 = np.dtype([("address", ">u2"), ("stamp", ">i4")])
"""AEDAT1's"""

APS = 0x80000000


def pixel_of(address: Bits) -> tuple[Bits, Bits]:
    """x and y in a DAVIS's addresses, in their own coordinates."""
    return address >> 12 & 0x3FF, address >> 22 & 0x1FF


def header_lines(data: bytes) -> tuple[list[str], int]:
    """The lines of the header, and the byte offset of the words."""
    lines, at = [], 0
    while data[at : at + 1] == b"#":
        end = data.find(b"\n", at)
        text = data[at:end].rstrip(b"\r") if end >= 0 else b"\0"
        # the first word may begin with the byte of a '#' too; a line of text has no such bytes
        if any(byte < 32 and byte != 9 for byte in text):
            break
        lines.append(text.decode(errors="replace"))
        at = end + 1
        if lines[-1].strip() == END:
            break
    return lines, at
