"""Grey PNG pictures of 16 bits, from bytes."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import numpy.typing as npt


def grey_png(data: bytes, width: int, height: int) -> npt.NDArray[np.uint16] | None:
    """(height, width) pixels of a PNG file; None: it is none, of another size, or in colour."""
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data), formats=("PNG",)) as picture:
            if picture.size != (width, height) or not picture.mode.startswith("I"):
                return None
            pixels: Any = np.asarray(picture)
    except Exception:  # damaged bytes make Pillow raise a dozen kinds
        return None
    return pixels.astype(np.uint16) if pixels.shape == (height, width) else None
