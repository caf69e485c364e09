"""Controls: zero, keyframe, random, file, function; held in between; bad ones named in one line."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from evs.emulator.world import make_control
from evs.msgs import EvsError

XML = """
<mujoco>
  <worldbody>
    <body><joint name="a" type="slide"/><joint name="b" type="hinge"/><geom size=".1"/></body>
  </worldbody>
  <actuator><motor joint="a" ctrlrange="2 6"/><motor joint="b"/></actuator>
  <keyframe><key name="rest" ctrl="3 0"/><key name="wave" ctrl="5 .5"/></keyframe>
</mujoco>
"""


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_string(XML)


def test_zero(model):
    assert make_control(model, "zero")(5000, None).tolist() == [0, 0]


def test_a_keyframe_by_name_by_number_or_the_first(model):
    for name, ctrl in (("", [3, 0]), ("wave", [5, 0.5]), ("1", [5, 0.5])):
        assert make_control(model, "keyframe", keyframe=name)(0, None).tolist() == ctrl


def test_random_is_smooth_and_fills_the_range_and_nothing_else(model):
    control = make_control(model, "random", seed=1, rate_hz=1000)
    signal = np.array([control(t, None) for t in range(0, 20_000_000, 1000)])
    low, high = signal.min(axis=0), signal.max(axis=0)
    assert (low >= (2, -1)).all()
    assert (high <= (6, 1)).all()
    assert ((high - low) > 0.8 * np.array([4, 2])).all()
    # a smoothstep over 1 / 4 s is at most 1.5 ranges steep
    steepest = np.abs(np.diff(signal, axis=0)).max(axis=0) * 1000
    assert (steepest <= 1.5 * 4 * np.array([4, 2])).all()
    # the speed does not jump either: at most 6 ranges / (1 / 4 s)^2
    bend = np.abs(np.diff(signal, n=2, axis=0)).max(axis=0) * 1e6
    assert (bend <= 6.1 * 16 * np.array([4, 2]) * 2).all()


def test_random_depends_on_seed_and_time_alone(model):
    first, again = (make_control(model, "random", seed=7) for _ in range(2))
    times = list(range(0, 3_000_000, 10_000))
    forwards = [first(t, None).tolist() for t in times]
    backwards = [again(t, None).tolist() for t in reversed(times)]
    assert forwards == backwards[::-1]
    other = make_control(model, "random", seed=8)
    assert [other(t, None).tolist() for t in times] != forwards


def test_random_is_the_same_on_every_machine(model):
    control = make_control(model, "random", seed=42)
    # made once by this very class: a change of these numbers changes every recording
    assert control(1_230_000, None).tolist() == [4.8406437373813205, -0.3204641815686299]


def test_random_uses_its_share_of_the_range(model):
    control = make_control(model, "random", seed=3, scale=0.25)
    signal = np.array([control(t, None) for t in range(0, 10_000_000, 10_000)])
    assert (np.abs(signal - (4, 0)) <= 0.25 * np.array([2, 1])).all()


def test_random_and_files_are_held_for_a_period(model, tmp_path):
    control = make_control(model, "random", rate_hz=50)
    held = [control(t, None).tolist() for t in range(0, 40_000, 1000)]
    assert held == [held[0]] * 20 + [held[20]] * 20
    assert held[0] != held[20]


@pytest.mark.parametrize("suffix", ["npy", "npz", "csv", "header.csv"])
def test_files_of_every_kind(model, tmp_path, suffix):
    rows = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.5]])
    path = tmp_path / f"controls.{suffix}"
    if suffix == "npy":
        np.save(path, rows)
    elif suffix == "npz":
        np.savez(path, ctrl=rows, other=np.zeros(3))
    else:
        np.savetxt(
            path, rows, delimiter=",", header="a,b" if "header" in suffix else "", comments=""
        )
    control = make_control(model, "file", file=str(path), rate_hz=100)
    at = [control(t, None).tolist() for t in (0, 9_999, 10_000, 20_000, 29_999, 90_000)]
    # the last row holds to the end
    assert at == [rows[row].tolist() for row in (0, 0, 1, 2, 2, 2)]


def test_a_function_gets_seconds_and_data_and_none_keeps_the_last(model):
    seen = []

    def f(t_s, data):
        seen.append((t_s, data))
        return None if t_s > 0 else [1, 2]

    control = make_control(model, f)
    assert control(0, "data").tolist() == [1, 2]
    assert control(1000, "data") is None
    assert seen == [(0.0, "data"), (0.001, "data")]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"source": "rnadom"}, "no control 'rnadom'; there is: random,"),
        ({"source": "keyframe", "keyframe": "wvae"}, "no keyframe 'wvae'; there is: wave, rest"),
        ({"source": "random", "rate_hz": 0}, "scene.control_hz is 0"),
        ({"source": "random", "scale": 1.5}, "scene.control_scale is 1.5"),
        ({"source": "file"}, "no control file ''"),
        ({"source": "file", "file": "no.npy"}, "no control file 'no.npy'"),
    ],
)
def test_what_does_not_exist(model, options, says):
    with pytest.raises(EvsError) as caught:
        make_control(model, options.pop("source"), **options)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_no_keyframe_at_all():
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(EvsError, match="no keyframe '': there are none"):
        make_control(model, "keyframe")


@pytest.mark.parametrize(
    ("write", "says"),
    [
        (lambda p: np.save(p, np.zeros((3, 5))), "has shape (3, 5); give one row a period: (n, 2)"),
        (lambda p: np.save(p, np.zeros((0, 2))), "has shape (0, 2)"),
        (lambda p: np.save(p, np.array([[0, 0], [0, np.nan]])), "row 1 has a value that is not"),
        (lambda p: np.save(p, np.array([["x", "y"]])), "could not convert string to float"),
        (lambda p: p.write_bytes(b"junk"), "controls.npy': is no whole .npy file of numbers"),
        (lambda p: p.write_bytes(b""), "controls.npy': is no whole .npy file of numbers"),
        (lambda p: np.save(p, np.array([{}], object)), "is no whole .npy file of numbers"),
    ],
)
def test_a_bad_file(model, tmp_path, write, says):
    path = tmp_path / "controls.npy"
    write(path)
    with pytest.raises(EvsError) as caught:
        make_control(model, "file", file=str(path))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_bad_text_and_archives(model, tmp_path):
    for name, content, says in (
        ("a.csv", "1,2\n3,x\n", "could not convert"),
        ("b.csv", "", "no row of numbers"),
        ("bb.csv", "a,b\n\n", "no row of numbers"),
        ("bbb.csv", "1,x\n3,4\n", "could not convert"),
        ("c.txt", "1,2\n", "not a .npy, .npz or .csv file"),
    ):
        (tmp_path / name).write_text(content)
        with pytest.raises(EvsError, match=says):
            make_control(model, "file", file=str(tmp_path / name))
    np.savez(tmp_path / "d.npz", a=np.zeros((1, 2)), b=np.zeros((1, 2)))
    with pytest.raises(EvsError, match="no array 'ctrl', only a, b"):
        make_control(model, "file", file=str(tmp_path / "d.npz"))
    np.savez(tmp_path / "e.npz", ctrl=np.zeros((9, 2)))
    whole = (tmp_path / "e.npz").read_bytes()
    # torn anywhere, turned into something else, or one bit wrong in the numbers
    flipped = bytes([*whole[:200], whole[200] ^ 1, *whole[201:]])
    for content in (whole[:100], whole[:-9], b"", b"junk", flipped):
        (tmp_path / "e.npz").write_bytes(content)
        with pytest.raises(EvsError, match=r"is no whole \.npz file of numbers; write it with"):
            make_control(model, "file", file=str(tmp_path / "e.npz"))


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ([1.0], r"has shape \(1,\), the model has 2 controls: give shape \(2,\)"),
        (3.0, r"has shape \(\)"),
        ([1.0, float("nan")], "has nan at index 1"),
        ([float("inf"), 0.0], "has inf at index 0"),
        ("full", "is not 2 numbers"),
        ([[1], [1, 2]], "is not 2 numbers"),
    ],
)
def test_a_function_that_gives_nonsense(model, value, says):
    with pytest.raises(EvsError, match=says):
        make_control(model, lambda _t, _d: value)(0, None)
