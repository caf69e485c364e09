"""Arrays that come back from a GPU."""

from __future__ import annotations

import numpy as np

from evs.emulator.base.gpu.arrays import take_from_device


def test_nan_of_a_gpu_gets_the_bits_of_a_cpu() -> None:
    """An H200 gives these NaNs where an x86-64 processor passes on np.nan."""
    found = np.array([0x3F800000, 0x7FFFFFFF, 0x80000000, 0xFF800000], np.uint32)
    light = np.empty(4, np.float32)
    take_from_device(light, found.view(np.uint8))
    assert light.view(np.uint32).tolist() == [0x3F800000, 0x7FC00000, 0x80000000, 0xFF800000]
    found = np.array([0xFFF8000000000000, 0x3FF0000000000000], np.uint64)
    reference = np.empty(2, np.float64)
    take_from_device(reference, found.view(np.uint8))
    assert reference.view(np.uint64).tolist() == [0x7FF8000000000000, 0x3FF0000000000000]
    found = np.array([0x7FFFFFFF], np.int32)
    counts = np.empty(1, np.int32)
    take_from_device(counts, found.view(np.uint8))
    assert counts.tolist() == [0x7FFFFFFF]
