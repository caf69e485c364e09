"""EventCamera: an event camera inside a simulation loop that the user already owns."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from evs.emulator.base.protocols import Commit
from evs.emulator.base.scene import F32, GroundTruth
from evs.emulator.camera.camera import Camera
from evs.emulator.camera.view import camera_config
from evs.emulator.config import (
    CameraConfig,
    ModelConfig,
    RenderConfig,
    SceneConfig,
    SensorConfig,
    VisualConfig,
)
from evs.emulator.config.decoding import plain_integer
from evs.emulator.simulation.snapshot_history import SnapshotHistory
from evs.emulator.state import Resumable, Saved, joined, part, whole, words
from evs.emulator.world import (
    LiveScene,
    MjData,
    MjModel,
    ModelDigest,
    SnapshotTaker,
    StabilityWatch,
    UnstableError,
    Visual,
    resolve_visual,
    versions,
)
from evs.msgs import (
    EventPacket,
    Events,
    EvsError,
    Frame,
    ImuSamples,
    Labels,
    StreamInfo,
    empty_events,
)
from evs.msgs.pictures import event_facts, event_frame, exposure_for, html_card, to_srgb8

LATEST_US = 2**53
"""285 years: from there on, time in s has no whole microseconds"""


def _kind(thing: object) -> str:
    """Its class with the package that it is from: several have a MjModel."""
    kind = type(thing)
    return kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__name__}"


class EventCamera(Resumable):
    """An event camera for a mujoco.MjModel that your own code steps.

        sensor = EventCamera(model, camera="track")
        while True:
            mujoco.mj_step(model, data)
            events = sensor.observe(data)

    It works with any step length, which may vary. Neither the model nor the data is changed. If a
    daemon thread observes while the interpreter exits, it ends with SystemExit.

    The model may be edited between calls: the next observe shows it. Vertices of meshes, heights,
    texels, skins and flexes are compared only in the first observe after `reset`, and in `refresh`.
    """

    def __init__(
        self,
        model: MjModel,
        camera: str | CameraConfig = "",
        *,
        sensor: str | SensorConfig = "davis346",
        render: RenderConfig | None = None,
        model_config: ModelConfig | None = None,
        seed: int = 0,
        threads: int = 0,
        name: str | None = None,
        visual: Visual | None = None,
    ) -> None:
        """Put a camera into a model.

        Args:
            model: The model, which is not changed.
            camera: The name of one of the model's cameras, or a description; "" is its first.
            sensor: The name of a preset, or a configuration.
            render: How light reaches the pixels; None: the defaults.
            model_config: What turns light into events; None: the defaults.
            seed: Determines every random number of the sensor.
            threads: Worker threads; 0: one per core.
            name: Its name in packets; None: after the model's camera.
            visual: Visible groups and flags, a mujoco.MjvOption or a VisualConfig; None: MuJoCo's
                default.

        Raises:
            EvsError: Not an MjModel, no such camera or preset, or an invalid configuration.
        """
        if not isinstance(model, MjModel):
            raise EvsError(
                f"an EventCamera takes a mujoco.MjModel, not {_kind(model)}; "
                "gymnasium: env.unwrapped.model (Metaworld too), dm_control: physics.model.ptr, "
                "robosuite: env.sim.model._model"
            )
        self._model = model
        tick_us = max(1, round(model.opt.timestep * 1e6))
        self._visual = resolve_visual(visual)
        settings = SceneConfig(tick_us=tick_us, visual=self._visual)
        config = camera_config(settings, camera, sensor, render, model_config, seed, threads)
        if config.model.chunk > 1:
            raise EvsError(
                f"model.chunk is {config.model.chunk}, but an EventCamera gives its events at "
                "once: leave it 1"
            )
        self._scene, self._digest = LiveScene(model, self._visual), ModelDigest(model)
        self._camera = Camera(model, self._scene.scene, config, name)
        self._tick_us = tick_us
        self._t_us: int | None = None
        self._taker = SnapshotTaker(model, [self._camera.bound], self._visual)
        self._history = SnapshotHistory(self._taker)
        self.packet: EventPacket | None = None
        """the last observe's events as a packet; None before the second"""
        self._stability = StabilityWatch()

    def _see_edits(self) -> None:
        """Show edits of the model. Raises EvsError."""
        if not self._scene.outdated():
            return
        scene = self._scene.extract()
        self._camera.prepare_refresh(scene)()
        self._taker.fit([self._camera.bound])
        self._scene.taken(scene)

    def __repr__(self) -> str:
        info = self.info
        seen = "nothing seen yet" if self._t_us is None else f"t {self._t_us * 1e-6:g} s"
        return (
            f"<evs.EventCamera '{info.camera}': {info.sensor} {info.width} x {info.height}, {seen}>"
        )

    def _repr_html_(self) -> str:
        info = self.info
        facts = {"sensor": info.sensor, "size": f"{info.width} x {info.height} px"}
        if self._t_us is None:
            light = np.zeros((info.height, info.width), np.float32)
            facts["seen"] = "nothing yet: call observe(data)"
        else:
            light = self.luminance
            facts["seen"] = f"{self._t_us:,} us"
        events = empty_events() if self.packet is None else self.packet.events
        grey = to_srgb8(light, exposure_for(light))
        picture = event_frame(events, info.width, info.height, grey)
        return html_card(f"EventCamera {info.camera}", facts | event_facts(events), picture)

    def observe(self, data: MjData) -> Events:
        """Observe the present state. The first call sets the reference and returns no events.

        Args:
            data: Data of the model, or of an identical copy of it; it is only read.

        Returns:
            (n,) EVENT_DTYPE, the events since the last call, sorted by t, us of `data.time`.

        Raises:
            UnstableError: The simulation became unstable and MuJoCo reset the data, so time went
                backwards. An `UnstableWarning` reports other instabilities, once.
            EvsError: Time did not advance, the data belongs to another model, or the edited model
                cannot be shown.
        """
        if not isinstance(data, MjData):
            raise EvsError(
                f"observe takes a mujoco.MjData, not {_kind(data)}; "
                "gymnasium: env.unwrapped.data (Metaworld too), dm_control: physics.data.ptr, "
                "robosuite: env.sim.data._data"
            )
        if not math.isfinite(data.time):
            raise EvsError(f"data.time is {data.time}: the simulation is unstable")
        if abs(data.time) * 1e6 > LATEST_US:
            raise EvsError(
                f"data.time is {data.time:g} s: stamps in us end at {LATEST_US * 1e-6:.3g} s; let "
                "it begin at 0"
            )
        self._scene.check_data(data)
        unstable = self._stability.look(self._model, data)
        self._see_edits()
        t_us = round(data.time * 1e6)
        if unstable is not None and self._t_us is not None and t_us <= self._t_us:
            raise UnstableError(f"{unstable}: call reset() of the camera to go on")
        passed_us = self._tick_us if self._t_us is None else max(t_us - self._t_us, 0)
        snapshot = self._history.snapshot(data, t_us, passed_us)
        self._t_us = t_us
        if not self._camera.started:
            self._camera.start(snapshot)
            self._history.keep(snapshot)
            return empty_events()
        (self.packet,) = self._camera.observe(snapshot)
        self._history.keep(snapshot)
        return self.packet.events

    def reset(self, seed: int | None = None, sensor: str | SensorConfig | None = None) -> None:
        """Start again; call it after the data was reset. The next observe sets the reference.

        That observe also compares arrays that are too large to compare every time: vertices of
        meshes, heights, texels, skins and flexes.

        Args:
            seed: Determines all noise from now on; None keeps the last.
            sensor: Another sensor of the same size from now on, as in evs.randomise_sensor; None
                keeps the last.

        Raises:
            EvsError: The sensor is invalid or has another size. Nothing has changed.
        """
        self._camera.reset(None if seed is None else plain_integer(seed, "seed"), sensor)
        self._scene.compare_large_arrays()
        self._history.reset()
        self.packet, self._t_us = None, None
        self._stability.forget()

    def adjust(self, **keys: object) -> None:
        """Change parameters of the sensor while it runs, from the next observe on.

        Args:
            **keys: See `Camera.adjust`. Examples: `pos_thres=0.3` and
                `**{"biases.bias_diff_on": 20}`.

        Raises:
            EvsError: See `Camera.adjust`. Nothing has changed.
        """
        self._camera.adjust(**keys)

    def restore(self, blob: bytes) -> None:
        """See `Resumable.restore`; put the data back as well."""
        self._scene.compare_large_arrays()
        self._see_edits()
        super().restore(blob)

    def prepare_restore(self, saved: Saved) -> Commit:
        """Check a saved state; the commit restores it. Raises EvsError."""
        t_us = saved["t_us"].tolist()
        if len(t_us) > 1:
            raise EvsError("saved state is damaged: its time is invalid; save it again")
        moments, seen = self._history.read(part(saved, "moments"), t_us[0] if t_us else 0)
        now, previous = (*seen, None, None)[:2]
        seed = whole(saved, "seed")
        commit_camera = self._camera.prepare_restore(part(saved, "camera"), seed, now, previous)

        def commit() -> None:
            commit_camera()
            self._history, self.packet = moments, None
            self._t_us = t_us[0] if t_us else None
            self._stability.forget()

        return commit

    def arrays(self) -> Saved:
        """What `save` packs, by name."""
        return {
            **joined(camera=self._camera.save(), moments=self._history.save()),
            **words(seed=str(self._camera.info.seed)),
            "t_us": np.array([] if self._t_us is None else [self._t_us], np.int64),
        }

    @property
    def identity(self) -> dict[str, Any]:
        """Where a saved state belongs, in plain values."""
        return {
            "kind": "sensor",
            "versions": {key: versions()[key] for key in ("evs", "mujoco")},
            "model": self._digest(),
            "camera": {"name": self._camera.name, **self._camera.identity},
            **({} if self._visual == VisualConfig() else {"visual": asdict(self._visual)}),
        }

    def refresh(self) -> None:
        """Compare the whole model now, large arrays included, and show the changes.

        The large arrays are vertices of meshes, heights, texels, skins and flexes. The next observe
        shows all other edits without this call. The pixels keep their state, so they respond to the
        change like to any other.

        Raises:
            EvsError: The model cannot be shown.
        """
        self._scene.compare_large_arrays()
        self._see_edits()
        self._camera.forget_instants()
        self._history.reset()

    @property
    def frames(self) -> tuple[Frame, ...]:
        """Intensity frames whose read-out ended in the last observe; needs sensor.aps.enabled."""
        return self._camera.frames

    @property
    def imu(self) -> ImuSamples:
        """(n,) IMU samples of the last observe; needs sensor.imu.enabled. See Camera.imu."""
        return self._camera.imu

    @property
    def labels(self) -> Labels | None:
        """(n,) the cause of each event of the last observe; None if model.labels is off."""
        return None if self.packet is None else self.packet.labels

    @property
    def events_dropped(self) -> dict[str, int]:
        """Events that the readout dropped since the last reset, by cause (empty if it is ideal)."""
        return self._camera.events_dropped

    @property
    def instabilities(self) -> int:
        """Number of observes before which MuJoCo found a bad position, velocity or acceleration."""
        return self._stability.count

    @property
    def rebuilt(self) -> dict[str, int]:
        """Number of rebuilds of the scene because the model was edited.

        `scenes` counts all of them; `meshes` and `textures` count the rebuilt parts.
        """
        return dict(self._camera.rebuilt)

    @property
    def luminance(self) -> F32:
        """(h, w) float32 linear luminance of the last observe, a copy."""
        return self._camera.luminance

    def ground_truth(self) -> GroundTruth:
        """Depth, normals, ids, flow, ... of the last observe, computed at each call."""
        return self._camera.ground_truth()

    @property
    def info(self) -> StreamInfo:
        """The constant facts of its stream."""
        return self._camera.info
