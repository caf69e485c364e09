"""The configuration of every stage inside the emulator: frozen dataclasses, each default told once.

A pipeline file (TOML) has one table per class, and every key can be given on the command line by
its dotted name: `render.spp=4`, `sensor.cutoff_hz=200`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from evs.emulator.config.biases import BiasConfig


@dataclass(frozen=True)
class SceneConfig:
    """[scene]: which world, and what moves it."""

    file: str = ""
    """MJCF (.xml) or MJB (.mjb) file"""
    camera: str = ""
    """name of a camera of the model; empty: [camera] says, or the model's first, or a free one"""
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
class ApsConfig:
    """[sensor.aps]: intensity frames beside the events, as a DAVIS gives. None: the preset's."""

    enabled: bool | None = None
    """whether there are frames at all; off unless asked for"""
    rate_hz: float | None = None
    """frames per second; frame n begins at n / rate_hz of simulated time"""
    exposure_us: int | None = None
    """how long a row collects light, us: what moves is blurred"""
    shutter: str | None = None
    """global: all rows at once | rolling: each row row_us after the one above it"""
    row_us: float | None = None
    """time to read out a row, us"""
    gain: float | None = None
    """at 1, light of 255 DN (white of the event pixels) fills the range; more is clipped"""
    bits: int | None = None
    """of a pixel of the frame: 8 or 16; the converter's bits are the upper ones of them"""
    adc_bits: int | None = None
    """resolution of the converter"""
    full_well_e: float | None = None
    """electrons that white is: shot noise is their square root; 0: no shot noise"""
    read_noise_dn: float | None = None
    """standard deviation of the read noise, steps of the converter; 0: none"""


@dataclass(frozen=True)
class ImuConfig:
    """[sensor.imu]: accelerometer and gyroscope at the camera. None: the preset's. As Kalibr."""

    enabled: bool | None = None
    """whether there are samples at all; off unless asked for"""
    rate_hz: float | None = None
    """samples per second; sample n is of n / rate_hz of simulated time"""
    accelerometer_bias: tuple[float, float, float] | None = None
    """constant error of x (right), y (down), z (forward), m/s^2"""
    accelerometer_noise_density: float | None = None
    """white noise, m/s^2/sqrt(Hz): a sample's standard deviation is this times sqrt(rate_hz)"""
    accelerometer_random_walk: float | None = None
    """how the bias walks, m/s^3/sqrt(Hz): its standard deviation after T s is this times sqrt(T)"""
    accelerometer_range_g: float | None = None
    """largest value of an axis, standard gravities; it clips there; 0: no limit"""
    gyroscope_bias: tuple[float, float, float] | None = None
    """constant error of x, y, z, rad/s"""
    gyroscope_noise_density: float | None = None
    """white noise, rad/s/sqrt(Hz)"""
    gyroscope_random_walk: float | None = None
    """how the bias walks, rad/s^2/sqrt(Hz)"""
    gyroscope_range_dps: float | None = None
    """largest value of an axis, degrees/s; it clips there; 0: no limit"""
    temperature_c: float | None = None
    """what the thermometer says, always, degrees C"""


@dataclass(frozen=True)
class ReadoutConfig:
    """[sensor.readout]: from pixel to packet. None: the preset's value."""

    order: str | None = None
    """ideal: every event at its own time | arbiter: rows in turn, as they ask (DAVIS)
    scan: all rows at fixed times (DVXplorer)"""
    row_ns: int | None = None
    """arbiter: time of a row access, ns; its end is the stamp of all events that the row holds"""
    column_ns: int | None = None
    """arbiter: time that each event of the row takes after that, ns"""
    jitter_ns: float | None = None
    """arbiter: standard deviation of the row access, ns"""
    scan_us: int | None = None
    """scan: time between two scans, us; stamps are multiples of it"""
    erc_rate_mevs: float | None = None
    """event rate control: most events that pass, Mev/s; 0: off"""
    erc_period_us: int | None = None
    """reference period of event rate control, us"""
    erc_drop: str | None = None
    """what it drops. time: evenly among all events | row, column: all events of some lines"""
    bandwidth_mevs: float | None = None
    """most events that leave by the link, Mev/s; 0: unlimited"""
    fifo: int | None = None
    """events that may wait for the link; what comes then is dropped"""
    stamp: str | None = None
    """sent: stamps say when events leave by the link | read: when they were read before that"""
    roi: tuple[int, ...] | None = None
    """region of interest: x y width height of a rectangle, px; any number of them; none: all"""
    mask: tuple[int, ...] | None = None
    """x y of each pixel that is switched off, one after the other"""
    mask_file: str | None = None
    """a text file of such pixels, one x y a line"""


@dataclass(frozen=True)
class SensorConfig:
    """[sensor]: the event pixel. None: the preset's value. v2e's names and meanings."""

    preset: str = "davis346"
    """a file of config/sensors"""
    width: int | None = None
    """px"""
    height: int | None = None
    """px"""
    pos_thres: float | None = None
    """mean ON threshold, log units"""
    neg_thres: float | None = None
    """mean OFF threshold, log units"""
    sigma_thres: float | None = None
    """standard deviation of both over pixels (fixed pattern)"""
    log: str | None = None
    """log map: "linlog" (linear below linlog_dn) or "log_eps" (ln(DN / 255 + log_eps))"""
    linlog_dn: float | None = None
    """DN at which linlog turns from linear to logarithmic; over 1, smooth at e"""
    log_eps: float | None = None
    """what "log_eps" adds to the light, of which 1 is white"""
    exposure_dn: float | None = None
    """DN per unit of scene luminance; 255 DN is white, nothing is clipped there"""
    white_lux: float | None = None
    """illuminance of the sensor at 255 DN, lux: what bandwidth and noise go by"""
    dark_lux: float | None = None
    """dark current, as the light that would give it, lux; the floor of contrast"""
    cutoff_hz: float | None = None
    """bandwidth of the photoreceptor at bright_lux, Hz, in proportion to the light; 0: no limit"""
    dim_lux: float | None = None
    """illuminance below which bandwidth stops falling and shot noise stops growing, lux"""
    bright_lux: float | None = None
    """illuminance that cutoff_hz, parasitic_leak_hz and shot_noise_bright are for, lux"""
    filter: str | None = None
    """exact: low passes stepped exactly, any tick length | euler: as v2e"""
    follower_hz: float | None = None
    """bandwidth of the source follower, a second pole, Hz; 0: no limit"""
    highpass_hz: float | None = None
    """slower changes give no events, Hz; 0: off"""
    leak_rate_hz: float | None = None
    """ON events of a pixel in still light, mean over pixels, Hz"""
    parasitic_leak_hz: float | None = None
    """how many more there are at bright_lux, in proportion to the light, Hz"""
    shot_noise_rate_hz: float | None = None
    """noise events of both polarities of a pixel in the dark, mean over pixels, Hz"""
    shot_noise_bright: float | None = None
    """share of them that is left in bright light"""
    shot_noise_law: str | None = None
    """linear: falls with the bandwidth, as v2e | inverse: as dim_lux / (dim_lux + light)"""
    noise_rate_cov_decades: float | None = None
    """spread of both rates over pixels, standard deviation of log10"""
    refractory_period_s: float | None = None
    """how long a pixel is blind after each event, s"""
    hot_pixel_fraction: float | None = None
    """share of pixels whose leak has a rate of its own"""
    hot_pixel_rate_hz: float | None = None
    """mean rate of that leak, Hz"""
    dead_pixel_fraction: float | None = None
    """share of pixels that never fire"""
    latency_us: float | None = None
    """mean time from the crossing of a threshold to the pixel's request to be read, us"""
    latency_sigma_us: float | None = None
    """its standard deviation from event to event, us"""
    biases: BiasConfig = field(default_factory=BiasConfig)
    aps: ApsConfig = field(default_factory=ApsConfig)
    imu: ImuConfig = field(default_factory=ImuConfig)
    readout: ReadoutConfig = field(default_factory=ReadoutConfig)


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


SPP = {"direct": 4, "path": 16, "raster": 4}
"""renderer -> samples per pixel where nothing else is said: the fewest whose events serve"""

SEEDS = {"direct": ("fixed",), "path": ("fixed", "fresh"), "raster": ("fixed",)}
"""renderer -> where its samples come from; without noise there is nothing that could be fresh"""


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
        return SPP.get(self.renderer, 1) if self.spp is None else self.spp

    @property
    def noisy_samples(self) -> int:
        """The same for light with noise; 0 where the renderer's light has none."""
        return self.samples if self.renderer == "path" else 0


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
    """every event also says its cause (signal, leak, shot noise, hot pixel) and the geom under it:
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
