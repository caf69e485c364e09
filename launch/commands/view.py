"""`evs view`: show a recording as a picture or film, or a live stream."""

from __future__ import annotations

import argparse
import math
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from evs.launch.support import options
from evs.launch.support.options import add_reading_options, reading_options
from evs.msgs import Events, EvsError

if TYPE_CHECKING:
    from evs.drivers.files.formats import ReadOptions
    from evs.drivers.files.reading import Recording
    from evs.drivers.pictures import Playback
    from evs.msgs.pictures import U8

EPILOG = """\
examples:
  evs view run.aedat4                                three instants, as run.aedat4.png
  evs view run.aedat4 -o run.gif                     the whole recording at 1/4 real time
  evs view run.npz -o run.mp4 --speed 0.1 --start 0.5 --stop 1
  evs view --live tcp://127.0.0.1:5560               live, in Rerun's viewer or as characters
  evs view --live tcp://127.0.0.1:5560 -o live.rrd   to a file for Rerun's viewer
  evs view --web tcp://127.0.0.1:5560                live, as a page in a browser
  evs view --live tcp://127.0.0.1:5560 --rerun-web   Rerun's viewer in a browser on this machine
blue: brighter (ON), red: darker (OFF). Times are seconds after the recording's first event."""

MAX_SCALE = 64
"""largest --scale"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    from evs.drivers.files import endings

    parser.epilog = EPILOG
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    add = parser.add_argument
    add("file", metavar="FILE", nargs="?", help=f"a recording: {endings()}")
    add("-o", "--out", metavar="PICTURE", help=".png, .gif or .mp4 (default: FILE.png); live: .rrd")
    add(
        "--window",
        metavar="MS",
        type=float,
        help="time span of the events shown (default: one frame)",
    )
    add("--fps", metavar="N", type=float, help="frames per second of the film")
    add(
        "--speed", metavar="X", type=float, help="speed of the film: 1 is real time, 0.25 a quarter"
    )
    add("--start", metavar="S", type=float, help="start, s after the first event")
    add("--stop", metavar="S", type=float, help="end, s after the first event")
    add("--scale", metavar="N", type=int, help="picture pixels per sensor pixel (default: by size)")
    add_reading_options(parser)
    live_view = parser.add_argument_group("live")
    live_view.add_argument(
        "--live", metavar="ADDRESS", help="show the stream of a publisher instead"
    )
    live_view.add_argument("--camera", default="", metavar="NAME", help="show only this camera")
    live_view.add_argument(
        "--sketch",
        action="store_true",
        help="draw with characters in the terminal, even with a display",
    )
    live_view.add_argument(
        "--rerun-web",
        action="store_true",
        help="serve Rerun's viewer to a browser on this machine, and print its address",
    )
    live_view.add_argument(
        "--points",
        type=int,
        metavar="N",
        help="in Rerun, also draw a cloud of events in x, y and time, of at most N points",
    )
    live_view.add_argument(
        "--timeout", type=float, metavar="S", help="end after S seconds without a packet"
    )
    live_view.add_argument(
        "--web", metavar="ADDRESS", help="show the stream of a publisher in a browser"
    )
    live_view.add_argument(
        "--control",
        default="",
        metavar="ADDRESS",
        help="the publisher's control port: sliders on the page then change its sensors",
    )
    live_view.add_argument(
        "--port", type=int, default=0, metavar="N", help="port of the page (default: any free one)"
    )
    live_view.add_argument(
        "--no-browser",
        action="store_true",
        help="print the page's address without opening a browser",
    )
    options.add_key_options(live_view)


def run(args: argparse.Namespace) -> int:
    """Write the picture and print what it shows, or show a live stream until it ends."""
    if sum(one is not None for one in (args.file, args.live, args.web)) != 1:
        raise EvsError(
            "give a recording, as in evs view run.aedat4, or --live ADDRESS, or --web ADDRESS"
        )
    if args.web is not None:
        from evs.launch.support import web_view

        _only("--web", args, ("out", "window", "fps", "speed", "start", "stop", "scale"))
        return web_view.run(args)
    if args.control or args.port or args.no_browser:
        raise EvsError("--control, --port and --no-browser belong to --web ADDRESS")
    if args.live is not None:
        from evs.launch.support import live_view

        _only("--live", args, ("window", "fps", "speed", "start", "stop", "scale"))
        return live_view.run(args)
    live = (args.sketch, args.camera, args.rerun_web, args.points, args.server_key, args.key)
    if any(live) or args.timeout is not None:
        raise EvsError(
            "--sketch, --rerun-web, --points, --camera, --timeout and keys belong to --live ADDRESS"
        )
    from evs.drivers.pictures import need_video, span_us, suffix_of

    # refuse bad words before anything is read
    out = Path(args.out) if args.out else Path(f"{args.file}.png")
    suffix = suffix_of(out)
    if suffix == ".mp4":
        need_video()
    if args.scale is not None and not 1 <= args.scale <= MAX_SCALE:
        raise EvsError(f"--scale is {args.scale}: give a whole number from 1 to {MAX_SCALE}")
    recording = _read(args.file, reading_options(args))
    # a camera's clock or Unix time would make --start and the captions unreadable
    origin_us, _ = span_us(recording)
    recording["t"] -= origin_us
    playback = _playback(args, recording)
    if suffix == ".png":
        shown = _still(out, recording, origin_us, playback, args.scale, Path(args.file).name)
    else:
        shown = _film(out, suffix, recording, origin_us, playback, args.scale)
    print(f"{out}: {shown}, {out.stat().st_size / 1e6:.2f} MB")
    return 0


def _only(what: str, args: argparse.Namespace, others: tuple[str, ...]) -> None:
    """Refuse options that have no meaning there."""
    for name in others:
        if getattr(args, name) is not None:
            raise EvsError(f"--{name} is for recordings: leave it out with {what}")


def _read(file: str, reading: ReadOptions) -> Recording:
    from evs.drivers.files import read

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        recording = read(file, **reading)
    for warning in caught:
        print(f"evs: warning: {warning.message}", file=sys.stderr)
    if not len(recording):
        print(f"evs: warning: {file} has no events", file=sys.stderr)
    return recording


def _playback(args: argparse.Namespace, events: Events) -> Playback:
    from evs.drivers.pictures import Playback, span_us

    first_us, last_us = span_us(events)
    start_us = first_us if args.start is None else _us("--start", args.start, 1e6)
    stop_us = last_us if args.stop is None else _us("--stop", args.stop, 1e6)
    if start_us >= last_us or stop_us <= first_us:
        raise EvsError(
            f"{args.file} lasts {last_us / 1e6:g} s from its first event on: choose --start and "
            "--stop in there"
        )
    window_us = None if args.window is None else _us("--window", args.window, 1e3)
    values = {"fps": args.fps, "speed": args.speed, "window_us": window_us}
    chosen = {name: value for name, value in values.items() if value is not None}
    return Playback(start_us, stop_us, **chosen)


def _us(option: str, value: float, unit_us: float) -> int:
    if not math.isfinite(value):
        raise EvsError(f"{option} is {value:g}: give a number")
    return round(value * unit_us)


def _still(
    out: Path,
    recording: Recording,
    origin_us: int,
    playback: Playback,
    scale: int | None,
    title: str,
) -> str:
    from evs.drivers.pictures import (
        Shot,
        events_between,
        preview,
        shot_times,
        write_png,
    )

    begin_us, end_us = playback.frame_window(0)
    window_us = end_us - begin_us
    times = shot_times(playback.start_us, playback.stop_us)
    stream = recording.stream
    behind = _behind(recording, origin_us) or (lambda _t_us: None)
    shots = [
        Shot(t, window_us, events_between(recording, t - window_us, t), behind(t)) for t in times
    ]
    page = preview(shots, stream.width, stream.height, f"{title}, {stream.sensor}", scale)
    write_png(out, page)
    when = ", ".join(f"{t / 1e6:g}" for t in times)
    return f"{len(shots)} instants ({when} s), {page.shape[1]} x {page.shape[0]} px"


def _film(
    out: Path,
    suffix: str,
    recording: Recording,
    origin_us: int,
    playback: Playback,
    scale: int | None,
) -> str:
    from evs.drivers.pictures import (
        MAX_FRAMES,
        clip_frames,
        events_between,
        speed_words,
        write_gif,
        write_mp4,
    )

    count, most = playback.frame_count, MAX_FRAMES[suffix]
    if count > most:
        where = _silence(events_between(recording, playback.start_us, playback.stop_us))
        other = ", or use .mp4" if most < count <= MAX_FRAMES[".mp4"] else ""
        raise EvsError(
            f"a film of {count} frames is too long (most of {suffix}: {most}): "
            f"{where}show less (--start, --stop) or faster (--speed){other}"
        )
    stream = recording.stream
    behind = _behind(recording, origin_us)
    frames = clip_frames(recording, stream.width, stream.height, playback, scale, behind)
    if suffix == ".gif":
        write_gif(out, frames, playback)
    else:
        write_mp4(out, frames, playback.fps)
    return f"{count} frames, {count / playback.fps:.2f} s at {speed_words(playback.speed)}"


def _behind(recording: Recording, origin_us: int) -> Callable[[int], U8 | None] | None:
    """The light behind the events at a time after the first event; None: there are no frames."""
    from evs.drivers.pictures import recorded_light

    light = recorded_light(recording.frames, recording.stream.width, recording.stream.height)
    return None if light is None else lambda t_us: light.at(t_us + origin_us)


def _silence(events: Events) -> str:
    """What to exclude if one gap is most of a recording, as after a damaged stamp."""
    t = events["t"]
    if len(t) < 2:
        return ""
    gaps = t[1:] - t[:-1]
    place = int(gaps.argmax())
    before_us, after_us = int(t[place]), int(t[place + 1])
    if 2 * (after_us - before_us) < int(t[-1]) - int(t[0]):
        return ""
    first = place + 1 < len(t) / 2
    fix = f"--start {(after_us - 1) / 1e6:.6f}" if first else f"--stop {before_us / 1e6:.6f}"
    return f"no event from {before_us / 1e6:.6f} s to {after_us / 1e6:.6f} s, so give {fix}; else "
