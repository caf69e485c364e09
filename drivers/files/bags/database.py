"""rosbag2's older storage, an SQLite database: read by rosbags."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from evs.drivers.files.aedat4.layout import DamageError
from evs.drivers.files.bags.library import load
from evs.drivers.files.bags.walk import Found, Walk


def walk_database(path: Path, walk: Walk) -> Iterator[Found]:
    """Every message of a .db3 file, by time. DamageError: it is none.

    The library tells no byte offsets: what is damaged within is said to be at 0.
    """
    number = 0
    try:
        with load().rosbag2.Reader(path) as bag:
            walk.kinds |= {one.topic: one.msgtype for one in bag.connections}
            for topic, _, data in bag.messages():
                number += 1
                yield Found(topic.topic, topic.msgtype, bytes(data), 0)
    except Exception as reason:  # damaged bytes make it raise a dozen kinds
        said = (str(reason) or type(reason).__name__).splitlines()[0][:300]
        if not number:
            raise DamageError(said) from None
        walk.damage.lost(f"after message {number}", said)
