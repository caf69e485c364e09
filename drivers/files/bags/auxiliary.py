"""Images and IMU samples in the messages of a bag."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from evs.drivers.files.bags.messages import deserialised
from evs.drivers.files.bags.records import BagMessage
from evs.drivers.files.bags.sensor_messages import (
    EXPOSURE,
    IMAGE,
    SAMPLE,
    TOPICS,
    frame_of,
    sample_of,
)
from evs.msgs import Frame, ImuSamples

MAX_SAMPLES_TOGETHER = 1000
"""most IMU samples in one message"""


def declared_auxiliary(kinds: dict[str, str], namespace: str) -> dict[str, Any]:
    """Field of StreamInfo -> whether the camera's namespace has such a topic."""
    wanted = {"frames": IMAGE, "imu": SAMPLE}
    return {key: kinds.get(f"{namespace}/{TOPICS[kind]}") == kind for key, kind in wanted.items()}


def count(left_out: dict[str, int], what: str) -> None:
    """Count one more message that is not read."""
    left_out[what] = left_out.get(what, 0) + 1


class AuxiliaryParser:
    """Parses a camera's messages into frames and groups of consecutive IMU samples."""

    def __init__(self, namespace: str, camera: str, ros: int) -> None:
        self._topics = {f"{namespace}/{name}": kind for kind, name in TOPICS.items()}
        self._camera, self._ros = camera, ros
        self._exposure_us = 0
        self._frames = 0
        self._samples: list[ImuSamples] = []

    def parse(self, found: BagMessage, left_out: dict[str, int]) -> Iterator[Frame | ImuSamples]:
        """Parse a message of the camera. BadMessageError: it is not of its type."""
        if self._topics.get(found.topic) != found.kind:
            return
        if found.kind == EXPOSURE:
            self._exposure_us = max(0, int(deserialised(found.data, EXPOSURE, self._ros).data))
        elif found.kind == SAMPLE:
            self._samples.append(sample_of(deserialised(found.data, SAMPLE, self._ros)))
            if len(self._samples) >= MAX_SAMPLES_TOGETHER:
                yield from self.flush()
        elif found.kind == IMAGE:
            message = deserialised(found.data, IMAGE, self._ros)
            frame = frame_of(message, self._frames, self._camera, self._exposure_us)
            if frame is None:
                count(left_out, "frames that are not grey")
                return
            yield from self.flush()
            yield frame
            self._frames += 1

    def flush(self) -> Iterator[ImuSamples]:
        """The samples since the last other message."""
        if self._samples:
            yield np.concatenate(self._samples)
            self._samples = []
