"""EvSNet as code for GPUs: every term of a convolution is an fma and nothing else is, nothing is
approximate, and denormals are flushed."""

from __future__ import annotations

import re

import pytest
from gpu.compile import compiled
from gpu.ptx import faults

from evs.emulator import _core
from evs.emulator.evsnet.gpu.network import KERNELS
from evs.emulator.evsnet.native import NativeRuntime
from evs.emulator.sensor import SensorParameters
from reference.networks import random_network

FMA = "fma.rn.ftz.f32"


@pytest.mark.parametrize(
    ("architecture", "channels"),
    [
        *((90, channels) for channels in (1, 4, 5)),
        *(pytest.param(name, 8, marks=pytest.mark.slow) for name in (75, 80, 90, 120)),
    ],
)
def test_instructions_are_those_of_a_cpu(architecture: int, channels: int) -> None:
    """So few inputs are unrolled: encoder, the two convolutions of a block, and the last one."""
    ptx = compiled("network", f"compute_{architecture}", {"EVS_CHANNELS": channels}).decode()
    assert f".target sm_{architecture}" in ptx
    assert all(f".entry {kernel}(" in ptx for kernel in KERNELS)
    assert faults(ptx) == [FMA]
    assert ptx.count(FMA) == 7 * channels + 2 * 7 * channels**2 + channels
    # what the convolutions sum stays in registers
    assert ".local" not in ptx


def test_those_of_many_channels_are_too() -> None:
    assert faults(compiled("network", "compute_90", {"EVS_CHANNELS": 64}).decode()) == [FMA]


def test_the_argument_has_the_size_that_kernels_expect() -> None:
    """Both compilers lay its structure out alike."""
    native = NativeRuntime(SensorParameters("test", 8, 8, 0.2, 0.2), random_network(1), threads=1)
    names = "last_luminance last_log v last moved fifo current leaked marks groups totals"
    argument = _core.DeviceNetwork(native.array).argument(0, **dict.fromkeys(names.split(), 0))
    ptx = compiled("network", "compute_90").decode()
    sizes = re.findall(r"\.param \.align 8 \.b8 \w+_param_0\[(\d+)\]", ptx)
    assert sizes == [str(argument.nbytes)] * len(KERNELS)
