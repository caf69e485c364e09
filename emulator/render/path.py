"""The `path` renderer: paths of light through the native caster."""

from __future__ import annotations

import numpy as np

from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.scene import F32, I32, CameraModel, CameraPose, SceneModel, SceneSnapshot
from evs.emulator.config import RenderConfig
from evs.emulator.render.direct import DirectRenderer, LentRenderer


class PathRenderer(DirectRenderer):
    """Light that bounces: area lights, the sky, soft shadows, gloss; so many samples a pixel.

    With fixed seeds a pixel draws the same numbers in every tick, so that still light stays still;
    with fresh ones every tick has its own noise, as in the paper.
    """

    integrator = "path"

    def __init__(
        self,
        scene: SceneModel,
        camera: CameraModel,
        config: RenderConfig,
        threads: int,
        rgb: bool = False,
        seed: int = 0,
        switches: Switches = UNFORCED,
        like: DirectRenderer | None = None,
        point_set: int = 0,
    ) -> None:
        """Build the caster.

        Args:
            scene: As of DirectRenderer.
            camera: As of DirectRenderer.
            config: As of DirectRenderer.
            threads: As of DirectRenderer.
            rgb: As of DirectRenderer.
            seed: What the noise follows from.
            switches: As of DirectRenderer.
            like: As of DirectRenderer.
            point_set: Which one of the cycle's, where config.seeds is "cycle".
        """
        sets = config.cycle_ticks if config.seeds == "cycle" else 1
        parts = (scene, camera, config, threads, rgb, switches, like)
        super().__init__(*parts, point_set=(point_set, sets))
        self._seed, self._fresh = seed, config.seeds == "fresh"

    def render(self, snapshot: SceneSnapshot, pose: CameraPose, into: F32 | None = None) -> F32:
        """As of the direct renderer, with the noise of this instant."""
        self._noise = self._noise_of(snapshot)
        return super().render(snapshot, pose, into)

    def reseed(self, seed: int) -> None:
        """The noise follows from `seed` from the next call on."""
        self._seed = seed

    def trace(self, snapshot: SceneSnapshot, pose: CameraPose, pixels: I32) -> F32:
        """Trace single pixels; their luminance is the same as `render` gives them.

        Args:
            snapshot: The world at an instant.
            pose: Where the camera is.
            pixels: (n, 2) columns and rows inside the image.

        Returns:
            (n,) float32 linear luminance.
        """
        self._noise = self._noise_of(snapshot)
        return super().trace(snapshot, pose, pixels)

    def lend(self) -> LentRenderer | str:
        """As of the direct renderer."""
        if self._fresh:
            return "render.seeds is fresh"
        parts = super().lend()
        return (
            parts
            if isinstance(parts, str)
            else parts._replace(seed=self._drawn((self._seed % 2**64,)))
        )

    def _noise_of(self, snapshot: SceneSnapshot) -> int:
        # seeds may be negative, words may not
        seed, tick = self._seed % 2**64, snapshot.t_us % 2**64
        return self._drawn((seed, tick) if self._fresh else (seed,))

    @staticmethod
    def _drawn(words: tuple[int, ...]) -> int:
        drawn = np.random.SeedSequence(words).generate_state(1, np.uint32)
        return int(drawn.view(np.int32)[0])
