"""One camera: light, events and packets of one pair of eyes in a world that others move."""

from __future__ import annotations

from dataclasses import asdict, fields, replace
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from evs.emulator.base.arrays import on_lines
from evs.emulator.base.features import Switches
from evs.emulator.base.protocols import Commit, DeviceRenderer, Meter, NoMeter, Renderer
from evs.emulator.base.scene import F32, I32, CameraPose, GroundTruth, SceneModel, SceneSnapshot
from evs.emulator.base.stamps import later_events
from evs.emulator.camera.auxiliary_sensors import AuxiliarySensors
from evs.emulator.camera.pixel_pipeline import DoneTick, LentPixels, PixelPipeline
from evs.emulator.camera.scene_plan import ScenePlan, is_unlit, plan_scene
from evs.emulator.camera.view import SceneView, Viewpoint, covered_by, may_be_covered
from evs.emulator.config import PlanConfig, RunConfig, SensorConfig
from evs.emulator.config.decoding import plain_config, with_keys
from evs.emulator.optics import camera_info
from evs.emulator.optics.camera_info import pose_message
from evs.emulator.render import flicker_warnings
from evs.emulator.render.native import LentRenderer, NativeRenderer
from evs.emulator.sensor import SensorParameters, completed, preset_biases, resolve_sensor
from evs.emulator.state import Saved, joined, number, numbers, part
from evs.emulator.world import MjModel, object_classes, versions, warn_left_out
from evs.msgs import (
    EventPacket,
    EvsError,
    Frame,
    ImuPacket,
    ImuSamples,
    Pose,
    StreamInfo,
    clear_causes,
    empty_imu,
    take_labels,
    unknown,
)


class RenderedFrame(NamedTuple):
    """One instant, and what a camera sees of it."""

    snapshot: SceneSnapshot
    pose: CameraPose
    """where the camera was"""
    luminance: F32
    """(h, w) float32, linear"""
    viewpoint: Viewpoint
    """which scene and renderer it is from"""
    traced_fraction: float
    """share of the pixels that had to be traced for it, 0 ... 1"""


class LentCamera(NamedTuple):
    """The parts of a camera that a batch of cameras uses in its place."""

    renderer: LentRenderer
    pixels: LentPixels
    viewpoint: Viewpoint
    """what it sees from"""


_OWN_KEYS = ("scene", "sensor", "render", "model", "name", "seed", "threads", "plan", "camera")
"""of RunConfig, in the header of a camera that is one of several: all but the duration"""


class Camera(SceneView):
    """Renders each snapshot and turns changes of light into events.

    `start` sets the reference. Every `observe` then returns the packet since the last call. With
    model.chunk over 1 it returns none while the chunk fills, and then those of all its ticks.
    """

    _seen_from: Viewpoint
    """whose light the last instant was"""
    info: StreamInfo
    """what is constant of its stream"""
    traced_fraction: float
    """share of the pixels that the last tick traced, 0 ... 1"""
    _class_of_geom: I32 | None = None
    rebuilt: dict[str, int]
    """how often its scene was built again since it was made, as the model was edited, and of that
    how many meshes and textures: scenes, meshes, textures"""
    left_out: tuple[str, ...]
    """one line for each thing that its ticks do not show, with the fix; issued as warnings too"""

    def __init__(
        self,
        world: MjModel,
        scene: SceneModel,
        config: RunConfig,
        name: str | None,
        *,
        place: int = 0,
        taken: tuple[str, ...] = (),
        whole: bool = False,
        meter: Meter | None = None,
        like: Camera | None = None,
    ) -> None:
        """Build the stages.

        Args:
            world: See SceneView.
            scene: See SceneView.
            config: See SceneView.
            name: Its name on the bus and in recordings; None: after the model's camera or the body.
            place: See SceneView.
            taken: Names that are not free.
            whole: Whether it is the one camera of a pipeline, whose header has all of `config`.
            meter: Measures the time of each stage.
            like: See SceneView.

        Raises:
            EvsError: The configuration makes no sense in this world.
        """
        self._meter, self._tracing = meter or NoMeter(), Lock()
        self._tick_us = config.scene.tick_us
        super().__init__(world, scene, config, place, like=like)
        # cameras of twins see the same
        self._checked_cover = like is not None
        self.left_out = ()
        self._stand(self._viewpoint)
        self.rebuilt = dict.fromkeys(("scenes", "meshes", "textures"), 0)
        sensor, name = self.sensor, free_name(name, self.bound.name, taken)
        self._pixels = PixelPipeline(sensor, config.model, config.seed, *self._pixel_settings)
        self._marks_causes = self._pixels.features.get("causes", False)
        self._auxiliary = AuxiliarySensors(sensor, name, self._switches, self._start_us)
        self._traces_truth = self._switches.decide("ground_truth", config.model.labels)
        plain = {**asdict(config), "name": name}
        plain["sensor"] = completed(plain["sensor"], sensor)
        keys = [field.name for field in fields(RunConfig)] if whole else _OWN_KEYS
        self.info = StreamInfo(
            width=self.width,
            height=self.height,
            camera=name,
            sensor=str(sensor.name),
            tick_us=self._tick_us,
            seed=config.seed,
            versions={**versions(), **self._pixels.versions},
            config={key: plain[key] for key in keys},
            camera_info=camera_info(self.bound.model),
            frames=sensor.aps.enabled,
            imu=sensor.imu.enabled,
            triggers=sensor.aps.enabled,
            latency_us=self._latency_us(self._pixels),
            classes=self._class_names(),
        )
        self._forget()

    def reset(self, seed: int | None = None, sensor: str | SensorConfig | None = None) -> None:
        """Forget everything seen.

        Args:
            seed: Another seed from now on, as if the camera were made with it.
            sensor: Another sensor of the same size from now on, as if the camera were made with it.

        Raises:
            EvsError: The sensor is invalid, or has another size, or other frames or IMU. Nothing
                has changed.
        """
        self.prepare_reset(seed, sensor)()

    def prepare_reset(
        self, seed: int | None = None, sensor: str | SensorConfig | None = None
    ) -> Commit:
        """Check a reset; the commit does it.

        Args:
            seed: See `reset`.
            sensor: See `reset`.

        Raises:
            EvsError: See `reset`.
        """
        exchange = None
        if isinstance(sensor, str):
            sensor = SensorConfig(preset=sensor)
        if not isinstance(sensor, SensorConfig | None):
            raise EvsError(f"sensor= takes a name or a SensorConfig, not {sensor!r}")
        if sensor is not None and sensor != self.config.sensor:
            exchange = self._prepare_sensor(sensor, self.config.seed if seed is None else seed)

        def commit() -> None:
            if exchange is not None:
                exchange()
            if seed is not None:
                self.config = replace(self.config, seed=seed)
                self._renderer.reseed(seed)
                # a world of one pipeline has the run's whole configuration there, seed included
                header = {**self.info.config, "seed": seed}
                self.info = replace(self.info, seed=seed, config=header)
            self._forget()

        return commit

    def _prepare_sensor(self, sensor: SensorConfig, seed: int) -> Commit:
        """Make everything that depends on the sensor, which is not the light."""
        config = replace(self.config, sensor=plain_config(sensor, "sensor"))
        made = resolve_sensor(config.sensor)
        if (made.width, made.height) != (self.width, self.height):
            raise EvsError(
                f"a sensor of {made.width} x {made.height} px for a camera of {self.width} x "
                f"{self.height}: make another camera"
            )
        for stream in ("aps", "imu"):
            if getattr(made, stream).enabled != getattr(self.sensor, stream).enabled:
                raise EvsError(
                    f"sensor.{stream}.enabled would change in a reset; leave it, or make another "
                    "camera"
                )
        pixels = PixelPipeline(made, config.model, seed, *self._pixel_settings)
        auxiliary = AuxiliarySensors(made, self.name, self._switches, self._start_us)

        def commit() -> None:
            self._pixels, self._auxiliary = pixels, auxiliary
            self._marks_causes = pixels.features.get("causes", False)
            self._take_sensor(config, made)
            latency_us = self._latency_us(pixels)
            self.info = replace(self.info, sensor=str(made.name), latency_us=latency_us)

        return commit

    @property
    def _pixel_settings(self) -> tuple[int, int, Switches, str]:
        """Arguments of PixelPipeline."""
        render = self.config.render
        return self.config.threads, render.noisy_samples, self._switches, render.isa

    def _take_sensor(self, config: RunConfig, made: SensorParameters) -> None:
        """Have another sensor in the configuration and in the header."""
        self.config, self.sensor = config, made
        table = completed(asdict(config.sensor), made)
        self.info = replace(self.info, config={**self.info.config, "sensor": table})

    def adjust(self, **keys: object) -> None:
        """Change parameters of the sensor while it runs, from the next tick on.

        Pixels keep their state. If a lowered threshold passes the level of a still pixel, the pixel
        fires in the next tick, as in a real chip. A changed sensor counts as another camera in
        saved states.

        Args:
            **keys: Keys in `adjustable`: keys of [sensor], as in `pos_thres=0.3`, and the chip's
                biases, as in `**{"biases.bias_diff_on": 20}`.

        Raises:
            EvsError: Another key, a value out of range, or a value that switches a term on or off.
                Nothing has changed.
        """
        known = self.adjustable
        for key in keys:
            if key not in known:
                raise unknown("parameter that changes while a camera runs", key, known)
        sensor = with_keys(self.config.sensor, keys, "sensor")
        made = resolve_sensor(sensor)
        self._pixels.adjust(made)
        self._take_sensor(replace(self.config, sensor=sensor), made)

    @property
    def adjustable(self) -> tuple[str, ...]:
        """Keys of [sensor] that `adjust` accepts, including the chip's biases."""
        biases = preset_biases(self.config.sensor.preset)
        names = () if biases is None else biases.values
        return (*self._pixels.adjustable, *(f"biases.{name}" for name in names))

    def _latency_us(self, pixels: PixelPipeline) -> int:
        return pixels.latency_us + round(self.config.render.delay_ticks * self._tick_us)

    def _forget(self) -> None:
        """Forget everything seen."""
        seed = self.config.seed
        self._renderer.restart()
        self._pixels.reset(seed)
        self._auxiliary.reset(seed)
        self._luminance: F32 | None = None
        self.traced_fraction = 0.0
        self._t_us: int | None = None
        self.forget_instants()
        self._seq = self._seen = 0
        self.events = 0

    def save(self) -> Saved:
        """Named arrays of all that the next tick needs, which `prepare_restore` takes back."""
        begun = [] if self._t_us is None else [self._t_us]
        return {
            **joined(pixels=self._pixels.save(), light=self._renderer.save()),
            **self._auxiliary.save(),
            **numbers(seq=self._seq, seen=self._seen, events=self.events),
            **numbers(instants=(self._now is not None) + (self._previous is not None)),
            "t_us": np.array(begun, np.int64),
        }

    def prepare_restore(
        self, saved: Saved, seed: int, now: SceneSnapshot | None, previous: SceneSnapshot | None
    ) -> Commit:
        """Check a saved state; the commit puts it in place.

        Args:
            saved: The result of `save`.
            seed: That of the camera that was saved.
            now: What it saw last.
            previous: What it saw before that.

        Raises:
            EvsError: It is damaged.
        """
        pixels = self._pixels.prepare_restore(part(saved, "pixels"), seed)
        auxiliary = self._auxiliary.prepare_restore(saved)
        light = self._renderer.prepare_restore(part(saved, "light"))
        counts = [number(saved, name, 0) for name in ("seq", "seen", "events")]
        instants = number(saved, "instants", 0, 2)
        t_us = saved["t_us"].tolist()
        needed = [now, previous][:instants]
        if None in needed or (needed and now is not None and t_us != [now.t_us]):
            raise EvsError("saved state is damaged: a camera's time is invalid; save it again")

        def commit() -> None:
            self.reset(seed)
            pixels()
            auxiliary()
            self._seq, self._seen, self.events = counts
            self._t_us = t_us[0] if t_us else None
            seen = [(one, one.cameras[self.place]) for one in needed if one is not None]
            self._now, self._previous = (*seen, None, None)[:2]
            light()
            # the light of the last instant is not saved, since it is found again
            self._luminance = self._renderer.render_again(*self._now) if self._now else None

        return commit

    def lend(self) -> LentCamera | str:
        """What steps in its place, with the same bytes, in a batch; or why it cannot.

        Call it again after a reset. Until `take_back` the camera must not be used.
        """
        if any(self._auxiliary.features.values()) or self._traces_truth:
            return "frames, IMU, labels or ground truth are made in every tick"
        renderer = self._renderer
        light = (
            renderer.lend()
            if isinstance(renderer, NativeRenderer)
            else "the renderer is not native"
        )
        if isinstance(light, str):
            return light
        pixels = self._pixels.lend()
        if isinstance(pixels, str):
            return pixels
        if (light.device is None) != (pixels.device is None):
            return "light and pixels are not both on a GPU (render.device, model.device)"
        return LentCamera(light, pixels, self._viewpoint)

    def take_back(
        self,
        lent: LentCamera,
        ticks: int,
        events: int,
        now: SceneSnapshot,
        previous: SceneSnapshot,
    ) -> None:
        """Go on after ticks that a batch has stepped.

        Args:
            lent: What `lend` gave.
            ticks: How many.
            events: In them.
            now: The world at their end.
            previous: One tick before.
        """
        self._seq += ticks
        self._seen += ticks
        self.events += events
        self._t_us, self.traced_fraction = now.t_us, float(lent.renderer.caster.traced_fraction)
        self._luminance, self._seen_from = lent.renderer.luminance, lent.viewpoint
        self._now = now, now.cameras[self.place]
        self._previous = previous, previous.cameras[self.place]

    @property
    def identity(self) -> dict[str, Any]:
        """What shapes its events, seed aside, in plain values: where a saved state belongs."""
        plain = self.info.config
        tables = {key: dict(plain[key]) for key in ("camera", "sensor", "render", "model")}
        # the same bytes
        for key in ("isa", "incremental", "device"):
            del tables["render"][key]
        del tables["model"]["device"]
        if self.config.plan != PlanConfig():
            # the same events of other arrays
            tables["plan"] = asdict(self.config.plan)
        return {"of": self.config.scene.camera, **tables, **self._pixels.versions}

    def prepare_refresh(self, scene: SceneModel) -> Commit:
        """Prepare the renderer for the edited world; the commit installs it.

        The pixels keep their state, so they see the change as they would see any other.

        Raises:
            EvsError: The edited world cannot be shown.
        """
        viewpoint = self._viewpoint_in(scene, self._viewpoint)

        def commit() -> None:
            if viewpoint.renderer is not self._renderer:
                self.rebuilt["scenes"] += 1
                everything = {"meshes": len(scene.meshes), "textures": len(scene.textures)}
                for kind, count in getattr(viewpoint.renderer, "built", everything).items():
                    self.rebuilt[kind] += count
            self._stand(viewpoint)
            seen = camera_info(viewpoint.bound.model)
            self.info = replace(self.info, camera_info=seen, classes=self._class_names())

        return commit

    def _class_names(self) -> list[str]:
        """Divide the world into classes, if events are labelled with them."""
        model = self.config.model
        if not model.labels:
            if model.classes:
                raise EvsError("model.classes are classes of labels: add model.labels=true")
            return []
        names, self._class_of_geom = object_classes(self._world, model.classes)
        return list(names)

    def _stand(self, viewpoint: Viewpoint) -> None:
        self._viewpoint = viewpoint
        self._stays: F32 | None = None
        """memory for its light that stays on the GPU; None: it does not"""
        self._renders_on_device = isinstance(viewpoint.renderer, DeviceRenderer)
        self._unlit = is_unlit(viewpoint.scene, self.config.render)
        lines = flicker_warnings(viewpoint.scene.lights, self.config.render, self._tick_us)
        warn_left_out([line for line in lines if line not in self.left_out])
        self.left_out = lines

    @property
    def _renderer(self) -> Renderer:
        return self._viewpoint.renderer

    @property
    def started(self) -> bool:
        """Whether the reference is set."""
        return self._t_us is not None

    def start(self, snapshot: SceneSnapshot) -> None:
        """The light of `snapshot` is the reference that later light is compared with.

        With fresh noise a network sees this light for the ticks of its window before: it has to
        know the noise, else the first ticks are full of it.
        """
        ticks = self._pixels.warm_up_ticks if self.config.render.seeds == "fresh" else 0
        tick_us = self._tick_us
        for t_us in range(snapshot.t_us - ticks * tick_us, snapshot.t_us, tick_us):
            earlier = replace(snapshot, t_us=t_us)
            luminance = self._renderer.render(earlier, snapshot.cameras[self.place])
            self._pixels.see(luminance, t_us - tick_us, t_us)
        # the first tick has no events, so it may begin anywhere before its end
        self._see(self.light(snapshot), snapshot.t_us - (tick_us if ticks else 1))
        self._pixels.finish()
        if not self._checked_cover:
            self._checked_cover = True
            pose = snapshot.cameras[self.place]
            if may_be_covered(self._world, self._viewpoint, snapshot, pose):
                truth = self.ground_truth()
                lines = covered_by(self._world, self._viewpoint, truth, self.name)
                warn_left_out(lines)
                self.left_out += lines

    def observe(self, snapshot: SceneSnapshot) -> tuple[EventPacket, ...]:
        """See a snapshot.

        Args:
            snapshot: The world at the end of the tick.

        Returns:
            The packet of the events since the last snapshot; with model.chunk over 1 none, or
            those of all ticks of the chunk.

        Raises:
            EvsError: Time did not advance, or `start` was not called.
        """
        self._check_time(snapshot)
        return self.observe_light(self.light(snapshot))

    def light(self, snapshot: SceneSnapshot, into: F32 | None = None) -> RenderedFrame:
        """Render what falls on the sensor: the half of `observe` without events.

        May be called in another thread than the rest, ahead of it, snapshot by snapshot.

        Args:
            snapshot: The world at an instant.
            into: Of `light_buffer`, where the light goes; without it, it is valid until the next
                call.
        """
        pose = snapshot.cameras[self.place]
        if into is None:
            if self._stays is None and self._pixels.on_device and self._renders_on_device:
                self._stays = self.light_buffer()
            into = self._stays
        with self._tracing:
            viewpoint = self._viewpoint
            luminance = viewpoint.renderer.render(snapshot, pose, into)
            traced = float(viewpoint.renderer.traced_fraction)
        self._meter.lap("render")
        return RenderedFrame(snapshot, pose, luminance, viewpoint, traced)

    def light_buffer(self) -> F32:
        """(h, w) float32, memory for light: on the GPU where renderer and pixels are there."""
        if self._pixels.on_device and isinstance(self._renderer, DeviceRenderer):
            light: F32 = self._renderer.device_light()
            return light
        return on_lines(np.zeros((self.height, self.width), np.float32))

    def observe_light(self, frame: RenderedFrame) -> tuple[EventPacket, ...]:
        """The other half of `observe`: the events from the last light to this."""
        return self._packets(self._see(frame, self._check_time(frame.snapshot)))

    def _check_time(self, snapshot: SceneSnapshot) -> int:
        """Where the tick that ends at `snapshot` begins, us. EvsError where it cannot."""
        begin_us = self._t_us
        if begin_us is None:
            raise EvsError("the camera has no reference yet: call start with the first snapshot")
        if snapshot.t_us <= begin_us:
            raise EvsError(
                f"time went from {begin_us} us to {snapshot.t_us} us, so there is nothing between: "
                "step the physics first, or call reset() after a reset"
            )
        return begin_us

    def finish(self) -> tuple[EventPacket, ...]:
        """The packets of ticks that wait for the rest of their chunk, without it."""
        return self._packets(self._pixels.finish())

    def _packets(self, ticks: list[DoneTick]) -> tuple[EventPacket, ...]:
        return tuple([self._packet(tick) for tick in ticks])

    def _packet(self, tick: DoneTick) -> EventPacket:
        labelled = self.config.model.labels and self._traces_truth
        if not labelled and self._marks_causes:
            clear_causes(tick.events)
        events, labels = later_events(tick.events, self._start_us), None
        if labelled:
            truth, classes = self.ground_truth(), self._class_of_geom
            labels = take_labels(events, truth.geom_id, classes, truth.depth, truth.flow)
        packet = EventPacket(
            seq=self._seq,
            time_base_us=tick.begin_us + self._start_us,
            time_end_us=tick.end_us + self._start_us,
            width=self.width,
            height=self.height,
            events=events,
            camera=self.info.camera,
            labels=labels,
        )
        self._seq += 1
        self.events += len(tick.events)
        return packet

    def _see(self, frame: RenderedFrame, begin_us: int) -> list[DoneTick]:
        snapshot, pose = frame.snapshot, frame.pose
        self._previous = self._now if frame.viewpoint.follows(self._seen_from) else None
        self._now, self._seen_from = (snapshot, pose), frame.viewpoint
        self._seen += 1
        self._luminance, self.traced_fraction = frame.luminance, frame.traced_fraction
        ticks = self._pixels.see(frame.luminance, begin_us, snapshot.t_us)
        self._auxiliary.step(frame.luminance, pose, self._world, begin_us, snapshot.t_us)
        if self._traces_truth and not self.config.model.labels:
            # [plan] alone requests it: nobody uses it
            self.ground_truth()
        self._t_us = snapshot.t_us
        self._meter.lap("sensor")
        return ticks

    @property
    def frames(self) -> tuple[Frame, ...]:
        """Intensity frames whose read-out ended in the last tick; needs sensor.aps."""
        return self._auxiliary.frames

    @property
    def imu_packet(self) -> ImuPacket | None:
        """IMU samples of the last tick; None: there are none, as always unless sensor.imu is on."""
        return self._auxiliary.imu_packet

    @property
    def pose(self) -> Pose | None:
        """Its pose at the end of the last tick; None before the first snapshot."""
        if self._now is None:
            return None
        snapshot, pose = self._now
        t_us = snapshot.t_us + self._start_us
        return pose_message(pose, self._seen - 1, t_us, self.info.camera)

    def ground_truth(self) -> GroundTruth:
        """Depth, normals, ids, ... at the end of the last tick, and the flow during it.

        Computed at each call.

        Raises:
            EvsError: Nothing was seen yet.
        """
        if self._now is None:
            raise EvsError("the camera has seen nothing yet: step the world first")
        with self._tracing:
            truth = self._seen_from.renderer.ground_truth(*self._now, self._previous)
        return replace(truth, t_us=truth.t_us + self._start_us)

    @property
    def imu(self) -> ImuSamples:
        """(n,) IMU samples of the last tick: t, acceleration, angular_velocity, temperature.

        Axes: x right, y down, z forward. Of the time up to the tick before; empty where it is off.
        """
        return empty_imu() if self.imu_packet is None else self.imu_packet.samples

    def forget_instants(self) -> None:
        """Forget what was seen last: no ground truth before the next tick, no flow in it."""
        self._now = self._previous = None
        self._seen_from = self._viewpoint

    @property
    def name(self) -> str:
        """Its name on the bus and in recordings."""
        return self.info.camera

    @property
    def luminance(self) -> F32:
        """(h, w) float32 linear luminance of the last tick, a copy; zeros before the first."""
        if self._luminance is None:
            return np.zeros((self.height, self.width), np.float32)
        return np.array(self._luminance, np.float32)

    @property
    def is_dark(self) -> bool:
        """Whether the last tick was dark: a black picture, or only a backdrop."""
        return self._luminance is not None and (self._unlit or not np.any(self._luminance))

    @property
    def clamps(self) -> int:
        """Pixels times ticks whose light was negative, NaN or infinite and was replaced."""
        return self._pixels.clamps

    @property
    def events_dropped(self) -> dict[str, int]:
        """Events that the readout dropped so far, by cause; empty where the readout is ideal."""
        return self._pixels.events_dropped

    @property
    def events_waiting(self) -> int:
        """Events that are still on their way through the readout."""
        return self._pixels.events_waiting

    @property
    def features(self) -> dict[str, bool]:
        """Which code paths it runs, by the names of evs.emulator.base.features.FEATURES."""
        with self._tracing:
            light = dict(self._renderer.features)
        truth = {"ground_truth": self._traces_truth}
        return {**light, **truth, **self._pixels.features, **self._auxiliary.features}

    @property
    def plan(self) -> ScenePlan:
        """The contents of its scene, the active code paths and why, computed at each call."""
        there = self._world, self._viewpoint.scene, self.bound, self.sensor
        return plan_scene(*there, self.config, self._switches, self.features)


def free_name(wanted: str | None, usual: str, taken: tuple[str, ...]) -> str:
    """A camera's name: the wanted one, else the usual one, numbered where it is taken."""
    if wanted is not None:
        if not wanted or not wanted.isprintable() or wanted in taken:
            raise EvsError(f"a camera called {wanted!r}: give each its own, printable name")
        return wanted
    number = 1
    while (name := usual if number == 1 else f"{usual}_{number}") in taken:
        number += 1
    return name
