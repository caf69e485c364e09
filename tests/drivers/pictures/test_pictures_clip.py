"""Previews, clips and the files they become: sizes, legends, frame times, palettes."""

import itertools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evs.drivers.pictures import (
    Playback,
    Shot,
    clip_frames,
    need_video,
    preview,
    shot_times,
    span_us,
    speed_words,
    suffix_of,
    write_gif,
    write_mp4,
    write_png,
)
from evs.drivers.pictures.image_files import GREY_LEVELS, gif_palette
from evs.msgs import EvsError, empty_events, make_events
from evs.msgs.pictures import OFF_RGB, ON_RGB

SIZES = [(1, 1), (1, 200), (200, 1), (32, 24), (346, 260), (640, 480), (1280, 720)]


def mask(picture: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """(h, w) True where the picture has exactly this colour."""
    return np.all(picture == np.array(colour, np.uint8), axis=2)


def moving_dot(count: int = 200) -> np.ndarray:
    """An event every 10 ms of 2 s, its column counting up."""
    steps = np.arange(1, count + 1)
    return make_events(steps * 10_000, steps % 32, steps % 24, steps % 2)


# preview


@pytest.mark.parametrize(("width", "height"), SIZES)
@pytest.mark.parametrize("title", ["", "humanoid.xml seen by davis346"])
def test_captions_and_legend_are_inside_the_page(width: int, height: int, title: str) -> None:
    shots = [Shot(end_us, 10_000, empty_events()) for end_us in (500_000, 1_000_000, 1_500_000)]
    page = preview(shots, width, height, title)
    # nothing touches the border, and both colours of the legend are there
    for edge in (page[0], page[-1], page[:, 0], page[:, -1]):
        assert (edge == 255).all()
    legend_on, legend_off = mask(page, ON_RGB), mask(page, OFF_RGB)
    assert legend_on.sum() == legend_off.sum() > 0
    # squares, one beside the other, ON first
    for legend in (legend_on, legend_off):
        rows, columns = np.nonzero(legend)
        assert rows.max() - rows.min() == columns.max() - columns.min()
        assert legend.sum() == (rows.max() - rows.min() + 1) ** 2
    assert np.nonzero(legend_on)[1].max() < np.nonzero(legend_off)[1].min()


def test_panels_hold_the_event_frames() -> None:
    events = make_events([1], [0], [0], [1])
    shots = [Shot(1000, 1000, events), Shot(2000, 1000, empty_events())]
    with_event = preview(shots, 2, 2, scale=300)
    without = preview([Shot(1000, 1000, empty_events()), shots[1]], 2, 2, scale=300)
    legend = mask(without, ON_RGB)
    extra = mask(with_event, ON_RGB)
    extra[legend] = False
    rows, columns = np.nonzero(extra)
    # one sensor pixel, 300 times enlarged, in the first panel
    assert extra.sum() == 300 * 300
    assert columns.max() - columns.min() == rows.max() - rows.min() == 299


def test_tall_sensors_stand_in_a_row_and_wide_ones_in_a_column() -> None:
    shots = [Shot(1000, 1000, empty_events())] * 3
    row = preview(shots, 346, 260)
    column = preview(shots, 1280, 480)
    assert row.shape[1] > 3 * 2 * 346
    assert 1280 < column.shape[1] < 2 * 1280
    assert column.shape[0] > 3 * 480


def test_background_is_shown_where_no_event_is() -> None:
    page = preview([Shot(1000, 1000, empty_events(), np.full((2, 2), 77, np.uint8))], 2, 2, scale=9)
    assert mask(page, (77, 77, 77)).sum() >= (2 * 9) ** 2


def test_shots_split_a_stretch_evenly_on_whole_ms() -> None:
    assert shot_times(0, 2_000_000) == [500_000, 1_000_000, 1_500_000]
    assert shot_times(-1000, 100_000) == [24_000, 50_000, 75_000]
    assert shot_times(1_000_000, 1_000_400) == [1_000_100, 1_000_200, 1_000_300]


# playback


def test_two_seconds_at_a_quarter_are_200_frames_in_eight_seconds() -> None:
    playback = Playback(0, 2_000_000, fps=25, speed=0.25)
    assert playback.frame_count == 200
    assert sum(playback.durations_cs()) == 800
    windows = list(playback.windows())
    assert windows[0] == (0, 10_000)
    assert windows[-1] == (1_990_000, 2_000_000)


@pytest.mark.parametrize(("fps", "speed"), [(30, 0.25), (24, 1 / 3), (50, 0.1), (7, 2.0)])
def test_windows_follow_without_gap_and_durations_add_up(fps: float, speed: float) -> None:
    playback = Playback(-1000, 1_234_000, fps=fps, speed=speed)
    windows = list(playback.windows())
    assert windows[0][0] == -1000
    assert all(a[1] == b[0] for a, b in itertools.pairwise(windows))
    assert windows[-2][1] < 1_234_000 <= windows[-1][1]
    seconds = playback.frame_count / fps
    assert abs(sum(playback.durations_cs()) / 100 - seconds) <= 0.005
    # the clip lasts as long as the speed says, to one frame
    assert abs(seconds - 1.235 / speed) <= 1 / fps + 1e-9


def test_a_window_of_ones_own_ends_with_the_frame() -> None:
    playback = Playback(0, 100_000, fps=10, speed=0.1, window_us=30_000)
    assert playback.frame_window(4) == (20_000, 50_000)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fps": 0}, "fps is 0"),
        ({"fps": float("nan")}, "fps is nan"),
        ({"speed": -1}, "speed is -1"),
        ({"speed": float("inf")}, "speed is inf"),
        ({"window_us": 0}, "window is 0 us"),
        ({"stop_us": 0}, "stop must be after start"),
        ({"speed": 1e-9}, "less than 1 us a frame"),
    ],
)
def test_what_cannot_be_played_is_refused(changes: dict[str, float], message: str) -> None:
    with pytest.raises(EvsError, match=message):
        Playback(**({"start_us": 0, "stop_us": 1000} | changes))


def test_span_takes_in_the_first_and_last_event() -> None:
    assert span_us(make_events([1000, 2001], [0, 0], [0, 0], [1, 1])) == (0, 3000)
    assert span_us(make_events([1001, 2000], [0, 0], [0, 0], [1, 1])) == (1000, 2000)
    assert span_us(make_events([0], [0], [0], [1])) == (-1000, 0)
    assert span_us(empty_events()) == (0, 1000)


@pytest.mark.parametrize(
    ("speed", "words"),
    [
        (0.25, "1/4 real time"),
        (1.0, "real time"),
        (2.0, "2x real time"),
        (0.1, "1/10 real time"),
        (1 / 3, "1/3 real time"),
        (0.3, "0.3x real time"),
        (0.0003, "0.0003x real time"),
    ],
)
def test_speed_in_words(speed: float, words: str) -> None:
    assert speed_words(speed) == words


# clip


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_frames_have_one_even_size_with_the_legend_in_it(width: int, height: int) -> None:
    frames = list(clip_frames(empty_events(), width, height, Playback(0, 30_000)))
    assert len(frames) == 3
    assert {frame.shape for frame in frames} == {frames[0].shape}
    assert frames[0].shape[0] % 2 == frames[0].shape[1] % 2 == 0
    for frame in frames:
        assert mask(frame, ON_RGB).sum() == mask(frame, OFF_RGB).sum() > 0
        # below the faint line stand the words; no letter is cut at an edge
        words = frame[int(np.nonzero((frame == 208).all(axis=(1, 2)))[0][-1]) + 1 :]
        assert len(words) > 20
        for edge in (words[0], words[-1], words[:, 0], words[:, -1]):
            assert (edge == 255).all()


def test_each_event_is_in_exactly_one_frame() -> None:
    events = moving_dot()
    legend = mask(next(clip_frames(empty_events(), 32, 24, Playback(0, 10_000), scale=1)), ON_RGB)
    for index, frame in enumerate(clip_frames(events, 32, 24, Playback(0, 2_000_000), scale=1)):
        step = index + 1
        colour = ON_RGB if step % 2 else OFF_RGB
        left = (frame.shape[1] - 32) // 2
        field = mask(frame, colour)[:24, left : left + 32]
        assert np.argwhere(field).tolist() == [[step % 24, step % 32]]
        assert mask(frame, ON_RGB)[25:].sum() == legend[25:].sum()


def test_backgrounds_are_asked_for_at_the_end_of_each_frame() -> None:
    asked: list[int] = []

    def light(end_us: int) -> np.ndarray:
        asked.append(end_us)
        return np.full((2, 2), len(asked), np.uint8)

    frames = list(clip_frames(empty_events(), 2, 2, Playback(0, 30_000), 1, light))
    assert asked == [10_000, 20_000, 30_000]
    left = (frames[0].shape[1] - 2) // 2
    assert [int(frame[0, left, 0]) for frame in frames] == [1, 2, 3]


# files


def gif_times(path: Path) -> list[int]:
    """Duration of each stored frame, ms."""
    with Image.open(path) as image:
        times = []
        for index in range(image.n_frames):
            image.seek(index)
            times.append(image.info["duration"])
        return times


@pytest.mark.slow
@pytest.mark.parametrize("fps", [25, 30])
def test_gif_has_the_frames_and_seconds_of_its_speed(tmp_path: Path, fps: int) -> None:
    playback = Playback(0, 1_000_000, fps=fps, speed=0.25)
    path = tmp_path / "new" / "folder" / "events.gif"
    write_gif(path, clip_frames(moving_dot(), 32, 24, playback), playback)
    times = gif_times(path)
    assert len(times) == 4 * fps
    assert sum(times) == 4000
    with Image.open(path) as image:
        assert image.info["loop"] == 0


@pytest.mark.slow
def test_gif_keeps_event_colours_exactly(tmp_path: Path) -> None:
    playback = Playback(0, 2_000_000)
    path = tmp_path / "events.gif"
    light = np.tile(np.linspace(0, 255, 32).astype(np.uint8), (24, 1))
    frames = list(clip_frames(moving_dot(), 32, 24, playback, background=lambda t_us: light))
    write_gif(path, frames, playback)
    with Image.open(path) as image:
        for index in (0, 1, 77, 199):
            image.seek(index)
            shown = np.asarray(image.convert("RGB"))
            for colour in (ON_RGB, OFF_RGB):
                np.testing.assert_array_equal(mask(shown, colour), mask(frames[index], colour))
            # greys are rounded to the palette's levels, nothing else
            error = np.abs(shown.astype(int) - frames[index]).max()
            assert error <= 255 / (GREY_LEVELS - 1) / 2 + 1


def test_noise_all_over_a_still_picture_costs_little(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    grey = random.integers(0, GREY_LEVELS, (90, 120, 1)) * 255 // (GREY_LEVELS - 1)
    frames = [np.repeat(grey, 3, 2).astype(np.uint8) for _ in range(40)]
    for frame in frames:
        for colour in (ON_RGB, OFF_RGB):
            frame[random.integers(0, 90, 4), random.integers(0, 120, 4)] = colour
    sizes = []
    for count in (1, 40):
        path = tmp_path / f"{count}.gif"
        write_gif(path, iter(frames[:count]), Playback(0, count * 10_000))
        sizes.append(path.stat().st_size)
    with Image.open(tmp_path / "40.gif") as image:
        for index in (1, 20, 39):
            image.seek(index)
            shown = np.asarray(image.convert("RGB"))
            assert np.abs(shown.astype(int) - frames[index]).max() <= 3
    # a frame is the pixels that changed: 16 of 10800, and its palette
    assert sizes[1] < sizes[0] + 39 * 1000 < 10 * sizes[0]


def test_a_single_frame_is_a_gif_too(tmp_path: Path) -> None:
    playback = Playback(0, 1000)
    write_gif(tmp_path / "one.gif", clip_frames(empty_events(), 1, 1, playback), playback)
    with Image.open(tmp_path / "one.gif") as image:
        assert image.n_frames == 1


def test_the_palette_leaves_an_entry_for_unchanged_pixels() -> None:
    assert len(gif_palette()) // 3 < 256


def test_gif_limits(tmp_path: Path) -> None:
    fast = Playback(0, 1_000_000, fps=60)
    with pytest.raises(EvsError, match="at most 50 fps"):
        write_gif(tmp_path / "x.gif", clip_frames(empty_events(), 1, 1, fast), fast)
    long = Playback(0, 3_600_000_000)
    with pytest.raises(EvsError, match="360000 frames is too long"):
        write_gif(tmp_path / "x.gif", clip_frames(empty_events(), 1, 1, long), long)
    assert not (tmp_path / "x.gif").exists()


def test_png_is_bit_exact(tmp_path: Path) -> None:
    page = preview([Shot(1000, 1000, make_events([1], [1], [0], [0]))], 3, 2)
    write_png(tmp_path / "page.png", page)
    with Image.open(tmp_path / "page.png") as image:
        np.testing.assert_array_equal(np.asarray(image), page)


def test_a_path_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(EvsError, match=r"cannot write .*page\.png"):
        write_png(tmp_path / "file" / "page.png", np.zeros((2, 2, 3), np.uint8))


def test_a_picture_that_no_viewer_opens_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EvsError, match="smaller --scale"):
        write_png(tmp_path / "page.png", np.zeros((1, 20_000, 3), np.uint8))


@pytest.mark.parametrize("name", ["out.jpg", "out", "out.gift"])
def test_an_unknown_suffix_lists_what_exists(name: str) -> None:
    with pytest.raises(EvsError) as caught:
        suffix_of(Path(name))
    assert all(suffix in str(caught.value) for suffix in (".gif", ".png", ".mp4"))


def test_mp4_has_the_frames_and_the_colours(tmp_path: Path) -> None:
    playback = Playback(0, 200_000)
    frames = list(clip_frames(moving_dot(), 32, 24, playback))
    path = tmp_path / "events.mp4"
    write_mp4(path, frames, playback.fps)
    height, width = frames[0].shape[:2]
    command = [need_video(), "-v", "error", "-i", str(path), "-f", "rawvideo"]
    raw = subprocess.run([*command, "-pix_fmt", "rgb24", "-"], capture_output=True, check=True)
    film = np.frombuffer(raw.stdout, np.uint8).reshape(-1, height, width, 3)
    assert len(film) == len(frames) == 20
    # lossy, but every event pixel (enlarged 15 times) still has its colour
    for shown, wanted in zip(film, frames, strict=True):
        for colour in (ON_RGB, OFF_RGB):
            field = mask(wanted, colour)
            error = np.abs(shown[field].astype(int) - np.array(colour))
            assert np.median(error) < 12


def test_mp4_without_the_extra_names_the_pip_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(EvsError, match=r"pip install 'evs\[video\]'"):
        write_mp4(tmp_path / "x.mp4", clip_frames(empty_events(), 1, 1, Playback(0, 1000)), 25)


def test_what_ffmpeg_cannot_write_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "x.mp4").mkdir()
    with pytest.raises(EvsError, match=r"cannot write .*x\.mp4: ffmpeg: .+") as caught:
        write_mp4(tmp_path / "x.mp4", clip_frames(empty_events(), 8, 8, Playback(0, 1000)), 25)
    assert "\n" not in str(caught.value)
