"""Every code path that a scene may need or not: its name, its stage, and whether it may run idle.

This table is the one list of them. Code that runs one calls Switches.decide with what the scene
needs, or passes the native core what is forced; `evs plan` and the report read the answers there.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

from evs.emulator.config import PlanConfig
from evs.emulator.config.declaration import Term, declaration
from evs.emulator.config.sensor import ROUNDS, PixelKeys
from evs.msgs import EvsError, unknown


@dataclass(frozen=True)
class Feature:
    """A code path that runs where it is needed."""

    name: str
    stage: str
    """render | truth | sensor | model | readout | beside"""
    what: str
    """what it does"""
    idle: str = ""
    """why it cannot run where nothing needs it; empty: it can, with the same bytes"""


def _keys_of_terms() -> dict[Term, tuple[str, ...]]:
    keys: dict[Term, tuple[str, ...]] = {}
    for key in fields(PixelKeys):
        if (declared := declaration(key)) is not None and (term := declared.term) is not None:
            keys[term] = (*keys.get(term, ()), key.name)
    return keys


TERMS = _keys_of_terms()
"""term of the pixel -> the parameters that are 0 where it is off, as config.sensor declares them"""

FEATURES = (
    Feature("colour", "render", "light in three channels in addition to its luminance"),
    Feature("physical_gloss", "render", "GGX gloss of physical materials, and their maps"),
    Feature("normal_maps", "render", "normals bent by an image"),
    Feature(
        "texture_filter", "render", "images read at several points of the area that a pixel covers"
    ),
    Feature("outlines", "render", "outlines of shapes blended by the area that they cover"),
    Feature("sky", "render", "an image where rays meet nothing"),
    Feature("fog", "render", "fog between surface and camera"),
    Feature("haze", "render", "haze below the horizon of an infinite plane"),
    Feature("shadows", "render", "shadow rays", "the scene decides which lights cast shadows"),
    Feature("plane_shadows", "render", "planes between a light and what it lights"),
    Feature("glowing", "render", "paths look for glowing surfaces after their last bounce"),
    Feature(
        "transparent",
        "render",
        "paths query the transmittance of each layer",
        "rounding differs between a search for the nearest hit and one for any hit",
    ),
    Feature(
        "cached_light",
        "render",
        "diffuse light of sky and bounces, cached on surfaces",
        "it is a different renderer: render.renderer=hybrid",
    ),
    Feature("hierarchy", "render", "a search tree over many geoms"),
    Feature("light_reach", "render", "lights are skipped where they cannot reach"),
    Feature("light_gains", "render", "the strength of each light in each tick"),
    Feature("lens", "render", "rays bent by a lens", ROUNDS),
    Feature("vignetting", "render", "a share of the light for each pixel"),
    Feature("full_retrace", "render", "every pixel is traced in every tick"),
    Feature("refits", "render", "search trees of skins and flexes that do not move"),
    Feature("ground_truth", "truth", "depth, flow and ids in every tick"),
    *(Feature(term.name, "sensor", term.what, term.idle) for term in TERMS),
    Feature(
        "running_mean",
        "model",
        "a running mean of the light, before the pixel",
        "it is a different model: model.name=adaptive",
    ),
    Feature("cold_tiles", "model", "the network where nothing moves"),
    Feature("causes", "model", "each event states its cause"),
    Feature("readout", "readout", "the way from pixel to packet"),
    Feature("aps", "beside", "intensity frames"),
    Feature("imu", "beside", "accelerometer and gyroscope"),
)
"""In the order of their stages."""

NAMES = tuple(feature.name for feature in FEATURES)

NATIVE = (
    *("colour", "physical_gloss", "normal_maps", "texture_filter", "outlines", "fog"),
    *("haze", "shadows", "plane_shadows", "full_retrace", "refits", "glowing", "transparent"),
    *("hierarchy", "light_reach", "cached_light"),
)
"""Those that the native tracer decides: core/render/feature_flags.h."""


@dataclass(frozen=True)
class Switches:
    """What is forced on or off, whatever the scene needs."""

    on: frozenset[str] = frozenset()
    off: frozenset[str] = frozenset()

    @classmethod
    def of(cls, config: PlanConfig) -> Switches:
        """What [plan] forces. EvsError for unknown names, and for what cannot run idle."""
        for key in ("on", "off"):
            for name in getattr(config, key):
                if name not in NAMES:
                    raise EvsError(f"at plan.{key}: {unknown('code path', name, NAMES)}")
        if both := sorted({*config.on} & {*config.off}):
            raise EvsError(f"at plan.on: '{both[0]}' is in plan.off too; leave it out of one")
        for feature in FEATURES:
            if feature.idle and feature.name in config.on:
                raise EvsError(
                    f"at plan.on: '{feature.name}' cannot be on where nothing needs it: "
                    f"{feature.idle}; leave it out"
                )
        idle = [feature.name for feature in FEATURES if not feature.idle]
        on = {*config.on, *(idle if config.everything else ())} - {*config.off}
        return cls(frozenset(on), frozenset(config.off))

    def decide(self, name: str, needed: object) -> bool:
        """Whether a code path runs.

        Args:
            name: Of the code path.
            needed: True where the scene or the user needs it.
        """
        return name in self.on or (bool(needed) and name not in self.off)

    def forced(self, names: Iterable[str] = NATIVE) -> dict[str, bool]:
        """Which of these are forced: name -> on or off; the scene decides on the others."""
        return {name: name in self.on for name in names if name in self.on | self.off}


UNFORCED = Switches()
"""The scene decides everything."""
