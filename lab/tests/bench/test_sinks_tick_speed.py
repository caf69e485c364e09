"""What sinks cost a camera's tick: the camera on one core, everything else on another.

The tick is a real one (a spinning bar under a DAVIS346, traced anew each ms); the packets that it
hands out hold a set number of events, so that the rate is what the issue names. Without sinks and
with them take turns. `worker`: the sink runs in a process of its own. A recorder of the first
rows is a process that listens to the bus; with workers, the camera writes its own file, too.
Processor time of the camera's process, so that other people's programs do not count.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from speed.turns import Table, Time, target

SCENE = """
<mujoco><option timestep="0.001"/>
<worldbody><light pos="0 -1 3"/><camera name="eye" pos="0 -2 .6" xyaxes="1 0 0 0 .2 1"/>
<geom type="plane" size="2 2 .1"/><body pos="0 0 .5"><joint name="spin" axis="0 1 0"/>
<geom type="box" size=".5 .05 .05"/></body></worldbody>
</mujoco>
"""
NONE = "no sink"

LISTEN = {
    "echo": """
import sys
from evs.drivers.bus import subscribe
for packet in subscribe(sys.argv[1]): pass
""",
    "recorder": """
import sys, tempfile
from evs.drivers.bus import subscribe
from evs.drivers.files.aedat4 import Aedat4Recorder
from evs.msgs import StreamInfo
with tempfile.TemporaryDirectory() as folder:
    recorder = Aedat4Recorder(folder + "/run.aedat4")
    recorder.open([StreamInfo(346, 260, "camera")])
    for packet in subscribe(sys.argv[1]): recorder.write(packet)
    recorder.close()
""",
    "dv": """
import socket, sys, time
for _ in range(1000):
    try:
        link = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
        break
    except ConnectionRefusedError:
        time.sleep(0.02)
while link.recv(1 << 20): pass
""",
    "ros2": """
import sys, time
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from reference.ros_readers import EVENTS
one = '<Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>'
domain = Domain(int(sys.argv[1]), "<CycloneDDS><Domain><General>" + one +
                "</General></Domain></CycloneDDS>")
participant = DomainParticipant(int(sys.argv[1]))
quality = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(10))
reader = DataReader(participant, Topic(participant, "rt/eye/events", EVENTS, qos=quality),
                    qos=quality)
came = False
while not came or reader.get_matched_publications():
    came = came or bool(reader.get_matched_publications())
    time.sleep(0.05)
    reader.take(10)
""",
}

CAMERA = """
import json, os, subprocess, sys, threading, time
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
import numpy as np
import evs
from evs.drivers.bus import Publisher
from evs.drivers.bus.address import free_address
from evs.drivers.dv import DvServer
from evs.drivers.ros2 import Ros2Publisher
from evs.drivers.run.config import make_sink
from evs.drivers.sink_config import SinkConfig
from evs.msgs import EventPacket, make_events

scene, listen, folder, *numbers = sys.argv[1:]
listen, (events, rounds, ticks) = json.loads(listen), map(int, numbers)
others = set(range(os.cpu_count())) - os.sched_getaffinity(0)
world = evs.World(scene, threads=1)
world.data.qvel[0] = 10
camera = world.add_camera(camera="eye", sensor="davis346")
random = np.random.default_rng(0)
bodies = []
for _ in range(8):
    t = np.sort(random.integers(1, 1001, events))
    x, y, p = (random.integers(0, side, events) for side in (346, 260, 2))
    bodies.append(make_events(t, x, y, p))

def start(name, where):
    return subprocess.Popen([sys.executable, "-c", listen[name], str(where)],
                            preexec_fn=lambda: os.sched_setaffinity(0, others))

publisher = Publisher("tcp://127.0.0.1:0", wait_for=2)
server = DvServer("tcp://127.0.0.1:0", wait_for=2)
domains = 1 + os.getpid() % 100, 101 + os.getpid() % 100
ros2 = Ros2Publisher(domain_id=domains[0], node="eye", wait_for=1, wait_s=30.0)
processes = [start("ros2", domain) for domain in domains]

# open waits for listeners, whose address is known once it is bound
def later(names, where):
    def run():
        while not where(): time.sleep(0.01)
        processes.extend(start(name, where()) for name in names)
    threading.Thread(target=run).start()

info = camera.info
later(("echo", "recorder"), lambda: not publisher.address.endswith(":0") and publisher.address)
publisher.open([info])
later(("dv", "dv"), lambda: server.ports.get(f"{info.camera}/events", 0))
server.open([info])
ros2.open([info])

def worker(**given):
    return make_sink(SinkConfig.of(worker=True, worker_cores=tuple(others), **given))

bus, dv = free_address(), free_address()
bus_worker = worker(type="zmq", address=bus, wait_for=2, wait_s=30.0)
dv_worker = worker(type="dv", address=dv, wait_for=2, wait_s=30.0)
file_worker = worker(type="aedat4", file=folder + "/camera.aedat4")
ros2_worker = worker(type="ros2", domain_id=domains[1], node="eye", wait_for=1, wait_s=30.0)
ports = {"echo": bus, "recorder": bus, "dv": dv.rpartition(":")[2]}
for sink, names in ((bus_worker, ("echo", "recorder")), (dv_worker, ("dv", "dv")),
                    (file_worker, ()), (ros2_worker, ())):
    sink.prepare()
    processes += [start(name, ports[name]) for name in names]
    # who came before the port was there has to come again
    sink.open([info])
sets = {"no sink": (), "bus, listener and recorder": (publisher,), "DV, two clients": (server,),
        "bus and DV, all of these": (publisher, server),
        "ROS 2, a reader of the events": (ros2,),
        "worker: ROS 2, a reader of the events": (ros2_worker,),
        "worker: bus, listener and recorder": (bus_worker,),
        "worker: bus and the camera's own file": (bus_worker, file_worker),
        "worker: bus, file and DV, two clients": (bus_worker, file_worker, dv_worker),
        "worker: bus, file, DV and ROS 2": (bus_worker, file_worker, dv_worker, ros2_worker)}
taken = {name: [] for name in sets}
seq = 0
for lap in range(rounds + 1):
    for name, sinks in sets.items():
        # the process' own, on whatever thread: ZeroMQ sends in one of its own
        begin = time.process_time()
        for _ in range(ticks):
            ends = time.monotonic() + 0.003
            body = bodies[seq % 8].copy()
            body["t"] += 1000 * seq
            packet = EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 346, 260, body, info.camera)
            world.step()
            for sink in sinks:
                sink.write(packet)
            seq += 1
            # as in real time: what is sent is gone before the next tick
            time.sleep(max(0.0, ends - time.monotonic()))
        if lap:
            taken[name].append(1e3 * (time.process_time() - begin) / ticks)
said = {"bus": publisher.close(), "dv": server.close(), "ros2": ros2.close()}
waited = [sink.close() for sink in (ros2_worker, dv_worker, file_worker, bus_worker)]
for process in processes: process.wait(30)
spread = {k: np.quantile(v, (0.5, 0.25, 0.75)).tolist() for k, v in taken.items()}
print(json.dumps({"taken": spread, "dropped": said["dv"]["packets_dropped"],
                  "worker": {k: v for one in waited for k, v in one.items() if "worker" in k}}))
"""


@pytest.mark.bench
def test_what_sinks_cost_a_tick(tmp_path: Path) -> None:
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip("needs two cores")
    scene = tmp_path / "bar.xml"
    scene.write_text(SCENE)
    search = os.pathsep.join(str(Path(entry).absolute()) for entry in sys.path if entry)
    columns: dict[str, dict[str, Time]] = {}
    for rate, events in (("1 Mev/s", 1000), ("5 Mev/s", 5000)):
        words = [str(scene), json.dumps(LISTEN), str(tmp_path), str(events), "60", "10"]
        done = subprocess.run(
            [sys.executable, "-c", CAMERA, *words],
            env={**os.environ, "PYTHONPATH": search},
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        found = json.loads(done.stdout)
        print(f"\n{rate}: {found['worker']}")
        columns[rate] = {name: Time(*three) for name, three in found["taken"].items()}
    yardsticks = {name: NONE for name in columns["1 Mev/s"] if name != NONE}
    print(
        Table(
            "one tick, ms of processor time, all that listens on another core", columns, yardsticks
        )
    )
    for rate, name in (
        ("5 Mev/s", "worker: bus, listener and recorder"),
        ("5 Mev/s", "worker: bus and the camera's own file"),
        ("1 Mev/s", "worker: bus, file and DV, two clients"),
        ("1 Mev/s", "worker: bus, file, DV and ROS 2"),
        ("5 Mev/s", "bus, listener and recorder"),
        ("1 Mev/s", "bus and DV, all of these"),
    ):
        times = columns[rate]
        slower = 100 * (times[name].median / times[NONE].median - 1)
        print(target(f"{rate}, {name}: slower", slower, 5, "%"))
        assert times[name].median > 0
