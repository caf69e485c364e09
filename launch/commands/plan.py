"""`evs plan`: show what a scene needs, which code paths are on, and the cost of a tick."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

from evs.drivers.run import config as pipeline
from evs.launch.commands.emulate import OPTIONS as EMULATE
from evs.launch.commands.emulate import STOPPED
from evs.launch.support import options
from evs.msgs import EvsError

if TYPE_CHECKING:
    from evs.drivers.run.planning import PipelinePlan

OPTIONS = {
    name: EMULATE[name]
    for name in (
        *(
            "scene",
            "camera",
            "sensor",
            "size",
            "renderer",
            "spp",
            "seeds",
            "model",
            "record",
            "publish",
        ),
        *("model-everything", "threads"),
    )
}

MEASURE_TICKS = 100


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.usage = "evs plan [SCENE.xml | PIPELINE.toml] [key=value ...] [options]"
    options.add_pipeline_options(parser, OPTIONS)
    parser.add_argument(
        "--measure",
        nargs="?",
        const=str(MEASURE_TICKS),
        metavar="TICKS",
        help=f"run TICKS ticks ({MEASURE_TICKS} if no number is given) and report their time",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead")
    parser.epilog = (
        "Keys are those of `evs emulate --help`. The report of every run holds the same plan."
    )


def run(args: argparse.Namespace) -> int:
    """Load the scene, print its plan."""
    config = pipeline.load(*options.parse_pipeline(args, OPTIONS))
    ticks = _ticks(args.measure)

    # here, so that --help is quick
    from evs.drivers.run.planning import plan_pipeline

    planned = plan_pipeline(config, ticks)
    if args.json:
        print(json.dumps(planned.plain(), indent=2))
    else:
        _show(planned)
    return STOPPED.get(planned.measured.ended.split()[0], 0) if planned.measured else 0


def _ticks(text: str | None) -> int:
    if text is None:
        return 0
    if not text.isdecimal() or not 1 <= int(text) <= 10**9:
        raise EvsError(f"--measure is '{text}': give a number of ticks, 1 or more")
    return int(text)


def _show(planned: PipelinePlan) -> None:
    """Tables: contents, code paths that are on and off, cost."""
    from evs.launch.support import terminal

    plain = planned.plan.compact()
    scene = f"{planned.scene}, camera '{planned.camera}'"
    terminal.table(scene, ("the scene has", ""), _contents(planned, plain["contents"]), False)
    print()
    for on, title in ((True, "code paths that are on"), (False, "code paths that are off")):
        rows = [
            (each.feature.name.replace("_", " "), each.why)
            for each in planned.plan.decisions
            if each.on == on
        ]
        terminal.table(title, ("code path", "because"), rows, False)
        print()
    cost = plain["cost"]
    costs = [
        ("world", cost["world_ms"], cost["world_ms"], "physics and poses"),
        ("render", cost["render_ms"], cost["render_still_ms"], _light(planned.renderer, cost)),
        ("sensor", cost["sensor_ms"], cost["sensor_still_ms"], f"model {planned.model}"),
    ]
    shown = [(stage, f"{most:.3g}", f"{least:.3g}", of) for stage, most, least, of in costs]
    title = f"a tick on one core, by the cost model (good to a factor of about {cost['within']:g})"
    terminal.table(title, ("stage", "ms, all moves", "ms, all rests", "of"), shown, False)
    if planned.measured is not None:
        print()
        measurement = planned.measured
        traced = f"{100 * measurement.traced_fraction:.3g} % of the pixels traced"
        of = {"render": traced, "sensor": f"{measurement.events:,} events in all"}
        measured = [
            (stage, f"{ms:.3g}", of.get(stage, "")) for stage, ms in measurement.stage_ms.items()
        ]
        title = f"measured: {measurement.ticks} ticks, threads: {planned.threads or 'one a core'}"
        terminal.table(title, ("stage", "median ms", "with"), measured, False)


def _light(renderer: str, cost: dict[str, Any]) -> str:
    if renderer == "raster":
        return "OpenGL in software; a GPU takes about a tenth"
    return f"{cost['primary_rays']:,} camera rays, at most {cost['shadow_rays']:,} shadow rays"


def _contents(planned: PipelinePlan, contents: dict[str, Any]) -> list[tuple[str, str]]:
    """The contents as text, without what does not occur."""
    rows = []
    for key, value in contents.items():
        text = str(value)
        if isinstance(value, dict):
            text = ", ".join(f"{count} {kind}" for kind, count in value.items())
        elif isinstance(value, tuple | list):
            text = ", ".join(map(str, value))
        elif value is True:
            text = "yes"
        elif key == "not_mirrors":
            text += " with reflectance, of shapes that do not mirror: planes and box tops do"
        rows.append((key.replace("_", " "), text))
    if "camera_moves" not in contents:
        rows.append(("camera", "stands still"))
    view = planned.plan.view
    size = f"{view['width']} x {view['height']} px, {view['projection']}"
    rows.append(("sensor", f"{planned.sensor}, {size}"))
    rows.append(("renderer", f"{planned.renderer}, samples a pixel: {view['samples']}"))
    rows.append(("event model", planned.model))
    rows.append(("sinks", ", ".join(planned.sinks) or "none"))
    return rows
