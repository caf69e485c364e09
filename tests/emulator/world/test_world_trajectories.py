"""Cameras on trajectories and shaking ones: the poses of the file, smooth between, and refusals."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import evs
from evs.emulator.world.trajectories import Shaking, read_trajectory
from evs.launch.main import main
from evs.msgs import STANDARD_GRAVITY, EvsError

SCENE = """
<mujoco><worldbody><light pos="0 0 3"/><geom type="plane" size="3 3 .1"/>
<body name="cart" pos="0 0 1"><joint type="slide" axis="1 0 0"/><geom size=".2"/></body>
<camera name="eye" pos="0 -2 1" xyaxes="1 0 0 0 .2 1" fovy="60"/></worldbody></mujoco>
"""
RANDOM = np.random.default_rng(3)
TIMES = np.cumsum(RANDOM.uniform(0.02, 0.05, 12)) + 1.7e9
PLACES = np.cumsum(RANDOM.normal(0, 0.05, (12, 3)), axis=0) + (0, -2, 1)
TURNS = Rotation.from_rotvec(np.cumsum(RANDOM.normal(0, 0.1, (12, 3)), axis=0) - (1.6, 0, 0))
# signs that jump, as some programs write them
QUATERNIONS = TURNS.as_quat() * RANDOM.choice((-1.0, 1.0), (12, 1))


def tum(path: Path, rows: Any = None) -> str:
    rows = np.column_stack([TIMES, PLACES, QUATERNIONS]) if rows is None else rows
    lines = [" ".join(f"{value:.17g}" for value in row) for row in rows]
    path.write_text("# timestamp tx ty tz qx qy qz qw\n" + "\n".join(lines) + "\n")
    return str(path)


@pytest.fixture
def scene(tmp_path: Path) -> str:
    (tmp_path / "scene.xml").write_text(SCENE)
    return str(tmp_path / "scene.xml")


def optical(pose: Any) -> Rotation:
    return Rotation.from_matrix(np.asarray(pose.mat).reshape(3, 3) * (1.0, -1.0, -1.0))


def test_it_goes_through_the_poses_as_a_natural_spline(tmp_path: Path) -> None:
    trajectory = read_trajectory(tum(tmp_path / "walk.txt"))
    times = TIMES - TIMES[0]
    spline = CubicSpline(times, PLACES, bc_type="natural")
    for t_s in (*times, *np.linspace(0.0, times[-1], 200)):
        position, _ = trajectory.pose(t_s)
        assert position == pytest.approx(spline(t_s), abs=1e-12)
    for t_s, turn in zip(times, TURNS, strict=True):
        _, mat = trajectory.pose(t_s)
        found = Rotation.from_matrix(mat * (1.0, -1.0, -1.0))
        assert (found * turn.inv()).magnitude() < 1e-7
    # between two poses it turns no farther than about from one to the other
    steps = [Rotation.from_matrix(trajectory.pose(t)[1]) for t in np.linspace(0, times[-1], 500)]
    largest = max((b * a.inv()).magnitude() for a, b in pairwise(steps))
    assert largest < 0.05
    # it stands still outside
    assert np.array_equal(trajectory.pose(-1.0)[0], trajectory.pose(0.0)[0])
    assert np.array_equal(trajectory.pose(99.0)[1], trajectory.pose(trajectory.seconds)[1])


@pytest.mark.parametrize(
    ("header", "columns", "scale"),
    [
        ("t,x,y,z,qx,qy,qz,qw", "txyzabcd", 1.0),
        ("t_us,tx,ty,tz,qx,qy,qz,qw", "txyzabcd", 1e6),
        ("#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], "
         "q_RS_y [], q_RS_z [], v_RS_R_x [m s^-1]", "txyzdabcx", 1e9),
        ("name,timestamp [ns],position_x,position_y,position_z,orientation_w,orientation_x,"
         "orientation_y,orientation_z", "ntxyzdabc", 1e9),
    ],
)  # fmt: skip
def test_headers_name_the_columns(tmp_path: Path, header: str, columns: str, scale: float) -> None:
    """EuRoC's ground truth among them, whose quaternion begins with w and whose time is in ns."""
    values = np.column_stack([TIMES, PLACES, QUATERNIONS])
    lines = [header]
    for row in values:
        named = dict(zip("txyzabcd", row, strict=True))
        named["t"] = round(named["t"] * scale) if scale != 1.0 else named["t"]
        lines.append(",".join("robot" if c == "n" else repr(named[c]).split("(")[-1].rstrip(")")
                              for c in columns))  # fmt: skip
    (tmp_path / "poses.csv").write_text("\n".join(lines))
    found = read_trajectory(str(tmp_path / "poses.csv"))
    plain = read_trajectory(tum(tmp_path / "poses.txt"))
    assert found.times_s == pytest.approx(plain.times_s, abs=2e-6)
    assert np.array_equal(found.poses, plain.poses)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3", "line 1: give t x y z qx qy qz qw"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 nan", "line 2: a number is not finite"),
        ("0 0 0 0 0 0 0 1", "has 1 poses: give two or more"),
        ("# nothing", "has 0 poses"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 0", "line 2: its quaternion is zero"),
        ("1 0 0 0 0 0 0 1\n\n0 0 0 0 0 0 0 1", "line 3: its time is before that of the last"),
        ("0,0,0,0,,0,0,1\n1,0,0,0,0,0,0,1", "line 1: give t x y z"),
    ],
)
def test_what_is_no_trajectory_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "bad.txt").write_text(text)
    with pytest.raises(EvsError, match=message):
        read_trajectory(str(tmp_path / "bad.txt"))


def test_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "bytes.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(EvsError, match="is no text"):
        read_trajectory(str(tmp_path / "bytes.txt"))
    with pytest.raises(EvsError, match=r"cannot read trajectory .*No such file"):
        read_trajectory(str(tmp_path / "none.txt"))


def test_a_moment_that_is_listed_twice_counts_once(tmp_path: Path) -> None:
    rows = np.column_stack([TIMES, PLACES, QUATERNIONS])
    twice = np.insert(rows, 4, rows[4] + (0, 9, 9, 9, 0, 0, 0, 0), axis=0)
    found = read_trajectory(tum(tmp_path / "twice.txt", twice))
    assert np.array_equal(found.poses, read_trajectory(tum(tmp_path / "once.txt")).poses)


def test_a_camera_sees_from_there(scene: str, tmp_path: Path) -> None:
    """In the world, in the frame of a body, with either axes; optics of a named camera."""
    file = tum(tmp_path / "walk.txt")
    cameras = {
        "world": evs.CameraConfig(trajectory=file),
        "other axes": evs.CameraConfig(trajectory=file, trajectory_axes="camera"),
        "body": evs.CameraConfig(trajectory=file, body="cart"),
    }
    world = evs.World(scene)
    small = evs.SensorConfig(width=16, height=12)
    made = {key: world.add_camera(config, sensor=small) for key, config in cameras.items()}
    world.data.qpos[0] = 0.5
    for _ in range(100):
        world.step()
    position, mat = read_trajectory(file).pose(0.1)
    poses = {key: camera._now[1] for key, camera in made.items()}  # type: ignore[index]
    assert poses["world"].pos == pytest.approx(position, abs=1e-14)
    assert np.reshape(poses["world"].mat, (3, 3)) == pytest.approx(mat, abs=1e-14)
    assert np.reshape(poses["other axes"].mat, (3, 3)) == pytest.approx(mat * (1, -1, -1))
    assert poses["body"].pos == pytest.approx(position + (0.5, 0, 1))
    assert made["world"].info.camera == "trajectory"
    for bad, message in (
        ({"trajectory": file, "pos": (0.0, 0.0, 1.0)}, "says where the camera is"),
        ({"trajectory": file, "azimuth": 3.0}, "says where the camera is"),
        ({"trajectory": file, "trajectory_axes": "blender"}, "give optical or camera"),
        ({"trajectory_axes": "camera"}, "but no camera.trajectory"),
        ({"trajectory": file, "body": "carts"}, "cart"),
        ({"shake_m": -1.0}, "camera.shake_m is -1; give 0 or more"),
    ):
        with pytest.raises(EvsError, match=message):
            evs.World(scene).add_camera(evs.CameraConfig(**bad))


@pytest.mark.slow
def test_recorded_poses_give_the_same_events_again(scene: str, tmp_path: Path) -> None:
    """What evs records of one run moves the camera of the next."""
    first = evs.World(scene)
    shaken = evs.CameraConfig(lookat=(0, 0, 1), distance=2.0, shake_m=0.01, shake_deg=1.0)
    camera = first.add_camera(shaken)
    rows, events = [], []
    for _ in range(60):
        (packet,) = first.step()
        events.append(packet.events)
        assert camera.pose is not None
        rows.append([camera.pose.t_us * 1e-6, *camera.pose.position, *camera.pose.orientation])
    second = evs.World(scene)
    again = second.add_camera(evs.CameraConfig(trajectory=tum(tmp_path / "again.txt", rows)))
    poses = []
    for _ in range(59):
        second.step()
        assert again.pose is not None
        poses.append([*again.pose.position, *again.pose.orientation])
    # the first row is that of 1 ms, and the trajectory begins at 0
    expected = np.array(rows)[1:, 1:]
    assert np.array(poses) == pytest.approx(expected, abs=1e-12)


def test_the_imu_feels_the_spline(scene: str, tmp_path: Path) -> None:
    """A circle of 0.5 m at 1 Hz: centripetal acceleration, and gravity."""
    times = np.arange(0.0, 2.0, 0.01)
    angle = 2 * np.pi * times
    places = np.column_stack([0.5 * np.cos(angle), 0.5 * np.sin(angle), np.full_like(times, 2.0)])
    down = Rotation.from_euler("x", 180, degrees=True)
    rows = np.column_stack([times, places, np.tile(down.as_quat(), (len(times), 1))])
    sensor = evs.SensorConfig(preset="ideal", width=16, height=12, imu=evs.ImuConfig(enabled=True))
    world = evs.World(scene)
    config = evs.CameraConfig(trajectory=tum(tmp_path / "circle.txt", rows))
    camera = world.add_camera(config, sensor=sensor)
    samples = []
    for _ in range(1000):
        world.step()
        samples.append(camera.imu)
    found = np.concatenate(samples)
    later = found[found["t"] > 100_000]
    sizes = np.hypot(later["acceleration"][:, 0], later["acceleration"][:, 1])
    assert sizes == pytest.approx(0.5 * (2 * np.pi) ** 2, rel=0.01)
    assert np.abs(later["acceleration"][:, 2]) == pytest.approx(STANDARD_GRAVITY, rel=1e-3)


@pytest.mark.statistical
def test_shaking_has_its_size_and_its_band() -> None:
    """Over 200 s: the rms of each axis, and nothing outside the band."""
    times = np.arange(0.0, 200.0, 0.005)
    shaking = Shaking(0.01, math.radians(0.5), 8.0, 3)
    offsets, turns = zip(*(shaking.offset(t) for t in times), strict=True)
    values = np.column_stack([offsets, Rotation.from_matrix(np.array(turns)).as_rotvec()])
    rms = values.std(axis=0)
    # sines of unlike frequencies: the mean square of each is exact over many periods
    assert rms[:3] == pytest.approx([0.01] * 3, rel=0.02)
    assert rms[3:] == pytest.approx([math.radians(0.5)] * 3, rel=0.02)
    power = (np.abs(np.fft.rfft(values * np.hanning(len(times))[:, None], axis=0)) ** 2).sum(axis=1)
    hz = np.fft.rfftfreq(len(times), 0.005)
    inside = (hz > 3.9) & (hz < 12.1)
    assert power[inside].sum() > 0.999 * power.sum()
    other = Shaking(0.01, 0.0, 8.0, 4).offset(1.0)
    assert not np.array_equal(other[0], shaking.offset(1.0)[0])
    assert np.array_equal(other[1], np.eye(3))
    assert np.array_equal(shaking.offset(7.0)[0], Shaking(0.01, 0.1, 8.0, 3).offset(7.0)[0])


def test_a_still_scene_has_events_once_the_camera_shakes(scene: str) -> None:
    counts = []
    for config in (evs.CameraConfig(), evs.CameraConfig(shake_m=0.02, shake_deg=0.5)):
        sensor = evs.SensorConfig(preset="ideal", width=64, height=48)
        world = evs.World(scene)
        world.add_camera(config, sensor=sensor)
        counts.append(sum(len(packet) for (packet,) in world.run(0.1)))
    assert counts[0] == 0
    assert counts[1] > 100


def test_the_command_takes_them(
    scene: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tum(tmp_path / "walk.txt")
    target = tmp_path / "run.npz"
    words = [
        "emulate",
        scene,
        "--camera",
        "eye",
        f"camera.trajectory={file}",
        "camera.shake_deg=0.2",
    ]
    assert main([*words, "--duration", "0.02", "--record", str(target), "--quiet"]) == 0
    recording = evs.read(target)
    assert recording.stream.config["camera"]["trajectory"] == file
    # the optics are those of the model's camera
    assert recording.stream.camera_info["k"][4] == pytest.approx(260 / 2 / math.tan(math.pi / 6))
    assert len(recording)
    assert main(["plan", scene, f"camera.trajectory={file}"]) == 0
    assert "it goes through a trajectory of 0.3" in capsys.readouterr().out
    assert main(["plan", scene, "camera.shake_m=0.1"]) == 0
    assert "it shakes" in capsys.readouterr().out
    # never over what it reads
    assert main([*words, "--duration", "0.02", "--record", file]) == 2
    assert Path(file).read_text().startswith("# timestamp")
