"""The library's writers, made to leave a readable file whenever the process is killed.

They hold back a chunk of 1 MB (MCAP, ROS 1) or a whole transaction (SQLite), and make a folder for
rosbag2. `keep` ends the chunk or the transaction; `settle` puts the open file into its place.
"""

from __future__ import annotations

import shutil
import sqlite3
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

from evs.drivers.files.bags.library import load


class Storage(ABC):
    """An open bag; messages go through `writer`."""

    writer: Any

    @abstractmethod
    def keep(self) -> None:
        """Hand everything to the system, so that it can be read."""

    @abstractmethod
    def settle(self, target: Path) -> None:
        """Move the file, which stays open."""

    def close(self) -> None:
        """End the file."""
        self.writer.close()


class Ros1Chunks(Storage):
    """A ROS 1 bag."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.writer = load().rosbag1.Writer(path)
        self.writer.open()

    def keep(self) -> None:
        """End the chunk; connections that were declared are in it."""
        self.writer.write_chunk(self.writer.chunks[-1])
        self.writer.bio.flush()

    def settle(self, target: Path) -> None:
        """Move the file."""
        self._path.replace(target)


class Chunks(Storage):
    """An MCAP file: alone it will do, so the library's folder goes."""

    def __init__(self, path: Path, name: str) -> None:
        self._folder = path
        path.mkdir()
        rosbag2 = load().rosbag2
        self.writer = rosbag2.Writer(
            path / name, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP
        )
        self.writer.open()

    def keep(self) -> None:
        """End the chunk, if there is anything in it."""
        if self.writer.storage.chunk.bio.tell():
            self.writer.storage.close_chunk()
        self.writer.storage.bio.flush()

    def settle(self, target: Path) -> None:
        """Move the file out of its folder."""
        self.writer.storage.path.replace(target)
        shutil.rmtree(self._folder)

    def close(self) -> None:
        """End the file; the library describes it in its folder."""
        self.writer.path.mkdir(parents=True)
        try:
            super().close()
        finally:
            shutil.rmtree(self._folder)


class Database(Storage):
    """An SQLite file; its journal lies beside it while a transaction ends."""

    def __init__(self, path: Path, name: str) -> None:
        self._folder = path
        path.mkdir()
        rosbag2 = load().rosbag2
        self.writer = rosbag2.Writer(
            path / name, version=9, storage_plugin=rosbag2.StoragePlugin.SQLITE3
        )
        self.writer.open()

    def keep(self) -> None:
        """End the transaction."""
        self.writer.storage.conn.commit()

    def settle(self, target: Path) -> None:
        """Move the file, and open it anew there, so that its journal lies there too."""
        storage = self.writer.storage
        storage.conn.close()
        for left in (f"{target}-journal", f"{target}-wal", f"{target}-shm"):
            Path(left).unlink(missing_ok=True)
        storage.path.replace(target)
        storage.conn = sqlite3.connect(target)
        # a kill is no power cut: what the system has is safe
        storage.conn.execute("PRAGMA synchronous = OFF")
        storage.conn.execute("PRAGMA cache_spill = OFF")
        storage.cursor = storage.conn.cursor()
        shutil.rmtree(self._folder)

    def close(self) -> None:
        """End the file; the library describes it in its folder."""
        self.writer.path.mkdir(parents=True)
        try:
            super().close()
        finally:
            shutil.rmtree(self._folder)
