"""`evs schema`: print the JSON Schema of pipeline files."""

from __future__ import annotations

import argparse
import json

EPILOG = """\
examples:
  evs schema > pipeline.schema.json      then, as the first line of a pipeline:
      #:schema ./pipeline.schema.json"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments: none."""
    parser.epilog = EPILOG


def run(_args: argparse.Namespace) -> int:
    """Print it."""
    from evs.drivers.run.config_reference import pipeline_schema

    print(json.dumps(pipeline_schema(), indent=1))
    return 0
