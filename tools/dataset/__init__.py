"""Data sets: scenes as events, frames and ground truth on one clock, in shards."""

from evs.tools.dataset.make import DatasetSummary, make_dataset, shard_count
from evs.tools.dataset.manifest import verify
from evs.tools.dataset.reader import Dataset, LabelledEvents, RecordedSequence
from evs.tools.dataset.scenes import SceneFile, named, names, of_file

__all__ = [
    "Dataset",
    "DatasetSummary",
    "LabelledEvents",
    "RecordedSequence",
    "SceneFile",
    "make_dataset",
    "named",
    "names",
    "of_file",
    "shard_count",
    "verify",
]
