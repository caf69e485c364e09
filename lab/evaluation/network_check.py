"""Check a network before `evs evaluate MODEL.onnx` measures it.

All checks run the network on one block of pixels in onnxruntime, so they are the same for our
networks and for graphs of another design.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evs.emulator.base.memory_limits import memory_gb
from evs.emulator.base.scene import F32
from evs.emulator.evsnet.graph_network import GraphNetwork, Network, read_graph_network
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.network_files import network_path, read_network
from evs.emulator.evsnet.onnx_graph import streaming_graph
from evs.emulator.evsnet.onnx_runtime import OnnxRuntime
from evs.emulator.evsnet.state import dense_bytes
from evs.emulator.evsnet.weights import MAX_STEP, NetworkWeights
from evs.emulator.sensor.parameters import SensorParameters
from evs.msgs import EvsError
from evs.tools.doctor.check import BAD, NOTE, OK

TOLERANCE = 1e-5
"""of a current, in units of the largest or of 1: float32 sums of another order"""
STILL_TICKS = 2000
REST_TICKS = 300
"""after which motion must be forgotten"""
MOVING_TICKS = 100
IMPULSE = 0.5
"""log units: a step of light"""
LATE_TICKS = 10
"""between the middle of an impulse's answer and what the sidecar says"""
SIZES = ((346, 260), (1280, 720), (4096, 4096))

_SIDE = 16
_PIXELS = _SIDE * _SIDE
_SEED = 20
_SHOWN = {OK: "", NOTE: "note", BAD: "**bad**"}


@dataclass(frozen=True)
class Finding:
    """The result of one check."""

    what: str
    found: str
    """one line"""
    verdict: str
    """OK, NOTE or BAD of tools/doctor/check.py"""


@dataclass(frozen=True)
class NetworkReport:
    """The results of all checks of a network."""

    name: str
    findings: tuple[Finding, ...]

    @property
    def is_sound(self) -> bool:
        """Whether no check failed."""
        return all(finding.verdict != BAD for finding in self.findings)

    def markdown(self) -> str:
        """A table, a finding a line."""
        rows = [f"| {self.name} | found | |", "|---|---|---|"]
        rows += [f"| {f.what} | {f.found} | {_SHOWN[f.verdict]} |" for f in self.findings]
        return "\n".join(rows) + "\n"


def check_network(network: str | Path, provider: str = "cpu") -> NetworkReport:
    """Look at the network of that path, or of that name in config/networks.

    Args:
        network: file or name.
        provider: the execution provider of onnxruntime it is run on.

    Raises:
        EvsError: one line, where it cannot be read or run at all: no file, damaged, no sidecar,
            other inputs or outputs.
    """
    path = network_path(str(network))
    found = read_network(path)
    stream = _Stream(found, provider)
    findings = [
        _shape(found, stream),
        _runtimes(found),
        *_same_as_named(path, found, stream),
        _chunks(stream),
        _alone(stream),
        _silence(found, stream, provider),
        _forgetting(found, stream),
        _strange_light(found, provider),
        *_impulse(found, stream),
        _extremes(stream),
        _memory(found),
    ]
    return NetworkReport(found.name, tuple(findings))


class _Stream:
    """Runs one block of pixels through a network, without the BiLIF."""

    def __init__(self, network: Network, provider: str) -> None:
        self.runtime = OnnxRuntime(_sensor(network), network, provider)
        self.rest = float(self.currents(np.zeros((64, _PIXELS), np.float32))[-1, 0])

    def currents(self, x: F32, cut: int = 32) -> F32:
        """(ticks, pixels) of X (ticks, pixels), `cut` ticks at a time, from rest."""
        fifos = list(self.runtime.own_arrays().values())
        found = []
        for first in range(0, len(x), cut):
            current, fifos = self.runtime.convolve(x[first : first + cut], fifos)
            found.append(current)
        return np.concatenate(found)

    def is_at_rest(self, currents: F32) -> bool:
        """Whether still light could give these: to the bit where it gives 0."""
        slack = 0.0 if self.rest == 0.0 else TOLERANCE * max(1.0, abs(self.rest))
        return bool(np.all(np.abs(currents - self.rest) <= slack))


def _shape(network: Network, stream: _Stream) -> Finding:
    shapes = Counter(f"{held.shape[0]} channels x {held.shape[1]}" for held in stream.runtime.held)
    states = ", ".join(f"{count} of {shape} ticks" for shape, count in shapes.items())
    low, high = network.spp
    found = (
        f"x, current and states: {states or 'none'}; tick {network.tick_us} us, tau "
        f"{network.tau_s:g} s, threshold {network.threshold:g}, {low} to {high} spp"
    )
    return Finding("inputs and outputs", found, OK)


def _runtimes(network: Network) -> Finding:
    if isinstance(network, GraphNetwork):
        return Finding("runtimes", "onnxruntime only: its weights do not have our names", NOTE)
    return Finding("runtimes", "native, onnxruntime, reference", OK)


def _same_as_named(path: Path, network: Network, stream: _Stream) -> list[Finding]:
    """Whether the file's own graph is the network that its named weights make."""
    what = "graph and named weights"
    if isinstance(network, GraphNetwork):
        return []
    graph = path.read_bytes()
    if graph == streaming_graph(network):
        return [Finding(what, "the graph is the one that evs writes", OK)]
    try:
        theirs = _Stream(_as_graph(network, graph), "cpu")
    except EvsError as reason:
        return [Finding(what, f"weights have our names, but {reason}", BAD)]
    x = _motion(64)
    ours, found = stream.currents(x), theirs.currents(x)
    off = _difference(found, ours)
    text = f"currents of the graph and of its named weights differ by {off:.1e}"
    return [Finding(what, text, OK if off < TOLERANCE else BAD)]


def _as_graph(weights: NetworkWeights, graph: bytes) -> GraphNetwork:
    keys = ("name", "tau_s", "threshold", "linlog_dn", "tick_us", "spp", "events_per_tick")
    look_ahead = [convolution.look_ahead for convolution in weights.convolutions]
    return read_graph_network(
        graph, {k: getattr(weights, k) for k in keys} | {"look_ahead": look_ahead}
    )


def _chunks(stream: _Stream) -> Finding:
    x = _motion(64)
    reference = stream.currents(x, 64)
    off = max(_difference(stream.currents(x, cut), reference) for cut in (1, 7, 32))
    if off == 0.0:
        return Finding("streaming", "chunks of 1, 7, 32 and 64 ticks give the same bytes", OK)
    text = f"chunks of 1, 7 or 32 ticks differ from one pass by {off:.1e}"
    return Finding("streaming", text, NOTE if off < TOLERANCE else BAD)


def _alone(stream: _Stream) -> Finding:
    x = _motion(64)
    order = np.random.default_rng(_SEED).permutation(_PIXELS)
    # neighbours differ in what they see, and one in whether it sees anything
    lone = np.zeros_like(x)
    lone[:, 7] = x[:, 7]
    reference = stream.currents(x)
    off = max(
        _difference(stream.currents(x[:, order]), reference[:, order]),
        _difference(stream.currents(lone)[:, 7], reference[:, 7]),
    )
    if off < TOLERANCE:
        return Finding("pixels", "each is computed for itself", OK)
    return Finding("pixels", f"a pixel's current depends on the others: by {off:.1e}", BAD)


def _silence(network: Network, stream: _Stream, provider: str) -> Finding:
    what = "X = 0"
    currents = stream.currents(np.zeros((STILL_TICKS, _PIXELS), np.float32))
    largest = float(np.max(np.abs(currents)))
    if largest == 0.0:
        return Finding(what, f"the current is exactly 0 for {STILL_TICKS} ticks", OK)
    light = np.full((STILL_TICKS, _SIDE, _SIDE), 0.5, np.float32)
    rate = _events(network, light, provider, 0) / _PIXELS / (STILL_TICKS * network.tick_us * 1e-6)
    text = f"a current of {stream.rest:.2g}: {rate:.3g} ghost events per px and s from still light"
    return Finding(what, text, NOTE if stream.is_at_rest(currents) else BAD)


def _forgetting(network: Network, stream: _Stream) -> Finding:
    what = "still after motion"
    x = np.concatenate([_motion(MOVING_TICKS), np.zeros((REST_TICKS, _PIXELS), np.float32)])
    after = stream.currents(x)[MOVING_TICKS:]
    moving = [k for k, current in enumerate(after) if not stream.is_at_rest(current)]
    memory = 1 + max(moving, default=-1)
    if memory < REST_TICKS:
        rest = "0" if network.is_still else "that of rest"
        return Finding(what, f"the current is {rest} after {memory} ticks", OK)
    off = float(np.max(np.abs(after[-1] - stream.rest)))
    return Finding(what, f"the current is {off:.1e} from rest after {REST_TICKS} ticks", BAD)


def _strange_light(network: Network, provider: str) -> Finding:
    what = "NaN, Inf, negative, 1e9"
    rng = np.random.default_rng(_SEED)
    light = rng.gamma(4.0, 0.1, (MOVING_TICKS + 2 * REST_TICKS, _SIDE, _SIDE)).astype(np.float32)
    bad = np.array([np.nan, np.inf, -np.inf, -1.0, 1e9, 0.0], np.float32)
    wild = light[:MOVING_TICKS]
    wild[...] = np.where(rng.random(wild.shape) < 0.3, rng.choice(bad, wild.shape), wild)
    light[MOVING_TICKS:] = 0.5
    count = _events(network, light, provider, MOVING_TICKS + REST_TICKS)
    if count == 0:
        return Finding(what, f"silent {REST_TICKS} ticks after such light", OK)
    rate = count / _PIXELS / (REST_TICKS * network.tick_us * 1e-6)
    text = f"{rate:.3g} events per px and s, {REST_TICKS} ticks after such light"
    return Finding(what, text, BAD if network.is_still else NOTE)


def _impulse(network: Network, stream: _Stream) -> list[Finding]:
    """Gain and latency, by a step of light up in half of the pixels and down in the others."""
    x = np.zeros((REST_TICKS, _PIXELS), np.float32)
    x[0, 0], x[0, 1] = IMPULSE, -IMPULSE
    answer = stream.currents(x)[:, :2].astype(np.float64) - stream.rest
    up, down = answer.sum(axis=0)
    wanted = IMPULSE / network.threshold
    text = f"{up:+.2f} and {down:+.2f} thresholds for a step of +-{wanted:.2f}"
    usual = all(0.5 < part / wanted < 2.0 for part in (up, -down))
    gain = Finding("gain", text, (OK if usual else NOTE) if up > 0.0 > down else BAD)

    size = np.abs(answer).sum(axis=1)
    late = network.latency_ticks
    if not size.any():
        return [gain, Finding("latency", f"no answer to a step of +-{IMPULSE}", BAD)]
    felt = np.flatnonzero(size)
    half = int(np.searchsorted(np.cumsum(size), size.sum() / 2))
    text = (
        f"declared {late} ticks; the answer to a step begins after {felt[0]}, is half done "
        f"after {half} and over after {felt[-1]}"
    )
    verdict = BAD if late > felt[-1] else OK if abs(half - late) <= LATE_TICKS else NOTE
    return [gain, Finding("latency", text, verdict)]


def _extremes(stream: _Stream) -> Finding:
    what = "extreme X"
    rng = np.random.default_rng(_SEED)
    x = np.zeros((4 * 64 + REST_TICKS, _PIXELS), np.float32)
    x[:64] = MAX_STEP
    x[64:128] = MAX_STEP * (-1.0) ** np.arange(64)[:, np.newaxis]
    x[128:192] = MAX_STEP * rng.choice([-1.0, 0.0, 1.0], (64, _PIXELS))
    x[192:256] = rng.choice([1e-38, -1e-9, 1e-6], (64, _PIXELS))
    currents = stream.currents(x)
    if not np.all(np.isfinite(currents)):
        return Finding(what, f"X up to +-{MAX_STEP:g} makes a NaN or Inf", BAD)
    most = float(np.max(np.abs(currents)))
    if not stream.is_at_rest(currents[-1]):
        return Finding(what, f"not at rest {REST_TICKS} ticks after X of +-{MAX_STEP:g}", BAD)
    return Finding(what, f"finite: X up to +-{MAX_STEP:g} gives currents up to {most:.3g}", OK)


def _memory(network: Network) -> Finding:
    _, free_gb = memory_gb()
    sizes = []
    for width, height in SIZES:
        gb = dense_bytes(network, width, height) / 1e9
        sizes.append(f"{width}x{height} {gb:.2g} GB{'' if gb <= free_gb else ' (not free here)'}")
    fits = "not free" not in sizes[1]
    return Finding("memory of a dense state", ", ".join(sizes), OK if fits else NOTE)


def _sensor(network: Network) -> SensorParameters:
    level = network.threshold
    return SensorParameters("check", _SIDE, _SIDE, level, level)


def _events(network: Network, light: F32, provider: str, first: int) -> int:
    """Events from tick `first` on."""
    model = EvsNetModel(_sensor(network), network, runtime="onnxruntime", provider=provider)
    ticks, _ = model.step_chunk(light, model.init(_SEED), 0, network.tick_us)
    return sum(len(events) for events in ticks[first:])


def _motion(ticks: int) -> F32:
    """X of noisy light, still now and then; another for each pixel."""
    rng = np.random.default_rng(_SEED)
    x = rng.normal(0.0, 0.3, (ticks, _PIXELS)) * (rng.random((ticks, _PIXELS)) < 0.5)
    return x.astype(np.float32)


def _difference(one: F32, other: F32) -> float:
    """Largest of two currents, in units of the largest current or of 1; infinite for a NaN."""
    if not np.all(np.isfinite(one)) or not np.all(np.isfinite(other)):
        return float("inf")
    scale = max(1.0, float(np.max(np.abs(other))))
    return float(np.max(np.abs(one - other))) / scale
