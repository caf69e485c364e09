"""The way of one key from a pipeline file to the kernel: short, and never upwards."""

from __future__ import annotations

import sys
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import FrameType
from typing import Any

VALUE, KEY = 987.625, "follower_hz"
LAST = "PlainModel._build"
"""Makes the native pixels."""
ROOMS = (
    *("launch", "tools", "drivers", "emulator/simulation", "emulator/camera", "emulator/sensor"),
    *("emulator/render", "emulator/state", "emulator/world", "emulator/optics"),
    *("emulator/config", "emulator/base", "msgs"),
)
"""From top to bottom."""
MOST_STAYS = 15


def holds(value: Any, depth: int = 4) -> bool:
    """Whether a value is the number, its key, or a container or dataclass with the number in it."""
    if isinstance(value, str):
        return value in (KEY, f"sensor.{KEY}")
    if isinstance(value, float):
        return value == VALUE
    inside: Any = ()
    if isinstance(value, dict):
        inside = value.values()
    elif isinstance(value, list | tuple) and len(value) < 200:
        inside = value
    elif is_dataclass(value) and not isinstance(value, type):
        inside = [getattr(value, field.name, None) for field in fields(value)]
    return depth > 0 and any(not isinstance(one, str) and holds(one, depth - 1) for one in inside)


def room(file: str) -> int:
    """The place of a file's room in ROOMS."""
    return next(n for n, name in enumerate(ROOMS) if file.startswith(f"{name}/"))


class Walk:
    """Which functions of evs hold the key, in the order of their calls, until LAST."""

    def __init__(self, checkout: Path) -> None:
        self.top = f"{checkout}/"
        self.names: dict[str, str] = {}
        self.calls: list[list[Any]] = []
        """file, function, file of the caller, whether it holds the key"""
        self.open: dict[int, list[Any]] = {}

    def file(self, frame: FrameType | None) -> str:
        """The file of a frame, from the top; "" where it is generated or not of evs."""
        name = "<" if frame is None else frame.f_code.co_filename
        if name not in self.names:
            path = "" if name.startswith("<") else str(Path(name).resolve())
            ours = path.startswith(self.top) and "/.venv/" not in path
            self.names[name] = path.removeprefix(self.top) if ours else ""
        return self.names[name]

    def __call__(self, frame: FrameType, event: str, result: object) -> None:
        if event not in ("call", "return") or not (file := self.file(frame)):
            return
        if event == "call":
            caller = frame.f_back
            while caller is not None and not self.file(caller):
                caller = caller.f_back
            call = [file, frame.f_code.co_qualname, self.file(caller), False]
            self.open[id(frame)] = call
            self.calls.append(call)
        call = self.open.get(id(frame), [None] * 4)
        values = [*frame.f_locals.values(), result if event == "return" else None]
        call[3] = call[3] or any(map(holds, values))


def test_a_key_walks_from_the_file_to_the_kernel(checkout: Path, tmp_path: Path) -> None:
    from evs.launch.main import main

    file, scene = tmp_path / "a.toml", checkout / "config" / "scenes" / "pendulum.xml"
    file.write_text(
        f'duration_s = 0.001\n[scene]\nfile = "{scene}"\n'
        f'[sensor]\npreset = "ideal"\nwidth = 8\nheight = 8\n{KEY} = {VALUE}\n'
    )
    walk = Walk(checkout)
    sys.setprofile(walk)
    try:
        assert main(["emulate", str(file), "--quiet"]) == 0
    finally:
        sys.setprofile(None)
    end = next(number for number, call in enumerate(walk.calls, 1) if call[1] == LAST)
    way = [call for call in walk.calls[:end] if call[3]]
    assert LAST in way[-1]
    files = [call[0] for call in way]
    stays = sum(before != after for before, after in zip(["", *files], files, strict=False))
    climbs = [call[:3] for call in way if room(call[2]) > room(call[0])]
    listing = "\n".join(f"{file} {function}" for file, function, *_ in way)
    assert (climbs, stays > MOST_STAYS) == ([], False), f"{stays} stays\n{listing}"
