"""Stress cases of the sensor's size: one pixel, a line, 16 million, and a network on those."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial

from evs.emulator.evsnet.network_files import load_network
from evs.emulator.evsnet.weights import NetworkWeights
from evs.msgs import EvsError
from evs.tools.stress.memory_limit import address_space
from evs.tools.stress.step_target import OPEN, SHUT, capture_step
from evs.tools.stress.stress_case import Measurement, StressCase

LARGE_PX, LARGE_SHORT_PX = 4096, 1024
"""sides of the largest sensor, and of the one in its place in the short form"""


def _size(width: int, height: int, short: bool) -> Measurement:
    """The plate moves in, out and in again; thresholds so high that events are few."""
    large = width == height == LARGE_PX
    if large and short:
        width = height = LARGE_SHORT_PX
    edge = 1.2 if large else SHUT
    sensor = {"width": width, "height": height, "pos_thres": 2.0, "neg_thres": 2.0}
    shown = capture_step(lambda tick: OPEN if tick in (0, 2) else edge, 6, {"sensor": sensor})
    on, off = shown.counts()
    # the last pixel has events, and all have the same ones each time
    right = bool(on[-1, -1] > 0 and (off == 2 * on).all())
    report = shown.capture.report
    messages = (
        f"{report.events:,} events of {width}x{height} px, {report.events_dropped} dropped",
    )
    return Measurement(
        shown.residual_thresholds(), 1.0 + shown.rounding(), "thresholds", messages, right
    )


def _network(short: bool) -> Measurement:
    """The network of 8 channels on a sensor of which every pixel moves, with too little memory."""
    side = LARGE_SHORT_PX if short else LARGE_PX
    pixels = side * side
    refusal = ""
    try:
        with address_space(600 * pixels):
            _film_network(side, 4)
    except EvsError as error:
        refusal = str(error)
    found = re.search(r"is ([\d.e+]+) GB of network state; [\d.e+-]+ GB are free", refusal)
    needed_gb = state_bytes(pixels) / 1e9
    off_by = abs(float(found[1]) - needed_gb) if found and "\n" not in refusal else float("nan")
    # with room it is there again, and what moves has events
    again = _film_network(64, 4) > 0
    return Measurement(off_by, 0.005 * needed_gb, "GB", (refusal,), again)


def _film_network(side: int, ticks: int) -> int:
    tables = {"sensor": {"width": side, "height": side}, "model": {"name": "evsnet"}}
    return capture_step(lambda tick: SHUT if tick else OPEN, ticks, tables).capture.report.events


def state_bytes(pixels: int) -> int:
    """What the native runtime remembers of moving pixels: 6 float32 an input of a convolution."""
    network = load_network("evsnet_c8")
    if not isinstance(network, NetworkWeights):
        raise EvsError("evsnet_c8 is no network of ours; install evs again")
    inputs = sum(int(one.weight.shape[1]) for one in network.convolutions)
    return pixels * 4 * 6 * inputs


def _plain(width: int, height: int) -> Callable[[bool], Measurement]:
    return partial(_size, width, height)


_TOLD = (
    "every pixel, the last one too, tells the light's change but for less than a threshold (at 1 "
    "there is one more event), and the same again backwards"
)

CASES = (
    StressCase("size-1x1", "sensor", "a sensor of one pixel", _TOLD, _plain(1, 1)),
    StressCase("size-1x4096", "sensor", "a sensor of one column of 4096", _TOLD, _plain(1, 4096)),
    StressCase(
        "size-4096x4096",
        "sensor",
        "16.8 million pixels (short: 1024 x 1024)",
        _TOLD,
        _plain(LARGE_PX, LARGE_PX),
    ),
    StressCase(
        "evsnet-4096x4096",
        "sensor",
        "the network on as many, all moving, with less memory than its state has",
        "refused in one line with the memory that it needs, 4 x 6 bytes a pixel and input, to the "
        "3 digits that it gives; then a small one runs",
        _network,
    ),
)
