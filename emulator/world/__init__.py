"""The world: a MuJoCo model, its physics in exact ticks, and what a renderer sees of it.

The only folder that imports mujoco.
"""

from evs.emulator.world import mujoco_import  # noqa: F401  # isort: skip

from mujoco import MjData, MjModel

from evs.emulator.world.cameras import BoundCamera, bind_camera
from evs.emulator.world.compat import ORTHOGRAPHIC
from evs.emulator.world.controls import (
    NO_KEYFRAME,
    Control,
    ControlFunction,
    actuator_names,
    check_control,
    control_range,
    find_keyframe,
    home_keyframe,
    make_control,
    name_of_keyframe,
    starting_keyframe,
)
from evs.emulator.world.encoders import (
    Encoders,
    Measurements,
    NamedSensors,
    add_joint_sensors,
)
from evs.emulator.world.extraction import extract_scene
from evs.emulator.world.live_scene import LiveScene
from evs.emulator.world.mobility import Mobility, mobility_of
from evs.emulator.world.model import (
    MUJOCO_VERSION,
    LeftOutWarning,
    ModelDigest,
    Scene,
    bytes_of,
    digest_of,
    geom_label,
    load_model,
    load_spec,
    load_text,
    versions,
    warn_left_out,
)
from evs.emulator.world.object_classes import ObjectClasses, object_classes
from evs.emulator.world.physics import (
    Physics,
    StabilityWatch,
    Substeps,
    UnstableError,
    UnstableWarning,
    fill_tick,
    gravity_of,
    moving_bodies,
)
from evs.emulator.world.physics_batch import (
    PhysicsBatch,
    PoseBatch,
    has_callbacks,
    why_not_batched,
)
from evs.emulator.world.scene_keys import SceneKey, every_key, find_keys
from evs.emulator.world.scene_values import SceneValues
from evs.emulator.world.snapshots import SnapshotTaker
from evs.emulator.world.visual import Visual, new_option, resolve_visual, visible_geoms

__all__ = [
    "MUJOCO_VERSION",
    "NO_KEYFRAME",
    "ORTHOGRAPHIC",
    "BoundCamera",
    "Control",
    "ControlFunction",
    "Encoders",
    "LeftOutWarning",
    "LiveScene",
    "Measurements",
    "MjData",
    "MjModel",
    "Mobility",
    "ModelDigest",
    "NamedSensors",
    "ObjectClasses",
    "Physics",
    "PhysicsBatch",
    "PoseBatch",
    "Scene",
    "SceneKey",
    "SceneValues",
    "SnapshotTaker",
    "StabilityWatch",
    "Substeps",
    "UnstableError",
    "UnstableWarning",
    "Visual",
    "actuator_names",
    "add_joint_sensors",
    "bind_camera",
    "bytes_of",
    "check_control",
    "control_range",
    "digest_of",
    "every_key",
    "extract_scene",
    "fill_tick",
    "find_keyframe",
    "find_keys",
    "geom_label",
    "gravity_of",
    "has_callbacks",
    "home_keyframe",
    "load_model",
    "load_spec",
    "load_text",
    "make_control",
    "mobility_of",
    "moving_bodies",
    "name_of_keyframe",
    "new_option",
    "object_classes",
    "resolve_visual",
    "starting_keyframe",
    "versions",
    "visible_geoms",
    "warn_left_out",
    "why_not_batched",
]
