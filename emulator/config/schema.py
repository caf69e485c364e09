"""The configuration of every stage inside the emulator, one frozen dataclass per stage.

A pipeline file (TOML) has one table per class. Every key can also be set on the command line by
its dotted name: `render.spp=4`, `sensor.cutoff_hz=200`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from evs.emulator.config.declaration import any_path, parameter, path_or_name
from evs.emulator.config.keywords import named_keywords
from evs.emulator.config.sensor import SensorConfig
from evs.emulator.render.renderer_table import RENDERERS
from evs.msgs import EvsError


@named_keywords
@dataclass(frozen=True)
class VisualConfig:
    """[scene.visual]: which parts of the model are visible, named as in MuJoCo's mjvOption."""

    geomgroup: tuple[int, ...] = (0, 1, 2)
    """groups of visible geoms, 0 ... 5; hidden geoms cast no shadow either"""
    sitegroup: tuple[int, ...] = (0, 1, 2)
    """groups of visible sites"""
    tendongroup: tuple[int, ...] = (0, 1, 2)
    """groups of visible tendons"""
    skingroup: tuple[int, ...] = (0, 1, 2)
    """groups of visible skins"""
    flexgroup: tuple[int, ...] = (0, 1, 2)
    """groups of visible flexes"""
    texture: bool = True
    """false: materials without their textures"""
    tendon: bool = True
    """false: no tendons"""
    skin: bool = True
    """false: no skins"""
    static: bool = True
    """false: no geoms or sites of bodies that are fixed to the world"""
    transparent: bool = False
    """true: movable geoms are transparent, by visual/map alpha"""
    flexskin: bool = True
    """the smooth surface of flexes"""
    flexface: bool = False
    """the faces of flexes, without flexskin"""
    flexedge: bool = True
    """the edges of flexes, of ropes and without flexskin"""


@named_keywords
@dataclass(frozen=True)
class SceneConfig:
    """[scene]: the world, and the controls that move it."""

    file: str = parameter("", "MJCF (.xml) or MJB (.mjb) file", is_path=any_path)
    camera: str = ""
    """name of a camera of the model; empty: the camera of [camera], else the model's first camera,
    else a free camera"""
    tick_us: int = 1000
    """length of a tick, us; the model's time step is subdivided to fit"""
    start_us: int = 0
    """time stamp of the start, us, for example a Unix time; it shifts every stamp and changes
    nothing else"""
    control: str = "auto"
    """auto: hold the controls of `home` if the run starts there, else zero | zero | keyframe |
    random | file"""
    control_file: str = parameter(
        "",
        ".npy or .npz (array `ctrl`) or .csv, one row per control period: (n, nu)",
        is_path=any_path,
    )
    control_hz: float = 100.0
    """rate of new values for `random` and `file`, Hz; each value holds until the next"""
    control_seed: int = 0
    """seed of `random`"""
    control_scale: float = 1.0
    """fraction of the control range that `random` uses"""
    keyframe: str = ""
    """name or number of the keyframe to start from; empty: `home` if the model has it; none: the
    model's own initial state (qpos0)"""
    visual: VisualConfig = field(default_factory=VisualConfig)


@named_keywords
@dataclass(frozen=True)
class CameraConfig:
    """[camera]: a camera that the model lacks, or different optics for one of its cameras."""

    lookat: tuple[float, float, float] | None = parameter(
        None,
        "free camera: the point it looks at, m; None: the centre of everything that moves",
        example=(0.0, 0.0, 1.0),
    )
    distance: float | None = parameter(
        None,
        "free camera: distance from that point, m; None: everything that moves fits the image",
        example=4.0,
    )
    azimuth: float | None = parameter(
        None,
        "free camera: degrees around z, as in MuJoCo's viewer",
        example=90.0,
    )
    elevation: float | None = parameter(
        None,
        "free camera: degrees; negative looks down",
        example=-20.0,
    )
    body: str = ""
    """mounted camera: the body that carries it"""
    pos: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """mounted camera: position in the body's frame, m"""
    quat: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """mounted camera: orientation in the body's frame (w, x, y, z); it looks along its -z"""
    xyaxes: tuple[float, float, float, float, float, float] | None = parameter(
        None,
        "mounted camera: its x and y axes in the body's frame, instead of quat",
        example=(0.0, -1.0, 0.0, 0.0, 0.0, 1.0),
    )
    trajectory: str = parameter(
        "",
        "file of poses that the camera follows, in the world or in the frame of `body`: lines "
        "of t x y z qx qy qz qw (TUM), or a CSV with a header (EuRoC); its first pose is at time 0",
        is_path=any_path,
    )
    trajectory_axes: str = "optical"
    """axes of the poses. optical: x right, y down, z forward, as in ROS and OpenCV | camera: x
    right, y up, looking along -z, as in MuJoCo and Blender"""
    shake_m: float = 0.0
    """any camera: random motion, rms along each axis, m"""
    shake_deg: float = 0.0
    """any camera: random rotation, rms around each axis, degrees"""
    shake_hz: float = 5.0
    """centre frequency of the shake: 5 Hz resembles a hand-held camera, 50 Hz a motor"""
    shake_seed: int = 0
    """seed of the shake"""
    fovy: float | None = parameter(
        None,
        "vertical field of view, degrees; None: that of the model's camera",
        example=45.0,
    )
    focal_px: tuple[float, float] | None = parameter(
        None,
        "fx, fy in px, instead of fovy",
        example=(300.0, 300.0),
    )
    principal_px: tuple[float, float] | None = parameter(
        None,
        "cx, cy in px; None: the centre",
        example=(173.0, 130.0),
    )
    near_m: float | None = parameter(
        None,
        "depth of the near plane, m; nearer geometry is invisible; None: as in MuJoCo, visual/map "
        "znear times statistic/extent; 0: none",
        example=0.01,
    )
    distortion_model: str = "none"
    """none | plumb_bob | rational_polynomial | equidistant (fisheye), as in ROS's CameraInfo"""
    distortion: tuple[float, ...] = ()
    """OpenCV's coefficients: k1 k2 p1 p2 k3 | k1 k2 p1 p2 k3 k4 k5 k6 | k1 k2 k3 k4"""
    vignetting: str = "none"
    """none | cos4: light falls off with the fourth power of the cosine of the angle to the axis"""
    vignetting_polynomial: tuple[float, ...] = ()
    """a b ...: a further factor 1 + a r^2 + b r^4 + ...; r is the distance from the principal
    point in half diagonals of the image"""


@named_keywords
@dataclass(frozen=True)
class FlickerConfig:
    """[[render.flicker]]: a pulsing light, averaged over each tick. Any number of tables."""

    light: str = "*"
    """name of a light, its number if it has no name, or "headlight"; "*": every light without its
    own table"""
    waveform: str = "mains"
    """mains: a lamp on alternating current | sine | pwm: on and off; the mean of each is 1"""
    hz: float = 50.0
    """frequency of the waveform, Hz; mains: of the voltage, so the light pulses at twice this
    rate"""
    depth: float = 0.3
    """mains, sine: amplitude as a fraction of the mean; pwm: 1 is dark between the pulses"""
    duty: float = 0.5
    """pwm: fraction of a period that is on"""
    phase: float = 0.0
    """phase of the light at t = 0, as a fraction of its period"""


@named_keywords
@dataclass(frozen=True)
class RenderConfig:
    """[render]: how light reaches the pixels."""

    renderer: str = "direct"
    """direct: direct light with hard shadows, no noise | hybrid: soft light without noise; sky and
    bounces are cached on surfaces | path: path tracing with soft shadows | raster: OpenGL"""
    spp: int | None = parameter(
        None,
        "samples per pixel; direct, hybrid, raster: 1 ... 64, default 4; path: 1 ... 4096, "
        "default 16. hybrid with adaptive antialiasing: default 16 if the scene has meshes",
        example=4,
    )
    antialiasing: str | None = parameter(
        None,
        "fixed: every pixel takes all samples | adaptive: only pixels at an edge of the light "
        "(direct, hybrid) or of a geom (path) take all, the others one (direct, hybrid) or a "
        "quarter (path); direct, hybrid: default adaptive; path, raster: default fixed",
        example="adaptive",
    )
    seeds: str = "fixed"
    """fixed: a pixel takes the same samples every tick, so constant light causes no events |
    fresh: new samples every tick, as in the paper | cycle: a cycle of sets of samples, one per
    tick; the light is the mean of the last cycle (fresh, cycle: path only)"""
    cycle_ticks: int = 4
    """cycle: ticks in a cycle, 2 ... 16; light has this many times the samples of a tick, and is
    (cycle_ticks - 1) / 2 ticks late"""
    bounces: int = 2
    """hybrid, path: maximum number of bounces between surfaces: 0 ... 64"""
    sampler: str = "owen"
    """path: the sample pattern: owen | sobol | global | random (docs/explanation/paths.md) |
    anchored: as owen, but the noise moves with the visible surface (for studies)"""
    headlight: str = "model"
    """model: the headlight of the model | off: no headlight"""
    sky: str = "backdrop"
    """the model's skybox. backdrop: visible behind everything, but lights nothing, as in MuJoCo's
    viewer | light: it also lights the scene and appears in mirrors (hybrid, path)"""
    shadows: bool = True
    """true: lights that cast shadows in the model cast them here; false: none do"""
    fog: bool = False
    """the model's fog (visual/map fogstart, fogend); MuJoCo's viewer shows it only on request"""
    haze: bool = True
    """the model's haze below the horizon, if it has a sky and an infinite plane"""
    sites: bool = True
    """draw the sites that scene.visual shows; use false if they only mark sensors,
    goals or touch zones"""
    lux_per_unit: float = 1000.0
    """illuminance that equals 1 unit of light, for lights with a physical intensity (candela,
    lux)"""
    linear_textures: tuple[str, ...] = ()
    """names of the model's textures that hold linear light; all other colour textures are
    sRGB, whatever their `colorspace`; data maps (normal, roughness, ...) never are"""
    incremental: bool = True
    """trace again only the pixels that a motion can affect; the result is the same bit for bit"""
    isa: str = "auto"
    """auto | avx512 | avx2 | neon | portable: the instruction set of renderer, pixels and networks;
    the result is the same bit for bit"""
    device: str = "cpu"
    """cpu | cuda: an NVIDIA GPU (direct, hybrid, path; needs evs[cuda]) | auto: cuda where
    possible; the result is the same bit for bit"""
    flicker: tuple[FlickerConfig, ...] = ()

    @property
    def samples(self) -> int:
        """Samples per pixel: `spp`, or the default of the renderer."""
        if self.spp is not None:
            return self.spp
        row = RENDERERS.get(self.renderer)
        return row.default_spp if row else 1

    @property
    def adaptive(self) -> bool:
        """Whether only pixels at an edge take all samples."""
        if self.antialiasing is not None:
            return self.antialiasing == "adaptive"
        row = RENDERERS.get(self.renderer)
        return row is not None and row.adaptive and self.samples > 1

    def for_scene(self, has_meshes: bool) -> RenderConfig:
        """Return the configuration with the `spp` that a scene needs, where none is set.

        Edges of meshes are sampled; other outlines are areas (lab/docs/sampling.md).
        """
        row = RENDERERS.get(self.renderer)
        at_meshes = has_meshes and self.spp is None and self.adaptive
        return replace(self, spp=row.mesh_spp) if at_meshes and row and row.mesh_spp else self

    @property
    def delay_ticks(self) -> float:
        """Delay of moving light in ticks: half of a cycle."""
        return 0.5 * (self.cycle_ticks - 1) if self.seeds == "cycle" else 0.0

    @property
    def noisy_samples(self) -> int:
        """Samples in the light of a tick if it has noise; 0 otherwise."""
        row = RENDERERS.get(self.renderer)
        ticks = self.cycle_ticks if self.seeds == "cycle" else 1
        return ticks * self.samples if row and row.paths else 0


@named_keywords
@dataclass(frozen=True)
class ModelConfig:
    """[model]: the event model, which turns light into events."""

    name: str = "plain"
    """plain: the event pixel | adaptive: the event pixel behind a running mean of the light, which
    removes the noise of fresh samples | evsnet: the paper's network"""
    network: str = parameter(
        "evsnet_c8",
        "evsnet: a file of config/networks, a family of files (evsnet_c8 selects the member for "
        "the samples per pixel, such as evsnet_c8_4spp), or the path of your own .onnx file",
        is_path=path_or_name(".onnx"),
    )
    runtime: str = "native"
    """evsnet: native: evs's own kernel, which updates only what changes | onnxruntime: any
    provider, any graph | reference: plain NumPy, slow"""
    provider: str = "cpu"
    """evsnet on onnxruntime: cpu | cuda | tensorrt | openvino | coreml, if its build has it"""
    chunk: int = 1
    """evsnet: ticks per network call: 1 for closed loops, 8 live, 16 to 32 for recordings; the
    events are the same, but the packets of a chunk leave together at its end"""
    initial_state: str = "random"
    """evsnet: membrane potential of each pixel at the start: random, as in the paper | zero"""
    events_per_tick: str = "auto"
    """evsnet: events of a pixel per tick: auto: as the network was trained | one, as in the paper:
    the rest of a large step fires in later ticks (saturation) | many: all events of the step, at
    most 64"""
    device: str = "cpu"
    """cpu | cuda: an NVIDIA GPU (evsnet: runtime native; needs evs[cuda]) | auto: cuda where
    possible; the events are the same"""
    labels: bool = False
    """label every event with its cause (signal, leak, shot noise, hot pixel), and with the
    geom, class, depth and flow at its pixel, in packet.labels and in .npz recordings"""
    classes: tuple[str, ...] = ()
    """labels: NAME=PATTERN: a class, and the names of its geoms, or of bodies with their
    descendants, such as hand=finger*; the first match counts. Geoms without a match get the name
    of the whole object, such as the robot's root body"""


@named_keywords
@dataclass(frozen=True)
class PlanConfig:
    """[plan]: code paths to force on or off, whatever the scene needs (`evs plan` lists them)."""

    everything: bool = False
    """run every code path that can run, even if nothing needs it: the same events, slower"""
    on: tuple[str, ...] = ()
    """code paths to run even if nothing needs them: the same events"""
    off: tuple[str, ...] = ()
    """for tests: code paths to omit even if they are needed; the results that need them are then
    wrong"""


@named_keywords
@dataclass(frozen=True)
class RunConfig:
    """A whole pipeline. Top level: name, duration_s, seed, threads; then one table per stage."""

    scene: SceneConfig = field(default_factory=SceneConfig)
    camera: CameraConfig = field(default_factory=CameraConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)
    render: RenderConfig = field(default_factory=RenderConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    plan: PlanConfig = field(default_factory=PlanConfig)
    name: str = "camera"
    """the camera's name on the bus and in recordings"""
    duration_s: float = 1.0
    """simulated seconds"""
    seed: int = 0
    """seed of every random number of the sensor"""
    threads: int = 0
    """worker threads of the renderer and the pixels; 0: one per core"""


@named_keywords
@dataclass(frozen=True)
class DelayConfig:
    """[loop.delays]: the path between camera, controller and actuators.

    These delays add to the sensor's own latency ([sensor] latency_us, [sensor.readout]).
    """

    transport_us: int = 0
    """delay from the end of a tick until its packet is available, us; the next decision receives
    it"""
    transport_jitter_us: float = 0.0
    """standard deviation of that delay from packet to packet, us; packets stay in order"""
    drop_share: float = 0.0
    """fraction of packets that are lost, 0 ... 1; lost packets are counted"""
    control_us: int = 0
    """delay from a decision to its effect, us; it takes effect in the first tick that begins at
    or after that time"""
    control_jitter_us: float = 0.0
    """standard deviation of that delay from decision to decision, us; decisions stay in order"""


@named_keywords
@dataclass(frozen=True)
class LimitConfig:
    """[[loop.limits]]: a range in which a model sensor must stay. Any number of tables."""

    sensor: str = ""
    """name of a <sensor> of the model"""
    low: float = -1e300
    """the episode ends when the sensor reads less than this"""
    high: float = 1e300
    """the episode ends when the sensor reads more than this"""


@named_keywords
@dataclass(frozen=True)
class LoopConfig:
    """[loop]: the closed loop of pace = "lockstep"."""

    max_s: float | None = parameter(
        None,
        "simulated time after which the episode ends, s; None: no limit",
        example=30.0,
    )
    limits: tuple[LimitConfig, ...] = ()
    delays: DelayConfig = field(default_factory=DelayConfig)

    def options(self) -> dict[str, Any]:
        """The arguments limits, max_s and delays of ClosedLoop and ClosedLoop.around.

        Raises:
            EvsError: A limit has no range, or a sensor has two limits.
        """
        names = [limit.sensor for limit in self.limits]
        for place, name in enumerate(names):
            if name in names[:place]:
                raise EvsError(f"at loop.limits.{place}.sensor: '{name}' has two limits; give one")
        for place, limit in enumerate(self.limits):
            if (limit.low, limit.high) == (LimitConfig.low, LimitConfig.high):
                raise EvsError(f"at loop.limits.{place}: no bound; give low, high or both")
        limits = {limit.sensor: (limit.low, limit.high) for limit in self.limits}
        return {"limits": limits, "max_s": self.max_s, "delays": self.delays}
