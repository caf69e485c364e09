"""Parameters that change while pixels run: exact for every term, and refused where it cannot be."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import evs
from evs.emulator import _core
from evs.emulator.base.scene import F32
from evs.emulator.sensor import PlainModel, SensorParameters
from evs.emulator.sensor.running_mean import RunningMeanConstants
from evs.msgs import EvsError
from reference.pixel.model import ReferenceModel, caught_up

SENSOR = SensorParameters("test", 10, 8, 0.2, 0.2, 0.03)
NOISY = replace(
    SENSOR, cutoff_hz=300.0, follower_hz=900.0, highpass_hz=0.1, leak_rate_hz=5.0,
    parasitic_leak_hz=5.0, shot_noise_rate_hz=100.0, noise_rate_cov_decades=0.2,
    refractory_period_s=0.0003, hot_leak_median_hz=1.0, dead_pixel_fraction=0.1, dark_lux=0.1,
)  # fmt: skip
SILICON = replace(NOISY, log="ln", filter="large_signal", photocurrent_pa=0.3)
QUIET = {
    "highpass_hz": 0.0, "leak_rate_hz": 0.1, "parasitic_leak_hz": 0.1, "shot_noise_rate_hz": 0.5,
    "hot_leak_median_hz": 0.01,
}  # fmt: skip
"""Of still light: so little happens that blocks are skipped."""
CHANGES: dict[str, dict[str, Any]] = {
    "lower thresholds": {"pos_thres": 0.05, "neg_thres": 0.07},
    "higher thresholds": {"pos_thres": 1.0, "neg_thres": 0.9},
    "mismatch": {"sigma_thres": 0.1},
    "filters": {"cutoff_hz": 30.0, "follower_hz": 20.0, "highpass_hz": 10.0},
    "leak": {"leak_rate_hz": 900.0},
    "less leak": {"leak_rate_hz": 0.01},
    "shot noise": {"shot_noise_rate_hz": 5000.0},
    "refractory period": {"refractory_period_s": 0.01},
}


TICKS, CHANGED, BACK = 20, 12, 16
"""length of a film, and when parameters change and change back"""


@cache
def film(kind: str, ticks: int) -> list[F32]:
    """Still, moving until half of it, or wild."""
    x, y = np.arange(10), np.arange(8)[:, None]
    if kind == "wild":
        light = np.array([0.0, 1e-3, 0.5, 1.0, 50.0, np.nan], np.float32)
        random = np.random.default_rng(0)
        return [random.choice(light, size=(8, 10)) for _ in range(ticks)]
    moved = [min(k, ticks // 2) if kind == "stops" else 0 for k in range(ticks)]
    return [(0.3 + 0.2 * np.sin(x + 0.3 * y + 0.2 * k)).astype(np.float32) for k in moved]


def models_of(sensor: SensorParameters, average: RunningMeanConstants | None) -> list[Any]:
    """The oracle, then a native model for every instruction set."""
    natives = [
        PlainModel(sensor, 2, isa, average=average, causes=True) for isa in _core.isa_available()
    ]
    return [ReferenceModel(sensor, average=average, causes=True), *natives]


def go_on(models: list[Any], states: list[Any], kind: str, ticks: range) -> None:
    """Step all models, and check each against the first; `states` becomes those after the ticks."""
    for k in ticks:
        frame, span = film(kind, TICKS)[k], (1000 * k, 1000 * (k + 1))
        events, states[0] = models[0].step(frame, states[0], *span)
        for i, model in enumerate(models[1:], start=1):
            ours, states[i] = model.step(frame, states[i], *span)
            assert ours.tobytes() == events.tobytes(), f"{kind}, tick {k}"
            assert caught_up(model.sensor, states[i]) == states[0]


@cache
def before_change(
    sensor: SensorParameters, average: RunningMeanConstants | None, kind: str
) -> tuple[list[Any], list[Any]]:
    """All models, and their states at tick CHANGED: the same for every change that follows."""
    models = models_of(sensor, average)
    states = [model.init(5) for model in models]
    go_on(models, states, kind, range(CHANGED))
    return models, states


@pytest.mark.slow
@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
@pytest.mark.parametrize("sensor", [NOISY, SILICON], ids=["linear", "silicon"])
@pytest.mark.parametrize("average", [None, RunningMeanConstants()], ids=["plain", "adaptive"])
def test_native_is_the_oracle_over_a_change(
    change: dict[str, Any], sensor: SensorParameters, average: RunningMeanConstants | None
) -> None:
    """There and back, where all blocks are skipped and where none is; on every instruction set."""
    for kind in ("still", "stops", "wild"):
        start = replace(sensor, **QUIET) if kind == "still" else sensor  # type: ignore[arg-type]
        # of the terms that it has
        other = replace(start, **{key: x for key, x in change.items() if getattr(start, key)})
        before, kept = before_change(start, average, kind)
        if kind == "still" and sensor is NOISY:
            assert np.all(kept[1].since_us < kept[1].clock_us)
        # a step consumes its state
        states = deepcopy(kept)
        for now, ticks in ((other, range(CHANGED, BACK)), (start, range(BACK, TICKS))):
            after = models_of(now, average)
            states = [
                new.take_over(state, old)
                for new, state, old in zip(after, states, before, strict=True)
            ]
            go_on(after, states, kind, ticks)
            before = after


def test_a_still_pixel_fires_once_a_threshold_has_passed_it() -> None:
    """Without any term nothing but light wakes a block otherwise."""
    sensor = replace(SENSOR, sigma_thres=0.0)
    model, light = PlainModel(sensor, 1), np.full((8, 10), 0.5, np.float32)
    _, state = model.step(light, model.init(0), 0, 1000)
    none, state = model.step(light * np.float32(1.1), state, 1000, 2000)
    lower = PlainModel(replace(sensor, pos_thres=0.09), 1)
    state = lower.take_over(state, model)
    events, state = lower.step(light * np.float32(1.1), state, 2000, 3000)
    later, _ = lower.step(light * np.float32(1.1), state, 3000, 4000)
    assert len(none) == len(later) == 0
    assert len(events) == 80
    assert np.all(events["p"] == 1)
    assert np.all(events["t"] == 2001)


@pytest.mark.statistical
def test_shot_noise_has_its_new_rate_at_once() -> None:
    """From .01 to 50 Hz: without a new draw the first event would come after a minute."""
    slow = replace(SENSOR, width=64, height=64, shot_noise_rate_hz=0.01)
    fast = replace(slow, shot_noise_rate_hz=50.0)
    light = np.zeros((64, 64), np.float32)
    before, model = PlainModel(slow, 1), PlainModel(fast, 1)
    _, state = before.step(light, before.init(3), 0, 2000)
    _, always = model.step(light, model.init(3), 0, 2000)
    changed = model.take_over(state, before)
    counts = np.zeros((2, 100))
    for k in range(100):
        span = (1000 * k + 2000, 1000 * k + 3000)
        events, changed = model.step(light, changed, *span)
        others, always = model.step(light, always, *span)
        counts[:, k] = len(events), len(others)
    for ticks in (10, 100):
        ours, theirs = counts[:, :ticks].sum(1)
        # five standard deviations of the difference of two Poisson numbers
        assert abs(ours - theirs) < 5 * (ours + theirs) ** 0.5
        assert theirs > 100 * ticks


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cutoff_hz": 0.0}, "sensor.cutoff_hz is 0 and was over 0"),
        ({"refractory_period_s": 0.0}, "sensor.refractory_period_s is 0 and was over 0"),
        ({"shot_noise_rate_hz": 0.0}, "sensor.shot_noise_rate_hz is 0 and was over 0"),
    ],
)
def test_a_term_neither_comes_nor_goes(change: dict[str, Any], message: str) -> None:
    model, other = PlainModel(NOISY, 1), PlainModel(replace(NOISY, **change), 1)
    light = np.full((8, 10), 0.5, np.float32)
    for before, after, line in (
        (model, other, message),
        (other, model, message.replace("is 0 and was over 0", "is .* and was 0")),
    ):
        _, state = before.step(light, before.init(0), 0, 1000)
        kept = state.copy()
        with pytest.raises(EvsError, match=line):
            after.take_over(state, before)
        assert state == kept


def moving(t_us: int) -> F32:
    return (0.5 + 0.4 * np.sin(np.arange(48) / 5 + t_us / 4000) * np.ones((32, 1))).astype("f4")


@pytest.fixture(scope="module")
def scene() -> str:
    return (
        '<mujoco><worldbody><light pos="0 0 3"/><body pos="0 0 1"><freejoint/>'
        '<geom size=".2"/></body><geom type="plane" size="3 3 .1"/>'
        '<camera name="eye" pos="0 -2 1" xyaxes="1 0 0 0 .2 1"/></worldbody></mujoco>'
    )


def camera_of(world: evs.World, model: str = "plain", preset: str = "davis346") -> Any:
    sensor = evs.SensorConfig(preset=preset, width=64, height=48)
    return world.add_camera("eye", sensor=sensor, model=evs.ModelConfig(name=model))


@pytest.mark.parametrize("model", ["plain", "adaptive", "evsnet"])
def test_a_camera_changes_between_two_ticks(scene: str, model: str, tmp_path: Any) -> None:
    """The prefix stays, the rest differs; a state saved at once goes on with the same bytes."""
    (tmp_path / "ball.xml").write_text(scene)

    def world() -> tuple[evs.World, Any]:
        made = evs.World(str(tmp_path / "ball.xml"), seed=4)
        return made, camera_of(made, model)

    (plain, _), (changed, camera), (again, other) = world(), world(), world()
    before = [plain.step()[0].events.tobytes() for _ in range(30)]
    after = [changed.step()[0].events.tobytes() for _ in range(20)]
    camera.adjust(pos_thres=0.3, neg_thres=0.3)
    assert camera.sensor.pos_thres == 0.3
    assert camera.info.config["sensor"]["pos_thres"] == 0.3
    blob = changed.save()
    after += [changed.step()[0].events.tobytes() for _ in range(10)]
    assert after[:20] == before[:20]
    assert after[20:] != before[20:]
    # a state is of the sensor that it was saved with
    with pytest.raises(EvsError, match="sensor"):
        again.restore(blob)
    other.adjust(pos_thres=0.3, neg_thres=0.3)
    again.restore(blob)
    assert [again.step()[0].events.tobytes() for _ in range(10)] == after[20:]


def test_biases_change_too(scene: str, tmp_path: Any) -> None:
    (tmp_path / "ball.xml").write_text(scene)
    world = evs.World(str(tmp_path / "ball.xml"))
    camera = camera_of(world, preset="imx636")
    before = camera.sensor.pos_thres
    world.step()
    camera.adjust(**{"biases.bias_diff_on": 60})
    assert camera.sensor.pos_thres > before
    for keys, message in (
        ({"biases.bias_diff_on": 1000}, "bias_diff_on is 1000"),
        ({"pos_thres": -1.0}, "sensor.pos_thres is -1; give 0.001 ... 20"),
        ({"pos_thres": float("nan")}, "sensor.pos_thres is nan"),
        ({"pos_thres": "high"}, "sensor.pos_thres is 'high'"),
        ({"width": 7}, "no parameter that changes while a camera runs 'width'"),
        ({"posthres": 7}, "there is: pos_thres"),
    ):
        sensor = camera.sensor
        with pytest.raises(EvsError, match=message):
            camera.adjust(**keys)
        assert camera.sensor is sensor
    world.step()
