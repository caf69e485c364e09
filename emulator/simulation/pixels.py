"""Pixels: event pixels for frames of other renderers, simulators and films."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np

from evs import __version__
from evs.emulator.base.features import UNFORCED
from evs.emulator.base.protocols import Commit
from evs.emulator.base.scene import F32
from evs.emulator.camera.auxiliary_sensors import AuxiliarySensors
from evs.emulator.camera.frame_light import FrameLight, frame_array
from evs.emulator.camera.pixel_pipeline import DoneTick, PixelPipeline
from evs.emulator.config import ModelConfig, SensorConfig
from evs.emulator.config.decoding import plain_config, plain_integer, with_keys
from evs.emulator.sensor import completed, resolve_sensor
from evs.emulator.state import Resumable, Saved, joined, number, numbers, part, whole, words
from evs.msgs import (
    EventPacket,
    Events,
    EvsError,
    Frame,
    Labels,
    StreamInfo,
    clear_causes,
    empty_events,
    take_labels,
)

VERSIONS = {"evs": __version__, "numpy": np.__version__}
"""of what shapes the events; MuJoCo does not"""

LATEST_US = 2**52
"""142 years: no stamp of a frame is later"""


class Pixels(Resumable):
    """An event sensor without a scene: frames in, events out.

        pixels = Pixels("davis346", size=(640, 480))
        for t_us, frame in frames:
            events = pixels.observe(frame, t_us)
        last = pixels.finish()

    Frames may come from any renderer, simulator or film, at any spacing, which may vary. The
    logarithm of each pixel's light is interpolated linearly between two frames, as in every tick of
    evs. Motion between two frames is unknown.

    The stream is the same as that of an EventCamera: recorders, publishers and other sinks take
    `packet`, `frames` and `info`.
    """

    _t_us: int | None
    """of the last frame"""
    _geom_ids: np.ndarray[Any, Any] | None
    packet: EventPacket | None
    """the last events as a packet; None before the second frame"""
    info: StreamInfo
    """what is constant of its stream; recorders and publishers are opened with it"""

    def __init__(
        self,
        sensor: str | SensorConfig = "davis346",
        size: tuple[int, int] | None = None,
        *,
        model: str | ModelConfig = "plain",
        unit: str = "auto",
        seed: int = 0,
        threads: int = 0,
        name: str = "camera",
        tick_us: int = 1000,
        **keys: Any,
    ) -> None:
        """Make the pixels.

        Args:
            sensor: The name of a preset, the path of a sensor file, or a configuration.
            size: Width and height of sensor and frames, px; None: the preset's.
            model: What turns light into events: plain, adaptive or evsnet, or a configuration.
                `adaptive` is fitted to frames 1 ms apart; `evsnet` needs frames exactly one tick of
                its network apart.
            unit: What the numbers of a frame mean. `luminance`: linear, white is 1.0 (255 of uint8,
                65535 of uint16). `srgb`: the same, sRGB-coded. `dn`: linear, white is 255. `lux`:
                the illuminance of the sensor. `auto`: srgb for uint8 and uint16, luminance for
                floats.
            seed: Determines every random number of the sensor.
            threads: Worker threads; 0: one per core. The bytes are the same.
            name: Of the camera, in packets.
            tick_us: The usual time between two frames, us, for the headers of recordings. Frames
                may have other distances.
            **keys: Any key of [sensor], as in pos_thres=0.3. Keys of its tables have a dot, as in
                **{"readout.bandwidth_mevs": 5}, or are a dict or a configuration.

        Raises:
            EvsError: No such preset, model, unit or key, or an invalid configuration.
        """
        if not isinstance(sensor, str | SensorConfig):
            raise EvsError(f"sensor= takes a name or a SensorConfig, not {sensor!r}")
        if not isinstance(model, str | ModelConfig):
            raise EvsError(f"model= takes a name or a ModelConfig, not {model!r}")
        if size is not None:
            keys = {**keys, **_sides(size)}
        config = SensorConfig(preset=sensor) if isinstance(sensor, str) else sensor
        config = with_keys(config, keys, "sensor")
        self._model = plain_config(
            ModelConfig(name=model) if isinstance(model, str) else model, "model"
        )
        if self._model.chunk > 1:
            raise EvsError(
                f"model.chunk is {self._model.chunk}, but Pixels give their events at once: "
                "leave it 1"
            )
        if self._model.classes:
            raise EvsError(
                "model.classes match names of a scene, and frames have none: leave it out"
            )
        if not name or not isinstance(name, str) or not name.isprintable():
            raise EvsError(f"a camera called {name!r}: give it a printable name")
        self.sensor = resolved = resolve_sensor(config)
        if resolved.imu.enabled:
            raise EvsError(
                "sensor.imu.enabled is true, but frames do not say how the camera moves: leave it "
                "out, or use evs.EventCamera"
            )
        self._seed = plain_integer(seed, "seed")
        tick_us = plain_integer(tick_us, "tick_us")
        if tick_us < 1:
            raise EvsError(f"tick_us is {tick_us}; give 1 or more")
        threads = plain_integer(threads, "threads")
        self._shape = (int(resolved.height), int(resolved.width))
        self._frame_light = FrameLight(self._shape, unit, resolved)
        self._stages = PixelPipeline(resolved, self._model, self._seed, threads)
        self._auxiliary = AuxiliarySensors(resolved, name, UNFORCED, 0)
        self.info = StreamInfo(
            width=self._shape[1],
            height=self._shape[0],
            camera=name,
            sensor=str(resolved.name),
            tick_us=tick_us,
            seed=self._seed,
            versions={**VERSIONS, **self._stages.versions},
            config={
                "sensor": completed(asdict(config), resolved),
                "model": asdict(self._model),
                "frames": {"unit": unit},
                "name": name,
                "seed": self._seed,
                "threads": threads,
            },
            frames=resolved.aps.enabled,
            triggers=resolved.aps.enabled,
            latency_us=self._stages.latency_us,
        )
        self.reset()

    def __repr__(self) -> str:
        info = self.info
        seen = "nothing seen yet" if self._t_us is None else f"t {self._t_us * 1e-6:g} s"
        return f"<evs.Pixels '{info.camera}': {info.sensor} {info.width} x {info.height}, {seen}>"

    def observe(self, light: Any, t_us: int, ids: Any = None) -> Events:
        """Observe a frame. The first call sets the reference and returns no events.

        Args:
            light: (h, w) grey, or (h, w, 3) RGB, or (h, w, 4) whose alpha has no effect; uint8,
                uint16 or a float, in the unit of the constructor. A NumPy array, or an object that
                supports DLPack on the CPU, such as a tensor of PyTorch. It is only read, and not
                needed after the call.
            t_us: Time of the frame, us.
            ids: (h, w) whole numbers, the id that each pixel shows, for `labels`; None: -1
                everywhere.

        Returns:
            (n,) EVENT_DTYPE, the events since the last frame, sorted by t.

        Raises:
            EvsError: A wrong shape or dtype, a time that did not advance, or an array on another
                device.
        """
        now_us = self._check_time(t_us)
        geom_ids = self._check_ids(ids)
        luminance = self._frame_light.convert(light)
        begin_us = now_us - 1 if self._t_us is None else self._t_us
        (done,) = self._stages.see(luminance, begin_us, now_us)
        self._auxiliary.step(luminance, None, None, begin_us, now_us)
        is_first, self._t_us = self._t_us is None, now_us
        self._geom_ids = geom_ids
        return empty_events() if is_first else self._deliver(done)

    def finish(self) -> Events:
        """Read out the pending events; call it after the last frame.

        A busy readout or the latency of pixels delays events beyond the last frame. Time continues
        for them, but no pixel fires again.

        Returns:
            (n,) EVENT_DTYPE, sorted by t. `packet` holds them too, if there are any.

        Raises:
            EvsError: The readout takes longer than the clock can count.
        """
        self._finished = True
        if self._t_us is None:
            return empty_events()
        done = self._stages.drain(self._t_us)
        self._auxiliary.clear()
        if done is None:
            self.packet = None
            return empty_events()
        self._t_us = done.end_us
        return self._deliver(done)

    def _deliver(self, done: DoneTick) -> Events:
        """Make the packet of a tick."""
        labels = None
        if self._model.labels:
            ids = self._geom_ids
            labels = take_labels(done.events, np.full(self._shape, -1) if ids is None else ids)
        elif self._stages.features.get("causes", False):
            clear_causes(done.events)
        self.packet = EventPacket(
            seq=self._seq,
            time_base_us=done.begin_us,
            time_end_us=done.end_us,
            width=self._shape[1],
            height=self._shape[0],
            events=done.events,
            camera=self.info.camera,
            labels=labels,
        )
        self._seq += 1
        return done.events

    def _check_time(self, t_us: int) -> int:
        now_us = plain_integer(t_us, "t_us")
        if abs(now_us) > LATEST_US:
            raise EvsError(f"t_us is {now_us}: stamps end at {LATEST_US} us; let them begin at 0")
        if self._finished:
            raise EvsError("finish() was called: call reset() before the next frame")
        if self._t_us is not None and now_us <= self._t_us:
            raise EvsError(
                f"time went from {self._t_us} us to {now_us} us, so there is nothing between: give "
                "a later t_us, or call reset() first"
            )
        return now_us

    def _check_ids(self, ids: Any) -> np.ndarray[Any, Any] | None:
        if ids is None:
            return None
        if not self._model.labels:
            raise EvsError("ids are for labels: give model=evs.ModelConfig(labels=True)")
        array = frame_array(ids)
        if array.shape != self._shape or array.dtype.kind not in "iu":
            raise EvsError(
                f"ids are {array.shape} {array.dtype}; give {self._shape} (height, width) of whole "
                "numbers"
            )
        # the caller may use its own array again before the events are read out
        return array.astype(np.int32)

    def reset(self) -> None:
        """Start again: the next frame sets the reference, at any time."""
        self._stages.reset(self._seed)
        self._auxiliary.reset(self._seed)
        self._t_us = None
        self._geom_ids = None
        self.packet = None
        self._finished = False
        self._seq = 0

    def prepare_restore(self, saved: Saved) -> Commit:
        """Check a saved state; the commit restores it. Raises EvsError."""
        seed, seq = whole(saved, "seed"), number(saved, "seq", 0)
        finished = bool(number(saved, "finished", 0, 1))
        t_us = saved["t_us"].tolist()
        if len(t_us) > 1:
            raise EvsError("saved state is damaged: its time is invalid; save it again")
        commit_stages = self._stages.prepare_restore(part(saved, "stages"), seed)
        commit_auxiliary = self._auxiliary.prepare_restore(part(saved, "auxiliary"))

        def commit() -> None:
            self._seed = seed
            config = {**self.info.config, "seed": seed}
            self.info = replace(self.info, seed=seed, config=config)
            self.reset()
            commit_stages()
            commit_auxiliary()
            self._t_us = t_us[0] if t_us else None
            self._seq, self._finished = seq, finished

        return commit

    def arrays(self) -> Saved:
        """What `save` packs, by name."""
        return {
            **joined(stages=self._stages.save(), auxiliary=self._auxiliary.save()),
            **numbers(seq=self._seq, finished=self._finished),
            **words(seed=str(self._seed)),
            "t_us": np.array([] if self._t_us is None else [self._t_us], np.int64),
        }

    @property
    def identity(self) -> dict[str, Any]:
        """Where a saved state belongs, in plain values."""
        config = self.info.config
        return {
            "kind": "pixels",
            "versions": {"evs": __version__, **self._stages.versions},
            **{key: config[key] for key in ("sensor", "model", "frames", "name")},
        }

    @property
    def labels(self) -> Labels | None:
        """(n,) the cause of each of the last events; None if model.labels is off."""
        return None if self.packet is None else self.packet.labels

    @property
    def frames(self) -> tuple[Frame, ...]:
        """Intensity frames whose read-out ended in the last observe; needs sensor.aps.enabled."""
        return self._auxiliary.frames

    @property
    def luminance(self) -> F32:
        """(h, w) float32 linear light of the last frame, 1 = white, a copy."""
        return np.array(self._frame_light.light)

    @property
    def clamps(self) -> int:
        """Number of pixel values that were NaN, negative or infinite and were replaced.

        Such a pixel keeps its last light.
        """
        return self._stages.clamps

    @property
    def events_dropped(self) -> dict[str, int]:
        """Events that the readout dropped since the last reset, by cause (empty if it is ideal)."""
        return self._stages.events_dropped

    @property
    def events_waiting(self) -> int:
        """Pending events in the readout; `finish` reads them out."""
        return self._stages.events_waiting

    @property
    def features(self) -> dict[str, bool]:
        """The active code paths, with the names of `evs plan`."""
        return {**self._stages.features, **self._auxiliary.features}


def _sides(size: Any) -> dict[str, int]:
    """The keys of a size."""
    try:
        width, height = size
        sides = {"width": plain_integer(width, "width"), "height": plain_integer(height, "height")}
    except (TypeError, ValueError):
        raise EvsError(f"size is {size!r}; give (width, height) in px") from None
    return sides
