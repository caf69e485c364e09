"""Tendons and ropes: chains of capsules, as MuJoCo's visualiser draws them.

A tendon runs straight from site to site and around spheres and cylinders; one that hangs slack
between two sites is a catenary. A rope is a flex of dimension 1: a capsule for each of its edges.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import mujoco
import numpy as np

from evs.emulator.scene import F32, F64, I32
from evs.emulator.world.curves import HALVINGS, arc, catenary, dot, nearest, turned
from evs.emulator.world.kinematics import gravity_of
from evs.emulator.world.surfaces import Rgba, is_shown, shown_rgba

MOST_PIECES = 99
"""of a catenary"""


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
    """The visible tendons and ropes of one model, as capsules: first the tendons', then the ropes'.

    A stretch with a geom to wrap has a straight one, which has no radius while the tendon is
    wrapped, and those to, along and from the geom, which have none while it is not.
    """

    pos: F64
    """(n, 3) centres of the capsules, in the world; `update` writes it"""
    mat: F64
    """(n, 9) local to world; their axis is z"""
    sizes: F32
    """(n, 3) as SceneModel.geom_size: radius, half length, 0"""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._tendons = [
            i
            for i in range(model.ntendon)
            if model.wrap_type[model.tendon_adr[i]] != mujoco.mjtWrap.mjWRAP_JOINT
            and is_shown(model.tendon_group[i], self._tendon_look(i)[0])
        ]
        self._ropes = [
            i
            for i in range(model.nflex)
            if model.flex_dim[i] == 1
            and model.flex_radius[i] > 0
            and is_shown(model.flex_group[i], self._rope_look(i)[0])
        ]
        self._owner: list[int] = []
        widths: list[float] = []

        def add(owner: int, width: float, count: int = 1) -> int:
            first = len(widths)
            self._owner += [owner] * count
            widths.extend([width] * count)
            return first

        pieces = min(int(model.vis.quality.numslices), MOST_PIECES)
        straight, wrapped, rows_straight, rows_wrapped = [], [], [], []
        self._strings: list[tuple[_Stretch, slice]] = []
        for stretch in _stretches(model):
            if stretch.tendon not in self._tendons:
                continue
            width = float(model.tendon_width[stretch.tendon])
            if may_hang(model, stretch.tendon):
                first = add(stretch.tendon, width, pieces)
                self._strings.append((stretch, slice(first, first + pieces)))
            elif stretch.around < 0:
                straight.append(stretch)
                rows_straight.append(add(stretch.tendon, width))
            else:
                wrapped.append(stretch)
                rows_wrapped.append(add(stretch.tendon, width, 3 + 2**HALVINGS))
        self._straight = _columns(straight), np.array(rows_straight, np.intp)
        self._wrapped = _columns(wrapped), np.array(rows_wrapped, np.intp)
        self._tendon_rows = len(widths)

        edges = [np.zeros((0, 2), np.intp)]
        for i in self._ropes:
            begin, count = int(model.flex_edgeadr[i]), int(model.flex_edgenum[i])
            edges.append(model.flex_edge[begin : begin + count] + int(model.flex_vertadr[i]))
            add(i, float(model.flex_radius[i]), count)
        self._edges = np.concatenate(edges)

        self._radius = np.array(widths, np.float64)
        self._ends = np.zeros((2, len(widths), 3))
        self.pos, self.mat = np.zeros((len(widths), 3)), np.zeros((len(widths), 9))
        self.sizes = np.zeros((len(widths), 3), np.float32)
        self.sizes[:, 0] = self._radius

    def __len__(self) -> int:
        return len(self._owner)

    @property
    def tendon_count(self) -> int:
        """How many of the capsules are tendons'; the others are ropes'."""
        return self._tendon_rows

    def owners(self) -> list[int]:
        """Of each capsule: the tendon, or the flex."""
        return self._owner

    def looks(self) -> list[tuple[Rgba, int, bool]]:
        """Of each: colour, material (-1 none), and whether the material's image is on it."""
        tendon = {i: self._tendon_look(i) for i in self._tendons}
        rope = {i: self._rope_look(i) for i in self._ropes}
        count = self._tendon_rows
        return [tendon[i] for i in self._owner[:count]] + [rope[i] for i in self._owner[count:]]

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
            start[self._tendon_rows :], end[self._tendon_rows :] = corners[:, 0], corners[:, 1]
        span = end - start
        length = np.sqrt(dot(span, span))
        self.pos[:] = 0.5 * (start + end)
        self.sizes[:, 0], self.sizes[:, 1] = radius, 0.5 * length
        self.mat[:] = turned(span, length)

    def _wrap(self, data: mujoco.MjData, radius: F64) -> None:
        """The capsules of stretches with a geom between their sites. Out: radius."""
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

    def _tendon_look(self, tendon: int) -> tuple[Rgba, int, bool]:
        material = int(self._model.tendon_matid[tendon])
        rgba, kind = self._model.tendon_rgba[tendon], mujoco.mjtObj.mjOBJ_TENDON
        return shown_rgba(self._model, kind, tendon, rgba, material), material, True

    def _rope_look(self, flex: int) -> tuple[Rgba, int, bool]:
        material = int(self._model.flex_matid[flex])
        rgba, kind = self._model.flex_rgba[flex], mujoco.mjtObj.mjOBJ_FLEX
        return shown_rgba(self._model, kind, flex, rgba, material), material, False


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
