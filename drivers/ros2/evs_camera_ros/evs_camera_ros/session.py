"""What runs between configure and cleanup: a world with its camera, and where its ticks go."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from evs.drivers.clock import Pacer, monotonic_s
from evs.drivers.run.config import PipelineConfig
from evs.drivers.run.pace_monitor import PaceMonitor
from evs.drivers.run.sensor_control import SensorControl
from evs.drivers.run.sink_set import SinkSet
from evs.drivers.sink import Sink
from evs.emulator.base.protocols import NoMeter
from evs.emulator.simulation.world import World


class Session:
    """A world that is stepped, and counts."""

    def __init__(
        self, config: PipelineConfig, sink: Sink, speed: float, warn: Callable[[str], None]
    ) -> None:
        """Build the world and open the sink.

        Args:
            config: The world with its one camera.
            sink: Where ticks go.
            speed: Simulated seconds per wall second; 0: free.
            warn: Gets a line for each thing that is legal but hardly meant.

        Raises:
            EvsError: A value that cannot be.
        """
        self._pacer = Pacer(speed, catch_up_s=config.realtime.catch_up_s)
        self._monitor = PaceMonitor(self._pacer, warn)
        self.world = World.from_config(config)
        (self.camera,) = self.world.cameras
        self._sensors = SensorControl(self.world)
        self._described: list[dict[str, Any]] = []
        self.events = self.late_ticks = 0
        """since the start"""
        self._sink_set = SinkSet([sink], NoMeter(), warn, self._sensors)
        try:
            self._sink_set.open([self.camera.info])
        except BaseException:
            self._sink_set.close()
            raise

    @property
    def slips(self) -> int:
        """Ticks in which simulated time slipped behind the wall clock for good."""
        return self._pacer.slips

    @property
    def events_dropped(self) -> int:
        """Events that the sensor's readout has dropped."""
        return sum(self.camera.events_dropped.values())

    def parameters(self) -> list[dict[str, Any]]:
        """What may change of the sensor, as SensorControl describes it."""
        if not self._described:
            # takes milliseconds
            self._described = self._sensors.parameters()[self.camera.name]
        return self._described

    def set(self, values: Mapping[str, object]) -> None:
        """Change the sensor from the next tick on. EvsError: nothing has changed."""
        self._sensors.set(self.camera.name, values)
        self._described = []

    def resume(self) -> None:
        """Simulated time goes on from here."""
        self._pacer.start(self.world.t_us)

    def run_for(self, seconds: float) -> None:
        """Step for a time of the wall clock, at least one tick. Raises EvsError."""
        end_s = monotonic_s() + seconds
        self._step()
        while monotonic_s() < end_s:
            self._step()

    def close(self) -> BaseException | None:
        """Close the sink; the error, if any."""
        return self._sink_set.close()

    def _step(self) -> None:
        packets = self.world.step()
        t_us = self.world.t_us
        self._pacer.wait_until(t_us)
        self._monitor.update()
        self.late_ticks += self._pacer.late_s * 1e6 > self.camera.info.tick_us
        self.events += sum(map(len, packets))
        self._sink_set.write_tick(self.world.cameras, packets, t_us)
