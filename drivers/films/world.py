"""FilmWorld: a film as a run's world. Its ticks are the steps from frame to frame."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from evs.drivers.films.config import FilmConfig, FilmRunConfig, read_times
from evs.drivers.films.decoder import Picture
from evs.drivers.films.fitting import Box, area_mean, region
from evs.drivers.films.source import FilmFile, FrameFolder
from evs.emulator import Pixels
from evs.emulator.base.protocols import Meter
from evs.emulator.base.scene import F32, GroundTruth
from evs.emulator.camera.frame_light import FrameLight
from evs.emulator.config import decoding
from evs.emulator.sensor import SensorParameters, resolve_sensor
from evs.msgs import EventPacket, EvsError, Frame, StreamInfo

LEAST_DN = 0.01
"""Of the light that is added where the line is straight in log light, so that black has a place."""


def between(
    before: F32, after: F32, steps: int, line: str, floor: float
) -> Iterator[npt.NDArray[np.float32]]:
    """The light at equal steps from one frame to the next, in a straight line for each pixel.

    No motion is invented: an edge that moved by ten pixels fades out here and in there, and does
    not travel across those between. Frames of an interpolator that follows motion, or of a faster
    camera, are the way to more.

    Args:
        before: (h, w) linear.
        after: (h, w) linear, the light of the last step.
        steps: A power of two.
        line: What goes in a straight line: `log`, the logarithm of light + floor; `linear`, light.
        floor: Light, such as that of the sensor's dark current.

    Yields:
        (h, w) float32, `steps` times.
    """
    if steps > 1:
        lifted = np.float64(floor) if line == "log" else np.float64(0.0)
        first, last = (light.astype(np.float64) + lifted for light in (before, after))
        yield from (
            (light - lifted).astype(np.float32) for light in _halved(first, last, steps, line)
        )
    yield after


def _halved(
    first: npt.NDArray[np.float64], last: npt.NDArray[np.float64], steps: int, line: str
) -> Iterator[npt.NDArray[np.float64]]:
    """What lies between the two, without them: halves of halves.

    A square root is exact to the last bit on every processor; a logarithm is not.
    """
    if steps == 1:
        return
    with np.errstate(invalid="ignore", over="ignore"):
        # negative light becomes NaN, which the pixels count
        middle = np.sqrt(first) * np.sqrt(last) if line == "log" else 0.5 * (first + last)
    yield from _halved(first, middle, steps // 2, line)
    yield middle
    yield from _halved(middle, last, steps // 2, line)


class LightStep(NamedTuple):
    """The light on the sensor at an instant."""

    t_us: int
    light: F32
    """(h, w) of the sensor"""


class FilmLight:
    """Frames into light on the sensor, with their times."""

    def __init__(
        self, source: FilmFile | FrameFolder, config: FilmConfig, sensor: SensorParameters
    ) -> None:
        """Prepare; nothing is decoded yet.

        Raises:
            EvsError: The times of the frames are not known, or the film is HDR.
        """
        self._source, self._config, self._sensor = source, config, sensor
        self._times = read_times(config.times) if config.times else None
        if isinstance(source, FrameFolder) and config.fps is None and self._times is None:
            raise EvsError(
                f"the frames of '{source.path}' have no times: give --fps, or film.times=FILE"
            )
        if source.hdr_curve and config.unit in ("auto", "srgb"):
            raise EvsError(
                f"'{source.path}' is HDR ({source.hdr_curve}), not sRGB: convert it to SDR first, "
                "or take its numbers for light with --unit luminance"
            )
        self._shape = (int(sensor.height), int(sensor.width))
        self._frame_shape: tuple[int, int] | None = None
        self._convert: FrameLight | None = None
        self._box: Box = (0, 0, 1, 1)
        self.frames = 0
        """decoded so far"""
        self.not_later = 0
        """frames that were left out, as they were not later than the one before"""

    def steps(self) -> Iterator[LightStep]:
        """The light at each frame, and at the sub-steps before it."""
        # in the sensor's own log map, in units of white
        floor_dn = max(float(self._sensor.dark_dn), LEAST_DN)
        floor = floor_dn / float(self._sensor.exposure_dn)
        config, last = self._config, None
        for number, picture in enumerate(self._source.pictures()):
            self.frames += 1
            t_us = self._time_us(number, picture)
            if last is not None and t_us <= last.t_us:
                self.not_later += 1
                continue
            now = LightStep(t_us, self._light(picture))
            if last is None:
                yield now
            else:
                # no more steps than microseconds
                count = min(config.substeps, 1 << ((t_us - last.t_us).bit_length() - 1))
                lights = between(last.light, now.light, count, config.between, floor)
                for step, light in enumerate(lights, 1):
                    yield LightStep(last.t_us + (t_us - last.t_us) * step // count, light)
            last = now

    def _time_us(self, number: int, picture: Picture) -> int:
        """When a frame was, us after the first."""
        config = self._config
        if config.fps is not None:
            seconds = number / Fraction(config.fps)
        elif self._times is not None:
            if number >= len(self._times):
                raise EvsError(
                    f"{picture.label}: '{config.times}' has times of {len(self._times)} frames only"
                )
            seconds = Fraction(self._times[number])
        elif picture.t_s is not None:
            seconds = picture.t_s
        else:
            raise EvsError(f"{picture.label} has no time stamp: give --fps")
        if number == 0:
            self._begin_s = seconds
        micros = (seconds - self._begin_s) * 1_000_000 / Fraction(config.slowdown)
        # the nearest one, halves up
        return int((2 * micros + 1) // 2)

    def _light(self, picture: Picture) -> F32:
        """The light of a frame on the sensor."""
        pixels = picture.pixels
        shape = (pixels.shape[0], pixels.shape[1])
        if self._frame_shape is None:
            self._frame_shape = shape
            crop = self._config.crop
            box = (crop[0], crop[1], crop[2], crop[3]) if crop else None
            self._box = region(shape, self._shape, self._config.fit, box)
            _, _, width, height = self._box
            self._convert = FrameLight((height, width), self._config.unit, self._sensor)
        if shape != self._frame_shape or self._convert is None:
            before = self._frame_shape
            raise EvsError(
                f"{picture.label} is {shape[1]} x {shape[0]} px, the frames before are "
                f"{before[1]} x {before[0]}: make all of one size"
            )
        x, y, width, height = self._box
        part: npt.NDArray[Any] = pixels[y : y + height, x : x + width]
        # the array of the conversion is used again
        return np.array(area_mean(self._convert.convert(part), self._shape))


class FilmPlan:
    """Which code paths a film's pixels run, for the report."""

    def __init__(self, contents: dict[str, Any], features: dict[str, bool]) -> None:
        self._contents, self._features = contents, features

    def compact(self) -> dict[str, Any]:
        """See the plan of a scene."""
        return {
            "contents": self._contents,
            "on": [name for name, on in self._features.items() if on],
            "off": {name: "not needed" for name, on in self._features.items() if not on},
        }


class FilmCamera:
    """The pixels of a film as a run sees a camera."""

    imu_packet = None
    pose = None
    traced_fraction = 0.0
    is_dark = False
    """a film that begins black is no mistake"""

    def __init__(
        self, pixels: Pixels, config: FilmRunConfig, source: FilmFile | FrameFolder
    ) -> None:
        self.pixels = pixels
        film = decoding.to_plain(config.film)
        plain = {**pixels.info.config, "film": {**film, "file": str(source.path)}}
        self.info: StreamInfo = dataclasses.replace(pixels.info, config=plain)
        self.rebuilt: dict[str, int] = {}
        self._source = source

    @property
    def frames(self) -> tuple[Frame, ...]:
        """Intensity frames of the last step."""
        return self.pixels.frames

    @property
    def luminance(self) -> F32:
        """(h, w) float32 light of the last step."""
        return self.pixels.luminance

    @property
    def clamps(self) -> int:
        """Pixels times steps whose light was none."""
        return self.pixels.clamps

    @property
    def events_dropped(self) -> dict[str, int]:
        """Events that the readout dropped, by cause."""
        return self.pixels.events_dropped

    @property
    def events_waiting(self) -> int:
        """Events that are on their way through the readout."""
        return self.pixels.events_waiting

    @property
    def plan(self) -> FilmPlan:
        """What the film is and which code paths run."""
        kind = "folder" if isinstance(self._source, FrameFolder) else "film"
        return FilmPlan({kind: str(self._source.path)}, self.pixels.features)

    def ground_truth(self) -> GroundTruth:
        """A film has none."""
        raise EvsError(f"'{self._source.path}' is a film: it has no ground truth")


class FilmWorld:
    """A film's frames as ticks. The first frame, which only sets the reference, is seen at once."""

    left_out: tuple[str, ...] = ()
    substeps = "none: the light is a film's"

    def __init__(self, source: FilmFile | FrameFolder, config: FilmRunConfig, meter: Meter) -> None:
        """Make the pixels and look at the first frame.

        Args:
            source: The film; the caller closes it.
            config: As `load_film_config` gives it.
            meter: Measures how long decoding ("render") and pixels ("sensor") take.

        Raises:
            EvsError: The first frame cannot be read, the sensor makes no sense.
        """
        sensor = resolve_sensor(config.sensor)
        self._light = FilmLight(source, config.film, sensor)
        self._steps = self._light.steps()
        first = next(self._steps, None)
        if first is None:
            raise EvsError(f"'{source.path}' holds no frame")
        self._failure: EvsError | None = None
        self._ahead = self._decode()
        pixels = Pixels(
            config.sensor,
            model=config.model,
            unit="luminance",
            seed=config.seed,
            threads=config.threads,
            name=config.name,
            tick_us=1000 if self._ahead is None else self._ahead.t_us,
        )
        self._camera = FilmCamera(pixels, config, source)
        self.cameras = (self._camera,)
        self._meter = meter
        self.t_us = first.t_us
        pixels.observe(first.light, first.t_us)
        self._finished = False

    @property
    def is_over(self) -> bool:
        """Whether there is no further frame."""
        return self._ahead is None and self._failure is None

    @property
    def frames(self) -> int:
        """Frames of the film that were decoded."""
        return self._light.frames

    @property
    def notes(self) -> list[str]:
        """A line for each thing that was left out."""
        count = self._light.not_later
        if not count:
            return []
        return [f"{count:,} frames are not later than the one before them and were left out"]

    def step(self) -> tuple[EventPacket, ...]:
        """Show the next frame, or the next sub-step; its packet."""
        now = self._ahead
        if now is None:
            raise self._failure or EvsError("the film is over")
        pixels = self._camera.pixels
        pixels.observe(now.light, now.t_us)
        self.t_us = now.t_us
        self._meter.lap("sensor")
        # one ahead, so that the end is known when it is there
        self._ahead = self._decode()
        self._meter.lap("render")
        return (pixels.packet,) if pixels.packet is not None else ()

    def _decode(self) -> LightStep | None:
        """The next step; None at the end. A damaged frame is reported when its turn comes."""
        try:
            return next(self._steps, None)
        except EvsError as error:
            self._failure = error
            return None

    def finish(self) -> tuple[EventPacket, ...]:
        """The events that are still in the readout; none at the second call."""
        if self._finished:
            return ()
        self._finished = True
        self._camera.pixels.finish()
        packet = self._camera.pixels.packet
        return () if packet is None else (packet,)
