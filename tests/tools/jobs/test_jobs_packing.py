"""What crosses to a cluster and back, and what is refused before anything does."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import evs
from evs.drivers.search_path import search_path
from evs.msgs import EvsError
from evs.tools.jobs import run_jobs
from evs.tools.jobs.packing import PIECE_BYTES, FileEntry, Message, StreamEnd, Unpacker, pack
from evs.tools.jobs.ray_node import differences, fingerprint, make_on_node
from speed import jobs


def contents(folder: Path) -> dict[str, bytes | None]:
    """Path -> bytes, None for folders."""
    return {
        path.relative_to(folder).as_posix(): None if path.is_dir() else path.read_bytes()
        for path in sorted(folder.rglob("*"))
    }


def sent(job: jobs.Noise) -> list[Message]:
    """What a node like this one gives."""
    return list(make_on_node(job, fingerprint(), 1, "here"))


@pytest.mark.parametrize("size", [0, 1, PIECE_BYTES, PIECE_BYTES + 1, 3 * PIECE_BYTES])
def test_files_arrive_as_they_were_in_small_pieces(tmp_path: Path, size: int) -> None:
    there = tmp_path / "there"
    (there / "deep/er").mkdir(parents=True)
    (there / "hollow").mkdir()
    (there / "deep/er/x").write_bytes(random.Random(size).randbytes(size))
    (there / "ä b").write_bytes(b"after")
    pieces = list(pack(there))
    assert all(len(piece) <= PIECE_BYTES for piece in pieces if isinstance(piece, bytes))
    unpacker = Unpacker(tmp_path / "here")
    for piece in pieces:
        unpacker.write(piece)
    assert contents(tmp_path / "here") == contents(there)


def test_a_job_made_far_is_the_one_made_here(tmp_path: Path) -> None:
    run_jobs([jobs.Noise(3)], tmp_path / "here")
    unpacker = Unpacker(tmp_path / "far")
    for said in sent(jobs.Noise(3)):
        assert unpacker.end is None
        unpacker.write(said)
    assert unpacker.end is not None
    assert contents(tmp_path / "far") == contents(tmp_path / "here/noise/003")
    assert contents(tmp_path / "far")["in/b.txt"] == b"3\n"


def test_what_is_lost_or_changed_on_the_way_is_seen(tmp_path: Path) -> None:
    whole = sent(jobs.Noise(3))
    place = next(k for k, said in enumerate(whole) if isinstance(said, bytes))
    piece = whole[place]
    assert isinstance(piece, bytes)
    changed = [*whole[:place], bytes([piece[0] ^ 1]) + piece[1:], *whole[place + 1 :]]
    for name, damaged in (("lost", whole[:place] + whole[place + 1 :]), ("changed", changed)):
        unpacker = Unpacker(tmp_path / name)
        for said in damaged[:-1]:
            unpacker.write(said)
        with pytest.raises(EvsError, match="damaged on their way"):
            unpacker.write(damaged[-1])
        assert unpacker.end is None
    with pytest.raises(EvsError, match="before its file"):
        Unpacker(tmp_path / "order").write(b"x")


def test_warnings_of_a_job_come_with_it() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        end = list(make_on_node(jobs.Warns("w"), fingerprint(), 1, "here"))[-1]
    assert isinstance(end, StreamEnd)
    assert end.warnings == (("the light is dim", RuntimeWarning),)


def test_a_job_has_the_threads_it_was_given() -> None:
    said = list(make_on_node(jobs.One("x"), fingerprint(), 3, "here"))
    assert said[:2] == [FileEntry("x", 1), b"3"]


def test_a_node_that_is_another_is_named() -> None:
    wanted = fingerprint()
    assert set(wanted) == {"Python", "evs", "mujoco", "numpy", "zlib", "sources of evs"}
    assert wanted["evs"] == evs.__version__
    assert differences(wanted, wanted) == ""
    assert differences({"evs": "1", "numpy": "2"}, {"evs": "1", "numpy": "3"}) == "numpy 3 (here 2)"
    assert differences({"evs": "1"}, {}) == "evs unknown (here 1)"
    with pytest.raises(EvsError, match=r"^node b has mujoco .* \(here 1\.2\.3\); install"):
        next(make_on_node(jobs.One("x"), {**wanted, "mujoco": "1.2.3"}, 1, "b"))


def test_an_edit_makes_another_evs(tmp_path: Path) -> None:
    from evs.tools.jobs.ray_node import _sources

    (tmp_path / "drivers").mkdir()
    (tmp_path / "drivers/a.py").write_text("A = 1\n")
    (tmp_path / "drivers/a.txt").write_text("1")
    before = _sources(tmp_path)
    (tmp_path / "drivers/a.txt").write_text("2")
    assert _sources(tmp_path) == before
    (tmp_path / "drivers/a.py").write_text("A = 2\n")
    assert _sources(tmp_path) != before
    assert fingerprint()["sources of evs"] == _sources(Path(evs.__file__).parent)


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("127.0.0.1:1", "no Ray cluster at 127.0.0.1:1 that this machine belongs to .*refused"),
        ("nonsense", "give HOST:PORT of the head node"),
        ("ray://127.0.0.1:10001", "give HOST:PORT of the head node"),
        ("127.0.0.1:99999", "give HOST:PORT of the head node"),
        (":6379", "give HOST:PORT of the head node"),
    ],
)
def test_addresses_without_a_cluster(tmp_path: Path, address: str, says: str) -> None:
    pytest.importorskip("ray")
    with pytest.raises(EvsError, match=says):
        run_jobs([jobs.One("a")], tmp_path, ray=address)
    assert list(tmp_path.iterdir()) == []


def test_a_cluster_of_another_ray_is_told_in_what() -> None:
    """With Ray's own words for it, which are several lines."""
    pytest.importorskip("ray")
    from ray._private.utils import check_version_info

    from evs.tools.jobs.ray_cluster import _no_cluster

    with pytest.raises(RuntimeError) as caught:
        check_version_info({"ray_version": "2.0.1", "python_version": "3.9.0"}, "here")
    hexdigest = str(_no_cluster("10.0.0.1:6379", caught.value))
    assert hexdigest.startswith(
        "the Ray cluster at 10.0.0.1:6379 is another one than here: Version"
    )
    assert "Ray: 2.0.1" in hexdigest
    assert "Python: 3.9.0" in hexdigest
    assert "\n" not in hexdigest


def test_workers_here_and_a_cluster_are_two_things(tmp_path: Path) -> None:
    with pytest.raises(EvsError, match="--workers or --ray, not both"):
        run_jobs([jobs.One("a")], tmp_path, ray="auto", workers=2)


def test_nothing_of_ray_is_imported_where_no_cluster_is_asked_for(tmp_path: Path) -> None:
    text = (
        "import sys\nfrom pathlib import Path\nfrom speed.jobs import One\n"
        "from evs.tools.jobs import run_jobs\n"
        "run_jobs([One('a')], Path(sys.argv[1]))\nassert 'ray' not in sys.modules\n"
        "sys.modules['ray'] = None\n"
        "from evs.msgs import EvsError\n"
        "try:\n    run_jobs([One('b')], Path(sys.argv[1]), ray='auto')\n"
        "except EvsError as error:\n    print(error)\n"
    )
    environment = dict(os.environ, PYTHONPATH=search_path())
    ran = subprocess.run(
        [sys.executable, "-c", text, tmp_path],
        capture_output=True,
        text=True,
        env=environment,
    )
    assert (ran.stdout, ran.stderr) == ("a cluster needs Ray: pip install 'evs[cluster]'\n", "")
