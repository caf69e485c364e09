"""A camera that creeps over a checker or a photograph, and past the outlines of shapes: events of
each renderer against the exact area that each pixel covers, in float64, or 1,024 samples of it.

lab/docs/sampling.md has the tables of
`.venv/bin/pytest -m bench -s lab/tests/bench/test_creep_study.py`.
"""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
from matplotlib.cbook import get_sample_data
from PIL import Image

import evs
from evs.msgs import Events
from evs_lab.metrics.matching import match_events

WIDTH, HEIGHT, TICKS, SETTLE_US = 64, 48, 180, 20000
FOVY, HEIGHT_M = 50.0, 0.5
XML = """<mujoco><asset>
  <texture name="checker" type="2d" builtin="checker" rgb1=".8 .8 .8" rgb2=".2 .2 .2" width="300"
    height="300"/>
  <material name="checker" texture="checker" texrepeat="8 8" specular="0" shininess="0"/>
  <material name="white" rgba="1 1 1 1" specular="0" shininess="0"/>
  <texture type="skybox" builtin="flat" rgb1=".4 .4 .4" width="8" height="48"/></asset>
  <worldbody><light pos="1 -1 3" dir="-.2 .2 -1" diffuse=".8 .8 .8"/>
  <geom type="plane" size="4 4 1" material="{}"/>
  <body name="rider" mocap="true"><camera name="eye" xyaxes="1 0 0 0 .35 1" fovy="50"/></body>
  </worldbody></mujoco>"""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)
RENDERERS = {
    "direct 1 (fast)": {"renderer": "direct", "spp": 1},
    "direct 4 (default)": {"renderer": "direct", "spp": 4, "antialiasing": "adaptive"},
    "hybrid 1": {"renderer": "hybrid", "spp": 1},
    "hybrid 4 (balanced)": {"renderer": "hybrid", "spp": 4, "antialiasing": "adaptive"},
    "hybrid 16 (accurate)": {"renderer": "hybrid", "spp": 16, "antialiasing": "fixed"},
    "path 64": {"renderer": "path", "spp": 64, "seeds": "fixed"},
}


def linear(coded: float) -> float:
    return ((round(255 * coded) / 255 + 0.055) / 1.055) ** 2.4


def film_of(xml: str, at: list[np.ndarray], zoom: int = 1, **render: object) -> np.ndarray:
    """Light of a camera at these places, (ticks, h, w), of zoom x zoom pixels for each."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    camera = evs.EventCamera(
        model, "eye", sensor=evs.SensorConfig("ideal", width=zoom * WIDTH, height=zoom * HEIGHT),
        render=evs.RenderConfig(**render),  # type: ignore[arg-type]
    )  # fmt: skip
    out = []
    for tick, position in enumerate(at):
        data.time = 1e-3 * tick
        data.mocap_pos[0] = position
        mujoco.mj_forward(model, data)
        camera.observe(data)
        light = np.array(camera.luminance, np.float64)
        out.append(light.reshape(HEIGHT, zoom, WIDTH, zoom).mean((1, 3)))
    return np.array(out)


class Creep:
    """The plane, and a camera without roll that moves forward."""

    def __init__(self, speed_m_s: float) -> None:
        self.at = [np.array([0.013, -1.2 + 1e-3 * t * speed_m_s, HEIGHT_M]) for t in range(TICKS)]
        model = mujoco.MjModel.from_xml_string(XML.format("checker"))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        self.axes = data.cam_xmat[0].reshape(3, 3)
        y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
        u, _, depth = self.floor(x, y, self.at[0])
        above = self.floor(x, y - 1, self.at[0])
        self.inside = (np.abs(u) < 3) & (depth > 0) & (above[1] < 3) & (above[2] > 0)

    def floor(self, x: np.ndarray, y: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, ...]:
        """Where points of the picture lie on the floor, m, and their depth."""
        focal = 0.5 * HEIGHT / np.tan(np.deg2rad(FOVY / 2))
        ray = np.stack([(x - WIDTH / 2) / focal, (HEIGHT / 2 - y) / focal, -np.ones_like(x)], -1)
        ray = ray @ self.axes.T
        depth = -at[2] / ray[..., 2]
        return at[0] + depth * ray[..., 0], at[1] + depth * ray[..., 1], depth

    def film(self, material: str, **render: object) -> np.ndarray:
        return film_of(XML.format(material), self.at, **render)

    def exact(self, at: np.ndarray) -> np.ndarray:
        """Mean of the checker, +-1 in squares of 0.5 m, over each pixel: exact along its rows, and
        by Gauss's rule between the lines that cross it."""

        def integral(x: np.ndarray) -> np.ndarray:
            share = np.mod(x, 1.0)
            return np.minimum(share, 1 - share)

        out, x = np.zeros((HEIGHT, WIDTH)), np.arange(WIDTH + 1.0)

        def forward(y: float) -> float:
            return float(self.floor(np.array(0.0), np.array(y), at)[1])

        for row in np.flatnonzero(self.inside.any(1)):
            low, high = sorted((forward(row), forward(row + 1)))
            cuts = [float(row), row + 1.0]
            for line in np.arange(np.ceil(2 * low), np.floor(2 * high) + 1) / 2:
                a, b = float(row), row + 1.0
                for _ in range(50):
                    middle = (a + b) / 2
                    a, b = (middle, b) if forward(middle) > line else (a, middle)
                cuts.append(a)
            cuts.sort()
            for a, b in pairwise(cuts):
                for node, weight in zip(NODES, WEIGHTS, strict=True):
                    y = (a + b + (b - a) * node) / 2
                    u, v, _ = self.floor(x, np.full(WIDTH + 1, y), at)
                    sign = 1 - 2 * (int(np.floor(2 * v[0])) & 1)
                    mean = np.diff(integral(u)) / np.diff(u)
                    out[row] += 0.5 * weight * (b - a) * sign * mean
        return out

    def events(self, film: np.ndarray) -> Events:
        return events_of(np.where(self.inside, film, 0.3))


def events_of(film: np.ndarray) -> Events:
    pixels = evs.Pixels("ideal", size=(WIDTH, HEIGHT))
    out = [
        np.array(pixels.observe(light.astype(np.float32), 1000 * (tick + 1)))
        for tick, light in enumerate(film)
    ]
    events = np.concatenate(out)
    return events[events["t"] > SETTLE_US]


def print_scores(name: str, film: np.ndarray, truth: Events, error: np.ndarray) -> float:
    """Print a row. Returns the lower of recall and precision within 3 ms."""
    events = events_of(film)
    scores = [match_events(events, truth, 1000 * ms, 1) for ms in (3, 10)]
    line = "   ".join(f"R {s.recall:.2f} P {s.precision:.2f}" for s in scores)
    rms = np.sqrt(((error / 0.2) ** 2).mean())
    print(f"  {name:22} {len(events):5} {line}   {rms:.3f}", flush=True)
    return min(scores[0].recall, scores[0].precision)


@pytest.mark.bench
@pytest.mark.slow
@pytest.mark.parametrize("speed_m_s", [0.1, 0.02])
def test_events_of_a_creep(speed_m_s: float) -> None:
    creep = Creep(speed_m_s)
    films = {name: creep.film("checker", **render) for name, render in RENDERERS.items()}
    white = creep.film("white", renderer="hybrid", spp=1)
    bright, dark = linear(0.8), linear(0.2)
    wave = np.array([creep.exact(at) for at in creep.at])
    ratio = films["path 64"][0] / white[0]
    sign = np.sign(np.corrcoef(wave[0][creep.inside], ratio[creep.inside])[0, 1])
    area = ((bright + dark) / 2 + (bright - dark) / 2 * sign * wave) * white
    truth = creep.events(area)
    print(f"\n{speed_m_s} m/s: {len(truth)} events of the exact area")
    for name, film in films.items():
        seen = np.where(creep.inside, film, 0.3)
        assert print_scores(name, seen, truth, np.log(film / area)[:, creep.inside]) > 0.75


OUTLINES = """<mujoco>
  <visual><headlight ambient=".4 .4 .4" diffuse=".3 .3 .3" specular="0 0 0"/></visual>
  <asset><texture type="skybox" builtin="flat" rgb1=".4 .4 .4" width="8" height="48"/></asset>
  <default><geom rgba=".9 .9 .9 1"/></default><worldbody>
  <light pos="1 -1 3" dir="-.2 .2 -1" diffuse=".5 .5 .5" specular="0 0 0" castshadow="{}"/>
  <geom type="plane" size="4 4 1" rgba=".2 .2 .2 1"/>
  <geom pos=".1 0 .45" {}/>
  <body name="rider" mocap="true"><camera name="eye" xyaxes="1 0 0 0 .35 1" fovy="50"/></body>
  </worldbody></mujoco>"""
SHAPES = {
    "sphere": 'type="sphere" size=".25"',
    "capsule": 'type="capsule" size=".1 .3" euler="20 40 0"',
    "ellipsoid": 'type="ellipsoid" size=".15 .25 .1" euler="60 30 0"',
    "cylinder": 'type="cylinder" size=".15 .25" euler="60 30 0"',
    "box": 'type="box" size=".2 .15 .25" euler="10 20 30"',
}


@pytest.mark.bench
@pytest.mark.slow
@pytest.mark.parametrize("shape", [*SHAPES, "shadow"])
@pytest.mark.parametrize("speed_m_s", [0.1, 0.02])
def test_events_of_an_outline(shape: str, speed_m_s: float) -> None:
    xml = OUTLINES.format(
        "true" if shape == "shadow" else "false", SHAPES.get(shape, SHAPES["box"])
    )
    at = [np.array([0.013 + 1e-3 * t * speed_m_s, -1.2, 0.5]) for t in range(TICKS)]
    # of hard light, and of soft light
    areas = {
        name: film_of(xml, at, 8, renderer=name, spp=16, antialiasing="fixed")
        for name in ("direct", "hybrid")
    }
    truths = {name: events_of(area) for name, area in areas.items()}
    print(f"\n{shape}, {speed_m_s} m/s: {[len(t) for t in truths.values()]} events")
    for name, render in RENDERERS.items():
        light = "direct" if render["renderer"] == "direct" else "hybrid"
        film = film_of(xml, at, **render)
        print_scores(name, film, truths[light], np.log(film / areas[light]))


@pytest.mark.bench
@pytest.mark.slow
@pytest.mark.parametrize("speed_m_s", [0.1, 0.02])
def test_events_of_a_photograph(speed_m_s: float, tmp_path: Path) -> None:
    # matplotlib's sample portrait lies on the floor, with 2 to 100 texels a pixel
    file = tmp_path / "photograph.png"
    with get_sample_data("grace_hopper.jpg") as portrait:
        Image.open(portrait).convert("RGB").save(file)
    xml = re.sub(r'builtin="checker"[^>]*/>', f'file="{file}"/>', XML.format("checker"))
    xml = xml.replace("8 8", "2 2")
    at = [np.array([0.013, -1.2 + 1e-3 * t * speed_m_s, HEIGHT_M]) for t in range(TICKS)]
    area = film_of(xml, at, 8, renderer="hybrid", spp=16, antialiasing="fixed")
    truth = events_of(area)
    print(f"\nphotograph, {speed_m_s} m/s: {len(truth)} events")
    for name, render in RENDERERS.items():
        film = film_of(xml, at, **render)
        print_scores(name, film, truth, np.log(film / area))
