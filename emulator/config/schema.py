"""The configuration of every stage inside the emulator: a frozen dataclass each.

A pipeline file (TOML) has one table per class, and every key can be given on the command line by
its dotted name: `render.spp=4`, `sensor.cutoff_hz=200`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from evs.emulator.config.renderers import RENDERERS
from evs.emulator.config.sensor import SensorConfig


@dataclass(frozen=True)
class SceneConfig:
    """[scene]: which world, and what moves it."""

    file: str = ""
    """MJCF (.xml) or MJB (.mjb) file"""
    camera: str = ""
    """name of a camera of the model; empty: as in [camera], or the model's first, or a free one"""
    tick_us: int = 1000
    """length of a tick, us; the model's time step is subdivided to fit it"""
    start_us: int = 0
    """what the stamps begin at, us, as a Unix time does: the same events, that much later"""
    control: str = "auto"
    """auto: holds those of `home` if it starts there, else zero | zero | keyframe | random |
    file"""
    control_file: str = ""
    """.npy or .npz (array `ctrl`) or .csv, one row per control period: (n, nu)"""
    control_hz: float = 100.0
    """how often `random` and `file` give a new value; held in between"""
    control_seed: int = 0
    """what `random` follows from"""
    control_scale: float = 1.0
    """share of the control range that `random` uses"""
    keyframe: str = ""
    """name or number of the keyframe to start from; empty: `home` if the model has it; none: as the
    model stands by itself (qpos0)"""


@dataclass(frozen=True)
class CameraConfig:
    """[camera]: a camera that the model does not have, or other optics for one that it has."""

    lookat: tuple[float, float, float] | None = None
    """free camera: the point it looks at, m; None: the centre of what moves"""
    distance: float | None = None
    """free camera: distance from that point, m; None: what moves fits the picture"""
    azimuth: float | None = None
    """free camera: degrees around z, as MuJoCo's viewer"""
    elevation: float | None = None
    """free camera: degrees, negative looks down"""
    body: str = ""
    """mounted camera: the body that carries it"""
    pos: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """mounted camera: position in the body's frame, m"""
    quat: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """mounted camera: orientation in the body's frame (w, x, y, z); it looks along its -z"""
    xyaxes: tuple[float, float, float, float, float, float] | None = None
    """mounted camera: its x and y axes in the body's frame, instead of quat"""
    fovy: float | None = None
    """vertical field of view, degrees; None: the model's camera's own"""
    focal_px: tuple[float, float] | None = None
    """fx, fy in px, instead of fovy"""
    principal_px: tuple[float, float] | None = None
    """cx, cy in px; None: the centre"""
    distortion_model: str = "none"
    """none | plumb_bob | rational_polynomial | equidistant (fisheye), as in ROS's CameraInfo"""
    distortion: tuple[float, ...] = ()
    """OpenCV's coefficients: k1 k2 p1 p2 k3 | k1 k2 p1 p2 k3 k4 k5 k6 | k1 k2 k3 k4"""
    vignetting: str = "none"
    """none | cos4: light falls with the fourth power of the cosine of the angle off the axis"""
    vignetting_polynomial: tuple[float, ...] = ()
    """a b ...: another factor 1 + a r^2 + b r^4 + ..., r = 1 half a diagonal off the principal
    point"""


@dataclass(frozen=True)
class FlickerConfig:
    """[[render.flicker]]: light that pulses, by its mean over each tick. Any number of them."""

    light: str = "*"
    """name of a light, its number where it has none, or "headlight"; "*" is every light that has no
    table of its own"""
    waveform: str = "mains"
    """mains: a lamp on alternating current | sine | pwm: on and off; each has the mean 1"""
    hz: float = 50.0
    """of the waveform; mains: of the voltage, so light pulses twice as often (50 Hz: 100 times)"""
    depth: float = 0.3
    """mains, sine: amplitude, as share of the mean; pwm: 1 is dark between the pulses"""
    duty: float = 0.5
    """pwm: share of a period that is on"""
    phase: float = 0.0
    """share of a period of the light that has passed at t = 0"""


@dataclass(frozen=True)
class RenderConfig:
    """[render]: how light reaches the pixels."""

    renderer: str = "direct"
    """direct: hard light, no noise | path: light that bounces, soft shadows | raster: OpenGL"""
    spp: int | None = None
    """samples per pixel: 1 ... 64 (direct, raster; 4 if not given), 1 ... 4096 (path; 16)"""
    antialiasing: str = "fixed"
    """fixed: every pixel takes all samples | adaptive: only pixels at an edge of the light do, the
    others one; `direct` only"""
    seeds: str = "fixed"
    """fixed: a pixel's samples are the same every tick, so that still light gives no events
    fresh: new ones every tick, as in the paper (path only)"""
    bounces: int = 2
    """path: how often light may go from one surface to another on its way: 0 ... 64"""
    sampler: str = "owen"
    """path: owen | sobol | global | random: how its samples lie (docs/explanation/light.md)
    anchored: as owen, but the noise moves with the surface that is seen (for studies)"""
    headlight: str = "model"
    """model: as the model has it | off: removed"""
    shadows: bool = True
    """lights that cast shadows in the model cast them here"""
    fog: bool = False
    """the model's fog (visual/map fogstart, fogend); MuJoCo's viewer shows it on request only"""
    haze: bool = True
    """the model's haze below the horizon, where it has a sky and a plane without bounds"""
    sites: bool = True
    """sites of groups 0 to 2, as MuJoCo's viewer shows them; false: none, where they are only marks
    for sensors, goals or touch"""
    lux_per_unit: float = 1000.0
    """illuminance that counts as 1, for lights with a physical intensity (candela, lux)"""
    linear_textures: tuple[str, ...] = ()
    """names of the model's textures whose numbers are linear light; every other image of colour is
    display-coded, whatever its `colorspace`; maps of numbers (normal, roughness, ...) never are"""
    incremental: bool = True
    """trace again only what something moved can touch; the result is the same bit for bit"""
    isa: str = "auto"
    """auto | avx512 | avx2 | portable: the instruction set, of pixels and networks too; the result
    is the same bit for bit"""
    flicker: tuple[FlickerConfig, ...] = ()

    @property
    def samples(self) -> int:
        """Samples per pixel: `spp`, or what the renderer takes by itself."""
        if self.spp is not None:
            return self.spp
        row = RENDERERS.get(self.renderer)
        return row.default_spp if row else 1

    @property
    def noisy_samples(self) -> int:
        """The same for light with noise; 0 where the renderer's light has none."""
        row = RENDERERS.get(self.renderer)
        return self.samples if row and row.paths else 0


@dataclass(frozen=True)
class ModelConfig:
    """[model]: what turns light into events."""

    name: str = "plain"
    """plain: the event pixel | adaptive: a running mean of the light in front of it, which takes
    out the noise of fresh samples | evsnet: the paper's network"""
    network: str = "evsnet_c8"
    """evsnet: a file of config/networks, a family of them (evsnet_c8: the member for the light's
    samples, evsnet_c8_4spp for 4), or the path of an .onnx file of one's own"""
    runtime: str = "native"
    """evsnet: native: our own kernel, which steps only what moves | onnxruntime: any provider, any
    graph | reference: plain NumPy, slow"""
    provider: str = "cpu"
    """evsnet on onnxruntime: cpu | cuda | tensorrt | openvino | coreml, as it was built for"""
    chunk: int = 1
    """evsnet: ticks that are taken at once: 1 for closed loops, 8 live, 16 to 32 for recordings;
    the same events, but the packets of a chunk leave together at its end"""
    initial_state: str = "random"
    """evsnet: membrane of each pixel at the start: random, as in the paper | zero"""
    labels: bool = False
    """every event also has its cause (signal, leak, shot noise, hot pixel) and the geom under it:
    packet.labels, and recordings to .npz"""


@dataclass(frozen=True)
class PlanConfig:
    """[plan]: code paths that run, or do not, whatever the scene needs (`evs plan` lists them)."""

    everything: bool = False
    """every code path that can runs although nothing needs it: the same events, only slower"""
    on: tuple[str, ...] = ()
    """these run although nothing needs them: the same events"""
    off: tuple[str, ...] = ()
    """for tests: these are left out although they are needed, and what needs them is wrong"""


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
    """every random number of the sensor follows from it"""
    threads: int = 0
    """worker threads of the renderer and the pixels; 0: one a core"""
