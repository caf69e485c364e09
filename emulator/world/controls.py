"""What moves the actuators: nothing, a keyframe, a smooth random signal, a file, or a function.

Every source is a function of the tick's beginning alone (the caller's own function excepted), so
the same seed gives the same motion whatever happened before. ControlSource is the source that
the settings of a scene name.
"""

from __future__ import annotations

import copy
import math
import zipfile
import zlib
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F64
from evs.emulator.base.small_files import is_file, open_file, read_small_text
from evs.emulator.config import SceneConfig
from evs.emulator.world.model import find, name_of, names_of
from evs.msgs import EvsError, unknown

ControlFunction = Callable[[float, Any], npt.ArrayLike | None]
"""`f(t_s, data) -> ctrl (nu,)`, called at each tick's beginning; None keeps the last value."""

Control = Callable[[int, Any], F64 | None]
"""t_us, data -> ctrl (nu,), or None to keep the last value."""

HOME = "home"
"""The keyframe that a run starts from unless another is named, as robots' models call it."""

NO_KEYFRAME = "none"

_MOST_BYTES = 1 << 32
"""Of a control file, and of what is packed in one: 20 actuators at 1 kHz for 7 hours."""

KNOTS_HZ = 4.0
"""How often the random signal chooses a new target for each actuator."""


def make_control(
    model: mujoco.MjModel,
    source: str | ControlFunction,
    *,
    keyframe: str = "",
    file: str = "",
    rate_hz: float = 100.0,
    seed: int = 0,
    scale: float = 1.0,
) -> Control:
    """Make a control source.

    Args:
        model: The model.
        source: auto, zero, keyframe, random, file, or a function `f(t_s, data) -> ctrl`. "auto"
            gives no control, so that those of the starting keyframe hold.
        keyframe: Name or number, for "keyframe".
        file: Path of the controls, for "file".
        rate_hz: How often "random" and "file" change.
        seed: What "random" follows from.
        scale: Share of the control range that "random" uses.

    Raises:
        EvsError: A source, keyframe or file that does not exist, or does not fit the model.
    """
    if callable(source):
        return _from_function(source, model.nu)
    if source == "auto":
        return lambda _t_us, _data: None
    if source == "zero":
        zeros = np.zeros(model.nu)
        return lambda _t_us, _data: zeros
    if source == "keyframe":
        held = model.key_ctrl[find_keyframe(model, keyframe)].copy()
        return lambda _t_us, _data: held
    if not (rate_hz > 0.0 and math.isfinite(rate_hz)):
        raise EvsError(f"scene.control_hz is {rate_hz}: it must be over 0, for example 100")
    if source == "random":
        smooth = SmoothRandom(model, seed, scale)
        held_value = lru_cache(maxsize=1)(lambda period: smooth(period / rate_hz))
        return lambda t_us, _data: held_value(_period(t_us, rate_hz))
    if source == "file":
        rows = read_controls(file, model.nu)
        return lambda t_us, _data: rows[min(_period(t_us, rate_hz), len(rows) - 1)]
    raise unknown("control", str(source), ("auto", "zero", "keyframe", "random", "file"))


def starting_keyframe(model: mujoco.MjModel, name: str) -> int:
    """Find the keyframe that a run starts from.

    Args:
        model: The model.
        name: Name or number; "": `home` where the model has it; "none": qpos0.

    Returns:
        Its id; -1: qpos0.

    Raises:
        EvsError: No such keyframe.
    """
    if name == NO_KEYFRAME:
        return -1
    return find_keyframe(model, name) if name else home_keyframe(model)


def home_keyframe(model: mujoco.MjModel) -> int:
    """The id of the keyframe called `home`; -1: the model has none."""
    return int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, HOME))


def name_of_keyframe(model: mujoco.MjModel, keyframe: int) -> str:
    """Its name, its number where it has none; "" for -1."""
    return "" if keyframe < 0 else name_of(model, mujoco.mjtObj.mjOBJ_KEY, keyframe)


def find_keyframe(model: mujoco.MjModel, name: str) -> int:
    """The id of a keyframe by name or number; empty: `home`, else the first."""
    if not name and model.nkey:
        return max(home_keyframe(model), 0)
    return find(model, mujoco.mjtObj.mjOBJ_KEY, "keyframe", name)


def check_control(values: npt.ArrayLike, nu: int, origin: str) -> F64:
    """`values` as (nu,) float64; EvsError where the shape is wrong or a number is not finite."""
    try:
        ctrl = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise EvsError(f"{origin} gives {values!r}, which is not {nu} numbers") from None
    if ctrl.shape != (nu,):
        raise EvsError(
            f"{origin} has shape {ctrl.shape}, the model has {nu} controls: give shape ({nu},)"
        )
    if not np.isfinite(ctrl).all():
        where = int(np.flatnonzero(~np.isfinite(ctrl))[0])
        raise EvsError(f"{origin} has {ctrl[where]} at index {where}: controls must be finite")
    return ctrl.copy()


def read_controls(file: str, nu: int) -> F64:
    """(n, nu) controls from a .npy, a .npz (array `ctrl`, or its only one) or a .csv file."""
    path = Path(file)
    if not file or not is_file(path):
        raise EvsError(f"no control file '{file}': scene.control_file names a .npy, .npz or .csv")
    try:
        rows = _read_array(path)
    except (ValueError, OSError, EOFError) as reason:
        raise EvsError(f"control file '{file}': {' '.join(str(reason).split())}") from None
    if rows.ndim != 2 or rows.shape[1] != nu or not len(rows):
        raise EvsError(
            f"control file '{file}' has shape {rows.shape}; give one row a period: (n, {nu})"
        )
    if not np.isfinite(rows).all():
        row = int(np.flatnonzero(~np.isfinite(rows).all(axis=1))[0])
        raise EvsError(f"control file '{file}': row {row} has a value that is not finite")
    return rows


class SmoothRandom:
    """A smooth signal inside each control's range: it glides from one random target to the next.

    Targets are a function of (seed, number of the target) alone; `scale` is the share of the range
    in use, around its middle. A control without a range moves within -1 ... 1.
    """

    def __init__(self, model: mujoco.MjModel, seed: int, scale: float = 1.0) -> None:
        if not 0.0 <= scale <= 1.0:
            raise EvsError(f"scene.control_scale is {scale}: it must lie between 0 and 1")
        limited = np.asarray(model.actuator_ctrllimited, bool).reshape(-1, 1)
        limits = np.where(limited, model.actuator_ctrlrange.reshape(-1, 2), (-1.0, 1.0))
        self._middle = limits.mean(axis=1)
        self._half = (limits[:, 1] - limits[:, 0]) / 2 * scale
        # a target holds for many calls
        self._targets = lru_cache(maxsize=3)(partial(_uniform, seed, len(self._half)))
        # so that the actuators do not all turn at the same moment
        self._offset = _uniform(seed, len(self._half), -1)

    def __call__(self, t_s: float) -> F64:
        """(nu,) control at time t_s >= 0."""
        phase = t_s * KNOTS_HZ + self._offset
        knot = np.floor(phase)
        first = math.floor(t_s * KNOTS_HZ)
        targets = np.stack([self._targets(first + step) for step in range(3)])
        row = (knot - first).astype(np.int64)
        column = np.arange(len(row))
        here, there = targets[row, column] * 2 - 1, targets[row + 1, column] * 2 - 1
        # smoothstep: no jump in the speed either
        u = phase - knot
        u = u * u * (3 - 2 * u)
        return np.asarray(self._middle + self._half * (here + (there - here) * u), np.float64)


def _uniform(seed: int, count: int, number: int) -> F64:
    """(count,) numbers in [0, 1) that depend on seed and `number` only."""
    mask = (1 << 64) - 1
    bits = np.random.Philox(key=seed & mask, counter=(number & mask) << 64)
    raw = bits.random_raw(count) >> np.uint64(11)
    return raw.astype(np.float64) * 2.0**-53


def _period(t_us: int, rate_hz: float) -> int:
    """Number of the control period that t_us lies in; its first microsecond belongs to it."""
    return math.floor(t_us * rate_hz / 1e6 + 1e-9)


def _from_function(function: ControlFunction, nu: int) -> Control:
    def control(t_us: int, data: Any) -> F64 | None:
        values = function(t_us * 1e-6, data)
        return None if values is None else check_control(values, nu, "the control function")

    return control


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


class _TooLargeError(Exception):
    """An archive expands to more than any control file has."""


def _read_array(path: Path) -> F64:
    suffix, size = path.suffix.lower(), path.stat().st_size
    if size > _MOST_BYTES:
        raise ValueError(f"has {size} bytes; {_MOST_BYTES} is the most")
    if suffix == ".csv":
        lines = [line for line in read_small_text(path, _MOST_BYTES).splitlines() if line.strip()]
        # a first line without a single number names the columns
        if lines and not any(_is_number(cell) for cell in lines[0].split(",")):
            del lines[0]
        if not lines:
            raise ValueError("no row of numbers in it")
        return np.loadtxt(lines, np.float64, delimiter=",", ndmin=2)
    if suffix not in (".npy", ".npz"):
        raise ValueError("not a .npy, .npz or .csv file")
    try:
        # opened here: numpy leaves a broken archive open
        with open_file(path) as file:
            loaded = np.load(file, allow_pickle=False)
            packed = [] if isinstance(loaded, np.ndarray) else loaded.zip.infolist()
            if sum(member.file_size for member in packed) > _MOST_BYTES:
                raise _TooLargeError
            arrays = {"ctrl": loaded} if isinstance(loaded, np.ndarray) else dict(loaded)
    except _TooLargeError:
        raise ValueError(f"expands to more than {_MOST_BYTES} bytes") from None
    except (ValueError, EOFError, TypeError, MemoryError, zipfile.BadZipFile, zlib.error):
        # numpy's own words here are of pickles and zip files
        way = "np.save(FILE, ctrl)" if suffix == ".npy" else "np.savez(FILE, ctrl=ctrl)"
        raise ValueError(f"is no whole {suffix} file of numbers; write it with {way}") from None
    if "ctrl" not in arrays and len(arrays) != 1:
        raise ValueError(f"has no array 'ctrl', only {', '.join(arrays) or 'nothing'}")
    (one, *_) = arrays.values()
    return np.asarray(arrays.get("ctrl", one), np.float64)


def actuator_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Name of each actuator, its number where it has none, in the order of the controls.

    Raises EvsError where an actuator has several controls: then they have no name of their own.
    """
    names = tuple(names_of(model, mujoco.mjtObj.mjOBJ_ACTUATOR))
    if model.nu != len(names):
        raise EvsError(
            f"the model has {len(names)} actuators with {model.nu} controls: a loop that is "
            "shared by name needs actuators of one control each"
        )
    return names


def control_range(model: mujoco.MjModel) -> F64:
    """(nu, 2) lowest and highest control of each actuator; infinite without a limit."""
    limited = np.asarray(model.actuator_ctrllimited, bool).reshape(-1, 1)
    given = np.asarray(model.actuator_ctrlrange, np.float64).reshape(-1, 2)
    return np.where(limited, given, np.array([[-np.inf, np.inf]]))


class ControlSource:
    """The control source of a scene's settings, or a function, with a seed that may change."""

    def __init__(
        self, model: mujoco.MjModel, settings: SceneConfig, source: str | ControlFunction
    ) -> None:
        """Raises EvsError for what does not exist or fit."""
        if settings.control_file and source != "file":
            raise EvsError(
                f"scene.control_file '{settings.control_file}' is not used: "
                'set scene.control to "file", or leave it out'
            )
        self._model, self._settings, self._source = model, settings, source
        self.keyframe = starting_keyframe(model, settings.keyframe)
        if source == "keyframe" and settings.keyframe == NO_KEYFRAME:
            raise EvsError(
                'scene.control "keyframe" holds a keyframe: name it in scene.keyframe, not none'
            )
        if source == "keyframe":
            self.keyframe = find_keyframe(model, settings.keyframe)
        """id of the keyframe that the world starts from; -1: from qpos0"""
        if source == "auto" and not 0 <= self.keyframe == home_keyframe(model):
            self._source = "zero"
        self.seed = settings.control_seed
        self._control = self._make()

    def copy(self) -> ControlSource:
        """Another one, of the same seed."""
        other = copy.copy(self)
        other._control = other._make()
        return other

    @property
    def needs_data(self) -> bool:
        """Whether a function of the caller's decides, which may look at the data."""
        return callable(self._source)

    @property
    def is_constant(self) -> bool:
        """Whether it gives the same control in every tick, or none in any."""
        return self._source in ("auto", "zero", "keyframe")

    @property
    def holds(self) -> bool:
        """Whether the controls of the starting keyframe hold."""
        return self._source in ("auto", "keyframe") and self._model.nu > 0

    def reseed(self, seed: int) -> None:
        """Random controls follow from `seed` from now on."""
        if seed != self.seed:
            self.seed = seed
            self._control = self._make()

    def __call__(self, t_us: int, data: mujoco.MjData) -> F64 | None:
        """(nu,) the control of the tick that begins at t_us; None: as before."""
        return self._control(t_us, data)

    def _make(self) -> Control:
        settings = self._settings
        return make_control(
            self._model,
            self._source,
            keyframe=settings.keyframe,
            file=settings.control_file,
            rate_hz=settings.control_hz,
            seed=self.seed,
            scale=settings.control_scale,
        )
