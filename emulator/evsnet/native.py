"""Runtime `native`: the whole stream in one pass of C++, core/evsnet, only where something moves.

Pixels go in tiles of 4 x 4. A pixel is computed while something of an X that was not 0 is left in
its FIFOs; the membranes of a tile, while one of its pixels is or while one is at a threshold. Of
the others only the light is looked at. Networks with a bias, and sparse = False: every pixel is
computed in every tick. Either way the events and membranes are the same bytes.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from evs.emulator import _core
from evs.emulator.base.scene import F32
from evs.emulator.evsnet.bilif import decay_tables
from evs.emulator.evsnet.state import NetworkState, check_arrays, check_growth
from evs.emulator.evsnet.weights import KERNEL_SIZE, NetworkWeights
from evs.emulator.sensor.parameters import SensorParameters
from evs.msgs import EVENT_DTYPE, Events, EvsError

LANES = 16
"""pixels of a tile"""
NEVER = -(2**60)
"""number of the last tick in which a pixel moved that never did"""


class NativeRuntime:
    """The runtime `native`. Its own arrays in a state, of (h', w') tiles, are these.

    fifo (rows, F) float32, what tiles remember: [16 pixels][slot][input of a convolution], tick n
    in slot n mod 6; tile_row (h', w') int32, each tile's row of it, -1: none; tile_moved
    (h', w', 16) int64, number of the last tick in which a pixel's X was not 0; tile_loud (h', w')
    uint8, 1: some V is at a threshold.
    """

    name = "native"

    def __init__(
        self,
        sensor: SensorParameters,
        weights: NetworkWeights,
        threads: int = 0,
        isa: str = "auto",
        sparse: bool = True,
        most: int = 1,
    ) -> None:
        """Set the kernel up.

        Args:
            sensor: The sensor, resolved.
            weights: The network.
            threads: Worker threads; 0: one per core.
            isa: auto, avx512, avx2, neon or portable, all with the same bytes.
            sparse: Whether tiles where nothing moves are left out. Where that would be wrong, as
                in a network with a bias, EvsNetModel turns it off.
            most: Events of a pixel in a tick, 1 ... 64.

        Raises:
            EvsError: This machine cannot run the instruction set.
        """
        if isa != "auto" and isa not in _core.isa_available():
            raise EvsError(f"this machine cannot run instruction set '{isa}'; use auto")
        self.weights = weights
        self.shape = (sensor.height, sensor.width)
        self.dense = not sparse
        """whether every pixel is computed in every tick"""
        self.thresholds = (
            np.float32(sensor.pos_thres / weights.threshold),
            np.float32(sensor.neg_thres / weights.threshold),
        )
        """V_on and V_off"""
        decay = decay_tables(weights.tau_s, weights.tick_us)
        zeros = np.zeros(weights.channels, np.float32)
        biases = [zeros if c.bias is None else c.bias for c in weights.convolutions]
        parameters = SimpleNamespace(
            weights=np.concatenate([c.weight.ravel() for c in weights.convolutions]),
            biases=np.stack(biases),
            delays=np.array([block.look_ahead for block in weights.blocks], np.int32),
            last=np.ascontiguousarray(weights.last),
            last_bias=weights.last_bias,
            v_on=float(self.thresholds[0]),
            v_off=float(self.thresholds[1]),
            most=most,
            decay_low=decay.low,
            decay_high=decay.high,
            exposure_dn=sensor.exposure_dn,
            dark_dn=sensor.dark_dn,
            linlog_dn=weights.linlog_dn,
        )
        self.array = _core.NetworkArray(
            sensor.width,
            sensor.height,
            parameters,
            tick_us=weights.tick_us,
            dense=self.dense,
            threads=threads,
            isa=isa,
        )
        self.tiles: tuple[int, int] = self.array.tiles
        """how many, down and across"""
        self.row_floats = int(self.array.row_floats)
        """of the FIFOs of a tile"""

    def own_arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """Runtime.own_arrays. FIFOs of all tiles, or of none yet."""
        tiles = self.tiles[0] * self.tiles[1]
        fifo = np.zeros((tiles if self.dense else 0, self.row_floats), np.float32)
        row = np.full(self.tiles, -1, np.int32)
        if self.dense:
            row = np.arange(tiles, dtype=np.int32).reshape(self.tiles)
            rest = np.concatenate(self.weights.rest())
            if np.any(rest):
                fifo[:] = np.tile(rest, (KERNEL_SIZE - 1) * LANES)
        return {
            "fifo": fifo,
            "tile_row": row,
            "tile_moved": np.full((*self.tiles, LANES), NEVER, np.int64),
            "tile_loud": np.zeros(self.tiles, np.uint8),
        }

    def check(self, state: NetworkState) -> None:
        """Runtime.check."""
        fifo = state.arrays.get("fifo")
        rows = len(fifo) if fifo is not None and fifo.ndim else 0
        check_arrays(
            state,
            {
                "fifo": (np.float32, (rows, self.row_floats)),
                "tile_row": (np.int32, self.tiles),
                "tile_moved": (np.int64, (*self.tiles, LANES)),
                "tile_loud": (np.uint8, self.tiles),
            },
        )

    def step(
        self, luminance: F32, state: NetworkState, begin_us: int, currents: F32 | None = None
    ) -> list[Events]:
        """Runtime.step. Raises EvsError where the memory does not suffice or the state is damaged.

        Rows of FIFO memory that a chunk needs more are added to the state.
        """

        def grow(rows: int) -> F32:
            shape = (self.capacity(rows), self.row_floats)
            # the system would grant it, and end the process when it is filled
            check_growth(4 * shape[0] * shape[1], begin_us, *self.shape[::-1])
            larger = np.zeros(shape, np.float32)
            larger[: len(state.arrays["fifo"])] = state.arrays["fifo"]
            state.arrays["fifo"] = larger
            return larger

        arrays = {name: np.require(a, None, ["C", "W"]) for name, a in state.arrays.items()}
        state.arrays.update(arrays)
        try:
            raw, clamped, x_clamped, v_clamped = self.array.step(
                luminance, state.ticks, begin_us, grow=grow, currents=currents, **arrays
            )
        except MemoryError:
            raise EvsError(
                f"what moves up to {begin_us} us does not fit in memory; use a smaller sensor"
            ) from None
        except ValueError as reason:
            raise EvsError(f"network state cannot be stepped: {reason}; call init again") from None
        state.ticks += len(luminance)
        state.clamped += clamped
        state.x_clamped += x_clamped
        state.v_clamped += v_clamped
        return [events.view(EVENT_DTYPE) for events in raw]

    def capacity(self, rows: int) -> int:
        """Rows of memory for so many that are needed: in steps, however the chunks are cut."""
        tiles = self.tiles[0] * self.tiles[1]
        step = max(64, -(-tiles // 16))
        return min(tiles, -(-rows // step) * step)
