"""`evs loop NAME --connect`: its exit code says whether the controller did what it had to."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from evs.drivers import lockstep
from evs.launch import main
from evs.msgs import Observation


class Ends:
    """A loop that ends with its first step."""

    def __init__(self, done: str) -> None:
        self.done = done

    def reset(self, seed: int) -> Observation:
        return self.step()

    def step(self, ctrl: Any = None) -> Observation:
        done = "" if ctrl is None else self.done
        return Observation(1000, (), np.zeros(1), np.zeros(1), done)


@pytest.mark.parametrize(
    ("done", "code"),
    [
        ("10 s are over", 0),
        ("angle left -0.8 ... 0.8", 1),
        ("unstable at t = 0.001 s: bad qacc at joint 'hinge' of body 'pole'", 1),
    ],
)
def test_whoever_does_not_last_is_told_by_the_exit_code(
    done: str, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextlib.contextmanager
    def connect(*_words: Any, **_keys: Any) -> Iterator[Ends]:
        yield Ends(done)

    monkeypatch.setattr(lockstep, "connect", connect)
    assert main.main(["loop", "cartpole", "--connect", "tcp://127.0.0.1:1", "--quiet"]) == code
