"""`evs render`: render light and ground truth of a scene as arrays, without events."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path

from evs.drivers.run import config as pipeline
from evs.emulator.config import decoding
from evs.launch.support import options
from evs.msgs import EvsError

OPTIONS = {
    "scene": ("scene.file", "FILE", "MJCF or MJB file of the world"),
    "camera": ("scene.camera", "NAME", "camera of the model to look through"),
    "sensor": ("sensor.preset", "NAME", "sensor preset; only its size is used"),
    "size": options.SIZE,
    "renderer": ("render.renderer", "NAME", "how light is computed"),
    "spp": ("render.spp", "N", "samples per pixel"),
    "seeds": ("render.seeds", "WAY", "where the samples come from"),
    "duration": ("duration_s", "S", "simulated seconds; 0: one frame"),
    "threads": ("threads", "N", "worker threads; 0: one per core"),
    "seed": ("seed", "N", "random seed"),
}
"""option -> (the key it is short for, placeholder, one line). Defaults stand with the keys."""

NOT_HERE = (
    *("sink", "record", "overwrite", "beside", "report", "pace"),
    *(field.name for field in fields(pipeline.PipelineConfig) if field.name.startswith("publish")),
)
"""keys that only a run with events has; in a pipeline file they do no harm"""

EVERY_TICK = "tick"

EXAMPLES = """\
examples:
  evs render --scene robot.xml -o robot.npz                 a second at 25 fps, every channel
  evs render --scene robot.xml --duration 0 --size 640x480 -o still.npz --preview still.png
  evs render --scene robot.xml --fps tick --channels luminance,flow -o ticks.npz

The file: numpy.load("robot.npz") has t_us (n,), info (JSON: camera_info, configuration, seed,
versions) and one array (n, height, width, ...) per channel:
  luminance   linear, BT.709 weights            rgb        (3) linear
  depth       m, along the optical axis         distance   m, along the ray; both inf: nothing there
  normal      (3) unit, world frame             position   (3) m, world frame; both NaN: nothing
  geom_id     MuJoCo's; -1: nothing; -2 and below: skins, flexes, sites, tendons, actuators
  body_id     MuJoCo's; -1: nothing, or an object of several bodies
  flow        (2) px/s to the right and down, mean over the last tick; NaN at t = 0
Ground truth belongs to the ray through each pixel's centre. Each frame is written as soon as it is
rendered, so Ctrl-C loses nothing.

"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments; what is short for a key stays text."""
    parser.usage = "evs render [SCENE.xml] [PIPELINE.toml] [key=value ...] [options] -o FILE.npz"
    options.add_pipeline_options(parser, OPTIONS)
    add = parser.add_argument
    add("-o", "--out", metavar="FILE.npz", required=True, help="the file to write")
    add(
        "--fps",
        default="25",
        metavar="N",
        help="frames per simulated second (25); tick: every tick",
    )
    add("--channels", default="all", metavar="A,B", help="channels to write (default: all)")
    add("--preview", metavar="FILE.png", help="draw the channels of the last frame in one picture")
    add("--force", action="store_true", help="replace existing files")
    add("--quiet", action="store_true", help="print nothing but warnings and errors")


def epilog() -> str:
    """What help says below the options."""
    return EXAMPLES + options.keys_text(NOT_HERE)


def run(args: argparse.Namespace) -> int:
    """Render; the exit code."""
    file, overrides = options.parse_pipeline(args, OPTIONS)
    for key, _ in overrides:
        if key.partition(".")[0] in NOT_HERE:
            raise EvsError(f"{key} is a key of evs emulate; evs render writes one file, -o")
    config = pipeline.load(file, overrides)
    # here, so that --help is quick
    from evs.drivers.files.paths import check_new
    from evs.drivers.run import rendering
    from evs.launch.commands.emulate import STOPPED
    from evs.launch.support import terminal

    channels = rendering.chosen_channels(args.channels, config.render.renderer)
    ticks = rendering.instants(config.duration_s, _fps(args.fps), config.scene.tick_us)
    out = rendering.check_target(args.out, [config.scene.file, config.scene.control_file])
    preview = None if args.preview is None else Path(args.preview)
    if preview is not None and preview.suffix.lower() != ".png":
        raise EvsError(f"--preview is '{preview}': end it in .png")
    if not args.force:
        check_new([out, *([] if preview is None else [preview])])
    with terminal.bar("rendering", len(ticks), args.quiet) as moved:
        done = rendering.render(
            config,
            out,
            channels,
            ticks,
            lambda frames, t_us: moved(frames, f"{t_us / 1e6:7.3f} s"),
            decoding.to_plain(config),
        )
    if preview is not None and done.last is not None:
        from evs.drivers.pictures import channel_page, write_png

        write_png(preview, channel_page(done.last))
    if not args.quiet:
        partial = "" if done.frames == len(ticks) else f" of {len(ticks)} ({done.ended})"
        size = f"{done.size / 1e6:.2f} MB"
        print(f"{out}: {done.frames} frames{partial}, {size}: t_us, {', '.join(channels)}")
    return STOPPED.get(done.ended, 0)


def _fps(text: str) -> float | None:
    if text == EVERY_TICK:
        return None
    try:
        return float(text)
    except ValueError:
        raise EvsError(
            f"--fps is '{text}': give a number, or {EVERY_TICK} for every tick"
        ) from None
