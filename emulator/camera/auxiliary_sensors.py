"""The sensors of a camera beside its event pixels: intensity frames (APS) and IMU."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from evs.emulator.base.features import Switches
from evs.emulator.base.protocols import Commit
from evs.emulator.base.scene import F32, CameraPose
from evs.emulator.base.stamps import later_frame, later_imu
from evs.emulator.sensor import Aps, Imu, SensorParameters
from evs.emulator.sensor.imu import ImuState
from evs.emulator.state import Saved, joined, number, numbers, part
from evs.msgs import Frame, ImuPacket

if TYPE_CHECKING:
    from evs.emulator.world import MjModel


class AuxiliarySensors:
    """Intensity frames and IMU of one camera. One that is off has no state and no step."""

    frames: tuple[Frame, ...]
    """intensity frames whose read-out ended in the last tick; none unless sensor.aps is enabled"""
    imu_packet: ImuPacket | None
    """IMU samples of the last tick; None: there are none, as always unless sensor.imu is enabled"""

    def __init__(
        self, sensor: SensorParameters, name: str, switches: Switches, start_us: int
    ) -> None:
        """Make those that are on.

        Args:
            sensor: The sensor, resolved.
            name: Of the camera.
            switches: Which are forced on or off.
            start_us: By how much stamps are later than the world's time, us.
        """
        size = int(sensor.width), int(sensor.height)
        self._sensor, self._name, self._start_us = sensor, name, start_us
        self._aps = (
            Aps(sensor.aps, *size, float(sensor.exposure_dn), name)
            if switches.decide("aps", sensor.aps.enabled)
            else None
        )
        self._imu = Imu(sensor.imu) if switches.decide("imu", sensor.imu.enabled) else None
        self.features = {"aps": self._aps is not None, "imu": self._imu is not None}
        """which of them it makes, by the names of evs.emulator.base.features.FEATURES"""

    def reset(self, seed: int) -> None:
        """Forget everything.

        Args:
            seed: What their noise follows from.
        """
        self._aps_state = None if self._aps is None else self._aps.init(seed)
        self._imu_state = None if self._imu is None else self._imu.init(seed)
        self._imu_seq = 0
        self.frames, self.imu_packet = (), None

    def save(self) -> Saved:
        """Named arrays that `prepare_restore` takes back."""
        return {
            **(joined(aps=self._aps_state.save()) if self._aps_state is not None else {}),
            **(joined(imu=self._imu_state.save()) if self._imu_state is not None else {}),
            **numbers(imu_seq=self._imu_seq),
        }

    def prepare_restore(self, saved: Saved) -> Commit:
        """Checks what `save` gave; the commit puts it in place. Raises EvsError."""
        aps = None if self._aps is None else self._aps.restore(part(saved, "aps"))
        imu = None if self._imu is None else ImuState.restore(part(saved, "imu"))
        imu_seq = number(saved, "imu_seq", 0)

        def commit() -> None:
            self._aps_state, self._imu_state, self._imu_seq = aps, imu, imu_seq

        return commit

    def clear(self) -> None:
        """Forget what the last tick brought: nothing is exposed any more."""
        self.frames, self.imu_packet = (), None

    def step(
        self,
        luminance: F32,
        pose: CameraPose | None,
        world: MjModel | None,
        begin_us: int,
        end_us: int,
    ) -> None:
        """A tick. What runs only because [plan] forces it is computed and dropped.

        Args:
            luminance: (h, w) float32, linear.
            pose: Where the camera is; None: it is not known, and there are no IMU samples.
            world: What it stands in; None: nothing known, as above.
            begin_us: Where the tick begins, us.
            end_us: Where it ends, us.
        """
        if self._aps is not None and self._aps_state is not None:
            # light may lie on a GPU
            light = np.asarray(luminance)
            frames, self._aps_state = self._aps.step(light, self._aps_state, begin_us, end_us)
            if self._sensor.aps.enabled:
                self.frames = tuple(later_frame(frame, self._start_us) for frame in frames)
        if pose is None or world is None:
            return
        if self._imu is not None and self._imu_state is not None:
            # here, since frames of other simulators need no MuJoCo
            from evs.emulator.world import gravity_of

            samples, self._imu_state = self._imu.step(
                pose, gravity_of(world), self._imu_state, end_us
            )
            if self._sensor.imu.enabled:
                packet = ImuPacket(self._imu_seq, samples, self._name)
                self.imu_packet = later_imu(packet, self._start_us) if len(samples) else None
                self._imu_seq += len(samples) > 0
