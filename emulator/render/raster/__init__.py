"""The `raster` renderer draws triangles with OpenGL. Only this package imports pyrender.

pyrender (its fork pyrender2 0.2.2) provides the EGL context, the scene with its buffers and the
loop over them. Its shading is replaced by ours (shade.vert, shade.frag), so the light is that of
`direct`: linear, in 32-bit floats, with any number of MuJoCo's lights, their attenuation, cones and
gloss. It does not render shadows, mirrors, image lights, fog, haze or any maps except colour.

It needs `pip install "evs[raster]"`, and either the system's libEGL and Mesa or a GPU driver. They
are imported only when a RasterRenderer is made.
"""

from evs.emulator.render.raster.renderer import RasterRenderer

__all__ = ["RasterRenderer"]
