"""Lamps: from moonlight to sun, hard and soft shadows, flicker, lamps that swing."""

from __future__ import annotations

import math

import numpy as np

from evs.emulator.base.scene import F64
from evs.emulator.config import FlickerConfig
from evs_lab.training.scenes.draft import Draft, num
from evs_lab.training.scenes.motion import Eye, moving


def draw_level(draft: Draft) -> float:
    """Draw the light on white paper, 1 is 255 DN: a fifth of the scenes are at night."""
    if draft.chance(0.2):
        draft.tags.append("night")
        return draft.log_uniform(0.004, 0.1)
    return draft.log_uniform(0.1, 25.0)


def light_up(draft: Draft, eye: Eye, level: float, middle: F64, reach: float) -> None:
    """Lamps around `middle`, at most `reach` m away from it, and some light from everywhere."""
    count = draft.integer(1, 3)
    for _ in range(count):
        share = draft.log_uniform(0.2, 1.0) / math.sqrt(count)
        _lamp(draft, eye, level * share, middle, reach)
    ambient = level * draft.log_uniform(0.005, 0.5)
    head = level * draft.uniform(0.05, 0.6) if draft.chance(0.1) else 0.0
    draft.visual = (
        f'<headlight active="1" ambient="{num(ambient, ambient, ambient)}" '
        f'diffuse="{num(head, head, head)}" specular="0 0 0"/>'
    )
    if draft.chance(0.25):
        _flicker(draft)


def _lamp(draft: Draft, eye: Eye, strength: float, middle: F64, reach: float) -> None:
    kind = draft.choice(("point", "spot", "directional"), (4, 3, 2))
    turn, up = draft.uniform(0.0, 2.0 * math.pi), draft.uniform(0.3, 0.98)
    flat = math.sqrt(1.0 - up * up)
    away = np.array([math.cos(turn) * flat, math.sin(turn) * flat, up])
    place = middle + away * reach * draft.uniform(0.6, 1.0)
    tint = draft.rng.uniform(0.75, 1.0, 3) * strength
    soft = ""
    if kind != "directional":
        # a hard lamp has no size
        radius = 0.0 if draft.chance(0.4) else reach * draft.log_uniform(0.01, 0.2)
        soft = f'bulbradius="{num(radius)}"'
        draft.tags.append("soft shadows" if radius else "hard shadows")
    else:
        draft.tags.append("hard shadows")
    cone = ""
    if kind == "spot":
        cone = f'cutoff="{num(draft.uniform(20, 70))}" exponent="{num(draft.log_uniform(0.5, 20))}"'
    attributes = (
        f'<light type="{kind}" dir="{num(*-away)}" diffuse="{num(*tint)}" '
        f'specular="{num(*(tint * draft.uniform(0.0, 0.5)))}" {soft} {cone}'
    )
    if kind != "directional" and draft.chance(0.12):
        # a swinging lamp moves every shadow
        draft.bodies.append(
            moving(draft, eye, place, f'{attributes} pos="0 0 0"/>', 0.3 * reach, draft.speed())
        )
        draft.tags.append("swinging lamp")
        return
    draft.bodies.append(f'{attributes} pos="{num(*place)}"/>')


def _flicker(draft: Draft) -> None:
    """All lamps on the mains, dimmed by pulses, or waving."""
    waveform = draft.choice(("mains", "sine", "pwm"), (3, 1, 1))
    hz = {
        "mains": 50.0 if draft.chance(0.5) else 60.0,
        "sine": draft.log_uniform(1.0, 200.0),
        "pwm": draft.log_uniform(90.0, 3000.0),
    }[waveform]
    draft.flicker.append(
        FlickerConfig(
            waveform=waveform,
            hz=float(f"{hz:.6g}"),
            depth=float(f"{draft.log_uniform(0.03, 0.9):.6g}"),
            duty=float(f"{draft.uniform(0.1, 0.9):.6g}"),
            phase=float(f"{draft.uniform(0.0, 1.0):.6g}"),
        )
    )
    draft.tags.append(f"flicker {waveform}")
