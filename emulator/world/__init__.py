"""The world: a MuJoCo model, its physics in exact ticks, and the snapshots for a renderer.

The only folder that imports mujoco.
"""

from evs.emulator.world import mujoco_import  # noqa: F401  # isort: skip

from mujoco import MjData as MjData
from mujoco import MjModel as MjModel

from evs.emulator.world.cameras import BoundCamera as BoundCamera
from evs.emulator.world.cameras import bind_camera as bind_camera
from evs.emulator.world.compat import ORTHOGRAPHIC as ORTHOGRAPHIC
from evs.emulator.world.controls import NO_KEYFRAME as NO_KEYFRAME
from evs.emulator.world.controls import Control as Control
from evs.emulator.world.controls import ControlFunction as ControlFunction
from evs.emulator.world.controls import actuator_names as actuator_names
from evs.emulator.world.controls import check_control as check_control
from evs.emulator.world.controls import control_range as control_range
from evs.emulator.world.controls import find_keyframe as find_keyframe
from evs.emulator.world.controls import home_keyframe as home_keyframe
from evs.emulator.world.controls import make_control as make_control
from evs.emulator.world.controls import name_of_keyframe as name_of_keyframe
from evs.emulator.world.controls import starting_keyframe as starting_keyframe
from evs.emulator.world.encoders import Encoders as Encoders
from evs.emulator.world.encoders import Measurements as Measurements
from evs.emulator.world.encoders import NamedSensors as NamedSensors
from evs.emulator.world.encoders import add_joint_sensors as add_joint_sensors
from evs.emulator.world.extraction import extract_scene as extract_scene
from evs.emulator.world.live_scene import LiveScene as LiveScene
from evs.emulator.world.mobility import Mobility as Mobility
from evs.emulator.world.mobility import mobility_of as mobility_of
from evs.emulator.world.model import MUJOCO_VERSION as MUJOCO_VERSION
from evs.emulator.world.model import LeftOutWarning as LeftOutWarning
from evs.emulator.world.model import ModelDigest as ModelDigest
from evs.emulator.world.model import Scene as Scene
from evs.emulator.world.model import bytes_of as bytes_of
from evs.emulator.world.model import digest_of as digest_of
from evs.emulator.world.model import geom_label as geom_label
from evs.emulator.world.model import load_model as load_model
from evs.emulator.world.model import load_spec as load_spec
from evs.emulator.world.model import load_text as load_text
from evs.emulator.world.model import versions as versions
from evs.emulator.world.model import warn_left_out as warn_left_out
from evs.emulator.world.object_classes import ObjectClasses as ObjectClasses
from evs.emulator.world.object_classes import object_classes as object_classes
from evs.emulator.world.physics import Physics as Physics
from evs.emulator.world.physics import StabilityWatch as StabilityWatch
from evs.emulator.world.physics import Substeps as Substeps
from evs.emulator.world.physics import UnstableError as UnstableError
from evs.emulator.world.physics import UnstableWarning as UnstableWarning
from evs.emulator.world.physics import fill_tick as fill_tick
from evs.emulator.world.physics import gravity_of as gravity_of
from evs.emulator.world.physics import moving_bodies as moving_bodies
from evs.emulator.world.physics_batch import PhysicsBatch as PhysicsBatch
from evs.emulator.world.physics_batch import PoseBatch as PoseBatch
from evs.emulator.world.physics_batch import has_callbacks as has_callbacks
from evs.emulator.world.physics_batch import why_not_batched as why_not_batched
from evs.emulator.world.scene_keys import SceneKey as SceneKey
from evs.emulator.world.scene_keys import every_key as every_key
from evs.emulator.world.scene_keys import find_keys as find_keys
from evs.emulator.world.scene_values import SceneValues as SceneValues
from evs.emulator.world.snapshots import SnapshotTaker as SnapshotTaker
from evs.emulator.world.visual import Visual as Visual
from evs.emulator.world.visual import new_option as new_option
from evs.emulator.world.visual import resolve_visual as resolve_visual
from evs.emulator.world.visual import visible_geoms as visible_geoms
