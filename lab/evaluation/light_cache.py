"""LightCache: rendered light on disk, each array under a hash of all its inputs.

Files are written atomically. The checksum of the archive finds damage; damaged light is rendered
again.
"""

from __future__ import annotations

import contextlib
import os
import warnings
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from evs.emulator.base.package_paths import cache_folder
from evs.emulator.base.scene import F32
from evs.emulator.base.small_files import open_file
from evs.msgs import EvsError


class DamagedCacheWarning(UserWarning):
    """A file of the cache could not be read and is rendered again."""


def user_cache() -> Path:
    """The default folder: evs/evaluation in XDG_CACHE_HOME or ~/.cache."""
    return cache_folder("evaluation")


class LightCache:
    """A folder of arrays by key.

    Raises:
        EvsError: the folder cannot be made or written.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.hits = 0
        self.misses = 0
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as reason:
            raise EvsError(f"no cache folder '{folder}': {reason.strerror}; give --cache") from None

    def path(self, key: str) -> Path:
        """The file of a key."""
        return self.folder / f"{key}.npz"

    def get(self, key: str, shape: tuple[int, ...], make: Callable[[], F32]) -> F32:
        """The array of a key, rendered if it is not in the cache.

        Args:
            key: hash of all inputs.
            shape: of the array.
            make: renders it; an interruption leaves nothing behind.

        Returns:
            float32 of this shape.
        """
        found = self._read(key, shape)
        if found is not None:
            self.hits += 1
            return found
        self.misses += 1
        made = make()
        self._write(key, made)
        return made

    def has(self, key: str) -> bool:
        """Whether there is a file of that key, damaged or not."""
        return self.path(key).is_file()

    def _read(self, key: str, shape: tuple[int, ...]) -> F32 | None:
        path = self.path(key)
        if not path.is_file():
            return None
        try:
            with open_file(path) as file, np.load(file, allow_pickle=False) as archive:
                light = archive["light"]
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
            light = np.zeros(0)
        if light.dtype == np.float32 and light.shape == shape:
            return np.asarray(light)
        warnings.warn(f"{path} is damaged and is made anew", DamagedCacheWarning, stacklevel=3)
        return None

    def _write(self, key: str, light: F32) -> None:
        target = self.path(key)
        # two runs may make the same light at once
        part = target.with_name(f"{key}.{os.getpid()}.part")
        try:
            with part.open("wb") as file:
                np.savez(file, light=light)
            part.replace(target)
        except OSError as reason:
            raise EvsError(
                f"cannot write to the cache '{self.folder}': {reason.strerror}; "
                "make room there, or give --cache another folder"
            ) from None
        finally:
            with contextlib.suppress(OSError):
                part.unlink()
