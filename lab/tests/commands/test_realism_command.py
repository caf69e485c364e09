"""`evs realism` end to end: tables, JSON, pictures, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import evs
from evs.drivers.files import recorder_for
from evs.launch.main import main
from evs.msgs import EventPacket
from reference import moving_texture


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated camera before a moving texture, with frames; and noise without frames."""
    path = tmp_path_factory.mktemp("recordings")
    seen = moving_texture.recorded(303)
    pixels = evs.Pixels("ideal", size=(seen.width, seen.height), **{"aps.enabled": True})
    recorder = recorder_for(path / "real.aedat4")
    recorder.open([pixels.info])
    end_us = int(seen.events["t"][-1])
    recorder.write(EventPacket(0, 0, end_us, seen.width, seen.height, seen.events, "camera"))
    for frame in seen.frames:
        recorder.write_frame(frame)
    recorder.close()
    random = np.random.default_rng(1)
    for name, count in (("noise", 9000), ("more", 18_000), ("few", 500)):
        t = np.sort(random.integers(0, 4_000_000, count))
        x, y, p = (random.integers(0, size, count) for size in (32, 24, 2))
        np.savez(path / f"{name}.npz", t=t, x=x, y=y, p=p)
    return path


def test_sensors_beside_a_recording_with_frames(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture, numbers = folder / "page.png", folder / "page.json"
    sensor = folder / "mine.toml"
    # thresholds that are far off
    sensor.write_text("width = 64\nheight = 48\npos_thres = 0.6\nneg_thres = 0.9\ndim_lux = 1.0\n")
    words = [str(folder / "real.aedat4"), "--sensor", str(sensor), "--white-lux", "1000"]
    assert main(["realism", *words, "--picture", str(picture), "--json", str(numbers)]) == 0
    shown = capsys.readouterr().out
    assert "fitted to the first half: pos_thres" in shown
    found = json.loads(numbers.read_text())
    rows = {row["sensor"]: row for row in found["rows"]}
    assert list(rows) == ["the recording", str(sensor), "mine, fitted", "ideal", "v2e",
                          "ideal, fitted thresholds", "no events"]  # fmt: skip
    assert all(name.split("/")[-1][:20] in shown for name in rows)
    base, fitted = rows[str(sensor)], rows["mine, fitted"]
    # what was fitted on the first half is nearer on the second, in every column
    assert base["ratio"] < 0.5
    assert 0.6 < fitted["ratio"] < 1.3
    assert abs(fitted["on"] - rows["the recording"]["on"]) < 0.03
    for key in ("totals", "signed"):
        assert fitted[key] > base[key] + 0.02
    assert fitted["kl_nats"] < base["kl_nats"]
    assert rows["no events"]["totals"] is None
    told = {one["key"]: one for one in found["fitted"]}
    set_to = moving_texture.drawn(303).sensor
    for key in ("pos_thres", "neg_thres"):
        assert abs(told[key]["value"] - set_to[key]) < 3.0 * told[key]["error"]
    with Image.open(picture) as image:
        assert image.size[0] > 1000


def test_streams_beside_a_recording(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    noise, more = str(folder / "noise.npz"), str(folder / "more.npz")
    numbers = folder / "streams.json"
    words = [noise, more, "--unit", "us", "--json", str(numbers)]
    assert main(["realism", *words, "--picture", str(folder / "streams.png")]) == 0
    assert "events per pixel and second" in capsys.readouterr().out
    found = json.loads(numbers.read_text())
    rate = next(row for row in found["rows"] if row["quantity"] == "rate_hz")
    assert rate["floor"] < 0.02
    assert abs(rate["distances"][0] - np.log10(2.0)) < 0.02
    assert next(row for row in found["rows"] if row["quantity"] == "rates")["values"] == [None] * 2
    # a sensor in constant light, for programs
    words = [noise, "--unit", "us", "--still-lux", "0", "--sensor", "dvxplorer", "--json"]
    assert main(["realism", *words, "--again", more]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["streams"] == ["dvxplorer, 0 lux"]
    assert found["rows"][0]["floor"] > 0.2


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (["{}/noise.npz"], "has 0 intensity frames"),
        (["{}/real.aedat4", "--rows", "10", "48"], "rows 10 to 48 are not on a sensor of 48 rows"),
        (["{}/real.aedat4", "--again", "{}/more.npz"], "--again is for streams"),
        (["{}/noise.npz", "{}/more.npz", "--rows", "1", "2"], "--rows and --white-lux"),
        (["{}/noise.npz", "{}/more.npz", "--sensor", "davis346"], "not both"),
        (["{}/noise.npz", "{}/few.npz"], "few.npz has"),
        (["{}/noise.npz", "--still-lux", "-1"], "--still-lux is -1"),
        (["{}/noise.npz", "--still-lux", "1", "--sensor", "ideal"], "ideal has no events"),
        (["{}/real.aedat4", "--sensor", "davis364"], "davis346"),
        (["{}/real.aedat4", "--picture", "page.gif"], "end it in .png"),
        (["{}/none.npz"], "none.npz"),
    ],
)
def test_what_it_refuses_is_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], words: list[str], what: str
) -> None:
    assert main(["realism", *(word.format(folder) for word in words)]) == 2
    error = capsys.readouterr().err
    assert what in error
    assert error.count("\n") == 1
