"""A stage with one of everything, and edits of its model that change the picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import mujoco
import numpy as np

STAGE = """
<mujoco>
  <option timestep=".001" gravity="0 0 0"/>
  <visual>
    <headlight ambient=".1 .1 .1" diffuse=".2 .2 .2" specular=".1 .1 .1"/>
    <map fogstart="3" fogend="60" zfar="30"/>
  </visual>
  <statistic extent="3" center="0 0 .3"/>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".3 .5 .7" rgb2=".1 .1 .1" width="8"
      height="48"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".1 .2 .3" rgb2=".7 .8 .6" width="16"
      height="16"/>
    <texture name="hide" type="cube" builtin="gradient" rgb1=".8 .6 .4" rgb2=".2 .3 .4" width="8"
      height="48"/>
    <material name="floor" texture="tiles" texrepeat="4 4" texuniform="true" reflectance=".3"
      specular=".8" shininess=".3"/>
    <material name="tile" texture="tiles" texrepeat="3 3"/>
    <material name="hide" texture="hide" specular=".5" shininess=".4"/>
    <material name="steel" metallic=".8" roughness=".3" rgba=".7 .7 .8 1"/>
    <material name="glow" emission=".4" rgba=".9 .8 .2 1"/>
    <mesh name="wedge" vertex="0 0 0  .5 0 0  0 .5 0  0 0 .5"/>
    <mesh name="spike" vertex="0 0 0  .3 0 0  0 .3 0  0 0 .7"/>
    <hfield name="hill" nrow="5" ncol="5" size=".5 .5 .3 .1"
      elevation="0 0 0 0 0  0 .4 .5 .4 0  0 .5 1 .5 0  0 .4 .5 .4 0  0 0 0 0 0"/>
  </asset>
  <worldbody>
    <camera name="eye" pos="0 -3 1.6" xyaxes="1 0 0 0 .34 .94" fovy="50"/>
    <camera name="other" pos="1 -3 1.6" xyaxes="1 0 0 0 .47 .88"/>
    <light name="sun" type="directional" pos="0 0 4" dir=".3 .2 -1" diffuse=".3 .3 .3"
      ambient=".05 .05 .05"/>
    <light name="lamp" type="spot" pos="1 -1 2" dir="-1 1 -2" cutoff="40" exponent="4"
      diffuse=".6 .6 .6" attenuation="1 .1 0" specular=".5 .5 .5"/>
    <light name="bulb" type="point" pos="-1 -1 1.5" diffuse=".2 .2 .2" bulbradius=".1"/>
    <geom name="floor" type="plane" size="0 0 .1" material="floor"/>
    <geom name="tile" type="plane" size=".3 .3 .1" pos=".2 -1.2 .01" material="tile"/>
    <geom name="box" type="box" size=".2 .2 .2" pos="-.6 .5 .2" material="hide"/>
    <geom name="wedge" type="mesh" mesh="wedge" pos=".6 .5 .1"/>
    <geom name="spike" type="mesh" mesh="spike" pos=".9 -.3 0" material="steel"/>
    <geom name="hill" type="hfield" hfield="hill" pos="-1 -.7 0" rgba=".4 .6 .3 1"/>
    <geom name="glow" type="sphere" size=".1" pos="0 1 .6" material="glow"/>
    <geom name="ghost" type="sphere" size=".15" pos=".3 -.8 .2" group="3" rgba=".9 .1 .1 1"/>
    <body name="flier" pos="0 0 .6"><freejoint/>
      <geom name="rod" type="capsule" size=".1 .25" euler="30 40 0" rgba=".8 .3 .2 1"/>
      <geom name="pill" type="ellipsoid" size=".1 .2 .1" pos="-.25 .1 0" material="steel"/>
      <site name="hook" size=".05" pos="0 -.25 .25" rgba=".2 .2 .9 1"/>
    </body>
    <site name="eyelet" type="box" size=".05 .05 .05" pos="-.3 0 1.2" rgba=".9 .2 .2 1"/>
  </worldbody>
  <tendon>
    <spatial name="string" width=".02" rgba=".9 .9 .2 1">
      <site site="hook"/><site site="eyelet"/>
    </spatial>
  </tendon>
</mujoco>
"""

Edit = Callable[[mujoco.MjModel], None]


def stage() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The stage; something moves slowly in it."""
    model = mujoco.MjModel.from_xml_string(STAGE)
    data = mujoco.MjData(model)
    data.qvel[:] = (0.2, 0.1, 0.0, 1.0, 0.5, 0.2)
    return model, data


def put(path: str, value: object) -> Edit:
    """Sets `geom.rod.rgba`, `vis.map.haze`, ...: the value, or in an array all of it."""

    def edit(model: mujoco.MjModel) -> None:
        first, *rest = path.split(".")
        if first in ("vis", "stat"):
            place = getattr(model, first)
            for word in rest[:-1]:
                place = getattr(place, word)
            now = getattr(place, rest[-1])
            if not isinstance(now, np.ndarray):
                setattr(place, rest[-1], value)
                return
        else:
            now = getattr(model, f"{first}_{rest[1]}")[getattr(model, first)(rest[0]).id :][:1]
        now[...] = value

    return edit


def _texels(model: mujoco.MjModel) -> None:
    first = model.tex("tiles").adr[0]
    model.tex_data[first : first + 300] = 200


def _lengths(model: mujoco.MjModel) -> None:
    model.mesh_vert[model.mesh("spike").vertadr[0] :] *= 1.5


def _normals(model: mujoco.MjModel) -> None:
    model.mesh_normal[:] = (0.0, 0.0, 1.0)


def _heights(model: mujoco.MjModel) -> None:
    model.hfield_data[:] = model.hfield_data[::-1] * 0.5


SMALL: Mapping[str, Edit] = {
    "colour": put("geom.rod.rgba", (0.1, 0.9, 0.3, 1.0)),
    "see-through": put("geom.rod.rgba", (0.8, 0.3, 0.2, 0.5)),
    "invisible": put("geom.rod.rgba", (0.8, 0.3, 0.2, 0.0)),
    "size": put("geom.rod.size", (0.2, 0.3, 0.0)),
    "shape": put("geom.pill.type", int(mujoco.mjtGeom.mjGEOM_BOX)),
    "group out": put("geom.rod.group", 4),
    "group in": put("geom.ghost.group", 0),
    "other material": put("geom.box.matid", 3),
    "other mesh": put("geom.wedge.dataid", 1),
    "height of the field": put("hfield.hill.size", (0.5, 0.5, 0.6, 0.1)),
    "material's colour": put("mat.floor.rgba", (0.5, 0.6, 0.9, 1.0)),
    "material's image": put("mat.floor.texid", -1),
    "texrepeat": put("mat.floor.texrepeat", (2.0, 7.0)),
    "texuniform": put("mat.tile.texuniform", 1),
    "emission": put("mat.glow.emission", 0.9),
    "specular": put("mat.floor.specular", 0.1),
    "shininess": put("mat.floor.shininess", 0.9),
    "reflectance": put("mat.floor.reflectance", 0.0),
    "roughness": put("mat.steel.roughness", 0.8),
    "metallic": put("mat.steel.metallic", 0.1),
    "light's colour": put("light.sun.diffuse", (0.7, 0.5, 0.3)),
    "light's ambient": put("light.sun.ambient", (0.3, 0.3, 0.3)),
    "light's specular": put("light.lamp.specular", (1.0, 1.0, 1.0)),
    "light off": put("light.lamp.active", 0),
    "cutoff": put("light.lamp.cutoff", 60.0),
    "exponent": put("light.lamp.exponent", 20.0),
    "attenuation": put("light.lamp.attenuation", (1.0, 0.5, 0.2)),
    "no shadow": put("light.sun.castshadow", 0),
    "headlight's colour": put("vis.headlight.diffuse", (0.5, 0.5, 0.5)),
    "headlight's ambient": put("vis.headlight.ambient", (0.3, 0.3, 0.3)),
    "headlight's specular": put("vis.headlight.specular", (0.9, 0.9, 0.9)),
    "headlight off": put("vis.headlight.active", 0),
    "site's colour": put("site.eyelet.rgba", (0.1, 0.9, 0.9, 1.0)),
    "site's size": put("site.hook.size", (0.08, 0.08, 0.08)),
    "site's group": put("site.eyelet.group", 3),
    "tendon's colour": put("tendon.string.rgba", (0.2, 0.9, 0.2, 1.0)),
    "tendon's width": put("tendon.string.width", 0.05),
    "tendon's group": put("tendon.string.group", 4),
    "fovy": put("cam.eye.fovy", 70.0),
    "haze": put("vis.map.haze", 0.9),
    "zfar": put("vis.map.zfar", 3.0),
    "haze's colour": put("vis.rgba.haze", (0.9, 0.1, 0.1, 1.0)),
    "extent": put("stat.extent", 1.0),
    # of these the poses are read in every tick
    "camera's place": put("cam.eye.pos", (0.2, -2.8, 1.5)),
    "light's place": put("light.lamp.pos", (-1.0, -1.0, 2.0)),
    "light's direction": put("light.sun.dir", (-0.5, 0.1, -1.0)),
    "geom's place": put("geom.box.pos", (-0.3, 0.3, 0.2)),
    "geom's turn": put("geom.wedge.quat", (0.8, 0.6, 0.0, 0.0)),
}
"""seen by the next observe"""

LARGE: Mapping[str, Edit] = {
    "texels": _texels,
    "vertices": _lengths,
    "normals": _normals,
    "heights": _heights,
}
"""seen by the first observe behind a reset, and by refresh"""
