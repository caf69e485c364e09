"""Small things to evaluate: a scene in soft light, and cells of a table made by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from evs_lab.evaluation.aggregate import ResultCell
from evs_lab.evaluation.measure import Measures

SCENE = """<mujoco><statistic center="0 0 .5" extent="1"/>
  <visual><headlight ambient=".2 .2 .2" diffuse="0 0 0" specular="0 0 0"/></visual>
  <asset><texture name="tiles" type="2d" builtin="checker" rgb1=".8 .8 .8" rgb2=".2 .2 .2"
    width="64" height="64"/><material name="floor" texture="tiles" texrepeat="8 8"/></asset>
  <worldbody><camera pos="0 -1.0606601717798212 1.5606601717798212" fovy="45"
    xyaxes="1 0 0 0 1 1"/><light type="point" pos=".5 -1 2" diffuse="2 2 2"
    bulbradius=".2"/><geom type="plane" size="2 2 .1" material="floor"/>
  <body pos="0 0 .6"><joint name="turn" axis="0 0 1" damping=".01"/>
    <geom type="capsule" fromto="-.4 0 0 .4 0 0" size=".06" rgba=".9 .5 .2 1"/></body></worldbody>
  <actuator><motor joint="turn" gear="3" ctrllimited="true" ctrlrange="-1 1"/></actuator></mujoco>
"""
"""A bar that a motor turns above a chequered floor, under a lamp that is not a point."""


def written(folder: Path, repeat: int = 8) -> Path:
    """Write the scene to a file and return its path.

    Args:
        folder: The folder of the file.
        repeat: How often the texture of the floor repeats along each axis.
    """
    path = folder / "turning.xml"
    path.write_text(SCENE.replace('texrepeat="8 8"', f'texrepeat="{repeat} {repeat}"'))
    return path


def measures(**given: Any) -> Measures:
    """Measures of a perfect model with 100 events of each polarity on 1000 px in a second."""
    values: dict[str, Any] = {
        "pixels": 1000, "seconds": 1.0, "emd": 0.1, "on": 100, "off": 100,
        "reference_on": 100, "reference_off": 100, "pairs": 200, "static_px": 500,
        "static_events": 0, "delay_us": 0.0, "timing_us": 0.0, "rmse_hz": 0.0, "kl_nats": 0.0,
        "correlation": 1.0, "patch_px": 1024, "patch_emd": 0.1, "patch_events": 300,
        "patch_reference": 300, "patch_pairs": 300, "ms_per_tick": 1.0,
    }  # fmt: skip
    return Measures(**{**values, **given})


def cell(model: str, spp: int = 4, seeds: str = "fresh", **given: Any) -> ResultCell:
    """One cell; arguments that are not fields of a cell are measures."""
    own = {"scene": "one", "camera": "still", "soft": True, "light": "path"}
    fields = {key: given.pop(key, usual) for key, usual in own.items()}
    return ResultCell(**fields, spp=spp, seeds=seeds, model=model, measures=measures(**given))  # type: ignore[arg-type]


def light_of_steps(steps: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Luminance that changes in steps of just over 0.2 log units: (ticks, n) float32.

    Args:
        steps: How many steps the light is above its lowest, (ticks, n) whole numbers.
    """
    return (0.2 * np.exp(0.2001 * steps)).astype(np.float32)
