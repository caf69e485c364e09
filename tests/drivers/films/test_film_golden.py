"""evs convert gives what v2e gave of the same frames, with interpolation off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import evs
from evs.launch.main import main
from reference.foreign_films import exr

pytestmark = pytest.mark.golden

GOLDEN = Path(__file__).parents[2] / "support" / "golden"
FRAMES = 120


def test_a_folder_of_frames_gives_v2es_events(tmp_path: Path) -> None:
    """Net counts within one threshold, at every pixel and frame (support/golden/README.md)."""
    with np.load(GOLDEN / "video.npz") as file:
        video = file["luminance_dn"][:FRAMES]
    with np.load(GOLDEN / "v2e_counts.npz") as file:
        theirs = file["ideal_on"].astype(np.int64) - file["ideal_off"]
        theirs_all = int((file["ideal_on"][:FRAMES].astype(np.int64)).sum())
    (tmp_path / "frames").mkdir()
    for number, frame in enumerate(video):
        exr(tmp_path / f"frames/{number}.exr", frame, half=False)
    keys = ["sensor.width=64", "sensor.height=48", "sensor.pos_thres=0.2", "sensor.neg_thres=0.2"]
    # its light is DN, and ours is DN without a rounding
    keys += ["sensor.log=linlog", "sensor.linlog_dn=20", "sensor.exposure_dn=1", "--unit", "dn"]
    target = tmp_path / "run.npz"
    words = ["convert", str(tmp_path / "frames"), str(target), "--fps", "1000", *keys]
    assert main([*words, "--sensor", "ideal", "--quiet"]) == 0
    events = evs.read(target)
    ours = np.zeros((FRAMES, 48, 64), np.int64)
    sign = 2 * events["p"].astype(np.int64) - 1
    np.add.at(ours, (-(-events["t"] // 1000), events["y"], events["x"]), sign)
    apart = np.cumsum(ours, axis=0) - np.cumsum(theirs[:FRAMES], axis=0)
    assert np.abs(apart).max() <= 1
    assert np.count_nonzero(events["p"]) == pytest.approx(theirs_all, rel=0.005)
    assert theirs_all > 50_000
