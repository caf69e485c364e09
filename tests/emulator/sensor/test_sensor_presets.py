"""Presets, the user's own sensor files, and every way to get them wrong."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from evs.emulator.camera.pixel_pipeline import make_event_model
from evs.emulator.config import ModelConfig, SensorConfig
from evs.emulator.sensor import PlainModel, SensorParameters, preset_names, resolve_sensor
from evs.emulator.sensor.reference.filters import bandwidth
from evs.msgs import EvsError

SIZES = {
    "davis240": (240, 180),
    "davis346": (346, 260),
    "dvs128": (128, 128),
    "dvxplorer": (640, 480),
    "genx320": (320, 320),
    "ideal": (346, 260),
    "imx636": (1280, 720),
    "v2e": (346, 260),
}
NO_CHIP = {"ideal", "v2e"}
OWN = "width = 20\nheight = 10\npos_thres = 0.3\nneg_thres = 0.4\n"


def refusal(config: SensorConfig) -> str:
    with pytest.raises(EvsError) as error:
        resolve_sensor(config)
    message = str(error.value)
    assert "\n" not in message
    return message


def test_every_preset_resolves() -> None:
    assert preset_names() == sorted(SIZES)
    for name, size in SIZES.items():
        sensor = resolve_sensor(SensorConfig(preset=name))
        assert (sensor.name, sensor.width, sensor.height) == (name, *size)


def test_every_value_of_a_preset_tells_its_source() -> None:
    folder = Path(__file__).parents[3] / "config" / "sensors"
    for path in folder.glob("*.toml"):
        lines = [line for line in path.read_text().splitlines() if "=" in line.split("#")[0]]
        assert lines
        assert all("#" in line for line in lines), path


NOISE = (
    *("cutoff_hz", "follower_hz", "highpass_hz", "leak_rate_hz", "parasitic_leak_hz"),
    *("shot_noise_rate_hz", "photocurrent_pa", "noise_rate_cov_decades", "refractory_period_s"),
    *("hot_leak_median_hz", "dead_pixel_fraction", "sigma_thres", "dark_lux"),
)


def slower_hz(chip: SensorParameters, lux: float) -> float:
    """The pole that both poles are as one to noise: f1 f2 / (f1 + f2)."""
    first = chip.cutoff_hz * (lux + chip.dark_current_lux) / chip.bright_lux
    second = chip.follower_hz
    return first * second / (first + second)


def test_ideal_has_nothing_that_a_chip_has() -> None:
    ideal = resolve_sensor(SensorConfig("ideal"))
    assert {key: getattr(ideal, key) for key in NOISE} == dict.fromkeys(NOISE, 0.0)


@pytest.mark.parametrize("name", sorted(set(SIZES) - NO_CHIP))
def test_a_chip_has_noise_speed_and_a_floor(name: str) -> None:
    chip = resolve_sensor(SensorConfig(name))
    # the log of photocurrent and dark current, and a photoreceptor of silicon
    assert (chip.log, chip.filter) == ("ln", "large_signal")
    # leak of about one event in ten seconds: the usual one, the tail's below 5 Hz, that of light
    leak = chip.leak_rate_hz + 0.0753 / 0.0045 * chip.hot_leak_median_hz
    leak += 0.161 * chip.parasitic_leak_hz
    assert 0.02 < leak < 0.5
    # noise is that of the photocurrent, not v2e's, and at white it reaches no threshold
    assert chip.shot_noise_rate_hz == 0.0 < chip.photocurrent_pa
    white = math.sqrt(chip.photon_scale_us * 2e-6 * math.pi * slower_hz(chip, 1000.0) / 255.0)
    assert white < 0.1 * min(chip.pos_thres, chip.neg_thres)
    # bandwidth follows the photocurrent and the dark current, which counts once
    assert chip.dim_lux == 0.0 < chip.dark_lux
    # thresholds spread, and so much that none falls to the floor of 0.01
    assert 0.0 < chip.sigma_thres < (min(chip.pos_thres, chip.neg_thres) - 0.01) / 2.5
    assert chip.refractory_period_s < 1e-3


def test_v2e_has_the_pixel_of_v2e() -> None:
    """The parameters with which the golden counts of v2e are met, but for its thresholds."""
    ours = resolve_sensor(SensorConfig("v2e"))
    assert ours == SensorParameters(
        "v2e", 346, 260, 0.2, 0.2, 0.03, log="linlog", linlog_dn=20.0, cutoff_hz=300.0,
        filter="euler", leak_rate_hz=0.01, shot_noise_rate_hz=0.001, noise_rate_cov_decades=0.1,
        refractory_period_s=0.0005,
    )  # fmt: skip
    # its bandwidth at DN is 300 Hz (DN + 20) / 275
    dn = np.array([0.0, 100.0, 255.0], np.float32)
    share = bandwidth(ours, dn, 1000) / (2 * math.pi * 0.3)
    assert share == pytest.approx((dn + 20) / 275, rel=1e-6)


def test_configuration_overrides_the_preset() -> None:
    sensor = resolve_sensor(SensorConfig(preset="imx636", width=64, pos_thres=0.5, log="log_eps"))
    assert (sensor.width, sensor.height, sensor.pos_thres, sensor.log) == (64, 720, 0.5, "log_eps")


def test_default_sensor_is_davis346_on_the_log_of_silicon() -> None:
    sensor = resolve_sensor(SensorConfig())
    assert (sensor.name, sensor.log, sensor.linlog_dn) == ("davis346", "ln", math.e)
    assert sensor.exposure_dn == 255.0


def test_own_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(OWN)
    sensor = resolve_sensor(SensorConfig(preset=str(path), sigma_thres=0.1))
    assert sensor == SensorParameters("mine", 20, 10, 0.3, 0.4, 0.1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (OWN + "pos_tres = 1\n", "there is: pos_thres"),
        ("width = 20\nheight = 10\n", "lacks pos_thres, neg_thres"),
        ("width = ", "is not TOML"),
        (OWN.replace("20", "'wide'"), "sensor.width is 'wide'"),
        (OWN.replace("0.3", "true"), "sensor.pos_thres is True"),
    ],
)
def test_faults_of_an_own_file(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    assert said in refusal(SensorConfig(preset=str(path)))


def test_no_such_file(tmp_path: Path) -> None:
    assert "davis346" in refusal(SensorConfig(preset=str(tmp_path / "none.toml")))
    assert "no sensor file" in refusal(SensorConfig(preset=str(tmp_path)))


def test_unknown_preset_says_the_nearest_first() -> None:
    assert "there is: davis346" in refusal(SensorConfig(preset="davis364"))
    assert "there is: dvs128" in refusal(SensorConfig(preset="DVS128"))


@pytest.mark.parametrize(
    ("config", "said"),
    [
        (SensorConfig(width=0), "sensor.width is 0"),
        (SensorConfig(height=-3), "sensor.height is -3"),
        (SensorConfig(width=8193), "sensor.width is 8193; give 1 ... 8192"),
        (SensorConfig(width=8192, height=8192), "make it at most 64000000 px"),
        (SensorConfig(pos_thres=0.0), "sensor.pos_thres is 0"),
        (SensorConfig(neg_thres=-0.2), "sensor.neg_thres is -0.2"),
        (SensorConfig(pos_thres=math.nan), "sensor.pos_thres is nan"),
        (SensorConfig(neg_thres=math.inf), "sensor.neg_thres is inf"),
        (SensorConfig(sigma_thres=-0.1), "sensor.sigma_thres is -0.1"),
        (SensorConfig(linlog_dn=1.0), "monotone only above 1"),
        (SensorConfig(linlog_dn=math.nan), "sensor.linlog_dn is nan"),
        (SensorConfig(log_eps=0.0), "sensor.log_eps is 0"),
        (SensorConfig(dark_lux=-1.0), "sensor.dark_lux is -1"),
        (SensorConfig(dark_lux=1e-40), "sensor.dark_lux is 1e-40; give 0 or"),
        (SensorConfig(preset="ideal", log="ln"), "sensor.dark_lux is 0 and black has no logarithm"),
        (SensorConfig(exposure_dn=0.0), "sensor.exposure_dn is 0"),
        (SensorConfig(exposure_dn=math.nan), "sensor.exposure_dn is nan"),
        (SensorConfig(log="linear"), "no log map (sensor.log) 'linear'; there is: linlog"),
    ],
)
def test_senseless_values(config: SensorConfig, said: str) -> None:
    assert said in refusal(config)


def test_models_by_name() -> None:
    sensor = resolve_sensor(SensorConfig(width=4, height=3))
    assert isinstance(make_event_model(sensor, ModelConfig(), 1), PlainModel)
    with pytest.raises(EvsError, match="no model 'plane'; there is: plain"):
        make_event_model(sensor, ModelConfig(name="plane"))
    with pytest.raises(EvsError, match="cannot run instruction set 'neon'"):
        PlainModel(sensor, 1, isa="neon")
