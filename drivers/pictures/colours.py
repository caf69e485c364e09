"""The colours of every picture: one pair for the two polarities, grey for everything else."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

U8 = npt.NDArray[np.uint8]
"""Pictures are uint8: (h, w) grey or (h, w, 3) sRGB."""

ON_RGB = (0, 114, 255)
"""Blue: the light grew. Blue and red are the field's habit; this pair differs in hue, in lightness
and along the axis that every kind of colour blindness leaves (yellow-blue, or dark-light)."""

OFF_RGB = (224, 48, 16)
"""Red with a little orange: the light fell."""

PAPER = 255
"""Grey of the page, and of pixels without light or events."""

INK = 24
"""Grey of letters."""

FAINT = 208
"""Grey of the line around a panel."""
