"""How much noise few samples of `path` leave, beside Mitsuba 3 at as many.

Noise is the deviation of the log light of a pixel over pictures with other seeds, in thresholds of
0.2, in an 8-bit picture of mean 60; its mean over the pixels. It hides fireflies, which are rare:
they show in the deviation of the light itself, in the worst pixel. Mitsuba's samples are
independent, ours stratified.
"""

from __future__ import annotations

import numpy as np
import pytest

from reference.mitsuba_scene import mitsuba_scene, render
from reference.our_light import F64, path_batches
from reference.path_stages import PATH_STAGES, mitsuba_integrator

pytestmark = [pytest.mark.slow, pytest.mark.statistical]

PICTURES = 16
SAMPLES = (1, 4, 16)
MORE = 1.05
"""A mean of 16 deviations over 1,000 pixels and more has an error of 1 %."""

OURS = {
    "sun": (0.542, 0.163, 0.071),
    "bare_bulb": (0.640, 0.199, 0.077),
    "cone": (1.718, 1.838, 1.615),
    "bulb": (0.931, 0.250, 0.085),
    "panel": (3.129, 0.861, 0.338),
    "embers": (5.358, 3.375, 1.631),
    "dome": (1.890, 0.420, 0.163),
    "sky": (2.034, 0.405, 0.132),
    "sunset": (2.363, 0.904, 0.280),
    "mirror": (0.824, 0.311, 0.146),
    "faint_mirror": (2.767, 0.463, 0.159),
    "glossy": (2.660, 0.763, 0.334),
    "metals": (3.180, 1.147, 0.548),
    "metal_bulb": (1.096, 0.354, 0.121),
    "tiles": (1.149, 0.439, 0.188),
    "room": (2.967, 1.234, 0.569),
    "swell": (1.789, 0.579, 0.231),
    "glass": (3.350, 0.971, 0.431),
}
"""At 1, 4 and 16 samples."""
NOISIER_THAN_MITSUBA = {
    ("swell", 1),
    ("sky", 1),
    ("faint_mirror", 1),
}
"""Also at one sample: anything within 5 %."""


def noise(pictures: F64) -> float:
    dn = np.maximum(60 * pictures / pictures.mean(), 1.0)
    return float(np.std(np.log(dn), 0, ddof=1).mean() / 0.2)


def deviation(pictures: F64) -> tuple[float, float]:
    """Of a pixel's light, in the mean of the pictures: root of the mean square, and worst pixel."""
    pixels = np.std(pictures, 0, ddof=1) / pictures.mean()
    return float(np.sqrt(np.mean(pixels**2))), float(pixels.max())


@pytest.mark.parametrize("name", PATH_STAGES)
def test_few_samples_leave_no_more_noise_than_measured(name: str) -> None:
    stage = PATH_STAGES[name]()
    scene = mitsuba_scene(stage, mitsuba_integrator(name))
    theirs = [noise(render(scene, PICTURES, samples)) for samples in SAMPLES]
    mine = [noise(path_batches(stage, PICTURES, samples)) for samples in SAMPLES]
    cells = [f"{a:.2f} ({b:.2f})" for a, b in zip(mine, theirs, strict=True)]
    print(f"| {name} | {' | '.join(cells)} |")
    for samples, here, there, measured in zip(SAMPLES, mine, theirs, OURS[name], strict=True):
        assert here < MORE * measured, samples
        worse = (name, samples) in NOISIER_THAN_MITSUBA
        assert (here > there) if worse else (here < MORE * there), samples


DEVIATION = {
    "glossy": (0.115, 1.30),
    "metals": (0.378, 5.87),
    "metal_bulb": (0.371, 7.86),
    "embers": (0.214, 1.11),
}
"""Root of the mean square, and worst pixel. Of 64 pictures they spread by 2.5 % and by 9 %."""
DEVIATION_PICTURES, DEVIATION_SAMPLES = 64, 16


@pytest.mark.parametrize("name", DEVIATION)
def test_the_worst_pixel_is_no_worse_than_mitsubas(name: str) -> None:
    stage = PATH_STAGES[name]()
    scene = mitsuba_scene(stage, mitsuba_integrator(name))
    theirs = deviation(render(scene, DEVIATION_PICTURES, DEVIATION_SAMPLES))
    mine = deviation(path_batches(stage, DEVIATION_PICTURES, DEVIATION_SAMPLES))
    cells = [f"{a:.3f} ({b:.3f})" for a, b in zip(mine, theirs, strict=True)]
    print(f"{name}: root mean square {cells[0]}, worst {cells[1]}")
    measured = DEVIATION[name]
    assert mine[0] < min(1.1 * measured[0], theirs[0])
    assert mine[1] < min(1.4 * measured[1], theirs[1])
