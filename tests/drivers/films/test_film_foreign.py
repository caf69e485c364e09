"""Films and frames of other encoders give the events of the frames that they were made of."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import cv2
import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

import evs
from evs.drivers.files import RECORDED
from evs.drivers.files.formats import endings
from evs.drivers.films.decoder import Decoder
from evs.launch.main import main
from evs.msgs import join_events
from reference.foreign_films import exr, ffmpeg, gif, lossless, motion_jpeg, texture

SMALL = ["sensor.width=64", "sensor.height=48"]
SIZE = (64, 48)


def convert(source: Path, target: Path, *words: str) -> Any:
    """The events of a film, by the command."""
    assert main(["convert", str(source), str(target), *SMALL, *words, "--quiet"]) == 0
    return evs.read(target)


def direct(frames: Any, stamps: Any, **options: Any) -> Any:
    """The events of frames, by the class."""
    pixels = evs.Pixels("davis346", SIZE, **options)
    parts = [pixels.observe(f, t) for f, t in zip(frames, stamps, strict=True)]
    return join_events([*parts, pixels.finish()])


def same(found: Any, expected: Any) -> bool:
    return len(expected) > 300 and all(
        np.array_equal(found[name], expected[name]) for name in ("t", "x", "y", "p")
    )


@pytest.mark.parametrize("colour", [False, True])
def test_a_lossless_film_gives_the_events_of_its_frames(tmp_path: Path, colour: bool) -> None:
    frames = texture(12)
    if colour:
        frames = np.stack([frames, frames[::-1], 255 - frames], axis=-1)
    film = lossless(tmp_path / "film.mkv", frames, 100)
    found = convert(film, tmp_path / "run.aedat4", "seed=3", "sensor.pos_thres=0.3")
    stamps = [10_000 * k for k in range(12)]
    assert same(found, direct(frames, stamps, seed=3, pos_thres=0.3))
    assert found.stream.config["film"]["file"] == str(film)
    assert found.stream.tick_us == 10_000


def test_a_variable_frame_rate_is_the_films_own(tmp_path: Path) -> None:
    frames, durations = texture(8), [20, 100, 50, 30, 500, 20, 40, 20]
    film = gif(tmp_path / "film.gif", frames, durations)
    stamps = [1000 * ms for ms in np.cumsum([0, *durations[:-1]]).tolist()]
    # a palette has colours
    colours = np.repeat(frames[..., None], 3, axis=-1)
    assert same(convert(film, tmp_path / "run.npz"), direct(colours, stamps))


def test_times_of_a_film_with_a_container_clock(tmp_path: Path) -> None:
    """x264 in MP4, every third frame left out, beginning late; the first one is time 0."""
    frames = texture(12)
    keep = ["-vf", "select='not(eq(mod(n,3),1))',setpts=PTS+7/TB", "-fps_mode", "vfr"]
    film = ffmpeg(tmp_path / "film.mp4", frames, 250, *keep, "-c:v", "libx264", "-bf", "2")
    with Decoder(film) as decoder:
        times = [float(picture.t_s or 0) for picture in decoder.pictures()]
    assert [round(1e6 * (t_s - times[0])) for t_s in times] == [
        *(0, 8000, 12000, 20000, 24000, 32000, 36000, 44000),
    ]
    found = convert(film, tmp_path / "run.aedat4")
    assert found["t"].min() > 0
    # the arbiter needs a few us more
    assert found["t"].max() <= 44_100


def test_fps_and_slowdown_override_the_films_clock(tmp_path: Path) -> None:
    frames = texture(9)
    film = motion_jpeg(tmp_path / "film.avi", frames, 30)
    with Decoder(film) as decoder:
        decoded = [picture.pixels for picture in decoder.pictures()]
    assert len(decoded) == 9
    # lossy: near what went in
    assert np.abs(np.stack(decoded)[..., 0].astype(int) - frames).mean() < 4
    found = convert(film, tmp_path / "a.npz", "--fps", "3000")
    stamps = [0, 333, 667, 1000, 1333, 1667, 2000, 2333, 2667]
    assert same(found, direct(decoded, stamps))
    found = convert(film, tmp_path / "b.npz", "--slowdown", "10")
    stamps = [round(k * 1e6 / 300) for k in range(9)]
    assert same(found, direct(decoded, stamps))


def write_frames(folder: Path, kind: str, frames: Any) -> Any:
    """A folder of frames by other encoders, and what is to be seen of it."""
    folder.mkdir()
    deep = (frames.astype(np.uint16) << 8) + 77
    colour = np.stack([deep, deep // 2, 65535 - deep], axis=-1)
    light = (frames / 64.0).astype(np.float32)
    shown: dict[str, Any] = {
        "png8": frames,
        "png16": deep,
        "png48": colour,
        "tif16": deep,
        "tif8": frames,
        "bmp8": np.repeat(frames[..., None], 3, axis=-1),
        "exr32": light,
        "exr16": light,
        "exr16c": np.stack([light, light * 2, light[::-1]], axis=-1),
        "exr32a": np.stack([light, light * 2, light[::-1], light], axis=-1),
        "exr16a": np.stack([light, light * 2, light[::-1], light], axis=-1),
        "jpg": frames,
    }
    for number, frame in enumerate(shown[kind]):
        # 8, 9, 10 are in order of numbers, not of letters
        file = folder / f"frame_{number + 5}.{kind[:3]}"
        if kind.startswith("exr"):
            exr(file, frame, half="16" in kind)
        elif kind in ("png8", "tif8", "bmp8"):
            Image.fromarray(frame).save(file)
        else:
            cv2.imwrite(str(file), frame[..., ::-1] if frame.ndim == 3 else frame)
    return shown[kind]


@pytest.mark.parametrize(
    "kind",
    [
        "png8",
        "png16",
        "png48",
        "tif16",
        "tif8",
        "bmp8",
        "exr32",
        "exr16",
        "exr16c",
        "exr32a",
        "exr16a",
        "jpg",
    ],
)
def test_a_folder_of_frames_in_every_depth(tmp_path: Path, kind: str) -> None:
    shown = write_frames(tmp_path / "frames", kind, texture(8))
    (tmp_path / "frames" / "notes.txt").write_text("not a frame")
    if kind == "jpg":
        shown = [cv2.imread(str(tmp_path / f"frames/frame_{k + 5}.jpg"), 0) for k in range(8)]
    found = convert(tmp_path / "frames", tmp_path / "run.npz", "--fps", "1000")
    expected = direct(shown, [1000 * k for k in range(8)])
    if kind == "jpg":
        # two decoders of JPEG may differ by a grey
        assert abs(len(found) - len(expected)) < 0.05 * len(expected)
    else:
        assert same(found, expected)


def test_times_may_come_from_a_file(tmp_path: Path) -> None:
    frames = write_frames(tmp_path / "frames", "png8", texture(5))
    (tmp_path / "times.txt").write_text("# index time\n0 1.5\n1 1.501\n2 1.5035\n3 1.6\n4 1.6001\n")
    words = [f"film.times={tmp_path / 'times.txt'}"]
    found = convert(tmp_path / "frames", tmp_path / "run.npz", *words)
    assert same(found, direct(frames, [0, 1000, 3500, 100_000, 100_100]))


def test_frames_that_are_not_later_are_left_out_and_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = write_frames(tmp_path / "frames", "png8", texture(5))
    (tmp_path / "times.txt").write_text("0\n1e-3\n1e-3\n0.5e-3\n2e-3\n")
    words = [f"film.times={tmp_path / 'times.txt'}"]
    found = convert(tmp_path / "frames", tmp_path / "run.npz", *words)
    assert same(found, direct(frames[[0, 1, 4]], [0, 1000, 2000]))
    assert "2 frames are not later" in capsys.readouterr().err


def test_a_film_is_turned_as_it_was_taken(tmp_path: Path) -> None:
    """A phone's film lies on its side, and says so."""
    frames = texture(6, 48, 64)
    sideways = ffmpeg(
        tmp_path / "plain.mp4", np.rot90(frames, 1, (1, 2)), 100, "-c:v", "libx264", "-qp", "0"
    )
    tool = imageio_ffmpeg.get_ffmpeg_exe()
    words = [tool, "-v", "error", "-display_rotation", "-90", "-i", str(sideways), "-c", "copy"]
    subprocess.run([*words, str(tmp_path / "turned.mp4")], check=True)
    with Decoder(tmp_path / "turned.mp4") as decoder:
        picture = next(decoder.pictures())
    assert picture.pixels.shape[:2] == (64, 48)
    seen = picture.pixels[..., 0].astype(int)
    assert np.abs(seen - frames[0]).mean() < 6


def test_a_larger_film_is_fitted_in_linear_light(tmp_path: Path) -> None:
    """Twice the size, and wider: the middle is taken, four pixels become their mean light."""
    large = texture(6, 160, 96, step=4)
    film = lossless(tmp_path / "film.mkv", large, 1000)
    found = convert(film, tmp_path / "run.npz")
    coded = large[:, :, 16:144] / 255.0
    light = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    mean = light.reshape(6, 48, 2, 64, 2).mean((2, 4))
    expected = direct(mean, [1000 * k for k in range(6)])
    # light in another order of sums: a stamp here and there is a microsecond off
    assert len(expected) > 1000
    assert abs(len(found) - len(expected)) <= 2


def test_substeps_end_where_the_frames_are(tmp_path: Path) -> None:
    frames = texture(6)
    film = lossless(tmp_path / "film.mkv", frames, 100)
    coarse = convert(film, tmp_path / "a.npz", "sensor.preset=ideal")
    for line in ("log", "linear"):
        fine = convert(
            film,
            tmp_path / f"{line}.npz",
            *("--substeps", "8", "--between", line, "sensor.preset=ideal"),
        )
        # light that goes straight crosses the same thresholds in as many steps as one likes
        assert fine.stream.tick_us == 1250
        assert abs(len(fine) - len(coarse)) <= 0.002 * len(coarse) + 2
        assert len(coarse) > 1000


@pytest.mark.parametrize("one", RECORDED, ids=lambda one: one.name)
def test_every_format_is_written(tmp_path: Path, one: Any) -> None:
    film = lossless(tmp_path / "film.mkv", texture(6), 1000)
    target = tmp_path / f"run{one.suffixes[0]}"
    found = convert(film, target)
    assert same(found, convert(film, tmp_path / "again.npz"))
    assert Path(f"{target}.report.json").exists()
    assert one.suffixes[0] in endings()


def test_threads_and_the_time_of_day_change_no_byte(tmp_path: Path) -> None:
    film = lossless(tmp_path / "film.mkv", texture(8), 100)
    one = convert(film, tmp_path / "1.npz", "--threads", "1", "seed=5")
    two = convert(film, tmp_path / "2.npz", "--threads", "2", "seed=5")
    assert one.tobytes() == two.tobytes()
    assert len(one) > 300


def test_frames_and_labels_beside_the_events(tmp_path: Path) -> None:
    film = lossless(tmp_path / "film.mkv", texture(20), 100)
    keys = ["sensor.aps.enabled=true", "model.labels=true", "--sensor", "davis346"]
    found = convert(film, tmp_path / "run.npz", *keys)
    assert len(found.frames) >= 3
    assert found.frames[0].pixels.shape == (48, 64)
    assert found.labels is not None
    assert len(found.labels) == len(found) > 300
    assert np.all(found.labels["geom_id"] == -1)


def test_one_frame_is_a_reference_and_no_event(tmp_path: Path) -> None:
    film = lossless(tmp_path / "film.mkv", texture(1), 100)
    found = convert(film, tmp_path / "run.aedat4")
    assert len(found) == 0
    assert (found.stream.width, found.stream.height) == SIZE
