"""What can be tuned: samples of the light, event model, tick, threads; all combinations."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from evs.msgs import EvsError
from evs_lab.sweep.record import Setting

BASE_TICK_US = 1000

RENDERERS = ("direct", "hybrid", "path")
"""the cheapest first"""

DIRECT_SPP = (1, 2, 4, 8, 16)
HYBRID_SPP = (1, 4, 16)
EDGE_SPP = (4, 16)
PATH_EDGE_SPP = (16, 64)
PATH_SPP = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024)
NETWORK_SPP = (1, 2, 4, 8, 16, 32, 64)
TICKS_US = (500, 1000, 2000, 4000)
THREADS = (0, 1)
CHUNK = 8
"""ticks that the network takes at once"""

NAMES = {
    "renderer": "render.renderer",
    "spp": "render.spp",
    "antialiasing": "render.antialiasing",
    "seeds": "render.seeds",
    "model": "model.name",
    "tick_us": "scene.tick_us",
    "threads": "threads",
}
"""field -> the key that it is"""


@dataclass(frozen=True, order=True)
class Candidate:
    """One configuration."""

    renderer: str
    spp: int
    antialiasing: str
    seeds: str
    model: str
    tick_us: int = BASE_TICK_US
    threads: int = 0
    """0: one a core"""

    @property
    def family(self) -> tuple[str, ...]:
        """All but samples, tick and threads."""
        return self.renderer, self.antialiasing, self.seeds, self.model

    @property
    def samples(self) -> float:
        """log2 of the samples a pixel."""
        return math.log2(self.spp)

    @property
    def ticks(self) -> float:
        """log2 of the tick in ms."""
        return math.log2(self.tick_us / BASE_TICK_US)

    @property
    def settings(self) -> dict[str, Setting]:
        """Keys of a pipeline."""
        found: dict[str, Setting] = {key: getattr(self, name) for name, key in NAMES.items()}
        found["model.chunk"] = CHUNK if self.model == "evsnet" else 1
        return found

    @property
    def light(self) -> Candidate:
        """The candidate with the same events: threads change none."""
        return dataclasses.replace(self, threads=0)

    def __str__(self) -> str:
        seeds = f", {self.seeds}" if self.seeds != "fixed" else ""
        edges = " at edges" if self.antialiasing == "adaptive" else ""
        words = f"{self.renderer} {self.spp}{edges}{seeds}, {self.model}"
        if self.tick_us != BASE_TICK_US:
            words += f", {self.tick_us / 1000:g} ms"
        return words + (", 1 thread" if self.threads == 1 else "")


def candidates(pinned: Mapping[str, Setting] | None = None) -> list[Candidate]:
    """Every one, or those with these keys at these values.

    Pin render.seeds to cycle where a delay of 1.5 ticks does no harm, or to fresh for samples that
    are new in every tick, which were further from the truth in all measurements.

    Raises:
        EvsError: there is none.
    """
    pinned = dict(pinned or {})
    seeds = str(pinned.get("render.seeds", "fixed"))
    found = [one for family in _families(seeds, pinned) for one in family if _agrees(one, pinned)]
    if not found:
        raise _none(pinned, seeds)
    return sorted(found)


def _none(pinned: Mapping[str, Setting], seeds: str) -> EvsError:
    """Why there is none: a value that no candidate has, or values that never go together."""
    every = [one for family in _families(seeds, {}) for one in family]
    for name, key in NAMES.items():
        there = sorted({str(getattr(one, name)) for one in every})
        # any number is accepted; a name has to be a known one
        if isinstance(pinned.get(key), str) and there and pinned[key] not in there:
            return EvsError(f"{key}={pinned[key]} is not tuned; give {' or '.join(there)}")
    text = ", ".join(f"{key}={value}" for key, value in pinned.items())
    return EvsError(f"no configuration to tune has {text}; leave one of these keys out")


def _families(seeds: str, pinned: Mapping[str, Setting]) -> Iterable[list[Candidate]]:
    own = pinned.get("render.spp")
    ticks = _with(TICKS_US, pinned.get("scene.tick_us"))
    threads = _with(THREADS, pinned.get("threads"))

    def every(
        renderer: str, spp: Iterable[int], edges: str, seed: str, model: str
    ) -> list[Candidate]:
        return [
            Candidate(renderer, samples, edges, seed, model, tick, count)
            for samples in spp
            for tick in (ticks if model != "evsnet" else (BASE_TICK_US,))
            for count in threads
        ]

    if seeds == "fixed":
        yield every("direct", _with(DIRECT_SPP, own, 64), "fixed", "fixed", "plain")
        yield every("hybrid", _with(HYBRID_SPP, own, 64), "fixed", "fixed", "plain")
        for renderer in ("direct", "hybrid"):
            yield every(renderer, _with(EDGE_SPP, own, 64), "adaptive", "fixed", "plain")
    if seeds != "fresh":
        yield every("path", _with(PATH_EDGE_SPP, own), "adaptive", seeds, "plain")
    for model, spp in (("plain", PATH_SPP), ("adaptive", PATH_SPP), ("evsnet", NETWORK_SPP)):
        yield every("path", _with(spp, own), "fixed", seeds, model)


def _with(values: tuple[int, ...], own: Setting | None, most: int = 4096) -> tuple[int, ...]:
    """Replace our values by a user's own."""
    if isinstance(own, int) and not isinstance(own, bool) and 0 <= own <= most:
        return (own,)
    return values


def _agrees(candidate: Candidate, pinned: Mapping[str, Setting]) -> bool:
    keys = {key: getattr(candidate, name) for name, key in NAMES.items()}
    chunk = pinned.get("model.chunk", 1)
    if isinstance(chunk, int) and chunk > 1 and candidate.model != "evsnet":
        # only the network takes several ticks at once
        return False
    return all(keys[key] == value for key, value in pinned.items() if key in keys)


def calibration(every: Iterable[Candidate]) -> list[Candidate]:
    """The few candidates that are measured first, the cheapest first.

    Of each family two numbers of samples, few and some; of each renderer one longer tick; and one
    run on a single thread. What is pinned has fewer, and so have networks, the running mean, and
    hybrid at edges, which are like a family that has two.
    """
    candidates = list(every)
    chosen: list[Candidate] = []
    many = max(c.threads != 1 for c in candidates)
    usual = [
        c for c in candidates if (c.threads != 1) == many and c.tick_us == _usual_tick(candidates)
    ]
    for family in dict.fromkeys(c.family for c in usual):
        subset = sorted((c for c in usual if c.family == family), key=lambda c: c.spp)
        few = _nearest(subset, 4 if subset[0].renderer == "path" else 1)
        chosen.append(few)
        # a network is one more curve like the pixel's; edges are those of direct
        if family[3] == "plain" and family[:2] != ("hybrid", "adaptive"):
            chosen.append(_nearest(subset, 16))
    for renderer in dict.fromkeys(c.renderer for c in chosen):
        # of the pixel alone where there is one: a running mean has a pace of its own
        first = min((c for c in chosen if c.renderer == renderer), key=lambda c: c.model != "plain")
        longer = dataclasses.replace(first, tick_us=2 * first.tick_us)
        chosen += [longer] if longer in candidates else []
    single = dataclasses.replace(chosen[0], threads=1)
    chosen += [single] if single in candidates else []
    return sorted(dict.fromkeys(chosen), key=lambda c: (RENDERERS.index(c.renderer), c.spp))


def _usual_tick(candidates: list[Candidate]) -> int:
    ticks = {c.tick_us for c in candidates}
    return BASE_TICK_US if BASE_TICK_US in ticks else min(ticks)


def _nearest(subset: list[Candidate], spp: int) -> Candidate:
    return min(subset, key=lambda c: abs(c.samples - math.log2(spp)))
