"""Active pixels: light summed over an exposure, converted into an intensity frame.

    frames, state = stage.step(luminance, state, t_begin_us, t_end_us)

Light is taken as linear in time between two ticks and weighted by how much of the tick lies in a
row's exposure, to the microsecond, so that what moves is blurred along its way. The pixel clips at
white, unlike the event pixel. Correctly rounded operations only: same bytes on every machine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.emulator.base.arrays import same_bytes
from evs.emulator.base.scene import F32, F64
from evs.emulator.base.stamps import first_from, stamp_us
from evs.emulator.config.sensor import WHITE_DN
from evs.emulator.sensor.parameters import ApsParameters
from evs.emulator.sensor.random import Term, indexed_normals
from evs.msgs import EvsError, Frame

MAX_INDEX = 2**52
"""Frames of 142 years at one a us"""

MAX_FRAMES = 1000
"""Most frames that may begin in one tick: they all lie in memory."""


@dataclass(frozen=True, eq=False)
class Exposure:
    """A frame that is being taken."""

    index: int
    """it begins at index / rate_hz"""
    light: F64
    """(h, w) luminance times time so far, us, without the last tick's end"""
    due: F64
    """(h, 1) time for which the light at the last tick's end counts already, us"""


@dataclass(frozen=True, eq=False)
class ApsState:
    """What active pixels remember from tick to tick. A value: stepping leaves it as it is."""

    seed: int
    luminance: F32
    """(h, w) at the end of the last tick"""
    next_index: int | None = None
    """of the frame to begin next; None before the first tick"""
    taken: int = 0
    """frames handed out so far"""
    open: tuple[Exposure, ...] = ()
    """frames begun and not handed out, oldest first"""

    def save(self) -> dict[str, np.ndarray[Any, Any]]:
        """Named arrays that np.savez writes and `restore` takes back."""
        begun = self.next_index is not None
        light = [exposure.light for exposure in self.open]
        due = [exposure.due for exposure in self.open]
        return {
            "seed": np.array(self.seed % 2**64, np.uint64),
            "luminance": self.luminance.copy(),
            "next_index": np.array([self.next_index] if begun else [], np.int64),
            "taken": np.array(self.taken, np.int64),
            "open_index": np.array([exposure.index for exposure in self.open], np.int64),
            "open_light": np.array(light, np.float64).reshape(-1, *self.luminance.shape),
            "open_due": np.array(due, np.float64).reshape(-1, len(self.luminance), 1),
        }

    @classmethod
    def restore(cls, saved: Mapping[str, np.ndarray[Any, Any]]) -> ApsState:
        """The state that was saved. Raises EvsError where something of it is missing or unfit."""
        try:
            light = np.array(saved["open_light"], np.float64)
            due = np.array(saved["open_due"], np.float64)
            indices = [int(index) for index in saved["open_index"]]
            state = cls(
                seed=int(saved["seed"]),
                luminance=np.array(saved["luminance"], np.float32),
                next_index=next((int(index) for index in saved["next_index"]), None),
                taken=int(saved["taken"]),
                open=tuple(map(Exposure, indices, light, due)),
            )
        except KeyError as missing:
            raise EvsError(f"saved APS state lacks {missing}; save it with ApsState.save") from None
        shape = (len(indices), *state.luminance.shape)
        if state.luminance.ndim != 2 or light.shape != shape or due.shape != (*shape[:2], 1):
            raise EvsError("saved APS state has arrays of different shapes; save it again")
        parts = (state.luminance, light, due)
        if not all(((part >= 0.0) & (part < np.inf)).all() for part in parts):
            raise EvsError("saved APS state is damaged: its light is invalid; save it again")
        counts = [*indices, state.taken, state.next_index or 0]
        if max(map(abs, counts)) > MAX_INDEX or state.taken < 0:
            raise EvsError("saved APS state is damaged: its frames are invalid; save it again")
        return state

    def __eq__(self, other: object) -> bool:
        """Same bits everywhere."""
        if not isinstance(other, ApsState):
            return NotImplemented
        return same_bytes(self.save(), other.save())

    __hash__ = None  # type: ignore[assignment]


class Aps:
    """The active pixels of one camera."""

    def __init__(
        self,
        parameters: ApsParameters,
        width: int,
        height: int,
        exposure_dn: float = WHITE_DN,
        camera: str = "camera",
    ) -> None:
        """Check that the frames fit their rate.

        Args:
            parameters: [sensor.aps], resolved.
            width: Of a frame, px.
            height: Of a frame, px.
            exposure_dn: DN per unit of luminance, as in the event pixels; 255 DN is white.
            camera: Its name in frames.

        Raises:
            EvsError: Frames come faster than they can be taken.
        """
        parameters.check_time(height)
        self.parameters, self.camera = parameters, camera
        self._shape = (height, width)
        self._per_light = parameters.gain * exposure_dn / WHITE_DN / parameters.exposure_us
        offsets = [parameters.row_offset_us(row) for row in range(height)]
        self._offsets = np.array(offsets, np.int64)[:, np.newaxis]

    def init(self, seed: int) -> ApsState:
        """The state before the first tick."""
        return ApsState(seed, np.zeros(self._shape, np.float32))

    def restore(self, saved: Mapping[str, np.ndarray[Any, Any]]) -> ApsState:
        """ApsState.restore, of a state of these pixels. Raises EvsError."""
        state = ApsState.restore(saved)
        if state.luminance.shape != self._shape:
            raise EvsError("saved APS state is of another sensor; restore it into its own")
        return state

    def step(
        self, luminance: F32, state: ApsState, t_begin_us: int, t_end_us: int
    ) -> tuple[tuple[Frame, ...], ApsState]:
        """Expose for one tick. The first tick only sets the light; the first frame begins after it.

        Args:
            luminance: (h, w) float32, linear, as at t_end_us. Light that is negative, NaN or Inf
                leaves the pixel at its last value.
            state: The exposures so far.
            t_begin_us: Where the tick begins, us.
            t_end_us: Where it ends, us.

        Returns:
            The frames that were read out in (t_begin_us, t_end_us], oldest first; the state.

        Raises:
            EvsError: Wrong shape, a tick that does not go forward or has too many frames.
        """
        if np.shape(luminance) != self._shape:
            raise EvsError(
                f"luminance is {np.shape(luminance)}, the frame (height, width) is {self._shape}"
            )
        if t_end_us <= t_begin_us:
            raise EvsError(f"tick ({t_begin_us}, {t_end_us}] us does not go forward")
        rate_hz = self.parameters.rate_hz
        sound = (luminance >= 0.0) & (luminance < np.inf)
        now = np.array(luminance, np.float32)
        if not sound.all():
            now = np.where(sound, now, state.luminance)
        if state.next_index is None:
            return (), replace(state, luminance=now, next_index=first_from(t_end_us, rate_hz))

        coming = first_from(t_end_us, rate_hz) - state.next_index
        if coming > MAX_FRAMES:
            raise EvsError(
                f"{coming} frames in the tick ({t_begin_us}, {t_end_us}] us, over {MAX_FRAMES}: "
                "use shorter ticks, or a lower sensor.aps.rate_hz"
            )
        frames: list[Frame] = []
        still: list[Exposure] = []
        pending, following = list(state.open), state.next_index
        while pending or stamp_us(following, rate_hz) < t_end_us:
            if pending:
                exposure = pending.pop(0)
            else:
                exposure = Exposure(following, np.zeros(self._shape), np.zeros((len(now), 1)))
                following += 1
            exposure = self._collect(exposure, state.luminance, t_begin_us, t_end_us)
            begin_us = stamp_us(exposure.index, rate_hz)
            if begin_us + self.parameters.frame_us(self._shape[0]) <= t_end_us:
                frames.append(self._frame(exposure, now, state.seed, state.taken + len(frames)))
            else:
                still.append(exposure)
        taken = state.taken + len(frames)
        return tuple(frames), ApsState(state.seed, now, following, taken, tuple(still))

    def _collect(self, exposure: Exposure, before: F32, t_begin_us: int, t_end_us: int) -> Exposure:
        """The exposure after one more tick.

        Args:
            exposure: Until now.
            before: (h, w) the light at the tick's beginning.
            t_begin_us: Where the tick begins, us.
            t_end_us: Where it ends, us.
        """
        begins = stamp_us(exposure.index, self.parameters.rate_hz) + self._offsets
        starts = np.clip(begins, t_begin_us, t_end_us)
        ends = np.clip(begins + self.parameters.exposure_us, t_begin_us, t_end_us)
        # light linear in the tick: its mean over a part of it is its value in the part's middle
        spent = (ends - starts).astype(np.float64)
        middle = ((starts - t_begin_us) + (ends - t_begin_us)) / (2.0 * (t_end_us - t_begin_us))
        late = spent * middle
        # both ticks that a light belongs to count at once
        weight = exposure.due + (spent - late)
        rows = np.flatnonzero(weight)
        light = exposure.light
        if len(rows) == len(weight):
            light = light + weight * before
        elif len(rows):
            part = slice(rows[0], rows[-1] + 1)
            light = light.copy()
            light[part] += weight[part] * before[part]
        return Exposure(exposure.index, light, late)

    def _frame(self, exposure: Exposure, now: F32, seed: int, seq: int) -> Frame:
        """The frame of a complete exposure, with noise.

        Args:
            exposure: All that was collected.
            now: (h, w) the light at the tick's end.
            seed: The noise follows from it.
            seq: Number of the frame.
        """
        parameters = self.parameters
        share = (exposure.light + exposure.due * now) * self._per_light
        if parameters.full_well_e > 0.0:
            electrons = share * parameters.full_well_e
            noise = self._normals(seed, Term.APS_SHOT, exposure.index)
            # a Poisson number of this mean is this Gaussian one, but for a few electrons
            share = (electrons + np.sqrt(electrons) * noise) / parameters.full_well_e
        largest = 2**parameters.adc_bits - 1
        # a full pixel holds no more
        steps = np.minimum(share, 1.0) * largest
        if parameters.read_noise_dn > 0.0:
            noise = self._normals(seed, Term.APS_READ, exposure.index)
            steps = steps + noise * parameters.read_noise_dn
        codes = np.clip(np.floor(steps + 0.5), 0, largest).astype(np.uint16)
        begin_us = stamp_us(exposure.index, parameters.rate_hz)
        return Frame(
            seq=seq,
            begin_us=begin_us,
            exposure_begin_us=begin_us,
            exposure_end_us=begin_us + parameters.exposure_us,
            end_us=begin_us + parameters.frame_us(self._shape[0]),
            pixels=_shifted(codes, parameters.bits - parameters.adc_bits, parameters.bits),
            camera=self.camera,
        )

    def _normals(self, seed: int, term: Term, index: int) -> F64:
        rows, columns = (np.arange(side, dtype=np.uint64) for side in self._shape)
        return indexed_normals(seed, term, index, (rows[:, np.newaxis] << np.uint64(31)) | columns)


def _shifted(
    codes: npt.NDArray[np.uint16], up: int, bits: int
) -> npt.NDArray[np.uint8] | npt.NDArray[np.uint16]:
    """The ADC's codes as the upper bits of a pixel."""
    moved = codes << up if up >= 0 else codes >> -up
    return moved.astype(np.uint8) if bits == 8 else moved.astype(np.uint16)
