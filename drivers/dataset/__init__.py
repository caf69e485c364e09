"""Data sets: scenes as events, frames and ground truth on one clock, in shards."""

from evs.drivers.dataset.make import Made, make_dataset, shard_count
from evs.drivers.dataset.manifest import verify
from evs.drivers.dataset.reading import Dataset, LabelledEvents, Recorded
from evs.drivers.dataset.scenes import SceneFile, named, names, of_file

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
