"""The extremes' player and bus: a listener that comes late hears all the same."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers.bus import Subscription
from evs.drivers.bus import subscribe as real
from evs.drivers.clock import sleep_s
from evs.drivers.files import recorder_for
from evs.msgs import EventPacket, StreamInfo, make_events
from evs.tools.stress import time as time_cases


def test_a_listener_on_a_busy_machine_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = 20_000
    recorder = recorder_for(tmp_path / "run.aedat4")
    recorder.open([StreamInfo(width=8, height=8)])
    for tick in range(count):
        at = np.array([1000 * tick + 500])
        events = make_events(at, np.array([1]), np.array([2]), np.array([1]))
        recorder.write(EventPacket(tick, 1000 * tick, 1000 * tick + 1000, 8, 8, events))
    recorder.close()

    @contextmanager
    def slow(*args: Any, **named: Any) -> Iterator[Subscription]:
        with real(*args, **named) as subscription:
            sleep_s(2.0)
            yield subscription

    monkeypatch.setattr(time_cases, "subscribe", slow)
    events, lost = time_cases._played(tmp_path / "run.aedat4")
    assert (len(events), lost) == (count, 0)
