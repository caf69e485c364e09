"""`evs view --live ADDRESS`: show a live stream in a window, a file or characters."""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Protocol

from evs.drivers.viewer.display import has_display
from evs.msgs import EventPacket, EvsError

if TYPE_CHECKING:
    from evs.drivers.bus import Subscription
    from evs.drivers.viewer import Window, WindowBuilder
    from evs.drivers.viewer.rerun_drawing import ViewerProgram

REDRAW_S = 0.05
"""shortest time between two drawings of a terminal; windows between them are skipped"""

_HOME, _CLEAR_LINE, _CLEAR_REST = "\x1b[H", "\x1b[K", "\x1b[J"


class Screen(Protocol):
    """Where a live stream is shown."""

    def __enter__(self) -> Screen:
        """Begin."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End."""

    def show(self, packet: EventPacket, stream: Subscription) -> bool:
        """Show one packet and what came with it; False once the window is closed."""


def run(args: argparse.Namespace) -> int:
    """Show packets until the publisher ends, --timeout, Ctrl-C, or the window is closed."""
    from evs.drivers.bus import subscribe

    screen = _screen(args)
    with (
        subscribe(
            args.live,
            args.camera,
            timeout_s=args.timeout,
            frames=True,
            poses=True,
            camera_info=True,
            server_key=args.server_key,
            key=args.key,
        ) as stream,
        screen,
    ):
        try:
            for packet in stream:
                if not screen.show(packet, stream):
                    break
        except KeyboardInterrupt:
            pass
        lost = f"  lost {stream.lost}" if stream.lost else ""
        totals = f"packets {stream.packets}  events {stream.events}{lost}"
        if not stream.packets and not stream.ended and args.timeout is not None:
            raise EvsError(
                f"nothing came from {stream.address} within {args.timeout:g} s: is a publisher "
                "running there? (evs emulate starts one)"
            )
    print(totals, file=sys.stderr)
    return 0


def _screen(args: argparse.Namespace) -> Screen:
    """What is asked for; else a window, or characters without a display."""
    places = {"-o": args.out, "--sketch": args.sketch, "--rerun-web": args.rerun_web}
    asked = [option for option, value in places.items() if value]
    if len(asked) > 1:
        raise EvsError(f"{' and '.join(asked)} show the stream in different places: give one")
    characters = args.sketch or not (asked or has_display())
    if characters and args.points:
        raise EvsError("--points draws in Rerun's viewer: add -o live.rrd or --rerun-web")
    if characters:
        return _Characters()
    file = Path(args.out) if args.out else None
    return _Viewer(file, args.points or 0, web=args.rerun_web)


class _Characters:
    """A sketch of the newest window in the terminal; without one, sketches below each other."""

    def __init__(self) -> None:
        self._builders: dict[str, WindowBuilder] = {}
        self._is_terminal = sys.stdout.isatty()
        self._braille = (sys.stdout.encoding or "").lower().replace("-", "") == "utf8"
        self._due_s: dict[str, float] = {}

    def __enter__(self) -> _Characters:
        if self._is_terminal:
            # another page, which leaves the shell's as it was; no cursor
            print("\x1b[?1049h\x1b[?25l", end="", flush=True)
        return self

    def __exit__(self, *_: object) -> None:
        if self._is_terminal:
            print("\x1b[?25h\x1b[?1049l", end="", flush=True)

    def show(self, packet: EventPacket, stream: Subscription) -> bool:
        from evs.drivers.clock import monotonic_s

        for window in _windows(self._builders, packet):
            if monotonic_s() >= self._due_s.get(window.camera, 0.0):
                if window.camera not in self._due_s and self._is_terminal:
                    # one more camera: all get other places
                    print(_HOME, _CLEAR_REST, sep="", end="")
                self._draw(window, stream.lost)
                self._due_s[window.camera] = monotonic_s() + REDRAW_S
        return True

    def _draw(self, window: Window, lost: int) -> None:
        from evs.drivers.viewer import sketch

        columns, rows = shutil.get_terminal_size()
        # cameras one below the other
        rows = max(2, rows // max(1, len(self._builders)) - 1)
        place = list(self._builders).index(window.camera) * (rows + 1)
        lines = sketch(
            window.picture, columns, rows - 1, colours=self._is_terminal, braille=self._braille
        )
        total = window.on_hz + window.off_hz
        share = f", {100 * window.on_hz / total:.0f} % ON" if total else ""
        head = (
            f"{window.camera}  t {window.end_us / 1e6:.3f} s  {total:,.0f} events/s{share}"
            f"  lost {lost}"
        )
        if not self._is_terminal:
            print("\n".join([head, *lines]), flush=True)
            return
        text = f"{_CLEAR_LINE}\n".join([head[:columns], *lines])
        at = f"\x1b[{place + 1};1H" if place else _HOME
        end = _CLEAR_REST if window.camera == list(self._builders)[-1] else _CLEAR_LINE
        print(f"{at}{text}{end}", end="", flush=True)


class _Viewer:
    """Rerun's viewer in a window of its own or in a browser, or a .rrd file."""

    def __init__(self, file: Path | None, points: int, *, web: bool = False) -> None:
        from evs.drivers.viewer.rerun_drawing import RerunDrawing

        if file is not None and file.suffix != ".rrd":
            raise EvsError(f"'{file}' is no name for a live view: end it in .rrd")
        self._file, self._web = file, web
        self._drawing = RerunDrawing(points)
        self._builders: dict[str, WindowBuilder] = {}
        self._described: dict[str, bool] = {}
        """camera -> whether its optics are included"""
        self._program: ViewerProgram | None = None

    def __enter__(self) -> _Viewer:
        from evs.drivers.viewer.rerun_drawing import ViewerProgram

        if self._file is not None:
            self._drawing.to_file(self._file)
        else:
            self._program = ViewerProgram(web=self._web)
            if self._program.url:
                print(f"open {self._program.url}", file=sys.stderr, flush=True)
            self._drawing.to_viewer(self._program.port)
        return self

    def __exit__(self, *ended: object) -> None:
        for builder in self._builders.values():
            for window in builder.rest():
                self._drawing.window(window)
        self._drawing.close()
        if self._program is not None:
            self._stay(self._program, at_once=ended[0] is not None)

    def show(self, packet: EventPacket, stream: Subscription) -> bool:
        self._describe(packet, stream)
        for frame in stream.frames:
            self._drawing.frame(frame)
        for pose in stream.poses:
            self._drawing.pose(pose)
        self._drawing.events(packet)
        for window in _windows(self._builders, packet):
            self._drawing.window(window)
        if self._drawing.failure:
            raise EvsError(
                f"writing {self._file} stopped: {self._drawing.failure}; Rerun shows what came "
                "before, free some space and listen again"
            )
        return self._program is None or self._program.is_running

    def _describe(self, packet: EventPacket, stream: Subscription) -> None:
        """Describe a new camera, and again when its optics have arrived."""
        from evs.msgs import StreamInfo

        optics = stream.camera_info.get(packet.camera)
        if self._described.get(packet.camera) == (optics is not None):
            return
        self._described[packet.camera] = optics is not None
        known = {} if optics is None else {"k": list(optics.k)}
        self._drawing.describe(
            [StreamInfo(packet.width, packet.height, camera=packet.camera, camera_info=known)]
        )

    @staticmethod
    def _stay(program: ViewerProgram, at_once: bool) -> None:
        """Leave the viewer open until the user closes it, or presses Ctrl-C here."""
        try:
            if not at_once:
                if program.url:
                    print("the stream has ended; Ctrl-C ends the viewer", file=sys.stderr)
                program.wait()
        except KeyboardInterrupt:
            pass
        finally:
            program.close()


def _windows(builders: dict[str, WindowBuilder], packet: EventPacket) -> list[Window]:
    """The windows that a packet completes; a new camera gets a builder."""
    from evs.drivers.viewer import WindowBuilder

    if packet.camera not in builders:
        builders[packet.camera] = WindowBuilder(packet.camera, packet.width, packet.height)
    return list(builders[packet.camera].add(packet))
