"""The `raster` renderer: triangles drawn by OpenGL. The one door to pyrender and PyOpenGL.

pyrender, as its fork pyrender2 0.2.2 has it, brings the EGL context, the scene with its buffers and
the loop over them; its shading is replaced by ours (shade.vert, shade.frag), so that the light is
`direct`'s: linear, in 32-bit floats, MuJoCo's lights with their attenuation, cones and gloss, any
number of them. What it leaves out are shadows, mirrors, image lights, fog, haze and all maps but
the colour.

It needs `pip install "evs[raster]"` and the system's libEGL and Mesa, or a GPU's driver. Nothing of
them is imported before a RasterRenderer is made.
"""

from evs.emulator.render.raster.renderer import RasterRenderer

__all__ = ["RasterRenderer"]
