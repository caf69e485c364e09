"""The camera program at one end of a link, as the test sees it."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from evs.drivers.clock import monotonic_s, sleep_s
from links.link import Side

PROGRAM = Path(__file__).with_name("camera_program.py")


class Camera:
    """A sink in a process at one end, fed a thousand packets a second."""

    def __init__(self, side: Side, kind: str, *, events: int = 3000, **options: Any) -> None:
        """Start the program and wait until it has reported its addresses.

        Args:
            side: The end of the link at which the camera runs.
            kind: The kind of sink: bus, dv or ros2.
            events: How many events each packet holds.
            **options: Arguments of the sink, among them its address.
        """
        command = [*side.python, str(PROGRAM), kind, str(events)]
        self.program = side.run([*command, json.dumps(options)], stdin=-1, stdout=-1, text=True)
        self.where: dict[str, Any] = self._said()

    def look(self) -> dict[str, Any]:
        """Return its progress: seq, late_s, slowest_s, memory_kb, here (known listeners)."""
        return self._ask("look")

    def wait(self, name: str, least: int, most: int = sys.maxsize, patience_s: float = 60) -> None:
        """Wait until the value that it reports under `name` lies between `least` and `most`."""
        deadline_s = monotonic_s() + patience_s
        while not least <= (found := self.look()[name]) <= most:
            assert monotonic_s() < deadline_s, f"{name} is {found}, not {least} ... {most}"
            sleep_s(0.05)

    def stop(self) -> dict[str, Any]:
        """Stop it and return its report: that of the sink, and seq, slowest_s, closing_s."""
        said = self._ask("stop")
        assert self.program.wait(60) == 0
        return said

    def _ask(self, word: str) -> dict[str, Any]:
        try:
            self.program.stdin.write(f"{word}\n")
            self.program.stdin.flush()
        except BrokenPipeError:
            # the missing answer fails with a better message
            pass
        return self._said()

    def _said(self) -> dict[str, Any]:
        line = self.program.stdout.readline()
        assert line, f"the camera has died: {self.program.wait(10)}"
        found: dict[str, Any] = json.loads(line)
        return found
