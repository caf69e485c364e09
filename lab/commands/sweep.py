"""`evs sweep`: speed against error, one axis at a time around each preset."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from evs.launch.support import reinvoke
from evs.msgs import EvsError

EXAMPLES = """\
examples:
  evs sweep robot.xml --quick                     two presets, a first impression: two minutes
  evs sweep --json all.jsonl --errors-only        first the errors, on any machine
  evs sweep --json all.jsonl --markdown all.md --picture front.png    then the timings
  evs sweep gymnasium/ant --preset fast --axis samples,tick --camera pan

Scenes are those of evs evaluate: FILE.xml, package:path, gymnasium/ROBOT, dm_control/ROBOT,
procedural/NUMBER. Finished points are kept: run the same command again to resume it. Table and
picture show everything in the file. lab/docs/sweep.md explains them."""

LISTS = {
    "preset": "presets (fast, balanced, accurate, reference) or pipeline files, by commas",
    "axis": (
        "axes to vary around every preset: renderer, samples, seeds, cycle, model, network, chunk, "
        "tick, resolution, precision, threads, ahead, incremental, frames, paper; if not given, a "
        "selection for each preset"
    ),
    "camera": "how the camera moves: still, pan, slide",
}
NUMBERS: dict[str, tuple[type, str, str]] = {
    "repeats": (int, "N", "repeats of each timing; 6 or more give a distribution-free interval"),
    "seconds": (float, "S", "total wall time of all repeats of a point"),
    "ticks": (int, "N", "ms of light for the error measurement"),
    "pixels": (int, "N", "pixels for the error measurement"),
    "reference-spp": (int, "N", "samples per pixel of the converged light, in two halves"),
    "seed": (int, "N", "random seed of controls and pixels"),
    "workers": (int, "N", "parallel processes for errors; timings always run alone"),
}


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.usage = "evs sweep [SCENE ...] [options]"
    add = parser.add_argument
    add("scenes", nargs="*", metavar="SCENE", help="scenes; if not given, six of different kinds")
    for name, line in LISTS.items():
        add(f"--{name}", metavar="A,B", help=line)
    for name, (kind, letter, line) in NUMBERS.items():
        add(f"--{name}", type=kind, metavar=letter, help=line, dest=name.replace("-", "_"))
    add(
        "--ray",
        default="",
        metavar="ADDRESS",
        help="measure the errors on this Ray cluster instead",
    )
    add("--quick", action="store_true", help="one scene, two presets: under two minutes")
    add("--errors-only", action="store_true", help="no timings: works on any machine")
    add("--speed-only", action="store_true", help="no errors: only timings, on a quiet machine")
    add("--cache", metavar="DIR", help="folder for traced light (the user's cache folder)")
    add(
        "--json",
        metavar="FILE.jsonl",
        help="file of the records; if not given, one in the cache",
    )
    add("--markdown", metavar="FILE.md", help="write the tables to FILE.md instead of stdout")
    add(
        "--picture",
        metavar="FILE.png",
        help="draw error against speed; with several scenes, FILE-SCENE.png each",
    )
    add("--quiet", action="store_true", help="print nothing but warnings and errors")
    parser.epilog = EXAMPLES


def run(args: argparse.Namespace) -> int:
    """Sweep; the exit code: 0, 1 where a point could not be measured."""
    # here, so that --help is quick
    from evs.drivers.pictures.chart import check_chart_file
    from evs.drivers.run.report import check_targets
    from evs.drivers.run.stop_signals import ending_signals
    from evs.launch.support import terminal
    from evs_lab.evaluation.light_cache import LightCache, user_cache
    from evs_lab.sweep import sweep
    from evs_lab.sweep.store import SweepStore

    words, picture = (None if t is None else Path(t) for t in (args.markdown, args.picture))
    check_chart_file(picture)
    settings = _settings(args)
    drawn = {} if picture is None else _pictures(picture, settings.scenes)
    check_targets([path for path in (words, *drawn.values()) if path is not None])
    folder = user_cache() if args.cache is None else Path(args.cache).expanduser()
    cache = LightCache(folder)
    file = sweep.default_store(folder, settings) if args.json is None else Path(args.json)
    if file.is_dir():
        raise EvsError(f"--json is '{file}', a folder; give a file, as in sweep.jsonl")
    # report a missing scene before a file is begun
    cases = sweep.sweep_cases(settings)
    header = sweep.header(settings, _command(args))
    store = SweepStore(file, header)
    runner = sweep.Sweep(settings, cases, store, cache, header.about, warn=terminal.warn)
    try:
        with ending_signals(), terminal.bar("sweeping", runner.total(), args.quiet) as moved:
            runner.moved = moved
            runner.run()
    except (KeyboardInterrupt, SystemExit):
        terminal.warn(f"stopped; {file} has what is done, and the same command goes on")
        raise
    _tell(store, words, drawn, args.quiet)
    return 1 if runner.failed else 0


def _settings(args: argparse.Namespace) -> Any:
    """The settings of the command line."""
    from evs_lab.sweep import axes, sweep
    from evs_lab.sweep.errors import ErrorSettings
    from evs_lab.sweep.speed import SpeedSettings

    if args.errors_only and args.speed_only:
        raise EvsError(
            "--errors-only and --speed-only together leave nothing to do: give one of them"
        )
    lists = {name: _words(name, getattr(args, name)) for name in LISTS}
    quick = bool(args.quick)
    presets = lists["preset"] or tuple(axes.QUICK if quick else axes.DEFAULT)
    errors = sweep.QUICK_ERRORS if quick else ErrorSettings()
    speeds = sweep.QUICK_SPEEDS if quick else SpeedSettings()
    what: tuple[str, ...] = (sweep.ERRORS, sweep.SPEEDS)
    what = what[:1] if args.errors_only else what[1:] if args.speed_only else what
    return sweep.SweepSettings(
        scenes=tuple(args.scenes) or (sweep.QUICK_SCENES if quick else tuple(sweep.DEFAULT_SCENES)),
        cameras=lists["camera"] or ("still", "pan"),
        points=tuple(axes.points(presets, lists["axis"], quick=quick)),
        errors=_with(errors, args),
        speeds=_with(speeds, args),
        what=what,
        workers=1 if args.workers is None else args.workers,
        ray=args.ray,
    )


def _with(settings: Any, args: argparse.Namespace) -> Any:
    """The settings, changed by the command line."""
    import dataclasses

    names = [field.name for field in dataclasses.fields(settings)]
    changes = {name: getattr(args, name) for name in names if getattr(args, name, None) is not None}
    return dataclasses.replace(settings, **changes)


def _words(name: str, text: str | None) -> tuple[str, ...]:
    if text is None:
        return ()
    words = tuple(word.strip() for word in text.split(",") if word.strip())
    if not words:
        raise EvsError(f"--{name} is empty: give names separated by commas")
    return words


def _pictures(path: Path, scenes: tuple[str, ...]) -> dict[str, Path]:
    """Scene -> file of its picture."""
    if len({*scenes}) == 1:
        return {scenes[0]: path}
    names: dict[str, str] = {}
    for scene in dict.fromkeys(scenes):
        slug, count = _slug(scene), 2
        while slug in names.values():
            # a/b and a_b are alike
            slug, count = f"{_slug(scene)}_{count}", count + 1
        names[scene] = slug
    return {scene: path.with_name(f"{path.stem}-{slug}.png") for scene, slug in names.items()}


def _slug(scene: str) -> str:
    return "".join(sign if sign.isalnum() else "_" for sign in scene.removesuffix(".xml"))


def _tell(store: Any, words: Path | None, drawn: dict[str, Path], quiet: bool) -> None:
    """Write the table and the pictures of all records in the file."""
    from evs.drivers.pictures import write_png
    from evs.drivers.run.report import write_whole
    from evs_lab.sweep.pareto_chart import pareto_page
    from evs_lab.sweep.table import SweepInfo, markdown

    text = markdown(store.records, SweepInfo(**store.header.about))
    if words is not None:
        write_whole(text, words)
    elif not quiet:
        print(text, end="")
    for scene, path in drawn.items():
        here = [record for record in store.records if record.scene == scene]
        write_png(path, pareto_page(here), few_colours=True)


def _command(args: argparse.Namespace) -> str:
    """The command line, without options that change no number."""
    parts: list[str] = ["sweep", *args.scenes]
    for name in (*LISTS, *NUMBERS):
        value = getattr(args, name.replace("-", "_"))
        if value is not None and name != "workers":
            parts += [f"--{name}", str(value)]
    if args.quick:
        parts.append("--quick")
    return reinvoke.command(parts)
