"""Drawing: pyrender's renderer with a shader, lights, textures and framebuffers of our own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from evs.emulator.base.scene import F32, Texture, TextureKind
from evs.emulator.render.raster.context import NO_GL, Context, GlLibrary, one_line
from evs.emulator.render.raster.drawing import CUBE, FLAT, Uniforms, linear_texels, smaller_versions
from evs.msgs import EvsError


class Canvas:
    """pyrender's renderer with another shader, any number of lights and a float framebuffer."""

    def __init__(
        self, library: GlLibrary, width: int, height: int, samples: int, lights: int
    ) -> None:
        """A context of its own. samples: per pixel, 1 is the pixel's centre."""
        self.gl, self._size = library.gl, (width, height)
        self._program: Any = None
        self._textures: list[int] = []
        self._places: dict[str, int] = {}
        self._materials: dict[Any, tuple[Uniforms, int]] = {}
        self.renderer = renderer = library.pyrender.Renderer(width, height)
        # FAULT: 8 bits a channel, clamped and gamma-coded: 32-bit floats instead, linear
        renderer._configure_main_framebuffer = self._make_framebuffers
        renderer._read_main_framebuffer = lambda *_: None
        # FAULT: four lights of a kind, all inverse-square, and textures decoded after filtering
        renderer._get_primitive_program = lambda *_: self._program
        renderer._bind_lighting = lambda _scene, _program, node, _flags: self._bind(node)
        # FAULT: opaque meshes are drawn by distance, and the first of those that coincide is seen
        nearest_last = renderer._sorted_mesh_nodes
        renderer._sorted_mesh_nodes = lambda scene: self._in_order(nearest_last(scene))
        self.context = Context(library)
        try:
            with self.context:
                most = int(self.gl.glGetIntegerv(self.gl.GL_MAX_SAMPLES))
                self._samples = 0 if samples == 1 else min(samples, most)
                self._program = self._build(library, max(1, lights))
                self._make_framebuffers()
        except BaseException as reason:
            self.context.destroy()
            if isinstance(reason, self.gl.GLError):
                raise EvsError(NO_GL.format(f"this one cannot ({one_line(reason)})")) from None
            raise

    def _build(self, library: GlLibrary, lights: int) -> Any:
        """Compile and link shade.vert and shade.frag."""
        gl = self.gl
        program = library.shader_program.ShaderProgram("shade.vert", "shade.frag")
        # FAULT: PyOpenGL validates at once, when no framebuffer is bound, which Mesa calls an error
        program._program_id = gl.glCreateProgram()
        program._vao_id = gl.glGenVertexArrays(1)
        for suffix, kind in ((".vert", gl.GL_VERTEX_SHADER), (".frag", gl.GL_FRAGMENT_SHADER)):
            source = Path(__file__).with_name(f"shade{suffix}").read_text(encoding="utf-8")
            shader = gl.glCreateShader(kind)
            gl.glShaderSource(shader, source.replace("LIGHTS]", f"{lights}]"))
            gl.glCompileShader(shader)
            gl.glAttachShader(program._program_id, shader)
            gl.glDeleteShader(shader)
        gl.glLinkProgram(program._program_id)
        if not gl.glGetProgramiv(program._program_id, gl.GL_LINK_STATUS):
            log = gl.glGetProgramInfoLog(program._program_id)
            reason = log.decode(errors="replace") if isinstance(log, bytes) else str(log)
            raise EvsError(NO_GL.format(f"its compiler refuses ({one_line(reason)})"))
        return program

    def _make_framebuffers(self) -> None:
        """One to draw into, one to read from; under pyrender's names, since it frees them."""
        renderer, gl = self.renderer, self.gl
        if renderer._main_fb is not None:
            return
        for suffix, samples in (("", 0), ("_ms", self._samples)):
            colour, depth = (int(name) for name in gl.glGenRenderbuffers(2))
            frame = gl.glGenFramebuffers(1)
            gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, frame)
            for buffer, form, role in (
                (colour, gl.GL_RGBA32F, gl.GL_COLOR_ATTACHMENT0),
                (depth, gl.GL_DEPTH_COMPONENT32F, gl.GL_DEPTH_ATTACHMENT),
            ):
                gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, buffer)
                gl.glRenderbufferStorageMultisample(gl.GL_RENDERBUFFER, samples, form, *self._size)
                gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, role, gl.GL_RENDERBUFFER, buffer)
            setattr(renderer, f"_main_fb{suffix}", frame)
            setattr(renderer, f"_main_cb{suffix}", colour)
            setattr(renderer, f"_main_db{suffix}", depth)
        renderer._main_fb_dims = self._size

    def add_texture(self, texture: Texture) -> int:
        """Upload an image as linear floats, with its smaller versions; its OpenGL name."""
        gl = self.gl
        cube = texture.kind is not TextureKind.FLAT
        kind = gl.GL_TEXTURE_CUBE_MAP if cube else gl.GL_TEXTURE_2D
        first = gl.GL_TEXTURE_CUBE_MAP_POSITIVE_X if cube else gl.GL_TEXTURE_2D
        wrap = gl.GL_CLAMP_TO_EDGE if cube else gl.GL_REPEAT
        name = int(gl.glGenTextures(1))
        gl.glActiveTexture(gl.GL_TEXTURE0 + (CUBE if cube else FLAT))
        gl.glBindTexture(kind, name)
        for face, image in enumerate(texture.data if cube else texture.data[np.newaxis]):
            # FAULT: Mesa's own smaller versions are no means where a size is odd
            levels = smaller_versions(linear_texels(image, texture.srgb))
            for level, texels in enumerate(levels):
                gl.glTexImage2D(
                    first + face, level, gl.GL_RGB32F, texels.shape[1], texels.shape[0], 0,
                    gl.GL_RGB, gl.GL_FLOAT, texels,
                )  # fmt: skip
        gl.glTexParameteri(kind, gl.GL_TEXTURE_MIN_FILTER, gl.GL_LINEAR_MIPMAP_LINEAR)
        gl.glTexParameteri(kind, gl.GL_TEXTURE_MAG_FILTER, gl.GL_LINEAR)
        gl.glTexParameteri(kind, gl.GL_TEXTURE_WRAP_S, wrap)
        gl.glTexParameteri(kind, gl.GL_TEXTURE_WRAP_T, wrap)
        self._textures.append(name)
        return name

    def set_uniforms(self, uniforms: Uniforms) -> None:
        """Values of the uniforms by name; (n, 3) is an array of vectors, (n, 1) of numbers."""
        gl, program = self.gl, self._program._program_id
        gl.glUseProgram(program)
        for name, value in uniforms.items():
            if name not in self._places:
                self._places[name] = gl.glGetUniformLocation(program, name)
            place, array = self._places[name], np.asarray(value)
            if array.dtype.kind != "f":
                gl.glUniform1iv(place, array.size, np.ascontiguousarray(array, np.int32))
            elif array.ndim:
                put = gl.glUniform3fv if array.shape[-1] == 3 else gl.glUniform1fv
                count = array.size // array.shape[-1]
                put(place, count, np.ascontiguousarray(array, np.float32))
            else:
                gl.glUniform1f(place, float(array))

    def paint(self, node: Any, material: Uniforms, texture: int) -> None:
        """What a node of the scene looks like; texture: its OpenGL name, 0 none."""
        self._materials[node] = material, texture

    def _bind(self, node: Any) -> None:
        gl, (material, texture) = self.gl, self._materials[node]
        gl.glDepthFunc(gl.GL_LEQUAL)
        if texture:
            unit = material["texture_kind"]
            gl.glActiveTexture(gl.GL_TEXTURE0 + unit)
            gl.glBindTexture(gl.GL_TEXTURE_CUBE_MAP if unit == CUBE else gl.GL_TEXTURE_2D, texture)
        self.set_uniforms(material)

    def _in_order(self, nodes: list[Any]) -> list[Any]:
        """Opaque meshes as they were painted, then the others as they come."""
        ranks = {node: rank for rank, node in enumerate(self._materials)}
        blended = [node for node in nodes if self._materials[node][0]["alpha"] < 1]
        return sorted(set(nodes).difference(blended), key=ranks.__getitem__) + blended

    def deform(self, node: Any, positions: F32, normals: F32) -> None:
        """Move a node's corners: (n, 3) each."""
        gl, part = self.gl, node.mesh.primitives[0]
        part.positions, part.normals = positions, normals
        if part._in_context():
            rows = np.hstack([positions, normals, part.color_0]).astype(np.float32)
            gl.glBindBuffer(gl.GL_ARRAY_BUFFER, part._buffers[0])
            gl.glBufferSubData(gl.GL_ARRAY_BUFFER, 0, rows.nbytes, rows)

    def draw(self, scene: Any, flags: int, out: F32, single: bool) -> None:
        """Draw.

        Args:
            scene: pyrender's.
            flags: pyrender's.
            out: Filled: (h, w) the first channel, or (h, w, 4) all of them.
            single: Whether to take one sample a pixel.
        """
        gl, renderer = self.gl, self.renderer
        self._make_framebuffers()
        drawn = renderer._main_fb_ms
        renderer._main_fb_ms = renderer._main_fb if single else drawn
        try:
            renderer.render(scene, flags)
        finally:
            renderer._main_fb_ms = drawn
        width, height = self._size
        if not single:
            gl.glBindFramebuffer(gl.GL_READ_FRAMEBUFFER, drawn)
            gl.glBindFramebuffer(gl.GL_DRAW_FRAMEBUFFER, renderer._main_fb)
            box = (0, 0, width, height)
            gl.glBlitFramebuffer(*box, *box, gl.GL_COLOR_BUFFER_BIT, gl.GL_NEAREST)
        gl.glBindFramebuffer(gl.GL_READ_FRAMEBUFFER, renderer._main_fb)
        form = gl.GL_RED if out.ndim == 2 else gl.GL_RGBA
        rows = np.empty_like(out)
        gl.glReadPixels(0, 0, width, height, form, gl.GL_FLOAT, rows)
        # OpenGL's first row is the lowest
        out[...] = rows[::-1]

    def close(self) -> None:
        """Give everything back, if it is this process's."""
        if self.context.is_inherited:
            return
        with self.context:
            self.renderer.delete()
            self._program.delete()
            if self._textures:
                # FAULT: PyOpenGL takes the names, but not their number
                self.gl.glDeleteTextures(self._textures)
        self.context.destroy()
