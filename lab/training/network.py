"""The paper's network in JAX: the same sums as evs.emulator.evsnet, with gradients.

Equation numbers are those of the EventTracer paper's Method section, counted from its first:
1 log map (here evs.emulator.sensor), 2 LIF, 3 bipolar firing, 4 surrogate gradient, 5 network,
6 output; 7 ... 11 are in losses.py.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from evs.emulator.base.scene import F32
from evs.emulator.evsnet import Block, Convolution, NetworkWeights
from evs.emulator.evsnet.bilif import most_events
from evs.emulator.evsnet.weights import KERNEL_SIZE
from evs.msgs import EvsError

Parameters = dict[str, Any]
"""encoder and blocks (a list of first, second), each with a weight and maybe a bias; last, maybe
last_bias; log_tau"""

ALPHA = 2.0
"""Of the arctangent surrogate: its derivative at the threshold is ALPHA / 2 (SpikingJelly's)."""
MOST_V = 64.0
"""|V'| is clamped to it"""
TAU_S = (0.02, 20.0)
"""what tau is clamped to, s"""


@dataclass(frozen=True)
class Architecture:
    """The parts of a network that are not learnt."""

    channels: int = 8
    """C"""
    look_ahead: tuple[int, ...] = (0,) * 7
    """ticks of the future that each convolution reads: the encoder, then two a block"""
    biased: bool = False
    tick_us: int = 1000
    odd: bool = False
    """inverted contrast exchanges ON and OFF and changes nothing else: channels are mirrored pairs,
    and only one of each pair is learnt (`mirrored`). Not with biases; C is even"""
    events_per_tick: str = "one"
    """of a pixel, as model.events_per_tick"""

    def __post_init__(self) -> None:
        """Refuse what does not go together."""
        most_events(self.events_per_tick)
        if self.odd and (self.biased or self.channels % 2):
            raise EvsError("an odd network has an even number of channels and no biases")

    @property
    def blocks(self) -> int:
        """M."""
        return (len(self.look_ahead) - 1) // 2

    @property
    def receptive_field(self) -> int:
        """W, ticks."""
        return 1 + (KERNEL_SIZE - 1) * len(self.look_ahead)

    @property
    def latency_ticks(self) -> int:
        """Delay of a current, ticks."""
        return sum(self.look_ahead)


def spread_look_ahead(ticks: int, blocks: int = 3) -> tuple[int, ...]:
    """Spread ticks of the future over all convolutions as evenly as possible, early ones first."""
    count = 1 + 2 * blocks
    if not 0 <= ticks <= 3 * count:
        raise EvsError(f"look-ahead is {ticks} ticks; 0 ... {3 * count} is possible")
    return tuple(ticks // count + (i < ticks % count) for i in range(count))


@jax.custom_jvp
def fires(over: Array) -> Array:
    """1 where over >= 0, else 0 (the fire step of equation 2), with a surrogate derivative.

    sigma(u) = atan(pi/2 ALPHA u) / pi + 1/2; sigma'(u) = ALPHA / (2 (1 + (pi/2 ALPHA u)^2)).
    """
    return (over >= 0).astype(over.dtype)


@fires.defjvp
def _surrogate(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    (over,), (tangent,) = primals, tangents
    slope = (ALPHA / 2) / (1 + jnp.square((math.pi / 2 * ALPHA) * over))
    return fires(over), slope * tangent


def spikes_of(charged: Array, most: int) -> Array:
    """Whole thresholds of 1 in V', at most so many, with the surrogate of the nearest one."""
    if most == 1:
        return fires(charged - 1)
    nearest = jnp.clip(jnp.round(lax.stop_gradient(charged)), 1, most)
    return nearest - 1 + fires(charged - nearest)


def bilif(current: Array, start: Array, decay: Array, most: int = 1) -> tuple[Array, Array]:
    """Equations 2 and 3 with V_th = 1: (K, P) ON and OFF spikes, 0 ... most, of (K, P) currents.

    V' = d V + I; ON where V' >= 1, OFF where V' <= -1; V = V' - S.

    S = ON - OFF has equation 4's gradient. The reset is not detached (SpikingJelly's default): what
    a little more current adds to S is taken from V, so that it is counted once over all ticks.

    Args:
        current: input current.
        start: (P,), V(0).
        decay: of the membrane per tick.
        most: events of a pixel in a tick.
    """

    def tick(v: Array, current: Array) -> tuple[Array, tuple[Array, Array]]:
        charged = jnp.clip(decay * v + current, -MOST_V, MOST_V)
        on, off = spikes_of(charged, most), spikes_of(-charged, most)
        return charged - on + off, (on, off)

    # V(0) is that of the first tick, where nothing has decayed yet
    # unrolled, it is slower: the whole tick is one loop over pixels already
    spikes: tuple[Array, Array] = lax.scan(tick, start / decay, current)[1]
    return spikes


def decay_of(log_tau: Array, tick_us: int) -> Array:
    """D = exp(-dt / tau), tau = exp(log_tau) s, clamped to TAU_S."""
    tau = jnp.exp(jnp.clip(log_tau, math.log(TAU_S[0]), math.log(TAU_S[1])))
    return jnp.exp(-1e-6 * tick_us / tau)


def currents(parameters: Parameters, x: Array, architecture: Architecture, first: int = 0) -> Array:
    """Equations 5 and 6 up to BiLIF: (P, K - first) currents of (P, K) X.

    They are those of stream ticks `first` and on.
    Before the first tick the light was constant. With look-ahead, the current of stream tick k is
    that of light k - latency_ticks.
    """
    if architecture.odd:
        parameters = mirrored(parameters)
    before = architecture.receptive_field - 1
    x = x[:, max(0, first - before) :]
    padded = jnp.pad(x, ((0, 0), (max(0, before - first), 0)))[..., jnp.newaxis]
    held = jax.nn.relu(_layer(parameters["encoder"], padded))
    for i, block in enumerate(parameters["blocks"]):
        middle = jax.nn.relu(_layer(block["first"], held))
        late = sum(architecture.look_ahead[1 + 2 * i : 3 + 2 * i])
        added = _layer(block["second"], middle)
        begin = 2 * (KERNEL_SIZE - 1) - late
        held = jax.nn.relu(held[:, begin : begin + added.shape[1]] + added)
    current: Array = held @ parameters["last"]
    return current + parameters["last_bias"] if architecture.biased else current


def mirrored(parameters: Parameters) -> Parameters:
    """All filters of an odd network, of the half that is learnt.

    Channel c + C/2 sees -X as channel c sees X: filters between them are [[A, B], [B, A]], those of
    the encoder [e, -e] and of the last [l, -l]. The current of -X is then minus that of X.
    """

    def swap(layer: Parameters) -> Parameters:
        weight = layer["weight"]
        own, other = jnp.split(weight, 2, 1)
        return {"weight": jnp.concatenate([weight, jnp.concatenate([other, own], 1)])}

    def turned(half: Array) -> Array:
        return jnp.concatenate([half, -half])

    return {
        "encoder": {"weight": turned(parameters["encoder"]["weight"])},
        "blocks": [{key: swap(block[key]) for key in block} for block in parameters["blocks"]],
        "last": turned(parameters["last"]),
        "log_tau": parameters["log_tau"],
    }


def _layer(layer: Parameters, ticks: Array) -> Array:
    out: Array = convolve(ticks, layer["weight"])
    return out + layer["bias"] if "bias" in layer else out


def stream(
    parameters: Parameters, x: Array, start: Array, architecture: Architecture, first: int = 0
) -> tuple[Array, Array]:
    """ON and OFF spikes (K - first, P) of X (P, K): equations 2 to 6.

    Args:
        parameters: weights of the network.
        x: input of the network.
        start: (P,), V before stream tick `first`, which is the first that comes out.
        architecture: of the network.
        first: first tick that is returned.
    """
    decay = decay_of(parameters["log_tau"], architecture.tick_us)
    current = currents(parameters, x, architecture, first).T
    return bilif(current, start, decay, most_events(architecture.events_per_tick))


def to_weights(
    parameters: Parameters, architecture: Architecture, name: str, spp: tuple[int, int] = (1, 64)
) -> NetworkWeights:
    """Weights as the runtimes read them.

    Raises:
        EvsError: a weight is NaN or infinite.
    """
    if architecture.odd:
        parameters = mirrored(parameters)
    look_ahead = architecture.look_ahead

    def convolution(layer: Parameters, place: int) -> Convolution:
        bias = _array(layer["bias"]) if "bias" in layer else None
        return Convolution(_array(layer["weight"]), bias, look_ahead[place])

    log_tau = float(np.clip(float(parameters["log_tau"]), *np.log(TAU_S)))
    return NetworkWeights(
        name=name,
        encoder=convolution(parameters["encoder"], 0),
        blocks=tuple(
            Block(convolution(block["first"], 1 + 2 * i), convolution(block["second"], 2 + 2 * i))
            for i, block in enumerate(parameters["blocks"])
        ),
        last=_array(parameters["last"]),
        last_bias=float(parameters["last_bias"]) if architecture.biased else 0.0,
        tau_s=float(np.float32(math.exp(log_tau))),
        tick_us=architecture.tick_us,
        spp=spp,
        events_per_tick=architecture.events_per_tick,
    )


def from_weights(weights: NetworkWeights) -> tuple[Parameters, Architecture]:
    """The reverse of to_weights: to continue a training, or to run a network in JAX."""
    biased = weights.last_bias != 0.0 or any(c.bias is not None for c in weights.convolutions)

    def layer(convolution: Convolution) -> Parameters:
        if not biased:
            return {"weight": jnp.asarray(convolution.weight)}
        bias = convolution.bias
        zeros = np.zeros(convolution.weight.shape[0], np.float32)
        return {
            "weight": jnp.asarray(convolution.weight),
            "bias": jnp.asarray(zeros if bias is None else bias),
        }

    parameters: Parameters = {
        "encoder": layer(weights.encoder),
        "blocks": [{"first": layer(b.first), "second": layer(b.second)} for b in weights.blocks],
        "last": jnp.asarray(weights.last),
        "log_tau": jnp.asarray(math.log(weights.tau_s), jnp.float32),
    }
    if biased:
        parameters["last_bias"] = jnp.asarray(weights.last_bias, jnp.float32)
    look_ahead = tuple(convolution.look_ahead for convolution in weights.convolutions)
    architecture = Architecture(
        weights.channels,
        look_ahead,
        biased,
        weights.tick_us,
        events_per_tick=weights.events_per_tick,
    )
    return parameters, architecture


def _array(value: Array) -> F32:
    return np.asarray(value, np.float32)


THRESHOLD = 0.2
"""contrast threshold of the reference pixels, log units"""
RESIDUAL_SCALE = 0.03
"""scale of all filters except the identity's, relative to He's"""


def identity(architecture: Architecture, seed: int, tau_s: float) -> Parameters:
    """A network whose current is about X / threshold: it starts as the `plain` pixel.

    One channel carries ReLU(X) and one ReLU(-X) past all blocks, the others and all residual sums
    start small and random. C is 2 or more.
    """
    rng = np.random.default_rng(seed)
    channels = architecture.channels
    # an odd network learns half of its channels; channel 0 brings its mirror
    learnt, carriers = (channels // 2, 1) if architecture.odd else (channels, 2)
    signs = np.array([1.0, -1.0], np.float32)[:carriers]

    def he(inputs: int, share: float) -> F32:
        scale = share * math.sqrt(2.0 / (KERNEL_SIZE * inputs))
        return rng.normal(0.0, scale, (learnt, inputs, KERNEL_SIZE)).astype(np.float32)

    encoder = he(1, 1.0)
    encoder[:carriers] = 0.0
    encoder[:carriers, 0, KERNEL_SIZE - 1 - architecture.look_ahead[0]] = signs
    blocks = [(he(channels, 1.0), he(channels, RESIDUAL_SCALE)) for _ in range(architecture.blocks)]
    last = rng.normal(0.0, RESIDUAL_SCALE / THRESHOLD, learnt).astype(np.float32)
    last[:carriers] = signs / THRESHOLD
    return _initial_parameters(architecture, encoder, blocks, last, tau_s)


def uniform(architecture: Architecture, seed: int, tau_s: float) -> Parameters:
    """From scratch, as the paper: PyTorch's default, U(-1, 1) / sqrt(inputs), also of biases."""
    rng = np.random.default_rng(seed)
    channels = architecture.channels

    def draw(inputs: int, *shape: int) -> F32:
        reach = 1.0 / math.sqrt(inputs)
        return rng.uniform(-reach, reach, shape).astype(np.float32)

    encoder = draw(KERNEL_SIZE, channels, 1, KERNEL_SIZE)
    blocks = [
        tuple(draw(KERNEL_SIZE * channels, channels, channels, KERNEL_SIZE) for _ in range(2))
        for _ in range(architecture.blocks)
    ]
    found = _initial_parameters(architecture, encoder, blocks, draw(channels, channels), tau_s)
    if architecture.biased:
        found["encoder"]["bias"] = jnp.asarray(draw(KERNEL_SIZE, channels))
        for block in found["blocks"]:
            for layer in block.values():
                layer["bias"] = jnp.asarray(draw(KERNEL_SIZE * channels, channels))
        found["last_bias"] = jnp.asarray(draw(channels, 1)[0])
    return found


def _initial_parameters(
    architecture: Architecture,
    encoder: F32,
    blocks: Sequence[tuple[F32, ...]],
    last: F32,
    tau_s: float,
) -> Parameters:
    """Build Parameters; biases, if any, start at 0."""

    def layer(weight: F32) -> Parameters:
        if not architecture.biased:
            return {"weight": jnp.asarray(weight)}
        return {"weight": jnp.asarray(weight), "bias": jnp.zeros(weight.shape[0], jnp.float32)}

    found: Parameters = {
        "encoder": layer(encoder),
        "blocks": [{"first": layer(first), "second": layer(second)} for first, second in blocks],
        "last": jnp.asarray(last),
        "log_tau": jnp.asarray(math.log(tau_s), jnp.float32),
    }
    if architecture.biased:
        found["last_bias"] = jnp.zeros((), jnp.float32)
    return found


INITIAL = {"identity": identity, "uniform": uniform}
"""Name in a recipe -> function (architecture, seed, tau_s)."""


ROW_TICKS = 8
"""ticks in a row of `convolve`; 8 is the fastest of 4, 8 and 16 at C = 8"""


@lru_cache(maxsize=1)
def _band_places() -> F32:
    """(14, 8, 7): 1 where tap j leads from tick s of a row to its tick t, s = t + j."""
    s, t, j = np.ogrid[: ROW_TICKS + KERNEL_SIZE - 1, :ROW_TICKS, :KERNEL_SIZE]
    places: F32 = (s == t + j).astype(np.float32)
    return places


@jax.custom_vjp
def convolve(ticks: Array, weight: Array) -> Array:
    """Valid convolution as evs.emulator.evsnet.Convolution has it, without bias.

    It is one matrix product over blocks of ticks. Eight ticks of all channels are one row; a banded
    matrix of the 7 taps (block Toeplitz) leads from 8 + 6 input ticks to 8 output ticks. Half of
    its products are with zeros, and it is still twice as fast as XLA's own convolution on a CPU,
    which also is ten times slower inside a loop.

    Args:
        ticks: (P, K + 6, in) float32.
        weight: (out, in, 7), j = 6 is the latest tick.

    Returns:
        (P, K, out).
    """
    rows, count = _rows(ticks)
    out = rows @ _banded(weight)
    return out.reshape(ticks.shape[0], -1, weight.shape[0])[:, :count]


def _convolve_forward(ticks: Array, weight: Array) -> tuple[Array, tuple[Array, Array]]:
    return convolve(ticks, weight), (ticks, weight)


def _convolve_backward(inputs: tuple[Array, Array], gradient: Array) -> tuple[Array, Array]:
    ticks, weight = inputs
    edge = KERNEL_SIZE - 1
    padded = jnp.pad(gradient, ((0, 0), (edge, edge), (0, 0)))
    to_ticks = convolve(padded, jnp.transpose(weight, (1, 0, 2))[:, :, ::-1])
    # all of the banded matrix's gradient in one product, then along its bands
    rows, count = _rows(ticks)
    short = rows.shape[1] * ROW_TICKS - count
    out = jnp.pad(gradient, ((0, 0), (0, short), (0, 0))).reshape(-1, ROW_TICKS * weight.shape[0])
    full = lax.dot_general(rows.reshape(-1, rows.shape[2]), out, (((0,), (0,)), ((), ())))
    banded = full.reshape(ROW_TICKS + edge, weight.shape[1], ROW_TICKS, weight.shape[0])
    to_weight = jnp.einsum("stj,sito->oij", jnp.asarray(_band_places()), banded)
    return to_ticks, to_weight


convolve.defvjp(_convolve_forward, _convolve_backward)


def _rows(ticks: Array) -> tuple[Array, int]:
    """(P, rows, 14 in), and K: each row is 8 ticks and the 6 that follow, zeros past the end."""
    pixels, held, channels = ticks.shape
    count = held - (KERNEL_SIZE - 1)
    rows = -(-count // ROW_TICKS)
    padded = jnp.pad(ticks, ((0, 0), (0, (rows + 1) * ROW_TICKS - held), (0, 0)))
    own = padded[:, : rows * ROW_TICKS].reshape(pixels, rows, ROW_TICKS * channels)
    next_row = padded[:, ROW_TICKS:].reshape(pixels, rows, ROW_TICKS * channels)
    return jnp.concatenate([own, next_row[:, :, : (KERNEL_SIZE - 1) * channels]], -1), count


def _banded(weight: Array) -> Array:
    """(14 in, 8 out) of (out, in, 7)."""
    out, inputs, _ = weight.shape
    banded = jnp.einsum("stj,oij->sito", jnp.asarray(_band_places()), weight)
    return banded.reshape((ROW_TICKS + KERNEL_SIZE - 1) * inputs, ROW_TICKS * out)
