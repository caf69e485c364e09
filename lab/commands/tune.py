"""`evs tune`: the most accurate pipeline that keeps a speed, the fastest that keeps an error."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from evs.launch.support import options, reinvoke
from evs.msgs import EvsError

OPTIONS = {
    "camera": ("scene.camera", "NAME", "camera of the model to look through"),
    "sensor": ("sensor.preset", "NAME", "sensor preset"),
    "seed": ("seed", "N", "random seed"),
}
"""option -> (the key it is short for, placeholder, one line)"""

OUTPUT = "tuned.toml"
BUDGET_S, MAX_BUDGET_S = 300.0, 1e6

EXAMPLES = """\
examples:
  evs tune robot.xml --rtf 1.0                         the most accurate that runs in real time
  evs tune robot.xml --error 0.1 --camera wrist        the fastest with one event in ten wrong
  evs tune gymnasium/ant --rtf 0.5 model.name=plain    keeps the keys that are given
  evs emulate tuned.toml --record run.aedat4           run the result

SCENE is an MJCF or MJB file, package:path, a robot as in `evs evaluate`, or a pipeline file with a
scene. Controls are random, as in `evs evaluate`. The error is the fraction of events, measured and
reference, that have no match on their pixel within 3 ms; with no events at all it is 1. A few
configurations are measured and all others predicted from them. Then the best candidates are
measured too. Exit code 1: the goal cannot be reached; the best configuration found is printed.
See lab/docs/tuning.md."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    scene = (
        "SCENE, key=value",
        "the scene (or a pipeline with a scene), then keys to keep as given",
    )
    options.add_pipeline_options(parser, OPTIONS, scene)
    parser.usage = "evs tune SCENE (--rtf R | --error E) [key=value ...] [options]"
    add = parser.add_argument
    add("--rtf", type=float, metavar="R", help="real-time factor to reach; maximises accuracy")
    add("--error", type=float, metavar="E", help="largest error; maximises speed")
    add(
        "--metric",
        default="unmatched",
        metavar="NAME",
        help="error metric: unmatched, emd",
    )
    add("--motion", default="still", metavar="HOW", help="camera motion: still, pan, slide (still)")
    add("--budget", type=float, default=BUDGET_S, metavar="S", help=f"time limit, s ({BUDGET_S:g})")
    add("-o", "--output", default=OUTPUT, metavar="FILE", help=f"file to write ({OUTPUT})")
    add("--anyway", action="store_true", help="write the file even if the goal is not reached")
    add("--quick", action="store_true", help="fewer pixels and a coarser reference: a rough answer")
    add("--cache", metavar="DIR", help="folder for traced light (the user's cache folder)")
    add("--quiet", action="store_true", help="print nothing but warnings and errors")
    parser.epilog = EXAMPLES


def run(args: argparse.Namespace) -> int:
    """Tune; the exit code."""
    # here, so that --help is quick
    from evs.drivers.clock import monotonic_s
    from evs.drivers.run.config import is_scene
    from evs.drivers.run.report import check_targets, write_whole
    from evs.drivers.run.stop_signals import ending_signals
    from evs.emulator.base.memory_limits import cores
    from evs.launch.support import terminal
    from evs.tools.doctor.machine import cpu_name
    from evs_lab.evaluation.light_cache import LightCache, user_cache
    from evs_lab.sweep.pareto_front import error_metric
    from evs_lab.tuning import measurement, search, summary
    from evs_lab.tuning.base_pipeline import base_pipeline
    from evs_lab.tuning.pipeline_file import check_own, pipeline_text
    from evs_lab.tuning.space import candidates

    begin_s = monotonic_s()
    goal, figure = search.TuningGoal(args.rtf, args.error), error_metric(args.metric)
    budget_s: float = args.budget
    if not 0.0 < budget_s <= MAX_BUDGET_S:
        raise EvsError(f"--budget is {budget_s:g} s: give more than 0, {MAX_BUDGET_S:g} at most")
    output = Path(args.output)
    if is_scene(args.output):
        raise EvsError(f"--output is '{output}', a scene by its ending: give one in .toml")
    check_own(output)
    check_targets([output])
    base = base_pipeline(*options.parse_pipeline(args, OPTIONS))
    able = candidates(base.pinned)
    cache = LightCache(user_cache() if args.cache is None else Path(args.cache).expanduser())
    effort = measurement.QUICK if args.quick else measurement.USUAL
    measuring = ""

    def left_s() -> float:
        return budget_s - (monotonic_s() - begin_s)

    with ending_signals(), terminal.bar("tuning", round(budget_s), args.quiet) as moved:

        def step() -> None:
            moved(round(budget_s - max(0.0, left_s())), measuring)

        def begin(_done: int, what: str) -> None:
            nonlocal measuring
            measuring = what
            step()

        with measurement.open_measurer(base, args.motion, figure, cache, effort, step) as measures:
            found = search.Search(able, goal, measures, left_s, begin).run()
    facts = summary.facts(found, figure, measures.reference_error, monotonic_s() - begin_s)
    facts.append(("machine", f"{cpu_name()}, {cores()} cores"))
    if found.reached or args.anyway:
        config = base.with_settings(found.winner.candidate.settings)
        why = [_command(args), *(f"{name}: {line}" for name, line in facts)]
        write_whole(pipeline_text(config, output, why), output)
        facts.append(("written", str(output)))
    else:
        facts.append(("not written", "--anyway writes it as it is"))
    if not args.quiet:
        _show(facts, summary.table(found), str(output) if found.reached or args.anyway else "")
    return 0 if found.reached else 1


def _show(facts: Sequence[tuple[str, str]], rows: Sequence[Sequence[str]], written: str) -> None:
    """Print what was measured, what was found, and what to try next."""
    from evs.launch.support import terminal

    headings = ("configuration", "real-time factor", "predicted", "error", "predicted")
    terminal.table("measured", headings, rows)
    for name, line in facts:
        print(f"{name:17s} {line}")
    if written:
        print("next:")
        print(f"  {reinvoke.command('emulate', written, '--record', 'run.aedat4')}")


def _command(args: argparse.Namespace) -> str:
    """The command line, without options that change no number."""
    parts: list[str] = ["tune", *args.words]
    for name in (*OPTIONS, "rtf", "error"):
        value = getattr(args, name)
        if value is not None:
            parts += [f"--{name}", f"{value:g}" if isinstance(value, float) else value]
    for name, usual in (("metric", "unmatched"), ("motion", "still")):
        if getattr(args, name) != usual:
            parts += [f"--{name}", getattr(args, name)]
    return reinvoke.command([*parts, *(["--quick"] if args.quick else [])])
