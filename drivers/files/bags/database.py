"""rosbag2's older storage, an SQLite database."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from evs.drivers.files.aedat4.compression import MAX_BODY_BYTES
from evs.drivers.files.aedat4.layout import CorruptDataError
from evs.drivers.files.bags.records import BagMessage, BagScan

_NAMES = "SELECT id, name, type FROM main.topics"
_MESSAGES = "SELECT topic_id, data FROM main.messages ORDER BY timestamp, id"
_TABLES = "SELECT name, type, sql FROM main.sqlite_master"
_PLAIN = re.compile(r"\s*create\s+table\b(?!.*\b(as|generated)\b)", re.I | re.S)
"""the SQL of a plain table, which computes nothing"""

_JOURNAL_ENDS = b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"
"""follows the name of another journal, which SQLite would read and delete"""

_STEPS, _STEPS_A_BYTE = 1 << 20, 64
"""SQLite's steps between two checks of their number; most steps for each byte of a file"""


def journal_of(path: Path) -> Path | None:
    """The journal that a killed writer left of its transaction; None without one."""
    journal = path.with_name(f"{path.name}-journal")
    return journal if journal.is_file() and journal.stat().st_size else None


def open_database(path: Path) -> sqlite3.Connection:
    """The database, as it was before a transaction that a kill cut off.

    SQLite takes such a transaction back when it opens the file, which needs the right to write it.
    No value is larger than the file, and no question takes longer than in proportion to it; other
    files are not looked at. CorruptDataError: it would have to be.
    """
    journal = journal_of(path)
    if journal is not None:
        with journal.open("rb") as file:
            file.seek(max(0, journal.stat().st_size - len(_JOURNAL_ENDS)))
            if file.read() == _JOURNAL_ENDS:
                raise CorruptDataError("its journal names another one, which is not read")
    how = "mode=rw" if journal or _has_log(path) else "immutable=1"
    bag = sqlite3.connect(f"file:{quote(str(path))}?{how}", uri=True)
    size = path.stat().st_size
    bag.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(MAX_BODY_BYTES, max(size, _STEPS)))
    bag.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)
    bag.execute("PRAGMA trusted_schema = OFF")
    left = iter(range(_STEPS_A_BYTE * size // _STEPS + 64))
    # the first answer but 0 ends the question
    bag.set_progress_handler(lambda: next(left, None) is None, _STEPS)
    return bag


def _has_log(path: Path) -> bool:
    return path.with_name(f"{path.name}-wal").is_file()


def scan_database(path: Path, scan: BagScan) -> Iterator[BagMessage]:
    """Every message of a .db3 file, by time. CorruptDataError: it is not one.

    SQLite gives no byte offsets, so damage within the file is reported at 0.
    """
    number = 0
    try:
        with closing(open_database(path)) as bag:
            _check_tables(bag)
            topics: dict[object, tuple[str, str]] = {}
            for place, name, kind in bag.execute(_NAMES):
                topics.setdefault(place, (str(name), str(kind)))
            scan.kinds.update(topics[place] for place in sorted(topics, key=str))
            for place, data in bag.execute(_MESSAGES):
                number += 1
                if isinstance(data, bytes) and place in topics:
                    yield BagMessage(*topics[place], data, 0)
    except (sqlite3.Error, UnicodeDecodeError, OverflowError, MemoryError) as reason:
        text = (str(reason) or type(reason).__name__).splitlines()[0][:300]
        if not number:
            raise CorruptDataError(text) from None
        scan.integrity.corrupt_part(f"after message {number}", text)


def _check_tables(bag: sqlite3.Connection) -> None:
    """CorruptDataError unless topics and messages are plain tables: views compute."""
    kinds = {name: (kind, sql) for name, kind, sql in bag.execute(_TABLES)}
    for name in ("topics", "messages"):
        kind, sql = kinds.get(name, ("", ""))
        if kind != "table" or not _PLAIN.match(str(sql)):
            raise CorruptDataError(f"{name} is no plain table in it")
