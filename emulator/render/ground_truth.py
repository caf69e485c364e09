"""Tracing ground truth: the first hits from the core, and the motion of their images."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from evs.emulator import _core
from evs.emulator.base.scene import (
    F32,
    F64,
    I32,
    CameraModel,
    CameraPose,
    GroundTruth,
    SceneModel,
    SceneSnapshot,
)
from evs.emulator.optics import Lens, project
from evs.msgs import EvsError

Instant = tuple[SceneSnapshot, CameraPose]


class Hits(NamedTuple):
    """What the native core finds; points and normals in the camera's frame."""

    geom: I32
    """(h, w) index into the scene's geoms, -1 none"""
    distance: F32
    """(h, w) m"""
    point: F32
    """(h, w, 3); where nothing is hit: the ray's direction"""
    normal: F32
    """(h, w, 3)"""
    triangle: I32
    """(h, w) face of a mesh, -1 none"""
    barycentric: F32
    """(h, w, 2) shares of the face's second and third corner"""


def trace_hits(
    caster: _core.Caster,
    placed: tuple[F64, F64, F64, F64, F64, F64],
    shape: tuple[int, int],
    lens: Lens,
) -> Hits:
    """Trace the first hit of each pixel's centre.

    Args:
        caster: The native tracer.
        placed: Poses as Caster.render takes them.
        shape: (h, w).
        lens: Pixels outside its image circle hit nothing, and have no direction either: NaN.
    """
    found = Hits(
        np.empty(shape, np.int32),
        np.empty(shape, np.float32),
        np.empty((*shape, 3), np.float32),
        np.empty((*shape, 3), np.float32),
        np.empty(shape, np.int32),
        np.empty((*shape, 2), np.float32),
    )
    caster.trace_truth(*placed, *found)
    if lens.outside is not None:
        found.geom[lens.outside] = found.triangle[lens.outside] = -1
        found.distance[lens.outside] = np.inf
        found.point[lens.outside] = found.normal[lens.outside] = np.nan
    return found


def trace_truth(
    caster: _core.Caster,
    placed: tuple[F64, F64, F64, F64, F64, F64],
    scene: SceneModel,
    camera: CameraModel,
    lens: Lens,
    snapshot: SceneSnapshot,
    pose: CameraPose,
    previous: Instant | None,
) -> GroundTruth:
    """Compute the ground truth of one instant.

    Args:
        caster: The native tracer.
        placed: `snapshot` and `pose` as Caster.render takes them.
        scene: What is seen.
        camera: The optics.
        lens: Their map.
        snapshot: The world at the instant.
        pose: Where the camera is.
        previous: An earlier instant, since which the flow is; None: there is no flow.

    Raises:
        EvsError: `previous` is not earlier than `snapshot`.
    """
    found = trace_hits(caster, placed, (camera.height, camera.width), lens)
    hit, turn = found.geom >= 0, pose.mat.reshape(3, 3)
    missing, nothing = np.float32(np.inf), np.float32(np.nan)
    position = found.point @ turn.T + pose.pos
    if previous is None:
        flow = np.full((*hit.shape, 2), nothing)
    else:
        flow = optical_flow(found, scene, camera, (snapshot, pose), previous)
    return GroundTruth(
        t_us=snapshot.t_us,
        depth=np.where(hit, -found.point[..., 2], missing),
        distance=found.distance,
        normal=np.where(hit[..., None], found.normal @ turn.T, nothing).astype(np.float32),
        position=np.where(hit[..., None], position, nothing).astype(np.float32),
        geom_id=_look_up(scene.geom_id, found.geom),
        body_id=_look_up(scene.geom_body, found.geom),
        flow=flow,
    )


def optical_flow(
    found: Hits, scene: SceneModel, camera: CameraModel, now: Instant, before: Instant
) -> F32:
    """(h, w, 2) px/s: where the point seen now was before, divided by the time since then."""
    elapsed_us = now[0].t_us - before[0].t_us
    if elapsed_us <= 0:
        raise EvsError(
            f"optical flow from {before[0].t_us} us to {now[0].t_us} us: the previous snapshot "
            "must be the earlier one"
        )
    turns, shifts, still = _motions(now, before, scene.stretching)
    points = found.point.reshape(-1, 3).astype(np.float64)
    moved = points.copy()
    geom = found.geom.ravel()
    deforming = {mesh: place for place, mesh in enumerate(scene.deforming)}
    for pixels in _groups(geom):
        index = geom[pixels[0]]
        if not still[index]:
            moved[pixels] = points[pixels] @ turns[index].T + shifts[index]
        mesh = int(scene.geom_mesh[index]) if index >= 0 else -1
        if mesh in deforming:
            place = deforming[mesh]
            corners = scene.meshes[mesh].faces[found.triangle.ravel()[pixels]]
            step = before[0].deformed[place].vertices.astype(np.float64)
            step -= now[0].deformed[place].vertices
            shares = found.barycentric.reshape(-1, 2)[pixels].astype(np.float64)
            shares = np.column_stack([1.0 - shares.sum(1), shares])
            local = (shares[..., np.newaxis] * step[corners]).sum(1)
            frame = before[1].mat.reshape(3, 3).T @ before[0].geom_mat[index].reshape(3, 3)
            moved[pixels] += local @ frame.T
    shift = project(camera, points) - project(camera, moved)
    if camera.orthographic:
        shift[geom < 0] = 0.0
    return (shift / (elapsed_us * 1e-6)).reshape(*found.geom.shape, 2).astype(np.float32)


def _motions(now: Instant, before: Instant, stretching: I32) -> tuple[F64, F64, F64]:
    """Of each geom, and last of what lies at infinity: from a point now to where it was before.

    Returns:
        Rotations (ng + 1, 3, 3) and shifts (ng + 1, 3), both in the cameras' frames, and (ng + 1)
        whether nothing moved at all.
    """
    (shot, pose), (shot_before, pose_before) = now, before
    camera, camera_before = pose.mat.reshape(3, 3), pose_before.mat.reshape(3, 3)
    mat, mat_before = shot.geom_mat.reshape(-1, 3, 3), shot_before.geom_mat.reshape(-1, 3, 3)
    turn = mat_before @ mat.transpose(0, 2, 1)
    still = (mat == mat_before).all((1, 2)) & (shot.geom_pos == shot_before.geom_pos).all(1)
    if len(stretching):
        turn[stretching] = _stretches(shot, shot_before, stretching)
        still[stretching] &= shot.stretched[:, 1] == shot_before.stretched[:, 1]
    # differences first: far from the origin nothing is lost
    arm = (turn @ (pose.pos - shot.geom_pos)[..., np.newaxis])[..., 0]
    shifts = (arm + shot_before.geom_pos - pose_before.pos) @ camera_before
    turns = camera_before.T @ np.concatenate([turn, np.eye(3)[np.newaxis]]) @ camera
    at_rest = np.array_equal(camera, camera_before)
    with_place = at_rest and np.array_equal(pose.pos, pose_before.pos)
    return turns, np.vstack([shifts, np.zeros(3)]), np.append(still & with_place, at_rest)


def _stretches(now: SceneSnapshot, before: SceneSnapshot, rows: I32) -> F64:
    """(ns, 3, 3) from offsets now to those before, of capsules that stretch and do not twist."""
    axis, was = now.geom_mat[rows, 2::3], before.geom_mat[rows, 2::3]
    half, half_was = now.stretched[:, 1].astype(np.float64), before.stretched[:, 1]
    ratio = np.divide(half_was, half, out=np.ones(len(rows)), where=half > 0)
    # the shortest turn of one axis into the other; 1e-12: they are opposite
    cross = np.cross(axis, was)
    x, y, z = cross.T
    none = np.zeros(len(rows))
    skew = np.stack([none, -z, y, z, none, -x, -y, x, none], 1).reshape(-1, 3, 3)
    share = 1.0 / np.maximum(1.0 + (axis * was).sum(1), 1e-12)
    turn = np.eye(3) + skew + skew @ skew * share[:, np.newaxis, np.newaxis]
    along = axis[:, :, np.newaxis] * axis[:, np.newaxis, :]
    return np.asarray(turn @ (np.eye(3) + along * (ratio - 1.0)[:, np.newaxis, np.newaxis]))


def _groups(index: I32) -> list[I32]:
    """Places of equal values, one array each."""
    order = np.argsort(index, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(index[order])) + 1)


def _look_up(table: I32, index: I32) -> I32:
    """table[index], -1 where the index is -1 or there is no table."""
    if not len(table):
        return np.full_like(index, -1)
    return np.append(table, np.int32(-1)).astype(np.int32)[index]
