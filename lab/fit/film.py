"""Light between the intensity frames of a recording, by optical flow.

The only door to OpenCV. Frames at 25 Hz miss how an edge moves from one to the next; a straight
line between them would fade the edge out here and in there. So each frame is moved along its flow
(dense inverse search: Kroeger et al., ECCV 2016) and the two are blended, as in Super SloMo (Jiang
et al., CVPR 2018) without its networks.
"""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np

from evs.emulator.base.scene import F32
from evs_lab.fit.frames import FEWEST_PIXELS, WHITE, FrameLight, standing
from evs_lab.fit.observed import F64

STEP_PX = 0.5
"""farthest that light moves from one picture to the next"""

MOVED = 0.999
"""of the pixels: what moves farther is taken for a fault of the flow"""

SMALLEST_PX = 32
"""side of frames in which flow can be found"""

BENT = 4.4
"""medians: three standard deviations"""

NOISY, FAR = 1.5, 6.0
"""deviation of a pixel in frames and its farthest frame, in deviations of the frames' noise"""


class Film:
    """Pictures of the light that the frames of a recording show, fine in time."""

    def __init__(self, frames: FrameLight, shape: tuple[int, int], dark: float, theta: float):
        """Find how far everything moves.

        Args:
            frames: Two or more, of `frame_light`; noise of pixels that stand is taken out.
            shape: Height and width of the sensor, px.
            dark: Dark level of the frames, of white 255.
            theta: Threshold of the pixels, log units: what moves less may be noise.
        """
        dn = frames.dn.copy()
        _without_noise(dn, dark, theta)
        # half a step of the converter: black has no logarithm
        self._light = (np.maximum(dn - dark, 0.0) + 0.5).reshape(-1, *shape)
        self._codes = np.sqrt(self._light * (255.0 * 255.0 / WHITE)).clip(0, 255).astype(np.uint8)
        self._still = min(shape) < SMALLEST_PX
        self._flow = lru_cache(maxsize=6)(self._find_flow)
        self._calm = lru_cache(maxsize=3)(self._find_calm)
        grid = np.meshgrid(*(np.arange(side, dtype=np.float32) for side in shape[::-1]))
        self._grid = np.stack(grid, axis=-1)
        steps = [self._steps(k) for k in range(len(dn) - 1)]
        self._place = [(k, j / n) for k, n in enumerate(steps) for j in range(n)]
        self._place.append((len(dn) - 2, 1.0))
        late = frames.mid_us - frames.mid_us[0]
        self.t_us: F64 = np.array(
            [late[k] + share * (late[k + 1] - late[k]) for k, share in self._place]
        ).round()
        """(pictures,) time after the middle of the first exposure, us"""

    def __len__(self) -> int:
        """Number of pictures."""
        return len(self._place)

    def __getitem__(self, index: int) -> F32:
        """(height, width) light over the dark level, DN of white 255."""
        k, s = self._place[index]
        there, back = self._flow(k, k + 1), self._flow(k + 1, k)
        before = _moved(self._calm(k), self._grid, s * s * back - s * (1.0 - s) * there)
        after = _moved(self._calm(k + 1), self._grid, (1.0 - s) * ((1.0 - s) * there - s * back))
        return np.asarray((1.0 - s) * before + s * after)

    def _find_flow(self, first: int, second: int) -> F32:
        """(height, width, 2) from where a pixel's light is in one frame to where in another."""
        if self._still:
            return np.zeros_like(self._grid)
        search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        none = np.zeros(0, np.float32)
        return np.asarray(search.calc(self._codes[first], self._codes[second], none), np.float32)

    def _steps(self, k: int) -> int:
        """Pictures from a frame to the next."""
        far = max(
            float(np.quantile(np.hypot(*np.moveaxis(self._flow(*pair), -1, 0)), MOVED))
            for pair in ((k, k + 1), (k + 1, k))
        )
        return max(1, math.ceil(far / STEP_PX))

    def _find_calm(self, k: int) -> F32:
        """(height, width) the mean of a frame and its neighbours, moved onto it: less noise.

        Light that rises or falls evenly stays; what bends farther than noise does is left alone.
        """
        frame = self._light[k]
        if k in (0, len(self._light) - 1):
            return np.asarray(frame)
        before, after = (
            _moved(self._light[j], self._grid, self._flow(k, j)) for j in (k - 1, k + 1)
        )
        bend = before + after - 2.0 * frame
        size = np.abs(bend)
        calm = np.where(size <= BENT * np.median(size), frame + bend / 3.0, frame)
        return np.asarray(calm, np.float32)


def _moved(picture: F32, grid: F32, flow: F32 | F64) -> F32:
    """The picture read where the flow of each pixel leads."""
    x, y = (np.ascontiguousarray(part, np.float32) for part in np.moveaxis(grid + flow, -1, 0))
    moved = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, np.float32)


def _without_noise(dn: F32, dark: float, theta: float) -> None:
    """Give pixels in which nothing but the noise of the frames moves their mean."""
    still = standing(dn, dark, theta)
    if still.sum() >= FEWEST_PIXELS:
        # the logarithm of dark pixels moves more
        deviation = dn.std(axis=0)
        noise = float(np.median(deviation[still]))
        most = np.abs(dn - dn.mean(axis=0)).max(axis=0)
        still |= (deviation < NOISY * noise) & (most < FAR * noise)
        dn[:, still] = dn[:, still].mean(axis=0)
