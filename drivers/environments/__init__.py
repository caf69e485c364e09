"""Events from environments of other libraries: Gymnasium, robosuite, Metaworld, dm_control."""

from evs.drivers.environments.event_env import EventEnv
from evs.drivers.environments.vector import make_vec
from evs.drivers.environments.wrapping import wrap

__all__ = ["EventEnv", "make_vec", "wrap"]
