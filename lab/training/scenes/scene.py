"""make_scene: a complete training scene as MJCF text, from a seed and its number alone.

No robot file and no other file is read: gymnasium's and dm_control's robots are for tests only.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.emulator.config import FlickerConfig
from evs_lab.training.scenes import kinds
from evs_lab.training.scenes.draft import Draft, num
from evs_lab.training.scenes.lamps import draw_level, light_up

KINDS = {
    "room": kinds.room,
    "tabletop": kinds.tabletop,
    "floor": kinds.floor,
    "clutter": kinds.clutter,
    "closeup": kinds.closeup,
}
CAMERA, START = "eye", "start"
"""Names of the camera and of the keyframe that it starts from."""


@dataclass(frozen=True)
class TrainingScene:
    """A scene: what `World` and the renderers need, and its meta data."""

    text: str
    """MJCF; it names the `files`"""
    files: dict[str, bytes]
    """name to content: textures"""
    flicker: tuple[FlickerConfig, ...]
    bounces: int
    """of light"""
    meta: dict[str, Any]
    """kind, level, tags, requested speeds"""

    @property
    def digest(self) -> str:
        """SHA-256 of the complete scene."""
        found = hashlib.sha256(self.text.encode())
        for name in sorted(self.files):
            found.update(name.encode() + self.files[name])
        found.update(repr((self.flicker, self.bounces)).encode())
        return found.hexdigest()


def make_scene(seed: int, number: int, attempt: int = 0) -> TrainingScene:
    """Make scene `number` of a seed.

    Five scenes in a row are of five kinds.

    Args:
        seed: of the data set.
        number: of the scene.
        attempt: number of the attempt, where earlier scenes were not useful.
    """
    order = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 1, number // 5])))
    kind = list(KINDS)[int(order.permutation(len(KINDS))[number % len(KINDS)])]
    source = np.random.SeedSequence([seed, 2, number, attempt])
    draft = Draft(np.random.Generator(np.random.PCG64(source)))
    level = draw_level(draft)
    eye, middle, reach = KINDS[kind](draft, level)
    light_up(draft, eye, level, middle, reach)
    bounces = draft.integer(1, 3)
    # joints come in the order of their bodies, and so do the numbers of qvel
    text = f"""<mujoco model="training {seed} {number}">
<compiler angle="degree"/>
<option timestep="0.001" gravity="0 0 {num(-draft.gravity)}" integrator="implicitfast"/>
<default><geom contype="0" conaffinity="0"/></default>
<visual>{draft.visual}<map haze="0"/></visual>
<asset>
{chr(10).join(draft.assets)}
</asset>
<worldbody>
{chr(10).join(draft.bodies)}
</worldbody>
<keyframe><key name="{START}" qvel="{num(*draft.velocity)}"/></keyframe>
</mujoco>
"""
    meta = {
        "number": number,
        "attempt": attempt,
        "kind": kind,
        "level": level,
        "bounces": bounces,
        "tags": sorted(set(draft.tags)),
        "speeds_asked_px_s": [float(f"{speed:.4g}") for speed in draft.speeds],
    }
    return TrainingScene(text, draft.files, tuple(draft.flicker), bounces, meta)
