"""The IMU on motions of known acceleration, given as poses: rest, fall, spin, pendulum; states."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from evs.emulator.base.scene import CameraPose
from evs.emulator.sensor import Imu, ImuParameters, ImuState
from evs.emulator.sensor.imu import rotation_vector
from evs.msgs import DEGREE, STANDARD_GRAVITY, EvsError, ImuSamples

F64 = npt.NDArray[np.float64]
Motion = Callable[[float], tuple[F64, F64]]

G = np.array([0.0, 0.0, -9.81])
UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""A MuJoCo camera that looks along the world's y, its y axis up."""
IDEAL = ImuParameters(enabled=True)
NOISY = replace(
    IDEAL,
    accelerometer_noise_density=3e-3,
    accelerometer_random_walk=2e-3,
    gyroscope_noise_density=2e-4,
    gyroscope_random_walk=3e-5,
)
FLOAT32 = 2.0**-24
"""The device's rounding, relative."""


def felt(
    parameters: ImuParameters,
    motion: Motion,
    stamps_us: Iterable[int],
    gravity: F64 = G,
    seed: int = 0,
) -> ImuSamples:
    """The samples of an analytic motion: t_s -> (position, camera to world)."""
    imu = Imu(parameters)
    state, parts = imu.init(seed), []
    for t_us in stamps_us:
        position, turn = motion(t_us * 1e-6)
        samples, state = imu.step(CameraPose(position, turn.ravel()), gravity, state, t_us)
        parts.append(samples)
    return np.concatenate(parts)


def about_z(angle: float) -> F64:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def ticks(tick_us: int, until_us: int) -> range:
    return range(0, until_us + 1, tick_us)


def test_at_rest_the_force_that_holds_the_camera_points_up() -> None:
    samples = felt(IDEAL, lambda _: (np.array([1.0, 2.0, 3.0]), UPRIGHT), ticks(1000, 100_000))
    # optical axes: up is -y
    assert samples["acceleration"] == pytest.approx(
        np.tile([0.0, -9.81, 0.0], (99, 1)), rel=FLOAT32
    )
    assert not samples["angular_velocity"].any()
    assert (samples["temperature"] == 25.0).all()
    # looking straight down (mat = 1): up is -z
    down = felt(IDEAL, lambda _: (np.zeros(3), np.eye(3)), ticks(1000, 5000))
    assert down["acceleration"][0] == pytest.approx([0.0, 0.0, -9.81], rel=FLOAT32)


def test_samples_come_from_the_first_known_motion_to_the_tick_before_the_last() -> None:
    samples = felt(IDEAL, lambda _: (np.zeros(3), UPRIGHT), ticks(1000, 10_000))
    assert samples["t"].tolist() == list(range(1000, 10_000, 1000))
    fast = felt(replace(IDEAL, rate_hz=8000.0), lambda _: (np.zeros(3), UPRIGHT), ticks(1000, 4000))
    assert fast["t"].tolist() == list(range(1000, 3001, 125))
    slow = felt(
        replace(IDEAL, rate_hz=300.0), lambda _: (np.zeros(3), UPRIGHT), ticks(1000, 15_000)
    )
    assert slow["t"].tolist() == [3333, 6667, 10_000, 13_333]
    late = felt(IDEAL, lambda _: (np.zeros(3), UPRIGHT), range(5500, 12_000, 1000))
    assert late["t"].tolist() == [7000, 8000, 9000, 10_000]


def test_in_free_fall_it_feels_nothing() -> None:
    def motion(t_s: float) -> tuple[F64, F64]:
        return np.array([3.0 * t_s, 1.0, 5.0 + 0.5 * -9.81 * t_s**2]), UPRIGHT

    samples = felt(replace(IDEAL, rate_hz=2000.0), motion, ticks(1000, 300_000))
    # position of a few m in float64 over (1 ms)^2
    assert np.abs(samples["acceleration"]).max() < 8 * 2.0**-52 / 1e-6
    assert not samples["angular_velocity"].any()


def test_a_spinning_body_feels_its_turn_and_the_centripetal_force() -> None:
    omega, radius = 20.0, 0.3

    # the camera on an arm, looking outwards, up is z
    def motion(t_s: float) -> tuple[F64, F64]:
        turn = about_z(omega * t_s)
        return turn @ np.array([0.0, radius, 0.0]), turn @ UPRIGHT

    samples = felt(replace(IDEAL, rate_hz=4000.0), motion, ticks(1000, 500_000))
    # second differences of a circle: (2 sin(w T / 2) / T)^2 r = w^2 r (1 - (w T)^2 / 12)
    short = (2 * math.sin(omega * 5e-4) / 1e-3) ** 2 * radius
    assert short == pytest.approx(omega**2 * radius, rel=(omega * 1e-3) ** 2 / 12)
    # turning left about up: -y; pulled towards the axis, behind the camera: -z
    exact = np.tile([0.0, -9.81, -short], (len(samples), 1))
    assert samples["acceleration"] == pytest.approx(exact, rel=2 * FLOAT32, abs=1e-6)
    assert samples["angular_velocity"] == pytest.approx(np.tile([0, -omega, 0], (len(samples), 1)))


def pendulum(amplitude: float, length: float) -> tuple[Motion, Callable[[float], tuple[F64, F64]]]:
    """A camera that swings as told, about the world's y through the origin, looking along y.

    Out: its motion; and what it feels, in optical axes, by differentiating on paper.
    """
    rate = math.sqrt(9.81 / length)

    def angle(t_s: float) -> tuple[float, float, float]:
        a = amplitude * math.sin(rate * t_s)
        return a, amplitude * rate * math.cos(rate * t_s), -(rate**2) * a

    def turned(a: float) -> F64:
        # x towards the right, the pendulum hangs along -z, and swings towards +x
        c, s = math.cos(a), math.sin(a)
        return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])

    def motion(t_s: float) -> tuple[F64, F64]:
        turn = turned(angle(t_s)[0])
        return turn @ np.array([0.0, 0.0, -length]), turn @ UPRIGHT

    def truth(t_s: float) -> tuple[F64, F64]:
        a, da, dda = angle(t_s)
        along, inward = length * dda, length * da**2
        # proper acceleration along the swing (x) and up the rod (z of the turned frame)
        x, up = along + 9.81 * math.sin(a), inward + 9.81 * math.cos(a)
        # the turn by a takes z towards -x: about -y of the world, which is where it looks: -z
        return np.array([x, -up, 0.0]), np.array([0.0, 0.0, -da])

    return motion, truth


@pytest.mark.parametrize("tick_us", [1000, 500, 250])
@pytest.mark.parametrize("rate_hz", [1000.0, 8000.0])
def test_a_pendulum(tick_us: int, rate_hz: float) -> None:
    motion, truth = pendulum(0.9, 0.4)
    samples = felt(replace(IDEAL, rate_hz=rate_hz), motion, ticks(tick_us, 1_500_000))
    exact = [truth(t_us * 1e-6) for t_us in samples["t"].tolist()]
    force, turn = (np.array([one[n] for one in exact]) for n in (0, 1))
    # second order: central differences T^2 / 12 and / 6, interpolation T^2 / 8, of the second
    # derivative of what is felt, at most (2 w)^2 of its amplitude; T^2 / 2 covers them all
    share = 0.5 * (2 * math.sqrt(9.81 / 0.4) * tick_us * 1e-6) ** 2
    assert np.abs(samples["acceleration"] - force).max() < share * np.abs(force).max() + 1e-5
    assert np.abs(samples["angular_velocity"] - turn).max() < share * np.abs(turn).max() + 1e-5


def test_ticks_of_different_lengths_give_the_same_motion() -> None:
    motion, truth = pendulum(0.9, 0.4)
    steps = np.random.default_rng(1).integers(600, 1400, 1500)
    stamps = np.cumsum(steps)
    samples = felt(IDEAL, motion, stamps.tolist())
    exact = [truth(t_us * 1e-6) for t_us in samples["t"].tolist()]
    force, turn = (np.array([one[n] for one in exact]) for n in (0, 1))
    # of first order in the difference between neighbouring ticks (0.8 ms) for the force: a third
    # of it times the jerk, whose bound is w times the amplitude of what is felt, twice its rate
    jerk = 2 * math.sqrt(9.81 / 0.4) * np.abs(force).max()
    assert np.abs(samples["acceleration"] - force).max() < 0.8e-3 / 3 * jerk + 1e-2
    share = 0.5 * (2 * math.sqrt(9.81 / 0.4) * 1.4e-3) ** 2
    assert np.abs(samples["angular_velocity"] - turn).max() < share * np.abs(turn).max() + 1e-5


def test_a_day_later_it_feels_the_same() -> None:
    motion, _ = pendulum(0.9, 0.4)
    late_us = 86_400_000_000
    imu, found = Imu(replace(NOISY, rate_hz=4000.0)), []
    for shift_us in (0, late_us):
        state, parts = imu.init(0), []
        for t_us in ticks(1000, 200_000):
            position, turn = motion(t_us * 1e-6)
            samples, state = imu.step(CameraPose(position, turn.ravel()), G, state, shift_us + t_us)
            parts.append(samples)
        found.append(np.concatenate(parts))
    assert (found[1]["t"] - late_us == found[0]["t"]).all()
    silent = felt(replace(IDEAL, rate_hz=4000.0), motion, ticks(1000, 200_000))
    for samples in found:
        # another day, other noise; the walk begins with the run
        off = samples["acceleration"] - silent["acceleration"]
        assert 0 < np.abs(off).max() < 6 * 3e-3 * math.sqrt(4000) + 6 * 2e-3 * math.sqrt(0.2)


def test_integrating_the_samples_gives_the_way_back() -> None:
    motion, _ = pendulum(0.9, 0.4)
    samples = felt(IDEAL, motion, ticks(1000, 1_001_000))
    position, turn = motion(1e-3)
    velocity = (motion(2e-3)[0] - position) / 1e-3
    optical = np.diag([1.0, -1.0, -1.0])
    for before, after in itertools.pairwise(samples):
        # the step of MuJoCo's own integrator, with the acceleration at the new place
        position = position + velocity * 1e-3
        rate = optical @ (before["angular_velocity"] + after["angular_velocity"]) / 2
        turn = turn @ rotation(rate * 1e-3)
        velocity = velocity + (turn @ optical @ after["acceleration"] + G) * 1e-3
    end, end_turn = motion(1.0)
    assert position == pytest.approx(end, abs=2e-4)
    assert turn == pytest.approx(end_turn, abs=2e-5)


def rotation(vector: F64) -> F64:
    """Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / (angle or 1.0)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix: F64 = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return matrix


def test_the_turn_between_two_orientations() -> None:
    random = np.random.default_rng(0)
    for size in (1e-9, 1e-4, 0.1, 1.0, 2.0, 3.0, 3.14159):
        for _ in range(50):
            axis = random.normal(size=3)
            vector = size * axis / np.linalg.norm(axis)
            before = rotation(random.normal(size=3))
            found = rotation_vector(
                before.ravel().tolist(), (before @ rotation(vector)).ravel().tolist()
            )
            # a matrix holds the last bit of its largest numbers; near half a turn, of its sine too
            assert found == pytest.approx(
                vector, abs=3e-15 * max(1.0, 1 / max(1e-6, 3.1416 - size))
            )
    assert rotation_vector(np.eye(3).ravel().tolist(), np.eye(3).ravel().tolist()) == (0, 0, 0)
    half = rotation_vector(np.eye(3).ravel().tolist(), [-1, 0, 0, 0, -1, 0, 0, 0, 1])
    assert np.abs(half) == pytest.approx([0, 0, math.pi])


def test_bias_range_and_temperature() -> None:
    parameters = replace(
        IDEAL,
        accelerometer_bias=(0.5, -0.25, 100.0),
        accelerometer_range_g=4.0,
        gyroscope_bias=(0.01, -20.0, 0.0),
        gyroscope_range_dps=500.0,
        temperature_c=36.6,
    )
    samples = felt(parameters, lambda _: (np.zeros(3), UPRIGHT), ticks(1000, 5000))
    force, turn = samples["acceleration"][-1], samples["angular_velocity"][-1]
    assert force == pytest.approx([0.5, -10.06, 4 * STANDARD_GRAVITY], rel=FLOAT32)
    assert turn == pytest.approx([0.01, -500 * DEGREE, 0.0], rel=FLOAT32)
    assert samples["temperature"][-1] == np.float32(36.6)
    # as a file holds them: float32 in g and degrees/s, and back without a change
    said = (samples["acceleration"] / STANDARD_GRAVITY).astype(np.float32)
    assert (said.astype(np.float64) * STANDARD_GRAVITY == samples["acceleration"]).all()


def test_one_term_does_not_change_another() -> None:
    def still(**changes: float) -> ImuSamples:
        parameters = replace(IDEAL, **changes)
        return felt(parameters, lambda _: (np.zeros(3), UPRIGHT), ticks(1000, 50_000), seed=5)

    white = still(accelerometer_noise_density=3e-3)
    walk = still(accelerometer_random_walk=2e-3)
    both = still(accelerometer_noise_density=3e-3, accelerometer_random_walk=2e-3)
    silent = still()
    for key in ("angular_velocity", "temperature"):
        assert (both[key] == silent[key]).all()
    added = white["acceleration"] + walk["acceleration"] - silent["acceleration"]
    assert both["acceleration"] == pytest.approx(added, abs=5 * 10.0 * FLOAT32)
    assert (white["acceleration"] != walk["acceleration"]).any(axis=1).all()


@pytest.mark.parametrize("rate_hz", [1000.0, 8000.0, 130.0])
def test_a_saved_state_goes_on_with_the_same_bytes(rate_hz: float) -> None:
    motion, _ = pendulum(0.5, 0.4)
    imu = Imu(replace(NOISY, rate_hz=rate_hz))
    whole = felt(imu.parameters, motion, ticks(1000, 60_000), seed=9)
    state, parts = imu.init(9), []
    for t_us in ticks(1000, 60_000):
        position, turn = motion(t_us * 1e-6)
        samples, state = imu.step(CameraPose(position, turn.ravel()), G, state, t_us)
        parts.append(samples)
        file = io.BytesIO()
        np.savez(file, **state.save())
        file.seek(0)
        restored = ImuState.restore(np.load(file))
        assert restored == state
        state = restored
    assert np.concatenate(parts).tobytes() == whole.tobytes()


def test_noise_and_walk_do_not_depend_on_the_ticks() -> None:
    def still(_: float) -> tuple[F64, F64]:
        return np.zeros(3), UPRIGHT

    coarse = felt(NOISY, still, ticks(10_000, 210_000), seed=2)
    fine = felt(NOISY, still, [0, *range(9000, 201_000, 1000)], seed=2)
    start = 10_000
    assert coarse["t"][0] == start
    pairs = {int(one["t"]): one for one in fine if one["t"] >= start}
    # the fine one has a sample more before the first common one: its walk began earlier
    shift = pairs[start]["acceleration"] - coarse["acceleration"][0]
    for one in coarse:
        if int(one["t"]) in pairs:
            moved = pairs[int(one["t"])]["acceleration"] - one["acceleration"]
            assert moved == pytest.approx(shift, abs=1e-5)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"rate_hz": 0.0}, "sensor.imu.rate_hz is 0; give 0.001 ... 100000"),
        ({"accelerometer_bias": (1.0, 2.0)}, "give three numbers: x, y, z"),
        ({"gyroscope_bias": (1.0, "a", 2.0)}, "sensor.imu.gyroscope_bias is (1.0, 'a', 2.0)"),
        ({"gyroscope_noise_density": -1.0}, "sensor.imu.gyroscope_noise_density is -1"),
        ({"gyroscope_random_walk": math.nan}, "sensor.imu.gyroscope_random_walk is nan"),
        ({"enabled": "yes"}, "sensor.imu.enabled is 'yes'; give true or false"),
    ],
)
def test_senseless_parameters(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(EvsError) as error:
        replace(IDEAL, **changes)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_time_that_stands_still_and_damaged_states_are_refused() -> None:
    imu = Imu(IDEAL)
    _, state = imu.step(CameraPose(np.zeros(3), UPRIGHT.ravel()), G, imu.init(0), 1000)
    with pytest.raises(EvsError, match="time went from 1000 us to 1000 us"):
        imu.step(CameraPose(np.zeros(3), UPRIGHT.ravel()), G, state, 1000)
    far = Imu(replace(IDEAL, rate_hz=1e5))
    with pytest.raises(EvsError, match="9999900 IMU samples in one tick"):
        felt(far.parameters, lambda _: (np.zeros(3), UPRIGHT), [0, 1000, 100_000_000, 100_001_000])
    with pytest.raises(EvsError, match="lacks 'walk'"):
        ImuState.restore({k: v for k, v in state.save().items() if k != "walk"})
    with pytest.raises(EvsError, match="other shapes"):
        ImuState.restore({**state.save(), "walk": np.zeros((2, 4))})
