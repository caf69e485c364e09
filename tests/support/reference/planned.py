"""One scene for each code path of the plan, which needs that path, and the output of its run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from evs.emulator.config import (
    ApsConfig,
    CameraConfig,
    FlickerConfig,
    ImuConfig,
    ModelConfig,
    PlanConfig,
    ReadoutConfig,
    RenderConfig,
    RunConfig,
    SceneConfig,
    SensorConfig,
)
from evs.emulator.simulation.world import World
from reference.terms import TERMS

SUN = '<light type="directional" dir=".2 .3 -1" diffuse=".7 .7 .7" specular=".2 .2 .2"/>'
SCENE = """<mujoco>
  <option timestep=".001"/>
  <visual><headlight active="0"/>{visual}</visual>
  <asset>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".2 .2 .2" rgb2=".8 .8 .8" width="32"
             height="32"/>
    <material name="floor" {image} {floor}/>
    <material name="body" rgba=".8 .5 .3 {alpha}" {body}>{layers}</material>{asset}
  </asset>
  <worldbody>
    <camera name="eye" pos="0 -2 .8" xyaxes="1 0 0 0 .25 1"/>
    {lights}
    <geom type="plane" size="{size} .1" material="floor" {plane}/>
    <geom type="box" size=".3 .2 .2" pos="-.5 .4 .2" rgba=".6 .6 .6 1"/>
    <body pos="{pos}" gravcomp="1"><freejoint/>
      <geom type="capsule" size=".1 .2" euler="30 40 0" material="body"/>
      <geom type="ellipsoid" size=".12 .2 .1" pos=".1 .1 .2" material="body"/>
    </body>{more}
  </worldbody>{tail}
  <keyframe><key name="go" qvel="2 0 .3 3 5 2{rest}"/></keyframe>
</mujoco>"""
NOTHING = {
    **dict.fromkeys(("visual", "floor", "body", "layers", "asset", "plane", "more", "tail"), ""),
    "image": 'texture="tiles" texrepeat="6 6"',
    "lights": SUN,
    "size": "4 4",
    "rest": "",
    "alpha": "1",
    "pos": "-.3 0 .4",
}
SKY = """<texture type="skybox" builtin="gradient" rgb1=".9 .9 .9" rgb2=".1 .1 .1" width="16"
  height="96"/>"""
BUMPS = """<texture name="bumps" type="2d" builtin="checker" rgb1=".9 .5 .6" rgb2=".1 .5 .6"
  width="8" height="8"/>"""
CLOTH = """<flexcomp name="cloth" type="grid" count="6 6 1" spacing=".1 .1 .1" radius=".01" dim="2"
  pos=".4 .2 .6" mass="1" rgba=".9 .3 .2 1"><edge equality="true"/></flexcomp>"""
PEBBLES = "".join(
    f'<geom type="{("box", "sphere", "capsule")[k % 3]}" size=".03 .02 .04" rgba=".5 .7 .4 1"'
    f' pos="{k % 12 * 0.12 - 0.7} {k // 12 * 0.12 - 0.4} .03" euler="{7 * k} {11 * k} 0"/>'
    for k in range(144)
)
SPOTS = "".join(
    f'<light type="spot" pos="{0.3 * k - 1} .1 1.5" dir="0 0 -1" cutoff="15" diffuse=".5 .5 .5"/>'
    for k in range(7)
)
IDEAL = {
    "preset": "ideal", "width": 48, "height": 36, "pos_thres": 0.1, "neg_thres": 0.1
}  # fmt: skip


@dataclass(frozen=True)
class Film:
    """A scene, and how it is filmed."""

    xml: dict[str, str] = field(default_factory=dict)
    """the values of the fields of SCENE"""
    render: dict[str, Any] = field(default_factory=dict)
    camera: dict[str, Any] = field(default_factory=dict)
    sensor: dict[str, Any] = field(default_factory=dict)
    model: dict[str, Any] = field(default_factory=dict)

    def world(
        self, folder: Path, *, on: Sequence[str] = (), off: Sequence[str] = (), all_on: bool = False
    ) -> World:
        """Make its world, with code paths forced on or off.

        Args:
            folder: The folder that its MJCF file is written to.
            on: Code paths that are forced on.
            off: Code paths that are forced off.
            all_on: Whether all code paths are on.
        """
        file = folder / "scene.xml"
        file.write_text(SCENE.format(**{**NOTHING, **self.xml}))
        camera = {} if "distance" in self.camera else {"camera": "eye"}
        return World.from_config(
            RunConfig(
                scene=SceneConfig(file=str(file), keyframe="go", **camera),
                camera=CameraConfig(**self.camera),
                sensor=SensorConfig(**{**IDEAL, **self.sensor}),
                render=RenderConfig(**{"spp": 2, **self.render}),
                model=ModelConfig(**self.model),
                plan=PlanConfig(all_on, tuple(on), tuple(off)),
                seed=3,
                threads=1,
            )
        )


PLAIN = Film()
"""needs only what every film here has: a shadow, and a floor with an image"""

PATH: dict[str, Any] = {"renderer": "path", "spp": 2}

NEEDS = {
    "colour": Film({"lights": SUN.replace(".7 .7 .7", ".9 .3 .1")}),
    "physical_gloss": Film({"body": 'metallic="1" roughness=".3"'}),
    # a horizontal light without shadows, whose shading depends on the bent normals
    "normal_maps": Film(
        {
            "asset": BUMPS,
            "layers": '<layer texture="bumps" role="normal"/>',
            "lights": SUN.replace("-1", "0").replace("/>", ' castshadow="false"/>'),
        }
    ),
    "texture_filter": PLAIN,
    "outlines": PLAIN,
    "sky": Film({"asset": SKY}),
    "fog": Film(
        {"visual": '<map fogstart=".2" fogend=".6"/><rgba fog=".9 .9 .9 1"/>'}, {"fog": True}
    ),
    "haze": Film({"asset": SKY, "size": "0 0", "visual": '<map haze=".9" zfar="5"/>'}),
    "shadows": PLAIN,
    # the floor stands between the lamp and the body
    "plane_shadows": Film(
        {"lights": SUN.replace('dir=".2 .3 -1"', 'dir=".2 .3 1"') + SUN.replace(".7", ".1")}
    ),
    "glowing": Film({"body": 'emission="1"'}, {**PATH, "bounces": 0}),
    "transparent": Film({"alpha": ".4"}, PATH),
    "cached_light": Film({}, {"renderer": "hybrid", "spp": 1}),
    "hierarchy": Film({"more": PEBBLES}),
    "light_reach": Film({"lights": SPOTS}),
    "light_gains": Film({}, {"flicker": (FlickerConfig(hz=60.0),)}),
    "lens": Film(
        {}, {}, {"distortion_model": "plumb_bob", "distortion": (-0.2, 0.0, 0.0, 0.0, 0.0)}
    ),
    "vignetting": Film({}, {}, {"vignetting_polynomial": (-0.9,)}),
    "full_retrace": PLAIN,
    "refits": Film({"more": CLOTH, "rest": " 1 0 -3" * 36}),
    "ground_truth": Film({}, {}, {}, {}, {"labels": True}),
    **{name: Film(sensor=keys) for name, keys in TERMS.items()},
    "rate_spread": Film(sensor={"leak_rate_hz": 50.0, **TERMS["rate_spread"]}),
    "running_mean": Film({}, {}, {}, {}, {"name": "adaptive"}),
    "causes": Film({}, {}, {}, {}, {"labels": True}),
    "readout": Film(sensor={"readout": ReadoutConfig(order="scan", scan_us=400)}),
    "aps": Film(sensor={"aps": ApsConfig(enabled=True, rate_hz=200.0, exposure_us=2000)}),
    "imu": Film(sensor={"imu": ImuConfig(enabled=True, rate_hz=1000.0)}),
}
"""code path -> a film that needs it; the network has tests of its own"""


def told(world: World, ticks: int) -> list[tuple[bytes, ...]]:
    """Return the output of a run, tick by tick: events, labels, frames, IMU samples."""
    (camera,) = world.cameras
    given = []
    for _ in range(ticks):
        (packet,) = world.step()
        labels = b"" if packet.labels is None else packet.labels.tobytes()
        frames = b"".join(frame.pixels.tobytes() for frame in camera.frames)
        given.append((packet.events.tobytes(), labels, frames, camera.imu.tobytes()))
    return given
