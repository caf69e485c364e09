"""The library's writers, adapted so that a killed process leaves a readable file at any moment.

They buffer a chunk of 1 MB (MCAP, ROS 1) or a whole transaction (SQLite), and make a folder for
rosbag2. `sync` ends the chunk or the transaction; `move_to` moves the open file to its place.
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
    def sync(self) -> None:
        """Hand everything to the operating system, so that the file is readable up to here."""

    @abstractmethod
    def move_to(self, target: Path) -> None:
        """Move the file to its final name; it stays open."""

    def close(self) -> None:
        """Write the end of the file and close it."""
        self.writer.close()


class Ros1BagFile(Storage):
    """A ROS 1 bag."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.writer = load().rosbag1.Writer(path)
        self.writer.open()

    def sync(self) -> None:
        """End the chunk; it contains the connections declared so far."""
        self.writer.write_chunk(self.writer.chunks[-1])
        self.writer.bio.flush()

    def move_to(self, target: Path) -> None:
        """Move the file."""
        self._path.replace(target)


class _Rosbag2Storage(Storage):
    """A file of rosbag2, out of the folder that the library makes for it."""

    def __init__(self, path: Path, name: str, plugin: str) -> None:
        """Create the file.

        Args:
            path: The folder.
            name: Name of the bag in it.
            plugin: MCAP or SQLITE3, of the library's StoragePlugin.
        """
        self._folder = path
        path.mkdir()
        rosbag2 = load().rosbag2
        self.writer = rosbag2.Writer(
            path / name, version=9, storage_plugin=getattr(rosbag2.StoragePlugin, plugin)
        )
        self.writer.open()

    def close(self) -> None:
        """Write the end of the file; the library describes the bag in its folder."""
        self.writer.path.mkdir(parents=True)
        try:
            super().close()
        finally:
            shutil.rmtree(self._folder)


class McapFile(_Rosbag2Storage):
    """An MCAP file, which is complete without its folder."""

    def __init__(self, path: Path, name: str) -> None:
        super().__init__(path, name, "MCAP")

    def sync(self) -> None:
        """End the chunk, if there is anything in it."""
        if self.writer.storage.chunk.bio.tell():
            self.writer.storage.close_chunk()
        self.writer.storage.bio.flush()

    def move_to(self, target: Path) -> None:
        """Move the file out of its folder."""
        self.writer.storage.path.replace(target)
        shutil.rmtree(self._folder)


class SqliteFile(_Rosbag2Storage):
    """An SQLite file; its journal lies next to it while a transaction ends."""

    def __init__(self, path: Path, name: str) -> None:
        super().__init__(path, name, "SQLITE3")

    def sync(self) -> None:
        """End the transaction."""
        self.writer.storage.conn.commit()

    def move_to(self, target: Path) -> None:
        """Move the file, and open it again there, so that its journal lies there too."""
        storage = self.writer.storage
        storage.conn.close()
        for left in (f"{target}-journal", f"{target}-wal", f"{target}-shm"):
            Path(left).unlink(missing_ok=True)
        storage.path.replace(target)
        storage.conn = sqlite3.connect(target)
        # a kill is not a power cut: what the operating system has is safe
        storage.conn.execute("PRAGMA synchronous = OFF")
        storage.conn.execute("PRAGMA cache_spill = OFF")
        storage.cursor = storage.conn.cursor()
        shutil.rmtree(self._folder)
