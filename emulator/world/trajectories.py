"""Camera motion that no body makes: poses from a file, and shaking.

Positions and quaternions are natural cubic splines through the poses of the file, so velocity and
acceleration are continuous, as an IMU on the camera feels them. Quaternions are normalised after
that. Additions, products, quotients and roots alone: the same numbers on every machine.
"""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from evs.emulator.base.scene import F64
from evs.emulator.base.small_files import read_small_text
from evs.msgs import EvsError

AXES = ("optical", "camera")
"""optical: x right, y down, z forward, as in ROS, OpenCV and evs' poses; camera: x right, y up,
looks along -z, as in MuJoCo, OpenGL and Blender"""

MOST_BYTES = 1 << 28

_TIMES = ("t", "time", "timestamp")
_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_SINCE_1970 = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))
"""a first stamp that is larger has that unit, s, where the file does not say it: our years"""
_POSITION = ("x", "y", "z")
_QUATERNION = ("qx", "qy", "qz", "qw")
_SINES = 8
"""that the shaking of an axis is the sum of"""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses over time. Before the first and after the last it stands still."""

    times_s: F64
    """(n,) ascending; the first is 0"""
    poses: F64
    """(n, 7) position, m, and unit quaternion x, y, z, w of the camera's axes, each in the
    hemisphere of the one before"""

    @cached_property
    def _knots(self) -> list[float]:
        return [float(t_s) for t_s in self.times_s]

    @cached_property
    def _bends(self) -> F64:
        """(n, 7) second derivatives at the poses; zero at both ends."""
        t, p = self.times_s, self.poses
        h = np.diff(t)
        slopes = np.diff(p, axis=0) / h[:, None]
        bends = np.zeros_like(p)
        # a tridiagonal system, by elimination (Thomas)
        size = len(t) - 2
        upper, right = np.zeros(size), np.zeros((size, p.shape[1]))
        for i in range(size):
            below, above = h[i], h[i + 1]
            load = 6.0 * (slopes[i + 1] - slopes[i])
            pivot = 2.0 * (below + above) - (below * upper[i - 1] if i else 0.0)
            upper[i] = above / pivot
            right[i] = (load - (below * right[i - 1] if i else 0.0)) / pivot
        for i in reversed(range(size)):
            bends[i + 1] = right[i] - upper[i] * bends[i + 2]
        return bends

    @property
    def seconds(self) -> float:
        """When the last pose is reached."""
        return self._knots[-1]

    def pose(self, t_s: float) -> tuple[F64, F64]:
        """Where the camera is.

        Returns:
            (3,) position, m; (3, 3) its axes in the world.
        """
        t_s = min(max(t_s, 0.0), self._knots[-1])
        i = min(bisect.bisect_right(self._knots, t_s), len(self._knots) - 1) - 1
        h = self._knots[i + 1] - self._knots[i]
        b = (t_s - self._knots[i]) / h
        a = 1.0 - b
        values = a * self.poses[i] + b * self.poses[i + 1]
        values = values + (
            (a * a * a - a) * self._bends[i] + (b * b * b - b) * self._bends[i + 1]
        ) * (h * h / 6.0)
        x, y, z, w = values[3:] / math.sqrt(float(values[3:] @ values[3:]))
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, np.array([w, x, y, z]))
        return values[:3], turn.reshape(3, 3)


def read_trajectory(file: str, axes: str = "optical") -> Trajectory:
    """Read poses from a file.

    Either lines of `t x y z qx qy qz qw` (s, m), with blanks or commas, as TUM's tools have them;
    or a CSV with a header that names these columns, as EuRoC's ground truth has it. Lines that
    begin with # are comments. The first pose is at time 0, whatever its stamp; of two with one
    stamp the later line counts.

    Args:
        file: The file.
        axes: One of AXES.

    Returns:
        The trajectory of the camera's axes (x right, y up, looking along -z).

    Raises:
        EvsError: No such file, or a line that is no pose; the message has its number.
    """
    if axes not in AXES:
        raise EvsError(f"camera.trajectory_axes is '{axes}': give {' or '.join(AXES)}")
    try:
        text = read_small_text(Path(file).expanduser(), MOST_BYTES)
    except UnicodeDecodeError:
        raise EvsError(f"trajectory '{file}' is no text: give TUM's lines, or a CSV") from None
    except OSError as reason:
        raise EvsError(f"cannot read trajectory '{file}': {reason.strerror}") from None
    columns, unit = list(range(8)), 0.0
    rows: list[list[float]] = []
    lines: list[int] = []
    for number, line in enumerate(text.split("\n"), 1):
        cells = line.split(",") if "," in line else line.split()
        if not rows and (header := _header(line)) is not None:
            columns, unit = header
            continue
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            row = [float(cells[column]) for column in columns]
        except (ValueError, IndexError):
            raise EvsError(
                f"trajectory '{file}', line {number}: give t x y z qx qy qz qw, or a header that "
                "names them"
            ) from None
        if not all(map(math.isfinite, row)):
            raise EvsError(f"trajectory '{file}', line {number}: a number is not finite")
        if rows and row[0] <= rows[-1][0]:
            if row[0] < rows[-1][0]:
                raise EvsError(
                    f"trajectory '{file}', line {number}: its time is before that of the last line"
                )
            # estimates list a moment twice
            del rows[-1], lines[-1]
        rows.append(row)
        lines.append(number)
    if len(rows) < 2:
        raise EvsError(f"trajectory '{file}' has {len(rows)} poses: give two or more")
    table = np.array(rows)
    unit = unit or next((unit for least, unit in _SINCE_1970 if table[0, 0] > least), 1.0)
    times_s = (table[:, 0] - table[0, 0]) * unit
    return Trajectory(times_s, _in_camera_axes(table[:, 1:], axes, file, lines))


def _header(line: str) -> tuple[list[int], float] | None:
    """The places of the eight columns, and the unit of time, s; None: it is no header.

    A unit of 0 is not given.
    """
    found: dict[str, int] = {}
    unit = 0.0
    for place, cell in enumerate(line.lstrip("#").split(",")):
        name, of_time = _plain_name(cell)
        if name == "t" and "t" not in found:
            unit = of_time
        found.setdefault(name, place)
    wanted = ("t", *_POSITION, *_QUATERNION)
    return ([found[name] for name in wanted], unit) if found.keys() >= {*wanted} else None


def _plain_name(cell: str) -> tuple[str, float]:
    """A column's name as we call it, and the unit of time that it has, s; 0: none.

    `p_RS_R_x [m]`, `tx` and `position_x` are x; `q_RS_w []` is qw; `#timestamp [ns]` is a time.
    """
    word, _, unit = cell.strip().lower().partition("[")
    word, unit = word.strip(), unit.strip(" ]")
    last = word.rpartition("_")[2]
    if word in _TIMES or last in (*_UNITS, "timestamp"):
        return "t", _UNITS.get(unit, _UNITS.get(last, 0.0))
    if word[-1:] in "xyzw" and word.startswith(("q", "orientation", "rotation")):
        return f"q{word[-1]}", 0.0
    if word[-1:] in "xyz" and word.startswith(("x", "y", "z", "t", "p")):
        return word[-1], 0.0
    return word, 0.0


def _in_camera_axes(poses: F64, axes: str, file: str, lines: list[int]) -> F64:
    """(n, 7) with unit quaternions of the camera's axes, each in the hemisphere of the last."""
    lengths = np.sqrt((poses[:, 3:] ** 2).sum(axis=1))
    if not (lengths > 1e-6).all():
        where = lines[int(np.flatnonzero(lengths <= 1e-6)[0])]
        raise EvsError(f"trajectory '{file}', line {where}: its quaternion is zero")
    x, y, z, w = (poses[:, 3:] / lengths[:, None]).T
    if axes == "optical":
        # half a turn around x, on the right: q (1, 0, 0; 0)
        x, y, z, w = w, z, -y, -x
    quaternions = np.stack([x, y, z, w], axis=1)
    flips = np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    quaternions[1:] *= np.cumprod(flips)[:, None]
    return np.concatenate([poses[:, :3], quaternions], axis=1)


@dataclass(frozen=True)
class Shaking:
    """Random motion around a pose: for each axis a sum of sines of random phases."""

    rms_m: float
    """of the position, along each of the camera's axes"""
    rms_rad: float
    """of the angle, around each of them"""
    hz: float
    """middle of the band; it reaches from half to one and a half of it"""
    seed: int
    _waves: tuple[tuple[tuple[float, float], ...], ...] = field(init=False, repr=False)
    """for each of six axes: angular frequency, rad/s, and phase of each sine"""

    def __post_init__(self) -> None:
        bits = np.random.Philox(key=self.seed % 2**64).random_raw(6 * _SINES * 2)
        uniform = (bits >> np.uint64(11)).astype(np.float64) * 2.0**-53
        turn = 2.0 * math.pi
        waves = tuple(
            tuple((turn * self.hz * (0.5 + float(a)), turn * float(b)) for a, b in axis)
            for axis in uniform.reshape(6, _SINES, 2)
        )
        object.__setattr__(self, "_waves", waves)

    def offset(self, t_s: float) -> tuple[F64, F64]:
        """The motion at a time.

        Returns:
            (3,) m along the camera's axes; (3, 3) the turn of them.
        """
        scale = math.sqrt(2.0 / _SINES)
        values = [
            scale * math.fsum(math.sin(w * t_s + phase) for w, phase in axis)
            for axis in self._waves
        ]
        vector = np.array(values[3:]) * self.rms_rad
        angle = math.sqrt(float(vector @ vector))
        half = math.sin(angle / 2.0) / angle if angle > 0.0 else 0.5
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, np.array([math.cos(angle / 2.0), *(half * vector)]))
        return np.array(values[:3]) * self.rms_m, turn.reshape(3, 3)
