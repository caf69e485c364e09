"""`evs dataset`: events, frames and ground truth of scenes on one clock, in shards."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from evs.drivers.run.sensor_ranges import range_overrides
from evs.emulator.config import decoding
from evs.msgs import EvsError

if TYPE_CHECKING:
    from evs.tools.dataset import SceneFile

KEYS = {
    "duration": ("duration_s", "S", "simulated seconds of each scene"),
    "begin": ("begin_s", "S", "scene time at the start (0, or when the scene has settled)"),
    "camera": ("scene.camera", "NAME", "camera of the model to look through"),
    "sensor": ("sensor.preset", "NAME", "sensor preset"),
    "renderer": ("render.renderer", "NAME", "how light is computed: path or direct"),
    "spp": ("frames.spp", "N", "samples per pixel of the frames (256; direct: 64)"),
    "fps": ("frames.fps", "N", "frames per simulated second (60)"),
    "seed": ("seed", "N", "random seed"),
    "episodes": ("episodes", "N", "sequences of each scene, each with its own seed (1)"),
    "threads": ("threads", "N", "threads per shard; 0: its share of the cores"),
}
"""option -> (the key it is short for, placeholder, one line)"""

SHORT = {
    "duration_s": "0.1",
    "settle_s": "0",
    "sensor.width": "86",
    "sensor.height": "65",
    "render.spp": "2",
    "frames.spp": "8",
}
"""What --short sets, unless the command line says otherwise"""
SHORT_SHARD_S = 0.05

EXAMPLES = """\
examples:
  evs dataset out/etscenes                          six scenes, 90 s in total: 33 core hours
  evs dataset out/sharp --renderer direct           the same without bounced light: 1 core hour
  evs dataset out/small --short                     0.1 s of each scene, in a minute
  evs dataset out/night --scenes street,tunnel --workers 8
  evs dataset out/arm --scene robot.xml --camera wrist --duration 5 --renderer direct
  evs dataset out/varied --episodes 20 --randomise 'pos_thres=uniform(0.15, 0.35)'
                                                    120 sequences, each with its own thresholds
  evs dataset out/etscenes --verify                 compare every file with the manifest

Run a stopped command again to resume it. The bytes are the same with any number of workers. The
keys are those of evs emulate (render.spp=4 sets the samples of the events' light), plus frames.spp
and frames.fps. DIR/SCENE then has
  events/NNNN/events.npz  t us, x, y, p, cause, geom_id; IMU samples    (numpy.load, evs.read)
  events/NNNN/pose.npz    t_us, position, orientation of the camera at each tick
  frames/NNNN/frames.npz  t_us, rgb, luminance, depth, normal, flow, geom_id, body_id, pose
  events.aedat4           all events and IMU samples as one recording
  sheet.png               one moment in every channel
and DIR/manifest.json lists every file with its checksum, the names of geoms and bodies, and the
configuration.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments; what is short for a key stays text."""
    parser.usage = "evs dataset DIR [key=value ...] [options]"
    add = parser.add_argument
    add("words", nargs="+", metavar="DIR, key=value", help="the folder, then any keys")
    add("--scenes", metavar="A,B", help="scenes of the set to make (all)")
    add("--scene", metavar="FILE", help="your own scene instead: MJCF or MJB")
    add(
        "--randomise",
        action="append",
        default=[],
        metavar="FILE|KEY=RANGE",
        help="a different sensor or scene in each sequence: ranges, or a TOML file of them",
    )
    add("--short", action="store_true", help="small and quick, to check that everything works")
    for option, (key, placeholder, line) in KEYS.items():
        add(f"--{option}", metavar=placeholder, help=f"{line}; short for {key}=")
    add(
        "--workers",
        type=int,
        default=1,
        metavar="N",
        help="shards to make in parallel on this machine (1)",
    )
    add("--shard", type=float, metavar="S", help="simulated seconds per shard (1; --short: 0.05)")
    add("--ray", default="", metavar="ADDRESS", help="make the shards on this Ray cluster")
    add("--verify", action="store_true", help="only compare DIR with its manifest")
    add("--describe", action="store_true", help="only describe what DIR holds or will hold")
    add("--sheet", metavar="FILE.png", help="draw all scenes of the finished DIR in one picture")
    add("--quiet", action="store_true", help="print nothing but warnings and errors")
    parser.epilog = EXAMPLES


def run(args: argparse.Namespace) -> int:
    """Make, check or describe a data set; the exit code."""
    folders = [word for word in args.words if "=" not in word]
    if len(folders) != 1:
        raise EvsError(f"give one folder for the data set, not {len(folders)}")
    folder = Path(folders[0]).expanduser()
    # here, so that --help is quick
    from evs.launch.support import terminal

    if args.sheet and args.describe:
        raise EvsError("--describe makes no scenes for --sheet to draw; leave out one of them")
    if args.sheet:
        _check_sheet(Path(args.sheet), folder)
    if args.verify:
        from evs.tools.dataset.manifest import MANIFEST, read_json, verify

        files = len(read_json(folder / MANIFEST)["files"])
        with terminal.bar("verifying", files, args.quiet) as moved:
            verify(folder, moved)
        if not args.quiet:
            print(f"{folder}: {files} files are as {MANIFEST} says")
        if args.sheet:
            _sheet(folder, Path(args.sheet))
        return 0
    scenes = _scenes(args)
    if args.describe:
        from evs.tools.dataset.make import describe

        for line in describe(folder, scenes):
            print(line)
        return 0
    code = _make(args, folder, scenes)
    if args.sheet and not code:
        _sheet(folder, Path(args.sheet))
    return code


def _scenes(args: argparse.Namespace) -> dict[str, SceneFile]:
    """What the command line asks for, by name."""
    from evs.tools.dataset import named, names, of_file

    if args.scene and args.scenes:
        raise EvsError("--scene is your own file, --scenes selects from the set; give one of them")
    explicit = range_overrides(args.randomise)
    explicit += [decoding.split_word(word) for word in args.words if "=" in word]
    for option, (key, _, _) in KEYS.items():
        text = getattr(args, option)
        if text is not None:
            explicit.append((key, text))
    explicit_keys = dict(explicit)
    short = SHORT if args.short else {}
    overrides = [
        *((key, text) for key, text in short.items() if key not in explicit_keys),
        *explicit,
    ]
    if args.scene:
        name = Path(args.scene).stem
        return {name: of_file(args.scene, name, overrides)}
    words = args.scenes.split(",") if args.scenes else names()
    chosen = [word.strip() for word in words if word.strip()]
    if not chosen:
        raise EvsError(f"--scenes is empty; give some of: {', '.join(names())}")
    return {name: named(name, overrides) for name in chosen}


def _make(args: argparse.Namespace, folder: Path, scenes: Mapping[str, SceneFile]) -> int:
    from evs.drivers.run.stop_signals import stop_signals
    from evs.launch.commands.emulate import STOPPED
    from evs.launch.support import terminal
    from evs.tools.dataset.make import SHARD_S, make_dataset, shard_count

    usual = SHORT_SHARD_S if args.short else SHARD_S
    shard_s = usual if args.shard is None else args.shard
    if not 0.001 <= shard_s <= 3600:
        raise EvsError(f"--shard is {shard_s:g}: give 0.001 ... 3600 simulated seconds")
    total = 1000 * shard_count(scenes, shard_s)
    with stop_signals() as stopped, terminal.bar("data set", total, args.quiet) as moved:
        made = make_dataset(
            folder,
            scenes,
            shard_s=shard_s,
            workers=args.workers,
            moved=lambda done, what: moved(round(1000 * done), what),
            stopped=lambda: bool(stopped),
            ray=args.ray,
        )
    if not args.quiet:
        ended = "" if made.whole else f" ({stopped[0]}; give the command again to go on)"
        print(f"{folder}: {made.made} shards made, {made.kept} were there{ended}")
    return STOPPED.get(stopped[0], 0) if stopped else 0


def _check_sheet(picture: Path, folder: Path) -> None:
    """EvsError before hours of work where the picture could not be written after them."""
    from evs.drivers.pictures import suffix_of
    from evs.drivers.run.report import check_targets

    if suffix_of(picture) != ".png":
        raise EvsError(f"--sheet is '{picture}': end it in .png")
    # the data set's own folder will be there by then
    if picture.parent.resolve() != folder.resolve():
        check_targets([picture])


def _sheet(folder: Path, picture: Path) -> None:
    from evs.drivers.pictures import write_png
    from evs.tools.dataset import Dataset
    from evs.tools.dataset.contact_sheet import set_page

    write_png(picture, set_page(Dataset(folder)), few_colours=True)
