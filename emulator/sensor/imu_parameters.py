"""ImuParameters: every number of the accelerometer and gyroscope in a camera's body."""

from __future__ import annotations

from dataclasses import dataclass

from evs.emulator.sensor.ranges import check_ranges, check_switch
from evs.msgs import EvsError

Vector = tuple[float, float, float]

_RANGES = {
    "rate_hz": (1e-3, 1e5),
    "accelerometer_bias": (-1e4, 1e4),
    "accelerometer_noise_density": (0.0, 1e4),
    "accelerometer_random_walk": (0.0, 1e4),
    "accelerometer_range_g": (0.0, 1e4),
    "gyroscope_bias": (-1e4, 1e4),
    "gyroscope_noise_density": (0.0, 1e4),
    "gyroscope_random_walk": (0.0, 1e4),
    "gyroscope_range_dps": (0.0, 1e6),
    "temperature_c": (-273.15, 1e4),
}


@dataclass(frozen=True)
class ImuParameters:
    """[sensor.imu]: names and meanings as Kalibr's, SI. EvsError for values without sense."""

    enabled: bool = False
    """whether there is an IMU at all"""
    rate_hz: float = 1000.0
    """samples per second; sample n is of n / rate_hz of simulated time"""
    accelerometer_bias: Vector = (0.0, 0.0, 0.0)
    """constant error of x, y, z, m/s^2"""
    accelerometer_noise_density: float = 0.0
    """white noise, m/s^2/sqrt(Hz): a sample's standard deviation is this times sqrt(rate_hz)"""
    accelerometer_random_walk: float = 0.0
    """how the bias walks, m/s^3/sqrt(Hz): its standard deviation after T s is this times sqrt(T)"""
    accelerometer_range_g: float = 0.0
    """largest value of an axis, standard gravities; it clips there; 0: no limit"""
    gyroscope_bias: Vector = (0.0, 0.0, 0.0)
    """constant error of x, y, z, rad/s"""
    gyroscope_noise_density: float = 0.0
    """white noise, rad/s/sqrt(Hz)"""
    gyroscope_random_walk: float = 0.0
    """how the bias walks, rad/s^2/sqrt(Hz)"""
    gyroscope_range_dps: float = 0.0
    """largest value of an axis, degrees/s; it clips there; 0: no limit"""
    temperature_c: float = 25.0
    """what the thermometer says, always"""

    def __post_init__(self) -> None:
        check_switch("sensor.imu", self, "enabled")
        for key in ("accelerometer_bias", "gyroscope_bias"):
            value = getattr(self, key)
            if not isinstance(value, tuple) or len(value) != 3:
                raise EvsError(f"sensor.imu.{key} is {value!r}; give three numbers: x, y, z")
        check_ranges("sensor.imu", self, _RANGES)
