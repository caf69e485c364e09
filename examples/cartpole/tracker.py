"""Track the angle of the pole by events.

The camera rides on the cart, so the hinge stays at one place in the image. Each pixel therefore has
a fixed angle about the hinge, and an event there means that an edge of the pole is at that angle.
The two edges lie on either side of the axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.msgs import Events

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class CameraMount:
    """The camera on the cart, which looks straight at the plane of the pole."""

    width: int = 128
    """px"""
    height: int = 128
    """px"""
    fovy_deg: float = 40.0
    """vertical field of view"""
    distance_m: float = 1.1
    """from the plane in which the pole turns"""
    height_m: float = 0.35
    """above the hinge"""


@dataclass(frozen=True)
class PoleShape:
    """Dimensions of the pole of gymnasium's inverted pendulum."""

    length_m: float = 0.6
    """from hinge to tip"""
    half_width_m: float = 0.049


class PoleTracker:
    """Tracks the angle of the pole. Without events it does not change, as nothing has moved."""

    def __init__(
        self,
        mount: CameraMount | None = None,
        pole: PoleShape | None = None,
        gate_rad: float = 0.1,
        memory: float = 20.0,
        inset_px: float = 0.45,
    ) -> None:
        """Begin with an upright pole.

        Args:
            mount: the camera on the cart.
            pole: dimensions of the pole.
            gate_rad: largest distance of an event of the pole from the nearer edge.
            memory: number of new events that weigh as much as all earlier ones.
            inset_px: how far inside the edge its events appear, since they are late.
        """
        mount, pole = mount or CameraMount(), pole or PoleShape()
        self._gate, self._memory = gate_rad, memory
        self.angle = 0.0
        m_per_px = 2.0 * mount.distance_m * np.tan(np.radians(mount.fovy_deg) / 2.0) / mount.height
        x = (np.arange(mount.width) + 0.5 - mount.width / 2.0) * m_per_px
        z = mount.height_m - (np.arange(mount.height) + 0.5 - mount.height / 2.0) * m_per_px
        right, up = np.meshgrid(x, z)
        radius = np.hypot(right, up)
        self._angles: F64 = np.arctan2(right, up)
        self._half: F64 = np.arcsin(
            np.clip((pole.half_width_m - inset_px * m_per_px) / radius, 0.0, 1.0)
        )
        # the cart hides the lower end, and the tip is round
        self._counts = (radius > 0.35 * pole.length_m) & (radius < 0.95 * pole.length_m)

    def update(self, events: Events) -> float:
        """Update the angle by events, all at once.

        Only ON events count: the pole is brighter than its background, and events of pixels that
        become darker are late, since a photoreceptor is slow in the dark.

        Args:
            events: (n,) EVENT_DTYPE.

        Returns:
            The angle, rad to the right.
        """
        events = events[events["p"] == 1]
        y, x = events["y"], events["x"]
        off = self._angles[y, x] - self.angle
        # an event is of the edge on its side of the axis
        off -= np.copysign(self._half[y, x], off)
        of_pole = self._counts[y, x] & (np.abs(off) < self._gate)
        count = int(np.count_nonzero(of_pole))
        if count:
            self.angle += count / (count + self._memory) * float(off[of_pole].mean())
        return self.angle
