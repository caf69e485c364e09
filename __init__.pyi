"""The names of evs. emulator/core/package_init.py.in imports each name on first use."""

from .drivers.bus import subscribe as subscribe
from .drivers.environments import (
    SimulatedDataset as SimulatedDataset,
    make_vec as make_vec,
    wrap as wrap,
)
from .drivers.files import EventSlices as EventSlices, read as read
from .drivers.lockstep import connect as connect
from .emulator import (
    ClosedLoop as ClosedLoop,
    EventCamera as EventCamera,
    Pixels as Pixels,
    World as World,
    Worlds as Worlds,
)
from .emulator.config import (
    ApsConfig as ApsConfig,
    CameraConfig as CameraConfig,
    ImuConfig as ImuConfig,
    ModelConfig as ModelConfig,
    ReadoutConfig as ReadoutConfig,
    RenderConfig as RenderConfig,
    SceneConfig as SceneConfig,
    SensorConfig as SensorConfig,
    VisualConfig as VisualConfig,
)
from .emulator.config.schema import (
    DelayConfig as DelayConfig,
    LimitConfig as LimitConfig,
    LoopConfig as LoopConfig,
)
from .emulator.config.sensor import BiasConfig as BiasConfig
from .emulator.representations import (
    event_frame as event_frame,
    time_surface as time_surface,
    voxel_grid as voxel_grid,
)
from .emulator.sensor.randomisation import (
    SensorRanges as SensorRanges,
    randomise_sensor as randomise_sensor,
    sensor_with_values as sensor_with_values,
)
from .emulator.simulation.scene_ranges import SceneRanges as SceneRanges
from .emulator.world import SceneValues as SceneValues
from .msgs import (
    EVENT_DTYPE as EVENT_DTYPE,
    EventPacket as EventPacket,
    EvsError as EvsError,
    Observation as Observation,
)

__version__: str
pytest_plugins: tuple[str, ...]
