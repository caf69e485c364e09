"""`evs evaluate`: event models on light of few samples, against events of converged light."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from evs.launch.support import reinvoke
from evs.msgs import EvsError

EXAMPLES = """\
examples:
  evs evaluate --quick                           two scenes, a first impression
  evs evaluate --json all.json --markdown all.md --picture all.png      the whole table
  evs evaluate mine.onnx --scenes gymnasium/ant --spp 4,16              your own network as well
  evs evaluate --reconstruct firenet.onnx        video from the events, against the true frames

Scenes are robots that no network has seen in training (gymnasium/ant, dm_control/walker ...),
procedural scenes with seeds reserved for evaluation (procedural/0, procedural/1 ...), your own file
or package:path. Light is traced only at the measured pixels and is cached, so a second run traces
nothing. The set held_out has robots that nothing was ever tuned on, either.
lab/docs/evaluation.md explains each column, lab/docs/real2sim.md those of
--reconstruct and what a network for it must look like."""

LISTS = {
    "scenes": "scenes, or sets of them: default, held_out; separated by commas",
    "cameras": "how the camera moves: still, pan, slide",
    "spp": "samples per pixel of the light to evaluate",
    "models": "plain, adaptive, and names of networks",
}
NUMBERS = {
    "ticks": "ms per clip; the last 384 are measured",
    "pixels": "pixels spread over the image, in addition to a patch of 32 x 32",
    "reference-spp": "samples per pixel of the converged light, in two halves",
    "threads": "worker threads; 0: one per core",
    "seed": "random seed of controls and pixels",
}

NAMES = {
    "runtime": "runtime of networks: native, onnxruntime, reference",
    "provider": "execution provider of onnxruntime: cpu, cuda, tensorrt, openvino, coreml",
    "events-per-tick": "events of a network's pixel per tick: one, many, or auto: as trained",
}


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.usage = "evs evaluate [MODEL.onnx] [options]"
    add = parser.add_argument
    add("network", nargs="?", metavar="MODEL.onnx", help="your own network, which is checked first")
    for name, line in LISTS.items():
        add(f"--{name}", metavar="A,B", help=line)
    for name, line in NUMBERS.items():
        add(f"--{name}", type=int, metavar="N", help=line, dest=name.replace("-", "_"))
    for name, line in NAMES.items():
        add(f"--{name}", metavar="NAME", help=line, dest=name.replace("-", "_"))
    add(
        "--reconstruct",
        nargs="?",
        const="",
        metavar="NET.onnx",
        help="another table: video made of the events by a filter, and by your network",
    )
    add("--raw-voxels", action="store_true", help="do not normalise the input of NET.onnx")
    add("--quick", action="store_true", help="two scenes, few pixels: under two minutes")
    add("--cache", metavar="DIR", help="folder for traced light (the user's cache folder)")
    add("--json", metavar="FILE", help="write everything that was measured")
    add("--markdown", metavar="FILE.md", help="write the table to FILE.md instead of stdout")
    add("--picture", metavar="FILE.png", help="draw EMD and recall, or the reconstructed pictures")
    add("--quiet", action="store_true", help="print nothing but warnings and errors")
    parser.epilog = EXAMPLES


def run(args: argparse.Namespace) -> int:
    """Evaluate; the exit code."""
    # here, so that --help is quick
    from evs.drivers.pictures import write_png
    from evs.drivers.pictures.chart import check_chart_file
    from evs.drivers.run.report import check_targets, write_whole

    numbers, words, picture = (
        None if text is None else Path(text) for text in (args.json, args.markdown, args.picture)
    )
    check_chart_file(picture)
    check_targets([path for path in (numbers, words, picture) if path is not None])
    made = _events(args) if args.reconstruct is None else _video(args)
    text = made.markdown()
    if numbers is not None:
        write_whole(made.json(), numbers)
    if words is not None:
        write_whole(text, words)
    elif not args.quiet:
        print(text, end="")
    if picture is not None:
        write_png(picture, made.page(), few_colours=True)
    return 0


@dataclass(frozen=True)
class _Made:
    """What an evaluation can be written as."""

    markdown: Callable[[], str]
    json: Callable[[], str]
    page: Callable[[], Any]


def _events(args: argparse.Namespace) -> _Made:
    """The table of events."""
    from evs.launch.support import terminal
    from evs_lab.evaluation import evaluate, table
    from evs_lab.evaluation.chart_page import evaluation_page

    if args.raw_voxels:
        raise EvsError(
            "--raw-voxels is for a network that makes video; give --reconstruct NET.onnx"
        )
    settings = _settings(args, evaluate.QUICK if args.quick else evaluate.EvaluationSettings())
    judged, missing, checked, cache = _prepared(args, settings)
    total = evaluate.work(settings, evaluate.look_ahead(judged))
    with terminal.bar("tracing", total, args.quiet) as moved:
        found = evaluate.evaluate(settings, cache, judged, moved, _command(args))
    found = replace(found, left_out=missing, check=checked)
    return _Made(lambda: table.markdown(found), found.to_json, lambda: evaluation_page(found))


def _video(args: argparse.Namespace) -> _Made:
    """The table of reconstructed video."""
    from evs.launch.support import terminal
    from evs_lab.evaluation import reconstruct, reconstruct_table
    from evs_lab.evaluation.reconstruct_page import video_page
    from evs_lab.reconstruction import read_video_network

    if args.pixels is not None:
        raise EvsError("--reconstruct needs every pixel of its pictures; leave out --pixels")
    if args.raw_voxels and not args.reconstruct:
        raise EvsError(
            "--raw-voxels is for a network that makes video; give --reconstruct NET.onnx"
        )
    settings = _settings(args, reconstruct.QUICK if args.quick else reconstruct.SETTINGS)
    reconstruct.picture_ticks(settings)
    network = None
    if args.reconstruct:
        network = read_video_network(
            Path(args.reconstruct), settings.size[::-1], raw=args.raw_voxels,
            provider=settings.provider, threads=settings.threads,
        )  # fmt: skip
    judged, missing, _, cache = _prepared(args, settings)
    by = reconstruct.reconstructors(settings, network)
    with terminal.bar("tracing", reconstruct.work(settings, judged), args.quiet) as moved:
        found = reconstruct.evaluate_video(settings, cache, judged, by, moved, _command(args))
    found = replace(found, left_out=missing)
    return _Made(
        lambda: reconstruct_table.video_markdown(found),
        lambda: reconstruct_table.video_json(found),
        lambda: video_page(found),
    )


def _prepared(args: argparse.Namespace, settings: Any) -> tuple[Any, list[str], Any, Any]:
    """The models, a line for each that is not there, the check of the user's own, the cache."""
    from evs.launch.support import terminal
    from evs_lab.evaluation import models
    from evs_lab.evaluation.light_cache import LightCache, user_cache

    judged, missing = models.models_under_test(settings.models, settings.network, settings.how)
    for line in missing:
        terminal.warn(line)
    own = settings.network
    checked = None if own is None else _checked(own, settings.provider)
    cache = LightCache(user_cache() if args.cache is None else Path(args.cache).expanduser())
    return judged, missing, checked, cache


def _checked(network: Path, provider: str) -> Any:
    """Check a user's network; each fault is a warning."""
    from evs.launch.support import terminal
    from evs.tools.doctor.check import BAD
    from evs_lab.evaluation.network_check import check_network

    checked = check_network(network, provider)
    for finding in checked.findings:
        if finding.verdict == BAD:
            terminal.warn(f"{network}: {finding.what}: {finding.found}")
    return checked


def _settings(args: argparse.Namespace, settings: Any) -> Any:
    """The settings of the command line over these."""
    changes: dict[str, Any] = {}
    for name in LISTS:
        text = getattr(args, name)
        if text is not None:
            words = [word.strip() for word in text.split(",") if word.strip()]
            changes[name] = tuple(_whole(name, words) if name == "spp" else words)
    for name in (name.replace("-", "_") for name in (*NUMBERS, *NAMES)):
        if getattr(args, name) is not None:
            changes[name] = getattr(args, name)
    if args.network is not None:
        changes["network"] = Path(args.network)
    return replace(settings, **changes)


def _whole(name: str, words: list[str]) -> list[int]:
    try:
        return [int(word) for word in words]
    except ValueError:
        raise EvsError(f"--{name} is '{','.join(words)}': give whole numbers, as in 4,16") from None


def _command(args: argparse.Namespace) -> str:
    """The command line, without options that change no number."""
    parts: list[str] = ["evaluate"]
    if args.network is not None:
        parts.append(args.network)
    shown = [*LISTS, *NUMBERS, *NAMES, "json", "markdown", "picture"]
    for name in shown:
        value = getattr(args, name.replace("-", "_"))
        if value is not None:
            parts += [f"--{name}", str(value)]
    if args.reconstruct is not None:
        parts += ["--reconstruct", *([args.reconstruct] if args.reconstruct else [])]
    if args.raw_voxels:
        parts.append("--raw-voxels")
    if args.quick:
        parts.insert(1, "--quick")
    return reinvoke.command(parts)
