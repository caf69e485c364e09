"""rosbag2's older storage, an SQLite database."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from evs.drivers.files.aedat4.layout import DamageError
from evs.drivers.files.bags.walk import Found, Walk

_MESSAGES = (
    "SELECT topics.name, topics.type, messages.data FROM messages JOIN topics "
    "ON messages.topic_id = topics.id ORDER BY messages.timestamp, messages.id"
)


def journal_of(path: Path) -> Path | None:
    """What a killed writer left of the transaction it was in; None: nothing."""
    journal = path.with_name(f"{path.name}-journal")
    return journal if journal.is_file() and journal.stat().st_size else None


def opened(path: Path) -> sqlite3.Connection:
    """The database, as it was before a transaction that a kill cut off.

    SQLite takes such a transaction back when it opens the file, which needs the right to write it.
    """
    how = "mode=rw" if journal_of(path) or _has_log(path) else "immutable=1"
    return sqlite3.connect(f"file:{quote(str(path))}?{how}", uri=True)


def _has_log(path: Path) -> bool:
    return path.with_name(f"{path.name}-wal").is_file()


def walk_database(path: Path, walk: Walk) -> Iterator[Found]:
    """Every message of a .db3 file, by time. DamageError: it is none.

    SQLite tells no byte offsets: what is damaged within is said to be at 0.
    """
    number = 0
    try:
        with closing(opened(path)) as bag:
            for name, kind in bag.execute("SELECT name, type FROM topics ORDER BY id"):
                walk.kinds[str(name)] = str(kind)
            for topic, kind, data in bag.execute(_MESSAGES):
                number += 1
                if isinstance(data, bytes):
                    yield Found(str(topic), str(kind), data, 0)
    except (sqlite3.Error, UnicodeDecodeError, OverflowError, MemoryError) as reason:
        said = (str(reason) or type(reason).__name__).splitlines()[0][:300]
        if not number:
            raise DamageError(said) from None
        walk.damage.lost(f"after message {number}", said)
