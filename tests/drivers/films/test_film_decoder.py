"""Pictures without colour take a short cut: the bytes are those of the conversion."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from evs.drivers.films.decoder import NEUTRAL, PLANAR, Decoder
from reference.foreign_films import ffmpeg, lossless, texture

HOW = av.video.reformatter.Interpolation
EXACT = HOW.BILINEAR | HOW.ACCURATE_RND | HOW.BITEXACT | HOW.FULL_CHR_H_INT | HOW.FULL_CHR_H_INP
RANDOM = np.random.default_rng(7)


@pytest.fixture
def decoder(tmp_path: Path) -> Any:
    """Of any film: frames are handed to it."""
    with Decoder(lossless(tmp_path / "any.mkv", texture(2))) as opened:
        yield opened


def frame(name: str, width: int, height: int, how: tuple[int, int]) -> Any:
    """Random luma in neutral chroma; what lies behind the end of a line is random, too."""
    made = av.VideoFrame(width, height, name)
    made.colorspace, made.color_range = how
    for number, plane in enumerate(made.planes):
        values = RANDOM.integers(0, 256, (plane.height, plane.line_size)).astype(np.uint8)
        if number:
            values[:, : plane.width] = NEUTRAL
        plane.update(values)
    return made


def converted(shown: Any) -> Any:
    return shown.to_ndarray(format="rgb24", interpolation=int(EXACT), threads=1)


@pytest.mark.parametrize("name", PLANAR)
@pytest.mark.parametrize("how", [(2, 0), (1, 1), (5, 2), (9, 1)])
def test_grey_in_colour_has_the_bytes_of_the_conversion(
    decoder: Any, name: str, how: tuple[int, int]
) -> None:
    for width, height in ((346, 260), (33, 17), (7, 5)):
        shown = frame(name, width, height, how)
        found = decoder._grey(shown)
        assert found is not None
        assert found.shape == (height, width, 3)
        assert np.array_equal(found, converted(shown))
        assert np.array_equal(decoder._pixels(shown), converted(shown))


@pytest.mark.parametrize("place", [(0, 0), (3, 2), (-1, -1)])
@pytest.mark.parametrize("plane", [1, 2])
def test_one_coloured_pixel_is_no_grey(decoder: Any, plane: int, place: tuple[int, int]) -> None:
    shown = frame("yuv420p", 33, 17, (1, 1))
    chroma = shown.planes[plane]
    values = np.full((chroma.height, chroma.line_size), NEUTRAL, np.uint8)
    values[:, : chroma.width][place] = NEUTRAL + 40
    chroma.update(values)
    assert decoder._grey(shown) is None
    found = decoder._pixels(shown)
    assert np.array_equal(found, converted(shown))
    assert np.any(found[:, :, 0] != found[:, :, 2])


@pytest.mark.parametrize("options", [(), ("-pix_fmt", "yuv420p"), ("-pix_fmt", "yuv422p")])
@pytest.mark.parametrize("is_grey", [True, False])
def test_a_film_has_the_bytes_of_the_conversion(
    tmp_path: Path, options: tuple[str, ...], is_grey: bool
) -> None:
    frames = texture(5, 70, 50)
    if not is_grey:
        frames = np.stack([frames, frames[:, ::-1], frames[:, :, ::-1]], axis=-1)
    film = ffmpeg(tmp_path / "film.mp4", frames, 100, "-c:v", "libx264", *options)
    with Decoder(film) as opened, av.open(str(film)) as container:
        ours = [picture.pixels for picture in opened.pictures()]
        theirs = [converted(one) for one in container.decode(video=0)]
        # the film is what the test means: grey ones took the short cut
        assert bool(opened._greys) == is_grey
    # after the file is closed: pictures keep what they need
    assert len(ours) == len(theirs) == 5
    for found, expected in zip(ours, theirs, strict=True):
        assert np.array_equal(found, expected)
