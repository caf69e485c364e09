"""Events from environments of other libraries: Gymnasium, robosuite, Metaworld, dm_control."""

from evs.drivers.environments.event_env import EventEnv
from evs.drivers.environments.wrapping import wrap

__all__ = ["EventEnv", "wrap"]
