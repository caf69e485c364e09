"""`evs plan`: show what a scene needs and which code paths are on; measure a tick."""

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
    """Tables: contents, code paths that are on and off, measured times."""
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
    if planned.measured is None:
        print(f"time of a tick: add --measure, which runs {MEASURE_TICKS} ticks")
    else:
        measurement = planned.measured
        traced = f"{100 * measurement.traced_fraction:.3g} % of the pixels traced"
        of = {"render": traced, "sensor": f"{measurement.events:,} events in all"}
        measured = [
            (stage, f"{ms:.3g}", of.get(stage, "")) for stage, ms in measurement.stage_ms.items()
        ]
        title = f"measured: {measurement.ticks} ticks, threads: {planned.threads or 'one a core'}"
        terminal.table(title, ("stage", "median ms", "with"), measured, False)


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
    rows.append(("renderer", f"{planned.renderer}, samples per pixel: {view['samples']}"))
    if "camera_rays" in view:
        rays = f"{view['camera_rays']:,} from the camera, at most {view['shadow_rays']:,} to lights"
        rows.append(("rays", f"of a full picture: {rays}"))
    rows.append(("event model", planned.model))
    rows.append(("sinks", ", ".join(planned.sinks) or "none"))
    return rows
