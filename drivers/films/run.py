"""A film through the pixels into a recording, frame by frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

from evs.drivers.clock import Pacer, StopWatch, monotonic_s
from evs.drivers.files.formats import Format
from evs.drivers.films.config import FilmRunConfig
from evs.drivers.films.source import open_film
from evs.drivers.films.world import FilmWorld
from evs.drivers.run.report import Report
from evs.drivers.run.run_loop import RunLoop
from evs.drivers.run.sink_set import SinkSet
from evs.drivers.run.stop_signals import stop_signals
from evs.drivers.sink import Sink
from evs.emulator.config import decoding
from evs.emulator.sensor import resolve_sensor
from evs.msgs import EvsError


def emulate_film(
    film: str | Path,
    sinks: Sequence[Sink],
    config: FilmRunConfig,
    *,
    progress: Callable[[float], None] | None = None,
    warn: Callable[[str], None] | None = None,
    on_report: Callable[[Report], None] | None = None,
) -> Report:
    """Show a film to a sensor.

    Ctrl-C and SIGTERM end it after the current frame; what was recorded until then is complete.

    Args:
        film: A film, or a folder of frames.
        sinks: Where the packets go, not open yet.
        config: As `load_film_config` gives it.
        progress: Called after every frame with the share of the film that is done, if it is known.
        warn: Gets one line for each warning.
        on_report: Gets the report once, after the sinks are closed, however it ends.

    Returns:
        The report. Its stage `render` is the film's decoding, its ticks are frames or sub-steps.

    Raises:
        EvsError: The film cannot be read, or a sink cannot be written; everything before is whole.
    """
    watch = StopWatch()
    source = open_film(film)
    with closing(source):
        world = FilmWorld(source, config, watch)
        run = _FilmRun(world, sinks, watch, source.count, progress, warn)
        plain = {**decoding.to_plain(config), "file": str(film)}
        return run.run(None, on_report, plain)


def check_holds(config: FilmRunConfig, target: str | Path, kind: Format) -> None:
    """Refuse what the format of the recording cannot hold. Raises EvsError with the key."""
    sensor = resolve_sensor(config.sensor)
    holds = kind.capabilities
    if sensor.aps.enabled and not holds.frames:
        raise EvsError(
            f"at sensor.aps.enabled: '{target}' cannot hold frames; record to .aedat4 or .npz"
        )
    if config.model.labels and not holds.labels:
        raise EvsError("at model.labels: only .npz recordings hold labels")


class _FilmRun(RunLoop):
    """Steps the film until its end or a request to stop."""

    def __init__(
        self,
        world: FilmWorld,
        sinks: Sequence[Sink],
        watch: StopWatch,
        count: int | None,
        progress: Callable[[float], None] | None,
        warn: Callable[[str], None] | None,
    ) -> None:
        self._sink_set = SinkSet(sinks, watch, self.warn)
        super().__init__(world, self._sink_set, watch, Pacer(), warn)
        self._film, self._count, self._progress = world, count, progress

    @property
    def sim_seconds(self) -> float:
        """Seconds of the film so far."""
        return self._film.t_us / 1e6

    def start(self) -> None:
        """Open the sinks."""
        self._sink_set.open([camera.info for camera in self._film.cameras])

    def drive(self) -> None:
        """Step, frame by frame."""
        start_s = monotonic_s()
        self.pacer.start(self._film.t_us)
        with stop_signals() as stopped:
            while not (self._film.is_over or stopped):
                self.watch.begin_tick()
                self.deliver(self._film.step())
                self.wall_seconds = monotonic_s() - start_s
                for line in self.statistics.new_warnings():
                    self.warn(line)
                if self._progress is not None and self._count:
                    self._progress(min(1.0, self._film.frames / self._count))
        if stopped and not self._film.is_over:
            self.ended = f"{stopped[0]} at {self.sim_seconds:.6g} s"
        for line in self._film.notes:
            self.warn(line)

    def stop(self) -> None:
        """Write what the readout still holds, however the run ended."""
        packets = self._film.finish()
        self._sink_set.write(packets)
        self.statistics.count_packets(packets)
