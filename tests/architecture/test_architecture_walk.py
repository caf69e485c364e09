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


def floor(file: str) -> int:
    """Of a file's room; the top is 0."""
    return next(number for number, name in enumerate(ROOMS) if file.startswith(name))


def test_a_key_walks_from_the_file_to_the_kernel(checkout: Path, tmp_path: Path) -> None:
    from evs.launch.main import main

    names: dict[str, str] = {}
    calls: list[list[Any]] = []  # file, function, file of the caller, whether it holds the key
    running: dict[int, list[Any]] = {}

    def file_of(frame: FrameType | None) -> str:
        """From the top; "" where it is generated or not of evs."""
        name = "<" if frame is None else frame.f_code.co_filename
        if name not in names:
            path = "" if name.startswith("<") else str(Path(name).resolve())
            ours = path.startswith(f"{checkout}/") and "/.venv/" not in path
            names[name] = path.removeprefix(f"{checkout}/") if ours else ""
        return names[name]

    def see(frame: FrameType, event: str, result: object) -> None:
        if event not in ("call", "return") or not (file := file_of(frame)):
            return
        if event == "call":
            caller = frame.f_back
            while caller is not None and not file_of(caller):
                caller = caller.f_back
            running[id(frame)] = [file, frame.f_code.co_qualname, file_of(caller), False]
            calls.append(running[id(frame)])
        values = [*frame.f_locals.values(), result if event == "return" else None]
        if id(frame) in running:
            running[id(frame)][3] |= any(map(holds, values))

    pipeline, scene = tmp_path / "a.toml", checkout / "config" / "scenes" / "pendulum.xml"
    pipeline.write_text(
        f'duration_s = 0.001\n[scene]\nfile = "{scene}"\n'
        f'[sensor]\npreset = "ideal"\nwidth = 8\nheight = 8\n{KEY} = {VALUE}\n'
    )
    sys.setprofile(see)
    try:
        assert main(["emulate", str(pipeline), "--quiet"]) == 0
    finally:
        sys.setprofile(None)
    end = next(number for number, call in enumerate(calls, 1) if call[1] == LAST)
    way = [call for call in calls[:end] if call[3]]
    assert LAST in way[-1]
    files = [call[0] for call in way]
    stays = sum(before != after for before, after in zip(["", *files], files, strict=False))
    climbs = [call[:3] for call in way if floor(call[2]) > floor(call[0])]
    lines = [f"{file} {function}" for file, function, *_ in way]
    shown = "\n".join([f"{stays} stays, climbs: {climbs}", *lines])
    assert stays <= MOST_STAYS, shown
    assert climbs == [], shown
