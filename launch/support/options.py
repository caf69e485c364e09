"""Options that several commands share: of pipelines, of subscribers and of recordings."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

from evs.launch.support.completion import pipeline_words
from evs.msgs import EvsError

if TYPE_CHECKING:
    from evs.drivers.files.formats import ReadOptions

Options = Mapping[str, tuple[str, str, str]]
"""option -> (the key it is short for, placeholder, help line). Defaults are declared with the keys.
Without a placeholder the option takes no value and sets its key to true."""


PIPELINE = (
    "SCENE.xml, PIPELINE.toml, key=value",
    "a scene, a pipeline file (or the name of one that comes with evs), then any keys",
)
"""the positional arguments of most commands, and their help line"""


SIZE = ("sensor.width= and sensor.height", "WxH", "sensor size, px")
"""the row of an option --size"""


def size_keys(text: str) -> list[tuple[str, str]]:
    """WxH as the two keys that it is short for. Raises EvsError where it is no size."""
    width, times, height = text.lower().partition("x")
    if not (times and width.isdecimal() and height.isdecimal()):
        raise EvsError(f"--size is '{text}': give width and height in px, as in 640x480")
    return [("sensor.width", width), ("sensor.height", height)]


def add_pipeline_options(
    parser: argparse.ArgumentParser, options: Options, words: tuple[str, str] = PIPELINE
) -> None:
    """Add the pipeline, its keys and the short options, all as text."""
    added = parser.add_argument("words", nargs="*", metavar=words[0], help=words[1])
    added.completer = pipeline_words  # type: ignore[attr-defined]
    for option, (key, placeholder, line) in options.items():
        if placeholder:
            parser.add_argument(
                f"--{option}", metavar=placeholder, help=f"{line}; short for {key}=", dest=option
            )
        else:
            parser.add_argument(
                f"--{option}",
                action="store_const",
                const="true",
                help=f"{line}; short for {key}=true",
                dest=option,
            )


def parse_pipeline(
    args: argparse.Namespace, options: Options
) -> tuple[str | None, list[tuple[str, str]]]:
    """Read what `add_pipeline_options` added.

    If there is an option --scene, a word with a scene's ending is short for it.

    Returns:
        The pipeline file, or None, and (key, text) of everything else on the command line.

    Raises:
        EvsError: two files of one kind, or two values for one key.
    """
    # here, so that commands without a pipeline start quickly
    from evs.drivers.run import config as pipeline
    from evs.emulator.config import decoding

    files = [word for word in args.words if "=" not in word]
    scenes = [word for word in files if "scene" in options and pipeline.is_scene(word)]
    files = [word for word in files if word not in scenes]
    for what, several in (("pipelines", files), ("scenes", scenes)):
        if len(several) > 1:
            raise EvsError(
                f"two {what}, '{several[0]}' and '{several[1]}'; give one, then key=value"
            )
    overrides = [decoding.split_word(word) for word in args.words if "=" in word]
    overrides += [("scene.file", scene) for scene in scenes]
    words = dict(overrides)
    for option, (key, _, _) in options.items():
        text = getattr(args, option)
        if text is None:
            continue
        for name, value in size_keys(text) if option == "size" else [(key, text)]:
            if words.get(name, value) != value:
                raise EvsError(
                    f"--{option} {text} and {name}={words[name]} are one key; give one of them"
                )
            overrides.append((name, value))
    return (files[0] if files else None), overrides


def add_key_options(parser: argparse._ActionsContainer) -> None:
    """Add the CURVE keys of a subscriber: --server-key and --key."""
    parser.add_argument(
        "--server-key", default="", metavar="KEY", help="the publisher's public key, if it has one"
    )
    parser.add_argument(
        "--key",
        default="",
        metavar="FILE",
        help="your secret key, if the publisher accepts only listed clients",
    )


def add_reading_options(
    parser: argparse.ArgumentParser, single: bool = True, unit: bool = True
) -> None:
    """Add what `reading_options` reads: how a recording is to be read.

    Args:
        parser: Of a command that reads recordings.
        single: Add --single too.
        unit: Add --unit too; a command that has one of its own does not need it.
    """
    parser.add_argument(
        "--columns",
        metavar="NAMES",
        help="what the columns of a table (text, npz, HDF5) hold, as in t,x,y,p, or their names, "
        "as in t=time,x=col,y=row,p=sign (default: inferred from names and values)",
    )
    if unit:
        parser.add_argument(
            "--unit",
            metavar="UNIT",
            help="unit of the times in a table: s, ms, us or ns (default: inferred)",
        )
    parser.add_argument(
        "--stream",
        metavar="NAME",
        help="the event stream to read, if a recording holds several (evs info lists them)",
    )
    parser.add_argument(
        "--chip",
        metavar="NAME",
        help="chip of an AEDAT2 file that does not state it: davis346, dvs128, dvs640, ...",
    )
    if single:
        parser.add_argument(
            "--single",
            action="store_true",
            help="read this file only, even if the recording continues in FILE-001, FILE-002, ...",
        )


def reading_options(args: argparse.Namespace) -> ReadOptions:
    """The options of `add_reading_options` that were given, as `evs.read` takes them."""
    given: ReadOptions = {}
    if args.columns:
        given["columns"] = args.columns
    if args.unit:
        given["unit"] = args.unit
    if args.stream:
        given["stream"] = args.stream
    if args.chip:
        given["chip"] = args.chip
    if getattr(args, "single", False):
        given["single"] = True
    return given


def keys_text(without: Collection[str] = ()) -> str:
    """Every configuration key with its default and meaning, from the classes themselves.

    Args:
        without: first parts of the names of the keys that are left out.
    """
    from evs.drivers.run import config as pipeline
    from evs.drivers.run import config_reference

    named = pipeline.pipelines()
    lines = [
        "Pipelines that come with evs; a preset needs a scene, as in",
        f"`evs emulate {pipeline.PRESETS[0]} robot.xml`:",
        *(f"  {name:12s}{pipeline.about(file)}" for name, file in named.items()),
        "",
        "Configuration: defaults < PIPELINE.toml < the command line. A key is set in the file,",
        "under its table, or here as key=value. Paths in a file are relative to that file, others",
        "to the working directory; package:path is a file inside an installed Python package.",
    ]
    for table in config_reference.describe(pipeline.PipelineConfig):
        shown = [key for key in table.keys if key.name.partition(".")[0] not in without]
        if not shown:
            continue
        lines += ["", f"[{table.name}]" if table.name else "top level"]
        if table.doc and table.name:
            lines[-1] += f"  {table.doc.partition(': ')[2] or table.doc}"
        for key in shown:
            lines.append(f"  {key.name}={key.default}")
            lines += textwrap.wrap(key.doc, 92, initial_indent=" " * 6, subsequent_indent=" " * 6)
    return "\n".join(lines)
