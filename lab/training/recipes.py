"""Recipes: the network, its light and the settings of its training."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field

from evs.msgs import EvsError, unknown
from evs_lab.training.losses import Terms
from evs_lab.training.network import INITIAL, Architecture, spread_look_ahead
from evs_lab.training.settings import VARIANTS, Variant

GROUP = 32
"""pixels that see one variant of the light; a batch is whole groups"""


@dataclass(frozen=True)
class Recipe:
    """A network and its training.

    Raises:
        EvsError: a value is out of range.
    """

    name: str
    architecture: Architecture = field(default_factory=Architecture)
    initial: str = "identity"
    """identity: starts as `plain`; uniform: from scratch"""
    tau_s: float = 1.0
    """where tau starts, s"""
    variants: tuple[Variant, ...] = VARIANTS
    """of the light it sees"""
    shares: tuple[float, ...] = ()
    """how often it sees each, any sum; empty: all the same"""
    terms: Terms = field(default_factory=Terms)
    balanced: bool = False
    """each variant's loss counts relative to what it is (calibration.py)"""
    noise: tuple[float, float] = (1.0, 1.0)
    """the noise of each pixel's log light is taken so many times, log-uniform between the two: the
    light of other scenes, with more lamps or wider ones, has more of it at the same samples"""
    noisy_truth: bool = False
    """truth: pixels with a real sensor's noise, in place of ideal ones"""
    warm_ticks: int = 42
    """before the first tick that is compared: they fill the network's window, and its membranes
    start after them, where the pixels of the truth then stand"""
    batch: int = 256
    """pixels, a multiple of GROUP"""
    steps: int = 40_000
    learning_rate: float = 3e-3
    """after the warm-up; from there it falls as a cosine to a hundredth"""
    warm_up: float = 0.02
    """share of the steps"""
    weight_decay: float = 1e-4
    clip: float = 1.0
    """most norm of a gradient"""

    def __post_init__(self) -> None:
        """Check what a command line may have changed."""
        if self.batch < GROUP or self.batch % GROUP:
            raise EvsError(f"batch is {self.batch} pixels; give a multiple of {GROUP}")
        if self.steps < 1:
            raise EvsError(f"steps is {self.steps}; give 1 or more")
        if self.initial not in INITIAL:
            raise unknown("start of a network", self.initial, INITIAL)
        if not 0.0 < self.noise[0] <= self.noise[1] < math.inf:
            raise EvsError(f"noise is {self.noise}; give the least and the most factor, over 0")
        shares = self.shares or (1.0,) * len(self.variants)
        if len(shares) != len(self.variants) or min(shares) < 0 or not sum(shares) > 0:
            raise EvsError(f"recipe '{self.name}' has {len(self.variants)} variants of the light "
                           f"and the shares {shares}")  # fmt: skip

    @property
    def spp(self) -> tuple[int, int]:
        """Fewest and most samples a pixel."""
        counts = [variant.spp for variant in self.variants]
        return min(counts), max(counts)

    def of_spp(self, spp: int) -> Recipe:
        """The same for light of so many samples alone, fresh: the member `NAME_{spp}spp`."""
        return dataclasses.replace(
            self, name=f"{self.name}_{spp}spp", variants=(Variant(spp, "fresh"),), shares=()
        )

    def with_look_ahead(self, ticks: int) -> Recipe:
        """The same for a network that sees so many ticks of the future."""
        look_ahead = spread_look_ahead(ticks, self.architecture.blocks)
        architecture = dataclasses.replace(self.architecture, look_ahead=look_ahead)
        return dataclasses.replace(self, architecture=architecture)

    def with_events_per_tick(self, events_per_tick: str) -> Recipe:
        """The same for a network whose pixels fire so often, as model.events_per_tick."""
        architecture = dataclasses.replace(self.architecture, events_per_tick=events_per_tick)
        return dataclasses.replace(self, architecture=architecture)


OURS = Terms(count=0.1, calibration=0.02, edge=16.0, silence=0.3, silence_ticks=6)


def _ours(name: str, channels: int) -> Recipe:
    architecture = Architecture(channels=channels, odd=True)
    return Recipe(name, architecture, terms=OURS, balanced=True, noise=(0.3, 4.0))


RECIPES = {
    # centred, biased, from scratch, its loss alone, its light; the paper does not state C
    "paper": Recipe(
        "paper",
        Architecture(channels=8, look_ahead=(3,) * 7, biased=True),
        initial="uniform",
        variants=(Variant(64, "fresh"),),
    ),
    "evsnet_c8": _ours("evsnet_c8", 8),
    "evsnet_c4": _ours("evsnet_c4", 4),
}
"""By name. Any of them can be changed on the command line."""


def recipe_named(name: str) -> Recipe:
    """Raises EvsError for one that is not there."""
    if name not in RECIPES:
        raise unknown("recipe", name, RECIPES)
    return RECIPES[name]
