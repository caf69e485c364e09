"""Motion: bodies that drift, sway, spin and tumble at a given image speed; cameras that move.

Without gravity, and with an inertia of 1 kg and 1 kg m^2 about every axis, a joint keeps its
velocity, and one with a spring of stiffness w^2 oscillates with w rad/s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from evs.emulator.base.scene import F64
from evs_lab.training.scenes.draft import DURATION_S, Draft, num

INERTIA = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
FASTEST_TURN = 800.0
"""rad/s: less than half a turn in 4 ms"""
FASTEST_SWING = 300.0
"""rad/s, 48 Hz: steps of 1 ms follow it"""
HEIGHT_PX = 260


@dataclass(frozen=True)
class Eye:
    """A camera: its position and what it looks at, m."""

    place: F64
    target: F64
    fovy_deg: float

    @property
    def focal_px(self) -> float:
        """Focal length."""
        return HEIGHT_PX / 2 / math.tan(math.radians(self.fovy_deg) / 2)

    @property
    def distance(self) -> float:
        """From the camera to what it looks at, m."""
        return float(np.linalg.norm(self.target - self.place))

    def px_per_m(self, place: F64) -> float:
        """Size of a metre there in the image, px."""
        return self.focal_px / max(0.05, float(np.linalg.norm(place - self.place)))

    def axes(self) -> tuple[F64, F64, F64]:
        """Unit vectors to the right, up and forward in the image."""
        forward = (self.target - self.place) / self.distance
        up = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        return right, np.cross(right, forward), forward


def still(place: F64, content: str) -> str:
    """A body that does not move."""
    return f'<body pos="{num(*place)}">{content}</body>'


def moving(draft: Draft, eye: Eye, place: F64, content: str, radius: float, speed: float) -> str:
    """A body at `place` whose surface moves at about `speed` px/s in the image."""
    scale = eye.px_per_m(place)
    velocity = speed / scale
    way = draft.choice(("drift", "spin", "wag", "orbit", "tumble"), (3, 3, 1, 2, 2))
    joint = ""
    if way == "drift":
        joint = _sliding(draft, _seen(draft, eye), velocity, _span_px(draft) / scale)
    elif way == "spin":
        joint = _turning(draft, draft.direction(), velocity / radius)
    elif way == "wag":
        joint = _turning(draft, draft.direction(), velocity / radius, draft.uniform(0.1, 1.0))
    elif way == "orbit":
        arm = radius * draft.uniform(0.5, 2.5)
        offset = draft.direction() * arm
        axis = np.cross(offset, draft.direction())
        joint = _turning(draft, axis, velocity / (arm + radius), pos=offset)
    else:
        # a body that leaves the picture is lost: fast ones turn instead
        drift = min(velocity, _span_px(draft) / scale / DURATION_S)
        turn = min(velocity / radius, FASTEST_TURN)
        draft.velocity += [*(_seen(draft, eye) * drift), *(draft.direction() * turn)]
        joint = "<freejoint/>"
    draft.speeds.append(speed)
    draft.tags.append(way)
    return f'<body pos="{num(*place)}">{INERTIA}{joint}{content}</body>'


def camera(
    draft: Draft, eye: Eye, span_px: float, *, around: bool = False, reach_m: float = math.inf
) -> None:
    """Write the camera `eye` and its motion.

    Args:
        draft: the scene so far.
        eye: the camera.
        span_px: how far the picture may turn before there is nothing to see.
        around: a turn about the vertical always shows something.
        reach_m: how far it may slide.
    """
    right, up, forward = eye.axes()
    way = draft.choice(("still", "pan", "slide", "shake"), (35, 25, 25, 15))
    speed = draft.speed()
    focal, away = eye.focal_px, eye.distance
    joint = ""
    if way == "pan":
        name = draft.choice(("yaw", "tilt", "roll"), (4, 2, 1))
        vertical = np.array([0.0, 0.0, 1.0])
        axis = {"yaw": vertical if around else up, "tilt": right, "roll": forward}[name]
        turn = speed / (focal if name != "roll" else HEIGHT_PX / 2)
        free = name == "roll" or (name == "yaw" and around)
        joint = _turning(
            draft, axis, turn, None if free else draft.uniform(0.1, 1.0) * span_px / focal
        )
    elif way == "slide":
        dolly = draft.chance(0.25)
        axis = forward if dolly else right * draft.uniform(-1, 1) + up * draft.uniform(-1, 1)
        velocity = speed * away / (focal if not dolly else HEIGHT_PX / 2)
        most = draft.uniform(0.05, 0.35) * away if dolly else min(span_px, 160.0) * away / focal
        joint = _sliding(draft, axis, velocity, min(most, reach_m))
    elif way == "shake":
        # two hinges of their own frequencies
        for axis in (up, right):
            joint += _turning(draft, axis, speed / focal, _span_px(draft) / 3 / focal)
    if way != "still":
        draft.speeds.append(speed)
    draft.tags.append(f"camera {way}")
    inertia = INERTIA if joint else ""
    draft.bodies.append(
        f'<body pos="{num(*eye.place)}">{inertia}{joint}'
        f'<camera name="eye" fovy="{num(eye.fovy_deg)}" xyaxes="{num(*right, *up)}"/></body>'
    )


def _span_px(draft: Draft) -> float:
    """How far a thing may go in the image."""
    return draft.log_uniform(6.0, 220.0)


def _seen(draft: Draft, eye: Eye) -> F64:
    """A unit direction, mostly across the view."""
    right, up, forward = eye.axes()
    turn = draft.uniform(0.0, 2.0 * math.pi)
    axis = math.cos(turn) * right + math.sin(turn) * up + draft.uniform(-0.5, 0.5) * forward
    return np.asarray(axis / np.linalg.norm(axis))


def _sliding(draft: Draft, axis: F64, velocity: float, span: float) -> str:
    """A slide; a spring keeps it within its span (m) if it would leave it."""
    draft.velocity.append(velocity if draft.chance(0.5) else -velocity)
    spring = ""
    if velocity * DURATION_S > span:
        spring = _spring(velocity, span)
    return f'<joint type="slide" axis="{num(*axis)}" {spring}/>'


def _spring(velocity: float, span: float) -> str:
    """The stiffness that returns a joint of this velocity at `span`, or as soon as possible."""
    return f'stiffness="{num(min(velocity / span, FASTEST_SWING) ** 2)}"'


def _turning(
    draft: Draft, axis: F64, turn: float, span: float | None = None, pos: F64 | None = None
) -> str:
    """A hinge that turns with so many rad/s; a spring keeps it within a span (rad), if given."""
    turn = min(turn, FASTEST_TURN)
    draft.velocity.append(turn if draft.chance(0.5) else -turn)
    spring = ""
    if span is not None and turn * DURATION_S > span:
        spring = _spring(turn, span)
    where = "" if pos is None else f'pos="{num(*pos)}"'
    return f'<joint type="hinge" axis="{num(*axis)}" {where} {spring}/>'
