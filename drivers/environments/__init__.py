"""For learners: environments, events from environments of other libraries, simulated samples."""

from evs.drivers.environments.episode import EpisodeSpec
from evs.drivers.environments.event_env import EventEnv
from evs.drivers.environments.simulated_dataset import EpochSampler, SimulatedDataset
from evs.drivers.environments.wrapping import make_vec, wrap

__all__ = ["EpisodeSpec", "EpochSampler", "EventEnv", "SimulatedDataset", "make_vec", "wrap"]
