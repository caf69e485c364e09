"""Track a ball: fit a straight path to its events, or to its middle in each frame.

x = x0 + vx t and y = y0 + vy t minimise the sum of squares over all samples: events of the ball, or
the middle of the ball in each frame. Five sums for each axis are enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.msgs import Events, Frame

F64 = npt.NDArray[np.float64]

FOCAL_PX = 136.0
HEIGHT_M = 1.28
"""height of the camera above the middle of the ball"""
LOOKS_AT_X_M = 0.55
CENTRE_PX = 63.5
"""centre of the image, counted from the centre of its first pixel (config/scenes/goalie.xml)"""

PADDLE_X_M = 0.05
"""the paddle and the posts are nearer to the goal"""

LIKELY_M_S = 20.0
"""standard deviation of the prior of the speed, whose mean is 0"""


@dataclass(frozen=True)
class Crossing:
    """Where and when a ball will cross the goal line, x = 0."""

    y_m: float
    t_s: float


class BallPath:
    """The straight path of a ball over time, on the table, m."""

    def __init__(self, noise_m: float) -> None:
        """Begin without samples.

        Args:
            noise_m: standard deviation of a sample, which limits what few samples say of speed.
        """
        self._sums = np.zeros((2, 5))
        # before the first samples, a speed is normal with the standard deviation LIKELY_M_S
        self._doubt = (noise_m / LIKELY_M_S) ** 2
        # times count from the first sample: squares of whole microseconds would lose digits
        self._begin_us: int | None = None

    def add(self, x_px: F64, y_px: F64, t_us: npt.NDArray[np.int64]) -> None:
        """Add samples.

        Args:
            x_px: (n,).
            y_px: (n,).
            t_us: (n,) their times.
        """
        if self._begin_us is None:
            self._begin_us = int(t_us[0])
        t = (t_us - self._begin_us) * 1e-6
        for axis, place in enumerate(on_table(x_px, y_px)):
            self._sums[axis] += len(t), t.sum(), t @ t, place.sum(), place @ t

    def at(self, t_us: int) -> tuple[F64, F64] | None:
        """Position, m, and speed, m/s, (2,) each, at a time; None before the first sample."""
        if self._begin_us is None:
            return None
        n, st, stt, sx, sxt = self._sums.T
        speed = (n * sxt - st * sx) / (n * stt - st * st + n * self._doubt)
        return (sx - speed * st) / n + speed * (t_us - self._begin_us) * 1e-6, speed

    def crossing(self, t_us: int) -> Crossing | None:
        """The crossing as predicted at a time; None: the ball does not move towards the goal."""
        found = self.at(t_us)
        if found is None:
            return None
        place, speed = found
        if not speed[0] < -0.1:
            return None
        left_s = -float(place[0] / speed[0])
        return Crossing(float(place[1] + speed[1] * left_s), t_us * 1e-6 + left_s)


def on_table(x_px: F64, y_px: F64) -> tuple[F64, F64]:
    """Convert pixels to x and y on the table, m."""
    scale = HEIGHT_M / FOCAL_PX
    return LOOKS_AT_X_M + (x_px - CENTRE_PX) * scale, (CENTRE_PX - y_px) * scale


GOAL_COLUMN = CENTRE_PX + (PADDLE_X_M - LOOKS_AT_X_M) * FOCAL_PX / HEIGHT_M
"""columns left of it show the paddle"""


class EventBallTracker:
    """A cluster of events: it begins where many come at once, and takes events near its path."""

    CELL_PX = 8
    ENOUGH = 5
    """events of one packet in one cell that begin a cluster; noise has about one in the image"""
    RADIUS_PX = 6.0
    LOST_US = 20_000
    """time without an event near its path after which the cluster ends"""
    NOISE_M = 0.014
    """events come from the rim of the ball"""

    def __init__(self) -> None:
        self.path = BallPath(self.NOISE_M)
        self._last_us = 0

    def update(self, events: Events, t_us: int) -> None:
        """Add the events of a packet, all at once.

        Args:
            events: (n,) EVENT_DTYPE.
            t_us: end of the packet.
        """
        if t_us - self._last_us > self.LOST_US:
            self.path, self._last_us = BallPath(self.NOISE_M), t_us
        events = events[events["x"] > GOAL_COLUMN]
        x, y = events["x"].astype(np.float64), events["y"].astype(np.float64)
        middle = self._middle(events, t_us)
        if middle is None:
            return
        near = (x - middle[0]) ** 2 + (y - middle[1]) ** 2 < self.RADIUS_PX**2
        if near.any():
            self.path.add(x[near], y[near], events["t"][near])
            self._last_us = t_us

    def _middle(self, events: Events, t_us: int) -> tuple[float, float] | None:
        """Expected middle of the cluster, px; None: there is no cluster."""
        found = self.path.at(t_us)
        if found is not None:
            (x, y), scale = found[0], FOCAL_PX / HEIGHT_M
            return CENTRE_PX + (x - LOOKS_AT_X_M) * scale, CENTRE_PX - y * scale
        if not len(events):
            return None
        cell = events["y"] // self.CELL_PX * 16 + events["x"] // self.CELL_PX
        most = int(np.bincount(cell).argmax())
        of_it = events[cell == most]
        if len(of_it) < self.ENOUGH:
            return None
        return float(of_it["x"].mean()), float(of_it["y"].mean())


class FrameBallTracker:
    """The middle of the dark pixels in each frame."""

    ENOUGH = 3.0
    """least number of dark pixels that are a ball"""
    NOISE_M = 0.0005

    def __init__(self) -> None:
        self.path = BallPath(self.NOISE_M)

    def update(self, frame: Frame) -> None:
        """Add a frame, as a sample at the middle of its exposure."""
        first = int(GOAL_COLUMN) + 1
        part = frame.pixels[:, first:].astype(np.float64)
        bright = max(float(np.median(part)), 1.0)
        dark = np.clip(1.0 - part / bright - 0.1, 0.0, None)
        total = float(dark.sum())
        if total < self.ENOUGH:
            return
        x = float(dark.sum(0) @ np.arange(first, first + part.shape[1])) / total
        y = float(dark.sum(1) @ np.arange(len(part))) / total
        middle_us = (frame.exposure_begin_us + frame.exposure_end_us) // 2
        self.path.add(np.array([x]), np.array([y]), np.array([middle_us], np.int64))
