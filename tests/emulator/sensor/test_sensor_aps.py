"""Active pixels against closed forms: blur, shutter, exposure inside a tick, ADC, noise, state."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from evs.emulator.sensor import Aps, ApsParameters, ApsState
from evs.msgs import EvsError, Frame

F64 = npt.NDArray[np.float64]
Light = Callable[[float], npt.NDArray[Any]]

LINEAR = ApsParameters(enabled=True, rate_hz=20.0, exposure_us=10_000, bits=16, adc_bits=16)
"""Light to numbers with nothing between but 16 bits: a step is 1/65535 of white."""
STEP = 1.0 / 65535


def taken(
    stage: Aps, light: Light, ticks_us: list[int], seed: int = 0
) -> tuple[list[Frame], ApsState]:
    """The frames of analytic light, light(t_s), seen at these instants."""
    state, frames = stage.init(seed), []
    before = ticks_us[0] - 1
    for t_us in ticks_us:
        found, state = stage.step(light(t_us * 1e-6).astype(np.float32), state, before, t_us)
        frames += found
        before = t_us
    return frames, state


def ticks(tick_us: int, until_us: int) -> list[int]:
    return list(range(0, until_us + 1, tick_us))


def edge(speed: float, width: int, rows: int = 3, dark: float = 0.1) -> Light:
    """Light in front of an edge at x = speed t, of pixels that are unit squares; linear in x."""
    columns = np.arange(width)

    def light(t_s: float) -> F64:
        covered = np.clip(speed * t_s - columns, 0.0, 1.0)
        return np.tile(dark + (0.9 - dark) * covered, (rows, 1))

    return light


def edge_blur(speed: float, width: int, begin_s: float, end_s: float, dark: float = 0.1) -> F64:
    """The mean of `edge` over an exposure: pixel x's covered share, integrated over time."""
    columns = np.arange(width)

    def integral(t_s: float) -> F64:
        # of clip(v t - x, 0, 1) over time
        passed = np.clip(speed * t_s - columns, 0.0, None)
        return (passed**2 / 2 - np.clip(passed - 1.0, 0.0, None) ** 2 / 2) / speed

    share = (integral(end_s) - integral(begin_s)) / (end_s - begin_s)
    return dark + (0.9 - dark) * share


def values(frame: Frame) -> F64:
    return frame.pixels.astype(np.float64) / np.iinfo(frame.pixels.dtype).max


@pytest.mark.parametrize("exposure_us", [10_000, 7_300, 1, 12_345])
@pytest.mark.parametrize("tick_us", [1000, 100, 700])
def test_a_moving_edge_is_blurred_along_its_way(exposure_us: int, tick_us: int) -> None:
    # 400 px/s: 4 px in 10 ms; an edge takes 2.5 ms over a pixel, so that light bends in few ticks
    stage = Aps(replace(LINEAR, exposure_us=exposure_us), 60, 3)
    frames, _ = taken(stage, edge(400.0, 60), ticks(tick_us, 150_000))
    assert [frame.exposure_begin_us for frame in frames] == [0, 50_000, 100_000]
    for seq, frame in enumerate(frames):
        begin_s = frame.exposure_begin_us * 1e-6
        end_s = frame.exposure_end_us * 1e-6
        assert frame.seq == seq
        assert frame.exposure_end_us - frame.exposure_begin_us == exposure_us
        exact = edge_blur(400.0, 60, begin_s, end_s)
        # light bends twice a pixel; a chord over a bend of slope s errs by s T^2 / 8 in the
        # integral at most, here s = 0.8 * 400 / s
        bend = 2 * 0.8 * 400.0 * (tick_us * 1e-6) ** 2 / 8 / (exposure_us * 1e-6)
        assert np.abs(values(frame) - exact).max() <= min(bend, 0.8 * 400 * tick_us * 1e-6) + STEP


def test_an_exposure_is_cut_to_the_microsecond_inside_a_tick() -> None:
    # light grows linearly, so the trapezoids are exact and only the cut can err
    def light(t_s: float) -> F64:
        return np.full((2, 2), 5.0 * t_s)

    for exposure_us in (1, 999, 1001, 3377):
        parameters = replace(LINEAR, rate_hz=1e6 / 12_347, exposure_us=exposure_us)
        frames, _ = taken(Aps(parameters, 2, 2), light, ticks(1000, 150_000))
        assert len(frames) == 12 + (exposure_us < 1837)  # 12 x 12347 + 1836 = 150000
        for n, frame in enumerate(frames):
            assert frame.begin_us == 12_347 * n
            middle_s = (frame.exposure_begin_us + frame.exposure_end_us) / 2e6
            assert np.abs(values(frame) - 5.0 * middle_s).max() <= 0.5 * STEP + 1e-6


def test_a_rolling_shutter_skews_what_moves() -> None:
    # rows begin 200 us apart: at 400 px/s each sees the edge 0.08 px further
    rolling = replace(LINEAR, shutter="rolling", row_us=200.0, exposure_us=5000)
    rows, light = 40, edge(400.0, 60, 40)
    frames, _ = taken(Aps(rolling, 60, rows), light, ticks(100, 120_000))
    assert [frame.begin_us for frame in frames] == [0, 50_000, 100_000]
    frame = frames[1]
    assert (frame.exposure_begin_us, frame.exposure_end_us) == (50_000, 55_000)
    assert frame.end_us == 50_000 + 5000 + rows * 200
    skewed = [
        edge_blur(400.0, 60, 0.05 + 200e-6 * row, 0.055 + 200e-6 * row) for row in range(rows)
    ]
    bend = 2 * 0.8 * 400.0 * 100e-6**2 / 8 / 5e-3
    assert np.abs(values(frame) - np.array(skewed)).max() <= bend + STEP
    # the edge's place in each row: 0.08 px a row
    place = ((values(frame) - 0.1) / 0.8).sum(axis=1)
    assert np.diff(place) == pytest.approx(np.full(rows - 1, 0.08), abs=2 * 60 * STEP)
    still, _ = taken(Aps(replace(rolling, shutter="global"), 60, rows), light, ticks(100, 120_000))
    assert (still[1].pixels == still[1].pixels[0]).all()
    assert (still[1].pixels[0] == frame.pixels[0]).all()
    assert still[1].end_us == frame.end_us


def test_rolling_frames_overlap_when_the_next_begins_before_the_last_row_has_ended() -> None:
    rolling = replace(LINEAR, shutter="rolling", row_us=480.0, exposure_us=9000, rate_hz=100.0)
    frames, state = taken(Aps(rolling, 4, 20), edge(100.0, 4, 20), ticks(1000, 60_000))
    assert [frame.begin_us for frame in frames] == [0, 10_000, 20_000, 30_000, 40_000]
    assert [exposure.index for exposure in state.open] == [5]
    for frame in frames:
        for row in range(20):
            begin_s = (frame.begin_us + 480 * row) * 1e-6
            exact = edge_blur(100.0, 4, begin_s, begin_s + 9e-3)
            bend = 2 * 0.8 * 100.0 * 1e-6 / 8 / 9e-3
            assert np.abs(values(frame)[row] - exact).max() <= bend + STEP


@pytest.mark.parametrize("shutter", ["global", "rolling"])
def test_the_tick_does_not_matter(shutter: str) -> None:
    parameters = replace(LINEAR, shutter=shutter, row_us=50.0, exposure_us=8123)

    def light(t_s: float) -> F64:
        phase = np.arange(24).reshape(4, 6)
        return 0.5 + 0.4 * np.sin(2 * np.pi * 60.0 * t_s + phase)

    found = {}
    for tick_us in (1000, 500, 100, 10):
        frames, _ = taken(Aps(parameters, 6, 4), light, ticks(tick_us, 120_000))
        found[tick_us] = np.array([values(frame) for frame in frames])
    curvature = 0.4 * (2 * np.pi * 60.0) ** 2
    for tick_us, seen in found.items():
        # the trapezoid rule: f'' T^2 / 12 of the mean at most; cuts inside a tick: twice that
        assert np.abs(seen - found[10]).max() <= curvature * (tick_us * 1e-6) ** 2 / 6 + 2 * STEP
    assert np.abs(found[1000] - found[10]).max() > 50 * np.abs(found[100] - found[10]).max() / 2


@pytest.mark.parametrize("late_us", [86_400_000_000, 3_155_760_000_000_000])
def test_a_frame_after_a_day_or_a_century_is_that_of_the_beginning(late_us: int) -> None:
    parameters = replace(LINEAR, exposure_us=7777, shutter="rolling", row_us=30.0)

    found = []
    for shift_us in (0, late_us):
        stage, before = Aps(parameters, 60, 3), shift_us - 1
        state, frames = stage.init(0), []
        for t_us in range(shift_us, shift_us + 150_001, 1000):
            seen = edge(400.0, 60)((t_us - shift_us) * 1e-6).astype(np.float32)
            more, state = stage.step(seen, state, before, t_us)
            frames += more
            before = t_us
        found.append(frames)
    assert [one.begin_us - late_us for one in found[1]] == [one.begin_us for one in found[0]]
    assert len(found[0]) == 3
    for one, other in zip(*found, strict=True):
        assert (one.pixels == other.pixels).all()


def test_ticks_of_any_length_and_several_frames_in_one() -> None:
    parameters = replace(LINEAR, rate_hz=1000.0, exposure_us=500)

    def light(t_s: float) -> F64:
        return np.full((2, 2), 10.0 * t_s)

    frames, state = taken(Aps(parameters, 2, 2), light, [3500, 3600, 7450, 7900, 9999])
    assert [frame.begin_us for frame in frames] == [4000, 5000, 6000, 7000, 8000, 9000]
    assert [frame.seq for frame in frames] == list(range(6))
    for frame in frames:
        assert values(frame) == pytest.approx(10e-6 * (frame.begin_us + 250), abs=STEP)
    assert state.open == ()


@pytest.mark.parametrize(
    ("bits", "adc_bits", "light", "number"),
    [
        (8, 10, 1.0, 255),
        (8, 10, 5.0, 255),
        (8, 10, 0.5, 512 >> 2),
        (16, 10, 1.0, 1023 << 6),
        (16, 10, 0.25, 256 << 6),
        (8, 4, 1.0, 15 << 4),
        (8, 16, 1.0, 255),
        (16, 16, 1.0, 65535),
        (8, 8, 0.0, 0),
        (8, 1, 0.49, 0),
        (8, 1, 0.5, 128),
    ],
)
def test_white_clips_and_the_converter_rounds(
    bits: int, adc_bits: int, light: float, number: int
) -> None:
    parameters = ApsParameters(bits=bits, adc_bits=adc_bits)
    frames, _ = taken(Aps(parameters, 3, 2), lambda _: np.full((2, 3), light), ticks(1000, 40_000))
    assert len(frames) == 1
    assert frames[0].pixels.dtype == (np.uint8 if bits == 8 else np.uint16)
    assert (frames[0].pixels == number).all()


def test_gain_and_exposure_scale_the_light() -> None:
    def light(_: float) -> F64:
        return np.full((1, 1), 0.2)

    for gain, exposure_dn, share in ((1.0, 255.0, 0.2), (3.0, 255.0, 0.6), (1.0, 510.0, 0.4)):
        stage = Aps(replace(LINEAR, gain=gain), 1, 1, exposure_dn)
        (frame, *_), _ = taken(stage, light, ticks(1000, 60_000))
        assert values(frame)[0, 0] == pytest.approx(share, abs=STEP)


def test_light_without_sense_leaves_a_pixel_at_its_last_value() -> None:
    def light(t_s: float) -> F64:
        bad = np.array([[np.nan, np.inf, -1.0, 0.5]])
        return np.full((1, 4), 0.5) if t_s < 0.004 else bad

    (frame, *_), _ = taken(Aps(LINEAR, 4, 1), light, ticks(1000, 60_000))
    assert values(frame) == pytest.approx(0.5, abs=STEP)


def test_noise_is_as_strong_as_it_was_set() -> None:
    size, count = 200, 200 * 200
    for light in (0.1, 0.5):
        noisy = replace(LINEAR, full_well_e=10_000.0, read_noise_dn=100.0)
        (frame, second, *_), _ = taken(
            Aps(noisy, size, size),
            lambda _, v=light: np.full((size, size), v),
            ticks(10_000, 100_000),
        )
        seen = frame.pixels.astype(np.float64)
        mean, variance = light * 65535, light / 10_000 * 65535**2 + 100.0**2 + 1 / 12
        # mean and variance of n normal numbers: sigma / sqrt(n), variance sqrt(2 / n); 5 sigma
        assert abs(seen.mean() - mean) < 5 * np.sqrt(variance / count)
        assert abs(seen.var() / variance - 1) < 5 * np.sqrt(2 / count)
        both = np.corrcoef(seen.ravel(), second.pixels.ravel())[0, 1]
        assert abs(both) < 5 / np.sqrt(count)
        across = np.corrcoef(seen[:, 1:].ravel(), seen[:, :-1].ravel())[0, 1]
        assert abs(across) < 5 / np.sqrt(count)


def test_one_noise_does_not_change_the_other() -> None:
    def numbers(full_well_e: float, read_noise_dn: float) -> F64:
        parameters = replace(LINEAR, full_well_e=full_well_e, read_noise_dn=read_noise_dn)
        (frame, *_), _ = taken(
            Aps(parameters, 30, 20), lambda _: np.full((20, 30), 0.5), ticks(10_000, 60_000), seed=3
        )
        return frame.pixels.astype(np.float64)

    shot, read, both = numbers(1e4, 0.0), numbers(0.0, 200.0), numbers(1e4, 200.0)
    silent = numbers(0.0, 0.0)
    assert len(np.unique(silent)) == 1
    assert np.abs((both - silent) - (shot - silent) - (read - silent)).max() <= 1.5


def test_the_seed_alone_makes_the_noise() -> None:
    parameters = replace(LINEAR, read_noise_dn=50.0)

    def frame(seed: int, width: int = 6) -> npt.NDArray[Any]:
        stage = Aps(parameters, width, 4)
        frames, _ = taken(stage, lambda _: np.full((4, width), 0.5), ticks(10_000, 60_000), seed)
        return frames[0].pixels

    assert (frame(1) == frame(1)).all()
    assert (frame(1) != frame(2)).any()
    # a pixel's noise does not depend on the size of the sensor
    assert (frame(1, 9)[:, :6] == frame(1)).all()


def resumed(stage: Aps, light: Light, cuts: set[int]) -> Iterator[Frame]:
    state, before = stage.init(7), -1
    for t_us in ticks(1000, 120_000):
        frames, state = stage.step(light(t_us * 1e-6).astype(np.float32), state, before, t_us)
        yield from frames
        before = t_us
        if t_us in cuts:
            file = io.BytesIO()
            np.savez(file, **state.save())
            file.seek(0)
            restored = ApsState.restore(np.load(file))
            assert restored == state
            state = restored


def test_a_saved_state_goes_on_with_the_same_bytes() -> None:
    noisy = replace(
        LINEAR, shutter="rolling", row_us=900.0, read_noise_dn=9.0, full_well_e=1e4, rate_hz=30.0
    )
    stage, light = Aps(noisy, 12, 8), edge(100.0, 12, 8)
    whole = list(resumed(stage, light, set()))
    assert len(whole) == 4
    # before the first frame, within an exposure, during the read-out
    assert list(resumed(stage, light, {0, 4000, 36_000, 45_000, 60_000})) == whole


def test_a_step_leaves_the_state_it_was_given() -> None:
    stage = Aps(LINEAR, 2, 2)
    _, state = stage.step(np.ones((2, 2), np.float32), stage.init(0), -1, 0)
    _, state = stage.step(np.ones((2, 2), np.float32), state, 0, 1000)
    kept = state.save()
    _, after = stage.step(np.zeros((2, 2), np.float32), state, 1000, 2000)
    assert after != state
    assert ApsState.restore(kept) == state


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"rate_hz": 0.0}, "sensor.aps.rate_hz is 0; give 0.001 ... 100000"),
        ({"rate_hz": float("nan")}, "sensor.aps.rate_hz is nan"),
        ({"exposure_us": 0}, "sensor.aps.exposure_us is 0"),
        ({"exposure_us": 2.5}, "sensor.aps.exposure_us is 2.5; give a whole number"),
        ({"bits": 12}, "sensor.aps.bits is 12; give 8 or 16"),
        ({"adc_bits": 17}, "sensor.aps.adc_bits is 17; give 1 ... 16"),
        ({"shutter": "roling"}, "there is: rolling, global"),
        ({"gain": 0.0}, "sensor.aps.gain is 0"),
        ({"full_well_e": -1.0}, "sensor.aps.full_well_e is -1"),
        ({"enabled": 1}, "sensor.aps.enabled is 1; give true or false"),
        ({"row_us": "1"}, "sensor.aps.row_us is '1'; give a number"),
    ],
)
def test_senseless_parameters(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(EvsError) as error:
        replace(LINEAR, **changes)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_frames_that_take_longer_than_their_period_are_refused() -> None:
    with pytest.raises(EvsError, match=r"a frame takes 13900 us: give 71\.9424 at most"):
        Aps(replace(LINEAR, row_us=15.0, rate_hz=72.0), 4, 260)
    # a rolling shutter exposes and reads at the same time
    Aps(replace(LINEAR, row_us=15.0, rate_hz=72.0, shutter="rolling"), 4, 260)
    with pytest.raises(EvsError, match="a frame takes 10015 us"):
        Aps(replace(LINEAR, row_us=15.0, rate_hz=100.0, shutter="rolling"), 4, 260)
    with pytest.raises(EvsError, match="a frame takes 26000 us"):
        Aps(replace(LINEAR, row_us=100.0, rate_hz=40.0, shutter="rolling"), 4, 260)


def test_bad_light_and_ticks_are_refused() -> None:
    stage = Aps(LINEAR, 4, 3)
    with pytest.raises(EvsError, match=r"luminance is \(4, 3\), the frame \(height, width\)"):
        stage.step(np.zeros((4, 3), np.float32), stage.init(0), 0, 1)
    with pytest.raises(EvsError, match="does not go forward"):
        stage.step(np.zeros((3, 4), np.float32), stage.init(0), 5, 5)
    _, state = stage.step(np.zeros((3, 4), np.float32), stage.init(0), -1, 0)
    with pytest.raises(EvsError, match=r"2001 frames in the tick .* use shorter ticks"):
        stage.step(np.zeros((3, 4), np.float32), state, 0, 100_000_001)
    with pytest.raises(EvsError, match="lacks 'taken'"):
        ApsState.restore({k: v for k, v in stage.init(0).save().items() if k != "taken"})
