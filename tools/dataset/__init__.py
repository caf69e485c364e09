"""Data sets: scenes as events, frames and ground truth on one clock, in shards."""

from evs.tools.dataset.make import Made, make_dataset, shard_count
from evs.tools.dataset.manifest import verify
from evs.tools.dataset.reading import Dataset, LabelledEvents, Recorded
from evs.tools.dataset.scenes import SceneFile, named, names, of_file

__all__ = [
    "Dataset",
    "LabelledEvents",
    "Made",
    "Recorded",
    "SceneFile",
    "make_dataset",
    "named",
    "names",
    "of_file",
    "shard_count",
    "verify",
]
