"""How like a picture is to the true one, once both histograms are equalised.

Events hold no absolute light, so a reconstructed picture has an arbitrary brightness and contrast.
After equalisation only the order of its grey values is left, which every monotone change of them
keeps: it makes no difference whether the true frame is linear or logarithmic.
"""

from __future__ import annotations

import numpy as np

from evs.emulator.base.scene import F64

WINDOW_PX, SIGMA_PX = 11, 1.5
"""of SSIM (Wang et al., TIP 2004), as are its constants"""
GREY_DN = 255.0
"""white, for the energy of the Laplacian"""


def equalise(picture: F64, step: float) -> F64:
    """Equalise the histogram of a picture.

    Args:
        picture: (h, w) in any unit.
        step: grey values are rounded to multiples of it first, so that rounding errors in an even
            part do not become contrast.

    Returns:
        (h, w) 0 ... 1: the share of the pixels that are darker or alike, without the darkest. A
        picture of one grey is 0.5.
    """
    levels = np.rint(picture / step)
    _, inverse, counts = np.unique(levels, return_inverse=True, return_counts=True)
    below = np.cumsum(counts)
    if len(counts) == 1:
        return np.full(picture.shape, 0.5)
    share = (below - below[0]) / (below[-1] - below[0])
    return np.asarray(share[inverse.reshape(picture.shape)])


def ssim(picture: F64, truth: F64, span: float | None = None) -> float:
    """Structural similarity with a Gaussian window, over the pixels whose window is complete.

    Args:
        picture: (h, w), 11 x 11 px or more.
        truth: (h, w).
        span: the full scale, from black to white; the truth's own where it is not given.
    """
    span = float(np.ptp(truth)) if span is None else span
    c1, c2 = (0.01 * span) ** 2, (0.03 * span) ** 2
    one, two = _blurred(picture), _blurred(truth)
    var_one = _blurred(picture * picture) - one * one
    var_two = _blurred(truth * truth) - two * two
    both = _blurred(picture * truth) - one * two
    likeness = (2 * one * two + c1) * (2 * both + c2)
    return float(np.mean(likeness / ((one**2 + two**2 + c1) * (var_one + var_two + c2))))


def correlation(picture: F64, truth: F64) -> float:
    """Pearson's correlation; 0 where one of the two has no contrast."""
    own, true = picture - picture.mean(), truth - truth.mean()
    scale = float(np.sqrt(np.mean(own**2) * np.mean(true**2)))
    return float(np.mean(own * true)) / scale if scale else 0.0


def laplacian_energy(picture: F64) -> float:
    """LPA: energy of the image Laplacian (Subbarao, Choi, Nikzad 1993), mean over the pixels.

    The Laplacian is the sum of the four neighbours less four times the pixel; the outermost pixels
    have none.

    Args:
        picture: (h, w) 0 ... 1.

    Returns:
        DN^2, of grey values 0 ... 255.
    """
    grey = GREY_DN * picture
    middle = grey[1:-1, 1:-1]
    around = grey[:-2, 1:-1] + grey[2:, 1:-1] + grey[1:-1, :-2] + grey[1:-1, 2:]
    return float(np.mean((around - 4 * middle) ** 2))


def _blurred(picture: F64) -> F64:
    """The Gaussian mean around each pixel whose window lies inside the picture."""
    away = np.arange(WINDOW_PX) - WINDOW_PX // 2
    weights = np.exp(-0.5 * (away / SIGMA_PX) ** 2)
    weights /= weights.sum()
    windows = np.lib.stride_tricks.sliding_window_view
    rows = windows(picture, WINDOW_PX, axis=0) @ weights
    return np.asarray(windows(rows, WINDOW_PX, axis=1) @ weights)
