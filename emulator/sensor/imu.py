"""IMU: what an accelerometer and a gyroscope at the camera feel, from the way the camera went.

    samples, state = stage.step(pose, gravity, state, t_us)

The camera's pose at each tick's end is all that is used: acceleration is the second difference of
its position, angular velocity the turn between the ticks around. So images and samples show one
motion, whatever moved the camera (forces, a mocap body, poses set by hand), and the simulation is
only looked at. At tick k the values of tick k - 1 are known: samples come one tick late, with true
stamps. Between ticks they are interpolated, linearly. MuJoCo's integrators move a body by this very
difference, so that its own accelerometer gives the same.

Axes: the camera's optical ones, x right, y down, z forward, at the camera's centre.

The rotation between two orientations is found by correctly rounded operations only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator.base.arrays import same_bytes
from evs.emulator.base.scene import F64, CameraPose
from evs.emulator.base.stamps import first_from, stamp_us
from evs.emulator.sensor.parameters import ImuParameters
from evs.emulator.sensor.random import Term, indexed_normals
from evs.msgs import DEGREE, STANDARD_GRAVITY, EvsError, ImuSamples, empty_imu

Vector3 = tuple[float, float, float]


def rotation_vector(before: Sequence[float], after: Sequence[float]) -> Vector3:
    """Find the turn from one orientation to another: the shorter way, at most half a turn.

    Args:
        before: (9,) row-major matrix, frame to world.
        after: As `before`.

    Returns:
        Axis times angle, rad, in the turning frame.
    """
    # element (i, j) of before^T after
    relative = [[dot(before[i::3], after[j::3]) for j in range(3)] for i in range(3)]
    w, x, y, z = _quaternion(relative)
    sine = math.sqrt(x * x + y * y + z * z)
    if sine == 0.0:
        return 0.0, 0.0, 0.0
    # a quarter of the angle has the tangent sine / (w + 1)
    angle = 4.0 * _arctangent(sine / (w + math.sqrt(w * w + sine * sine)))
    return angle * (x / sine), angle * (y / sine), angle * (z / sine)


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """Scalar product of two vectors of three, summed in their order."""
    # Python's sum() rounds in another way since 3.12
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _quaternion(m: Sequence[Sequence[float]]) -> tuple[float, float, float, float]:
    """w >= 0, x, y, z of a rotation matrix; by its largest part (Shepperd 1978)."""
    diagonal = m[0][0], m[1][1], m[2][2]
    trace = m[0][0] + m[1][1] + m[2][2]
    if trace >= max(diagonal):
        w = 0.5 * math.sqrt(max(0.0, 1.0 + trace))
        f = 0.25 / w
        return w, f * (m[2][1] - m[1][2]), f * (m[0][2] - m[2][0]), f * (m[1][0] - m[0][1])
    i = diagonal.index(max(diagonal))
    j, k = (i + 1) % 3, (i + 2) % 3
    largest = 0.5 * math.sqrt(max(0.0, 1.0 + m[i][i] - m[j][j] - m[k][k]))
    f = 0.25 / largest
    parts = [0.0, 0.0, 0.0]
    parts[i], parts[j], parts[k] = largest, f * (m[j][i] + m[i][j]), f * (m[k][i] + m[i][k])
    w = f * (m[k][j] - m[j][k])
    sign = -1.0 if w < 0.0 else 1.0
    return sign * w, sign * parts[0], sign * parts[1], sign * parts[2]


def _arctangent(value: float) -> float:
    """Of 0 ... 1, error below 1e-16: halved twice, then the Taylor series."""
    for _ in range(2):
        value = value / (1.0 + math.sqrt(1.0 + value * value))
    square = value * value  # at most 0.04
    series = 0.0
    for odd in range(23, 0, -2):
        series = 1.0 / odd - square * series
    return 4.0 * value * series


MAX_SAMPLES = 1_000_000
"""Most samples in one tick: they all lie in memory."""

MAX_VALUE = 2.0**52
"""Of a saved state: 142 years in us"""

_UNITS = (STANDARD_GRAVITY, DEGREE)
_NOISES = Term.ACCELEROMETER_NOISE, Term.GYROSCOPE_NOISE
_WALKS = Term.ACCELEROMETER_WALK, Term.GYROSCOPE_WALK
_SHAPES = {"poses": (13,), "motion": (7,), "walk": (2, 3)}


@dataclass(frozen=True, eq=False)
class ImuState:
    """What an IMU remembers from tick to tick. A value: stepping leaves it as it is."""

    seed: int
    poses: F64
    """(0 ... 2, 13) the last instants: t us, position (3,) m, orientation (9,), oldest first"""
    motion: F64
    """(0 ... 1, 7) at the older of them: t us, acceleration (3,), angular velocity (3,), optical"""
    walk: F64
    """(2, 3) how far the biases of accelerometer and gyroscope have walked, SI"""
    next_index: int = 0
    """of the next sample, once there is a motion"""

    @classmethod
    def still(cls, seed: int) -> ImuState:
        """Before the first instant."""
        return cls(seed, np.zeros((0, 13)), np.zeros((0, 7)), np.zeros((2, 3)))

    def save(self) -> dict[str, np.ndarray[Any, Any]]:
        """Named arrays that np.savez writes and `restore` takes back."""
        counters = {
            "seed": np.array(self.seed % 2**64, np.uint64),
            "next_index": np.array(self.next_index, np.int64),
        }
        return {key: getattr(self, key).copy() for key in _SHAPES} | counters

    @classmethod
    def restore(cls, saved: Mapping[str, np.ndarray[Any, Any]]) -> ImuState:
        """The state that was saved. Raises EvsError where something of it is missing or unfit."""
        try:
            arrays = {key: np.array(saved[key], np.float64) for key in _SHAPES}
            seed, next_index = int(saved["seed"]), int(saved["next_index"])
        except KeyError as missing:
            raise EvsError(f"saved IMU state lacks {missing}; save it with ImuState.save") from None
        for key, shape in _SHAPES.items():
            if arrays[key].shape[-len(shape) :] != shape or len(arrays[key]) > 2:
                raise EvsError("saved IMU state has arrays of other shapes; save it again")
            # positions and speeds of no robot, times of none
            if not (np.abs(arrays[key]) <= MAX_VALUE).all():
                raise EvsError(f"saved IMU state is damaged: {key} is invalid; save it again")
        if abs(next_index) > MAX_VALUE or (np.diff(arrays["poses"][:, 0]) < 1.0).any():
            raise EvsError("saved IMU state is damaged: its times are invalid; save it again")
        return cls(seed=seed, next_index=next_index, **arrays)

    def __eq__(self, other: object) -> bool:
        """Same bits everywhere."""
        if not isinstance(other, ImuState):
            return NotImplemented
        return same_bytes(self.save(), other.save())

    __hash__ = None  # type: ignore[assignment]


class Imu:
    """The IMU of one camera."""

    def __init__(self, parameters: ImuParameters) -> None:
        self.parameters = p = parameters
        self._biases = (np.array(p.accelerometer_bias), np.array(p.gyroscope_bias))
        step = 1.0 / math.sqrt(p.rate_hz)
        deviations = {
            Term.ACCELEROMETER_NOISE: p.accelerometer_noise_density / step,
            Term.ACCELEROMETER_WALK: p.accelerometer_random_walk * step,
            Term.GYROSCOPE_NOISE: p.gyroscope_noise_density / step,
            Term.GYROSCOPE_WALK: p.gyroscope_random_walk * step,
        }
        self._deviations = {term: size for term, size in deviations.items() if size > 0.0}
        self._ranges = (p.accelerometer_range_g, p.gyroscope_range_dps)

    def init(self, seed: int) -> ImuState:
        """The state before the first instant."""
        return ImuState.still(seed)

    def step(
        self, pose: CameraPose, gravity: F64, state: ImuState, t_us: int
    ) -> tuple[ImuSamples, ImuState]:
        """Sample the motion up to the instant before this one; the first two instants give none.

        Args:
            pose: Of the camera at t_us.
            gravity: (3,) m/s^2, in the world.
            state: The last poses and the noise.
            t_us: The instant, us.

        Returns:
            The samples that are due, and the state.

        Raises:
            EvsError: Time does not go forward, or by too much at once.
        """
        instant = np.array([float(t_us), *pose.pos, *pose.mat])
        if len(state.poses) and t_us <= state.poses[-1, 0]:
            raise EvsError(
                f"time went from {state.poses[-1, 0]:.0f} us to {t_us} us: call init again"
            )
        poses = np.vstack([state.poses, instant])
        if len(poses) < 3:
            return empty_imu(), replace(state, poses=poses)
        first_pose, middle, last = poses.tolist()
        motion = np.array(_motion(first_pose, middle, last, [float(axis) for axis in gravity]))
        state = replace(state, poses=poses[1:])
        rate_hz, known_us = self.parameters.rate_hz, int(motion[0])
        if not len(state.motion):
            first = first_from(known_us, rate_hz)
            state = replace(state, motion=motion[np.newaxis], next_index=first)
        before = state.motion[0]
        after_last = first_from(known_us + 1, rate_hz)
        if after_last - state.next_index > MAX_SAMPLES:
            raise EvsError(
                f"{after_last - state.next_index} IMU samples in one tick, over {MAX_SAMPLES}: "
                "use shorter ticks, or a lower sensor.imu.rate_hz"
            )
        index = np.arange(state.next_index, after_last)
        state = replace(state, motion=motion[np.newaxis], next_index=after_last)
        samples = empty_imu(len(index))
        if not len(index):
            return samples, state
        samples["t"] = [stamp_us(int(number), rate_hz) for number in index]
        span_us = max(known_us - before[0], 1.0)
        late = ((samples["t"] - before[0]) / span_us)[:, np.newaxis]
        true = before[1:] + late * (motion[1:] - before[1:]) if known_us > before[0] else motion[1:]
        true = np.broadcast_to(true, (len(index), 6))
        noise = self._noise(index, state.seed)
        walk = state.walk.copy()
        for which, key in enumerate(("acceleration", "angular_velocity")):
            value = true[:, 3 * which : 3 * which + 3] + self._biases[which]
            if _WALKS[which] in noise:
                # one after the other, so that it does not matter how many come in a tick
                walked = np.cumsum(np.vstack([walk[which], noise[_WALKS[which]]]), axis=0)[1:]
                value, walk[which] = value + walked, walked[-1]
            if _NOISES[which] in noise:
                value = value + noise[_NOISES[which]]
            samples[key] = self._measured(value, which)
        samples["temperature"] = np.float32(self.parameters.temperature_c)
        return samples, replace(state, walk=walk)

    def _noise(self, index: npt.NDArray[np.int64], seed: int) -> dict[Term, F64]:
        """(n, 3) of each term that is not zero, SI; a walk's is its step."""
        terms = list(self._deviations)
        if not terms:
            return {}
        places = np.array(terms)[:, np.newaxis, np.newaxis]
        normals = indexed_normals(seed, places, index[:, np.newaxis], np.arange(3))
        return {
            term: numbers * self._deviations[term]
            for term, numbers in zip(terms, normals, strict=True)
        }

    def _measured(self, value: F64, which: int) -> F64:
        """What a sensor measures of a value: within its range, and float32 in its own unit."""
        measured = value / _UNITS[which]
        if self._ranges[which] > 0.0:
            measured = np.clip(measured, -self._ranges[which], self._ranges[which])
        return measured.astype(np.float32).astype(np.float64) * _UNITS[which]


def _motion(
    first: list[float], middle: list[float], last: list[float], gravity: list[float]
) -> list[float]:
    """t us, proper acceleration and angular velocity at the middle of three instants, optical.

    Of second order in the ticks' lengths where these are equal.
    """
    early_s, late_s = (middle[0] - first[0]) * 1e-6, (last[0] - middle[0]) * 1e-6
    force = [
        2.0 * ((last[n] - middle[n]) / late_s - (middle[n] - first[n]) / early_s)
        / (early_s + late_s) - gravity[n - 1]
        for n in (1, 2, 3)
    ]  # fmt: skip
    turn = middle[4:]
    seen = [dot(turn[column::3], force) for column in range(3)]
    before = rotation_vector(first[4:], turn)
    after = rotation_vector(turn, last[4:])
    # the nearer of the two turns weighs more
    rate = [
        (b / early_s * late_s + a / late_s * early_s) / (early_s + late_s)
        for b, a in zip(before, after, strict=True)
    ]
    # MuJoCo's camera has y up and looks along -z
    return [middle[0], seen[0], -seen[1], -seen[2], rate[0], -rate[1], -rate[2]]
