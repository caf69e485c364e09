"""Height fields as meshes: closed, turned outwards, and where MuJoCo's own rays meet them."""

from __future__ import annotations

from collections import Counter

import mujoco
import numpy as np
import pytest

from evs.emulator.base.scene import Shape
from evs.emulator.world import extract_scene

ROWS, COLUMNS = 5, 7


@pytest.fixture(scope="module")
def field():
    rng = np.random.default_rng(3)
    values = " ".join(f"{v:.4f}" for v in rng.uniform(size=ROWS * COLUMNS))
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><hfield name="h" nrow="{ROWS}" ncol="{COLUMNS}" size="3 2 .8 .3"
        elevation="{values}"/></asset>
        <worldbody><geom type="hfield" hfield="h"/></worldbody></mujoco>"""
    )
    scene = extract_scene(model)
    assert scene.geom_type[0] == Shape.HFIELD
    return model, scene.meshes[scene.geom_mesh[0]]


def test_every_edge_belongs_to_two_faces_in_opposite_directions(field):
    faces = field[1].faces
    edges = Counter(
        (int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True)
    )
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)


def test_it_encloses_its_volume_from_outside(field):
    model, mesh = field
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(float) for k in range(3))
    volume = (a * np.cross(b, c)).sum() / 6
    height = model.hfield_data.reshape(ROWS, COLUMNS) * 0.8 + 0.3
    # each triangle's column has the mean of its corners' heights
    corners = height[:-1, :-1], height[:-1, 1:], height[1:, 1:], height[1:, :-1]
    lower = (corners[0] + corners[1] + corners[2]) / 3
    upper = (corners[0] + corners[2] + corners[3]) / 3
    cell = 6.0 / (COLUMNS - 1) * 4.0 / (ROWS - 1)
    assert volume == pytest.approx((lower + upper).sum() * cell / 2, rel=1e-6)


def test_mujocos_rays_meet_the_same_surface(field):
    model, mesh = field
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(float) for k in range(3))
    rng = np.random.default_rng(5)
    hits = np.zeros(1, np.int32)
    for x, y in rng.uniform((-2.9, -1.9), (2.9, 1.9), (200, 2)):
        origin = np.array([x, y, 5.0])
        distance = mujoco.mj_ray(model, data, origin, np.array([0, 0, -1.0]), None, 1, -1, hits)
        # the highest triangle over (x, y), by its edges seen from above
        over = np.ones(len(a), bool)
        for p, q in ((a, b), (b, c), (c, a)):
            over &= (q - p)[:, 0] * (y - p[:, 1]) - (q - p)[:, 1] * (x - p[:, 0]) > 0
        (above,) = np.flatnonzero(over)
        normal = np.cross(b[above] - a[above], c[above] - a[above])
        z = a[above][2] - (normal[:2] @ ((x, y) - a[above][:2])) / normal[2]
        assert 5.0 - distance == pytest.approx(z, abs=1e-5)
