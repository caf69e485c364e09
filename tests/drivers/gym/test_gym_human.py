"""render_mode human: a page shows every step, in real time, and ends with the environment."""

from __future__ import annotations

import json
import struct
import threading
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

pytest.importorskip("gymnasium")
pytest.importorskip("websockets")

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.gym import LoopEnv

CART = (
    '<mujoco><worldbody><light pos="0 0 3"/><geom type="plane" size="3 3 .1"/>'
    '<body pos="0 0 1"><joint name="slide" type="slide" axis="1 0 0"/><geom size=".2"/></body>'
    '<camera name="front" pos="0 -2 1" xyaxes="1 0 0 0 .2 1"/></worldbody>'
    '<actuator><motor name="push" joint="slide" ctrlrange="-1 1" gear="20"/></actuator></mujoco>'
)


@pytest.mark.slow
def test_a_page_shows_the_steps_in_real_time(
    tmp_path_factory: pytest.TempPathFactory, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path_factory.mktemp("cart") / "cart.xml"
    scene.write_text(CART)
    env = LoopEnv(scene, size=(40, 30), ticks=10, render_mode="human")
    assert "human" in env.metadata["render_modes"]
    env.reset(seed=1)
    until_s = monotonic_s() + 30
    address = ""
    while not address:
        assert monotonic_s() < until_s
        words = capfd.readouterr().out.split()
        address = next((word for word in words if word.startswith("http://")), "")
        sleep_s(0.01)
    pictures: list[dict[str, Any]] = []
    texts: list[dict[str, Any]] = []

    def read() -> None:
        with suppress(ConnectionClosed):
            for message in page:
                if isinstance(message, str):
                    texts.append(json.loads(message))
                    continue
                (length,) = struct.unpack_from("<I", message)
                pictures.append(json.loads(message[4 : 4 + length]))
                page.send(json.dumps({"camera": "front", "drawn": pictures[-1]["number"]}))

    with connect(address.replace("http", "ws").replace("/?", "/ws?")) as page:
        reader = threading.Thread(target=read)
        reader.start()
        # the page may have been late, and steps catch up
        env.reset(seed=1)
        began_s = monotonic_s()
        for _ in range(30):
            env.step(np.array([1.0], np.float32))
        took_s = monotonic_s() - began_s
        assert env.render() is None
        env.reset(seed=1)
        env.step(np.array([1.0], np.float32))
        env.close()
        reader.join(20)
    env.close()
    assert {"ended": True} in texts
    # 30 steps of 10 ms; a late machine only takes longer
    assert took_s > 0.25
    assert {one["camera"] for one in pictures} == {"front"}
    assert any(one["light"] == 40 * 30 for one in pictures)
    assert max(one["t_us"] for one in pictures) > 100_000
    # the second episode
    assert pictures[-1]["t_us"] == 10_000
