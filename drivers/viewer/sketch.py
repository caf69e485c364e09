"""A picture of events in characters, for a terminal without a display."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from evs.drivers.viewer.time_windows import NOTHING, OFF, ON
from evs.msgs.pictures import OFF_RGB, ON_RGB

# Unicode's braille patterns: the bit of each dot of a cell of 4 rows and 2 columns
_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
_BLANK = 0x2800
_SHADES = " .:+#@"
"""Few to many dots of a cell, where there is no braille."""

_RESET = "\x1b[0m"


def sketch(
    picture: npt.NDArray[np.uint8],
    columns: int,
    rows: int,
    *,
    colours: bool = True,
    braille: bool = True,
) -> list[str]:
    """Draw a picture in characters of 2 x 4 dots each.

    A dot is set where any pixel of its part of the picture fired.

    Args:
        picture: (h, w) of NOTHING, OFF, ON (time_windows.py).
        columns: Most characters of a line.
        rows: Most lines.
        colours: Whether a character is blue or red by the majority of its dots, in ANSI's 24-bit
            colours.
        braille: Whether to use Unicode's braille patterns; if not, plain ASCII.

    Returns:
        The lines.
    """
    dots = _shrunk(picture, 2 * max(1, columns), 4 * max(1, rows))
    height, width = -(-dots.shape[0] // 4), -(-dots.shape[1] // 2)
    padded = np.full((4 * height, 2 * width), NOTHING, np.uint8)
    padded[: dots.shape[0], : dots.shape[1]] = dots
    cells = padded.reshape(height, 4, width, 2).transpose(0, 2, 1, 3)
    on, off = ((cells == kind).sum((2, 3)) for kind in (ON, OFF))
    if braille:
        codes = _BLANK + ((cells != NOTHING) * _DOTS).sum((2, 3))
        letters = [[chr(code) for code in line] for line in codes.tolist()]
    else:
        shade = -(-(on + off) * (len(_SHADES) - 1) // 8)
        letters = [[_SHADES[level] for level in line] for line in shade.tolist()]
    if not colours:
        return ["".join(line).rstrip(f" {chr(_BLANK)}") for line in letters]
    kinds = np.where(on + off == 0, NOTHING, np.where(on >= off, ON, OFF))
    return [_coloured(line, kind) for line, kind in zip(letters, kinds.tolist(), strict=True)]


def _shrunk(picture: npt.NDArray[np.uint8], width: int, height: int) -> npt.NDArray[np.uint8]:
    """At most width x height, the aspect kept; a part that any pixel fired in shows the newest."""
    factor = max(1.0, picture.shape[1] / width, picture.shape[0] / height)
    size = max(1, int(picture.shape[0] / factor)), max(1, int(picture.shape[1] / factor))
    small = np.zeros(size, np.uint8)
    y, x = np.nonzero(picture)
    places = (
        np.minimum((y / factor).astype(int), size[0] - 1),
        np.minimum((x / factor).astype(int), size[1] - 1),
    )
    small[places] = picture[y, x]
    return small


def _coloured(letters: list[str], kinds: list[int]) -> str:
    """One line; an escape stands only where the colour changes."""
    line, now = [], NOTHING
    for letter, kind in zip(letters, kinds, strict=True):
        if kind not in (NOTHING, now):
            red, green, blue = ON_RGB if kind == ON else OFF_RGB
            line.append(f"\x1b[38;2;{red};{green};{blue}m")
            now = kind
        line.append(letter)
    text = "".join(line).rstrip(f" {chr(_BLANK)}")
    return text + _RESET if now != NOTHING else text
