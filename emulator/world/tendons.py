"""Tendons, ropes and slider-cranks: rods between points, as MuJoCo's visualiser draws them.

A tendon runs straight from site to site and around spheres and cylinders; one that hangs slack
between two sites is a catenary. A rope is a flex of dimension 1: a capsule for each of its edges.
A slider-crank, a kind of actuator, is a cylinder along its slider and a capsule from there to its
crank. The curves are computed in elementary operations and Python's math alone, so that every
machine finds the same bits.
"""

from __future__ import annotations

import math
from itertools import chain, pairwise
from typing import NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F32, F64, I32, ObjectKind, Shape
from evs.emulator.config import VisualConfig
from evs.emulator.world.materials import Rgba, shown_rgba
from evs.emulator.world.physics import gravity_of
from evs.emulator.world.visual import DEFAULT, faded, is_shown

HALVINGS = 4
"""A stretch that lies on a sphere or cylinder is halved so often: at a right angle its pieces run
0.12 % of the radius inside. MuJoCo 4 draws such an arc, its older versions a thinner chord."""

VERTICAL = 100.0
"""A string this much longer than its ends are apart sideways hangs like one with a bead on it."""


def catenary(start: F64, end: F64, gravity: F64, length: float, pieces: int) -> F64:
    """(pieces + 1, 3) points along a string of that length, m, that hangs between two points.

    Straight where it is too short to hang, or nothing pulls it down. At horizontal distances of
    i / (pieces + 1), where MuJoCo has them.
    """
    shares = np.arange(pieces + 1)[:, None] / pieces
    pull = math.sqrt(dot(gravity, gravity))
    span = end - start
    if pull < 1e-15 or dot(span, span) >= length * length:
        return start + shares * span
    up = gravity / -pull
    rise = float(dot(span, up))
    across = span - rise * up
    width = math.sqrt(dot(across, across))
    if length > VERTICAL * width:
        # as deep as a bead slides that hangs on it
        depth = 0.5 * (math.sqrt(length * length - width * width) - rise)
        lowest = start - depth * up + across * (depth / max(2.0 * depth + rise, 1e-30))
        half = (pieces + 1) // 2
        down = np.arange(half + 1)[:, None] / half
        rest = np.arange(1, pieces - half + 1)[:, None] / max(pieces - half, 1)
        return np.vstack([start + down * (lowest - start), lowest + rest * (end - lowest)])
    # sinh(x) / x = slack, x the width in half scales: Newton's steps from above fall to the root
    slack = math.sqrt(length * length - rise * rise) / width
    x, below = math.sqrt(6.0 * (slack - 1.0)), 0.0
    for _ in range(100):
        below = x - (math.sinh(x) - slack * x) / max(math.cosh(x) - slack, 1e-300)
        if not below < x:
            break
        x = below
    scale = 0.5 * width / max(x, 1e-8)
    middle = 0.5 * (width - scale * math.log((length + rise) / (length - rise)))
    at = [width * i / (pieces + 1) for i in range(1, pieces)]
    floor = math.cosh(middle / scale)
    heights = [scale * (math.cosh((a - middle) / scale) - floor) for a in at]
    points = np.empty((pieces + 1, 3))
    points[0], points[-1] = start, end
    steps = np.array(at)[:, None] * (across / width)
    points[1:-1] = start + steps + np.array(heights)[:, None] * up
    return points


def nearest(center: F64, axis: F64, first: F64, last: F64) -> F64:
    """(n, 3) the point from `first` to `last` that is nearest to a sphere or cylinder."""
    away, span = first - center, last - first
    for part in (away, span):
        part -= dot(part, axis)[:, None] * axis
    share = -dot(away, span) / np.maximum(dot(span, span), 1e-30)
    return np.asarray(first + np.clip(share, 0.0, 1.0)[:, None] * (last - first))


def arc(center: F64, axis: F64, touch: F64, leave: F64) -> list[F64]:
    """2**HALVINGS + 1 times (n, 3): from `touch` to `leave` around a sphere or cylinder."""
    ends = [touch - center, leave - center]
    rises = [dot(end, axis)[:, None] for end in ends]
    # seen along the axis; half-way between two points of a circle is where their sum points
    flat = [end - rise * axis for end, rise in zip(ends, rises, strict=True)]
    radius = np.sqrt(dot(flat[0], flat[0]))
    for _ in range(HALVINGS):
        sums = [one + other for one, other in pairwise(flat)]
        scales = [radius / np.maximum(np.sqrt(dot(s, s)), 1e-30) for s in sums]
        between = [s * scale[:, None] for s, scale in zip(sums, scales, strict=True)]
        flat = [*chain.from_iterable(zip(flat, between, strict=False)), flat[-1]]
    shares = [i / (len(flat) - 1) for i in range(len(flat))]
    climbs = [rises[0] + share * (rises[1] - rises[0]) for share in shares]
    middle = [center + part + climb * axis for part, climb in zip(flat, climbs, strict=True)]
    return [touch, *middle[1:-1], leave]


def dot(a: F64, b: F64) -> F64:
    """(...) of (..., 3), added up in one order everywhere."""
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2])


def turned(span: F64, length: F64) -> F64:
    """(n, 9) the shortest turn of the z axis into each direction; none where it has none."""
    there = length > 0
    unit = np.where(there[:, None], span, (0.0, 0.0, 1.0)) / np.where(there, length, 1.0)[:, None]
    x, y, z = unit.T
    across = x * x + y * y
    # 1 / (1 + z), exact where z is near -1, too
    share = np.where(z < 0, (1.0 - z) / np.maximum(across, 1e-300), 1.0 / (1.0 + np.abs(z)))
    xx, xy, yy = x * x * share, x * y * share, y * y * share
    turn = np.stack([1.0 - xx, -xy, x, -xy, 1.0 - yy, y, -x, -y, z], 1)
    # straight down: about x
    turn[(across == 0) & (z < 0)] = (1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0)
    return turn


MOST_PIECES = 99
"""of a catenary"""


Appearance = tuple[Rgba, int, bool]


class _Stretch(NamedTuple):
    """From a site of a tendon to the next."""

    tendon: int
    first: int
    """its number among all sites of all tendons, in their order"""
    start: int
    end: int
    """the sites"""
    around: int
    """the geom that is wrapped between them, -1 none"""


class Strands:
    """The visible tendons, ropes and slider-cranks of one model, in this order, as rods.

    A stretch with a geom to wrap has a straight one, which has no radius while the tendon is
    wrapped, and those to, along and from the geom, which have none while it is not. A crank is
    there twice: as one that reaches its slider, and in another colour as one that does not.
    """

    pos: F64
    """(n, 3) centres of the rods, in the world; `update` writes it"""
    mat: F64
    """(n, 9) local to world; their axis is z"""
    sizes: F32
    """(n, 3) as SceneModel.geom_size: radius, half length, 0"""

    def __init__(self, model: mujoco.MjModel, visual: VisualConfig = DEFAULT) -> None:
        self._model, self._visual = model, visual
        self._tendons = [
            i
            for i in range(model.ntendon)
            if model.wrap_type[model.tendon_adr[i]] != mujoco.mjtWrap.mjWRAP_JOINT
            and visual.tendon
            and is_shown(visual.tendongroup, model.tendon_group[i], self._tendon_appearance(i)[0])
        ]
        self._ropes = [
            i
            for i in range(model.nflex)
            if (model.flex_dim[i] == 1 or not visual.flexskin)
            and visual.flexedge
            and model.flex_radius[i] > 0
            and is_shown(visual.flexgroup, model.flex_group[i], self._rope_appearance(i)[0])
        ]
        self._appearances: list[Appearance] = []
        self._things: list[tuple[ObjectKind, int]] = []
        widths: list[float] = []

        def add(
            thing: ObjectKind, index: int, appearance: Appearance, width: float, count: int = 1
        ) -> int:
            first = len(widths)
            self._things += [(thing, index)] * count
            self._appearances += [appearance] * count
            widths.extend([width] * count)
            return first

        pieces = min(int(model.vis.quality.numslices), MOST_PIECES)
        straight, wrapped, rows_straight, rows_wrapped = [], [], [], []
        self._strings: list[tuple[_Stretch, slice]] = []
        for stretch in _stretches(model):
            if stretch.tendon not in self._tendons:
                continue
            one = ObjectKind.TENDON, stretch.tendon, self._tendon_appearance(stretch.tendon)
            width = float(model.tendon_width[stretch.tendon])
            if may_hang(model, stretch.tendon):
                first = add(*one, width, pieces)
                self._strings.append((stretch, slice(first, first + pieces)))
            elif stretch.around < 0:
                straight.append(stretch)
                rows_straight.append(add(*one, width))
            else:
                wrapped.append(stretch)
                rows_wrapped.append(add(*one, width, 3 + 2**HALVINGS))
        self._straight = _columns(straight), np.array(rows_straight, np.intp)
        self._wrapped = _columns(wrapped), np.array(rows_wrapped, np.intp)

        edges, first = [np.zeros((0, 2), np.intp)], len(widths)
        for i in self._ropes:
            begin, count = int(model.flex_edgeadr[i]), int(model.flex_edgenum[i])
            edges.append(model.flex_edge[begin : begin + count] + int(model.flex_vertadr[i]))
            add(ObjectKind.ROPE, i, self._rope_appearance(i), float(model.flex_radius[i]), count)
        self._edges, self._edge_rows = np.concatenate(edges), slice(first, len(widths))

        width = float(model.stat.meansize * model.vis.scale.slidercrank)
        colours = model.vis.rgba
        whole, broken = _plain(colours.slidercrank), _plain(colours.crankbroken)
        is_crank = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_SLIDERCRANK)
        self._cranks, rows_cranks = np.flatnonzero(is_crank), []
        for i in self._cranks.tolist():
            rows_cranks.append(add(ObjectKind.CRANK, i, whole, width))
            for appearance in (whole, broken):
                add(ObjectKind.CRANK, i, appearance, 0.5 * width)
        self._crank_rows = np.array(rows_cranks, np.intp)

        self._radius = np.array(widths, np.float64)
        self._ends = np.zeros((2, len(widths), 3))
        self.pos, self.mat = np.zeros((len(widths), 3)), np.zeros((len(widths), 9))
        self.sizes = np.zeros((len(widths), 3), np.float32)
        self.sizes[:, 0] = self._radius

    def __len__(self) -> int:
        return len(self._things)

    @property
    def things(self) -> list[tuple[ObjectKind, int]]:
        """Of each rod: what it is part of, and the id of that tendon, flex or actuator."""
        return self._things

    @property
    def appearances(self) -> list[Appearance]:
        """Of each: colour, material (-1 none), and whether the material's image is on it."""
        return self._appearances

    @property
    def shapes(self) -> list[Shape]:
        """Of each."""
        shapes = [Shape.CAPSULE] * len(self)
        for row in self._crank_rows:
            shapes[row] = Shape.CYLINDER
        return shapes

    def update(self, data: mujoco.MjData) -> None:
        """Find where they are; `data` has its kinematics, tendons and flexes computed."""
        if not len(self):
            return
        start, end = self._ends
        radius = self._radius.copy()
        places = data.site_xpos
        (stretches, rows) = self._straight
        start[rows], end[rows] = places[stretches.start], places[stretches.end]
        if len(self._wrapped[1]):
            self._wrap(data, radius)
        for stretch, which in self._strings:
            points = self._hung(data, stretch, which.stop - which.start)
            start[which], end[which] = points[:-1], points[1:]
        if len(self._edges):
            corners = data.flexvert_xpos[self._edges]
            start[self._edge_rows], end[self._edge_rows] = corners[:, 0], corners[:, 1]
        if len(self._cranks):
            self._turn_cranks(data, radius)
        span = end - start
        length = np.sqrt(dot(span, span))
        self.pos[:] = 0.5 * (start + end)
        self.sizes[:, 0], self.sizes[:, 1] = radius, 0.5 * length
        self.mat[:] = turned(span, length)

    def _wrap(self, data: mujoco.MjData, radius: F64) -> None:
        """Fill in the capsules of stretches with a geom between their sites, and `radius`."""
        stretches, rows = self._wrapped
        start, end = self._ends
        first, last = data.site_xpos[stretches.start], data.site_xpos[stretches.end]
        # sites are -1 among what tendons go along: two more points lie between those of a wrap
        used = int(data.ten_wrapnum.sum())
        sites = np.flatnonzero(data.wrap_obj.reshape(-1)[:used] == -1)
        here = sites[stretches.first]
        wraps = sites[stretches.first + 1] - here == 3
        along = data.wrap_xpos.reshape(-1, 3)
        # elsewhere the point where it would begin to, so that nothing jumps
        center, axis = data.geom_xpos[stretches.around], self._axes(data, stretches.around)
        near = nearest(center, axis, first, last)
        touch = np.where(wraps[:, None], along[np.where(wraps, here + 1, 0)], near)
        leave = np.where(wraps[:, None], along[np.where(wraps, here + 2, 0)], near)
        start[rows], end[rows] = first, last
        radius[rows] *= ~wraps
        points = [first, *arc(center, axis, touch, leave), last]
        for part, (one, other) in enumerate(pairwise(points), 1):
            start[rows + part], end[rows + part] = one, other
            radius[rows + part] *= wraps

    def _axes(self, data: mujoco.MjData, geom: I32) -> F64:
        """(n, 3) of cylinders; 0 of spheres."""
        is_cylinder = self._model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CYLINDER
        return np.asarray(data.geom_xmat[geom][:, 2::3] * is_cylinder[:, None])

    def _hung(self, data: mujoco.MjData, stretch: _Stretch, pieces: int) -> F64:
        """(pieces + 1, 3) along a tendon that may hang between its two sites."""
        model, tendon = self._model, stretch.tendon
        start, end = data.site_xpos[stretch.start], data.site_xpos[stretch.end]
        length = float(model.tendon_lengthspring[tendon, 1])
        if not _has_spring(model, tendon):
            length = float(model.tendon_range[tendon, 1])
        return catenary(start, end, gravity_of(model), length, pieces)

    def _turn_cranks(self, data: mujoco.MjData, radius: F64) -> None:
        """Fill in sliders, cranks that reach them or do not, and `radius`."""
        start, end = self._ends
        crank, slider = self._model.actuator_trnid[self._cranks].T
        length = self._model.actuator_cranklength[self._cranks]
        far, near = data.site_xpos[crank], data.site_xpos[slider]
        axis, span = data.site_xmat[slider][:, 2::3], far - near
        along = dot(span, axis)
        square = along * along + length * length - dot(span, span)
        joint = near + (along - np.sqrt(np.maximum(square, 0.0)))[:, None] * axis
        rows, reaches = self._crank_rows, square >= 0
        start[rows], end[rows] = near, joint
        for part, there in ((1, reaches), (2, ~reaches)):
            start[rows + part], end[rows + part] = joint, far
            radius[rows + part] *= there

    def _tendon_appearance(self, tendon: int) -> Appearance:
        material = int(self._model.tendon_matid[tendon])
        rgba, kind = self._model.tendon_rgba[tendon], mujoco.mjtObj.mjOBJ_TENDON
        own = shown_rgba(self._model, kind, tendon, rgba, material)
        return faded(self._model, own, self._visual), material, True

    def _rope_appearance(self, flex: int) -> Appearance:
        material = int(self._model.flex_matid[flex])
        rgba, kind = self._model.flex_rgba[flex], mujoco.mjtObj.mjOBJ_FLEX
        own = shown_rgba(self._model, kind, flex, rgba, material)
        return faded(self._model, own, self._visual), material, False


def _plain(rgba: npt.NDArray[np.float32]) -> Appearance:
    red, green, blue, alpha = map(float, rgba)
    return (red, green, blue, alpha), -1, False


class _Columns(NamedTuple):
    """Stretches as (n,) each."""

    first: I32
    start: I32
    end: I32
    around: I32


def _columns(stretches: list[_Stretch]) -> _Columns:
    fields = [[getattr(stretch, name) for stretch in stretches] for name in _Columns._fields]
    return _Columns(*(np.array(values, np.int32) for values in fields))


def _stretches(model: mujoco.MjModel) -> list[_Stretch]:
    """Of all tendons, visible or not, in the order in which MuJoCo goes along them."""
    site, pulley = mujoco.mjtWrap.mjWRAP_SITE, mujoco.mjtWrap.mjWRAP_PULLEY
    found: list[_Stretch] = []
    seen = 0
    for tendon in range(model.ntendon):
        begin = int(model.tendon_adr[tendon])
        path = [
            (int(model.wrap_type[k]), int(model.wrap_objid[k]))
            for k in range(begin, begin + int(model.tendon_num[tendon]))
        ]
        last, around, joined = -1, -1, False
        for kind, index in path:
            if kind == pulley:
                # a site alone between two pulleys is not on the way
                seen += joined
                last, around, joined = -1, -1, False
            elif kind == site:
                if last >= 0:
                    found.append(_Stretch(tendon, seen, last, index, around))
                    seen += 1
                    joined = True
                last, around = index, -1
            else:
                around = index
        seen += joined
    return found


def _has_spring(model: mujoco.MjModel, tendon: int) -> bool:
    return bool(model.tendon_stiffness[tendon]) or _any(model, "tendon_stiffnesspoly", tendon)


def _any(model: mujoco.MjModel, name: str, tendon: int) -> bool:
    """Whether the tendon has any of these coefficients, which an older MuJoCo does not know."""
    return bool(np.any(getattr(model, name)[tendon])) if hasattr(model, name) else False


def may_hang(model: mujoco.MjModel, tendon: int) -> bool:
    """Whether MuJoCo draws a tendon as a string that hangs: nothing but a longest length acts."""
    if int(model.tendon_num[tendon]) != 2:
        return False
    rest, reach = model.tendon_lengthspring[tendon], model.tendon_range[tendon]
    if _has_spring(model, tendon):
        slack = rest[0] == 0 and rest[1] > 0
    else:
        slack = model.tendon_limited[tendon] == 1 and reach[0] == 0 and reach[1] > 0
    pulled = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON) & (
        model.actuator_trnid[:, 0] == tendon
    )
    damped = bool(model.tendon_damping[tendon]) or _any(model, "tendon_dampingpoly", tendon)
    return bool(slack and not damped and not pulled.any() and not model.tendon_frictionloss[tendon])
