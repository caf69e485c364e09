"""A world goes on in a forked process, as in a worker of a data loader, with the same bytes."""

from __future__ import annotations

import multiprocessing
from multiprocessing.connection import Connection

import mujoco
import pytest

from evs import World
from evs.emulator.config import RenderConfig, SensorConfig

SCENE = """<mujoco><worldbody><light pos="0 0 3"/><geom type="plane" size="2 2 .1"/>
    <body pos="0 0 1"><freejoint/><geom size=".3"/></body>
    <camera pos="0 -2 1" xyaxes="1 0 0 0 .5 1"/></worldbody></mujoco>"""


def steps(world: World) -> bytes:
    return b"".join(packet.events.tobytes() for _ in range(20) for packet in world.step())


def child(worlds: list[World], answer: Connection) -> None:
    events = steps(worlds[0])
    # its threads are not here, so nobody may wait for them
    worlds.clear()
    answer.send_bytes(events)


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
@pytest.mark.parametrize("renderer", ["direct", "hybrid"])
def test_a_forked_process_goes_on_with_the_same_bytes_and_ends(renderer: str) -> None:
    worlds = [World(mujoco.MjModel.from_xml_string(SCENE), threads=3)]
    worlds[0].add_camera(
        "",
        sensor=SensorConfig("davis346", width=64, height=48),
        render=RenderConfig(renderer, spp=1),
    )
    steps(worlds[0])
    here, there = multiprocessing.Pipe(duplex=False)
    forking = multiprocessing.get_context("fork")
    process = forking.Process(target=child, args=(worlds, there), daemon=True)
    process.start()
    there.close()
    assert here.poll(60), "the forked process does not answer"
    events = here.recv_bytes()
    process.join(60)
    assert process.exitcode == 0
    assert len(events) > 0
    assert events == steps(worlds[0])
