"""Repair of AEDAT4 files: cuts the torn tail in place."""

from __future__ import annotations

import dataclasses
import os
from typing import BinaryIO

from evs.drivers.files.aedat4 import layout
from evs.drivers.files.aedat4.reader import Aedat4File
from evs.drivers.files.integrity import Repair
from evs.drivers.files.paths import target_error
from evs.msgs import EvsError


def repair(path: str | os.PathLike[str]) -> Repair:
    """Cut everything after the last whole packet (or the data table, where that is whole).

    Damaged packets between whole ones stay where they are. EvsError: not an AEDAT4 file that can be
    read, or not writable.
    """
    file = Aedat4File.at(path)
    for _ in file.messages():
        pass
    whole = file.whole_packets
    cut_at = file.size if file.integrity.torn_at is None else file.integrity.torn_at
    if not whole and file.first_packet_fits():
        raise EvsError(
            f"no packet of {file.path} can be read and its header may be damaged: "
            "repair leaves it as it is; restore it from a copy"
        )
    # a tail cut before the table takes the table with it
    reset = file.broken_pointer or layout.NO_TABLE < file.header.table_position >= cut_at
    report = Repair(file.path, file.size - cut_at, cut_at, reset)
    if report.needed:
        try:
            with file.path.open("r+b") as target:
                _cut(target, file, report)
        except OSError as reason:
            raise target_error(file.path, reason) from None
    return report


def _cut(target: BinaryIO, file: Aedat4File, report: Repair) -> None:
    at = file.header.table_position_at
    if report.pointer_reset and at is not None:
        target.seek(len(layout.MAGIC))
        header = bytearray(target.read(file.packets_at - len(layout.MAGIC)))
        header[at : at + 8] = layout.NO_TABLE.to_bytes(8, "little", signed=True)
        # in a damaged header the pointer may seem to lie where something else does
        wanted = dataclasses.replace(file.header, table_position=layout.NO_TABLE)
        if _parsed(bytes(header)) != wanted:
            raise EvsError(
                f"the header of {file.path} is damaged: repair leaves it as it is; "
                "restore it from a copy"
            )
        target.seek(len(layout.MAGIC))
        target.write(header)
        target.flush()
    target.truncate(report.cut_at)


def _parsed(header: bytes) -> layout.IOHeader | None:
    try:
        return layout.parse_io_header(header)
    except layout.CorruptDataError:
        return None
