"""What a sink for ROS 2 is made of: names, interfaces, gathering, queues, statistics."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from evs.drivers.clock import monotonic_s
from evs.drivers.files.bags.names import as_name, node_path
from evs.drivers.ros2 import sender as sender_module
from evs.drivers.ros2.event_messages import EventMessage, EventMessageBuilder
from evs.drivers.ros2.middleware import checked_domain, interface_of
from evs.drivers.ros2.names import GLOBAL, PRIVATE, quality_of
from evs.drivers.ros2.publisher import Statistics
from evs.drivers.ros2.sender import Sender, TopicQueue
from evs.msgs import EventPacket, Events, EvsError
from evs.msgs.codecs import PAYLOADS, PayloadReader
from reference.streams import random_packet

PACKETS = 12


def gathered(builder: EventMessageBuilder, packets: list[EventPacket]) -> list[EventMessage]:
    found = [message for one in packets for message in builder.add(one)]
    return found + builder.rest()


def decoded(encoding: str, messages: list[EventMessage]) -> Events:
    reader = PayloadReader(encoding)
    return np.concatenate([reader.events(one.data, one.time_base_ns) for one in messages])


@pytest.mark.parametrize("encoding", PAYLOADS)
# in the last case libcaer's clock wraps in the midst of a message
@pytest.mark.parametrize("start_us", [0, 5_000_000, 2**31 - 5_000])
@pytest.mark.parametrize("threshold_s", [0.0, 1e-3, 3e-3, 1.0])
def test_what_is_gathered_decodes_to_the_events(
    encoding: str, start_us: int, threshold_s: float
) -> None:
    packets = [random_packet(seq, 200 * (seq % 4), start_us=start_us) for seq in range(PACKETS)]
    messages = gathered(EventMessageBuilder(encoding, threshold_s, 1_000_000), packets)
    truth = np.concatenate([one.events for one in packets])
    assert np.array_equal(decoded(encoding, messages), truth)
    assert sum(message.events for message in messages) == len(truth)
    # a tick without events makes no message
    assert len(messages) == {0.0: 9, 1e-3: 9, 3e-3: 3, 1.0: 1}[threshold_s]
    assert [one.first_us for one in messages] == sorted(one.first_us for one in messages)
    assert all(one.first_us <= one.last_us for one in messages)


@pytest.mark.parametrize(("encoding", "each"), [("libcaer", 8), ("mono", 8)])
def test_a_message_that_is_large_enough_goes_early(encoding: str, each: int) -> None:
    packets = [random_packet(seq, 100) for seq in range(10)]
    messages = gathered(EventMessageBuilder(encoding, 1.0, 4 * 100 * each), packets)
    assert [len(one.data) // each for one in messages] == [400, 400, 200]


def test_an_event_is_not_in_two_messages() -> None:
    builder = EventMessageBuilder("evt3", 1.0, 10**9)
    assert builder.add(random_packet(0, 5)) == []
    assert builder.rest()[0].events == 5
    assert builder.rest() == []


@pytest.mark.parametrize(
    ("encoding", "threshold_s", "size", "says"),
    [
        ("evt4", 1e-3, 1, "evt3"),
        ("evt3", -1.0, 1, "event_message_time_threshold is -1 s"),
        ("evt3", float("nan"), 1, "event_message_time_threshold"),
        ("mono", 4.5, 1, "encoding = evt3"),
        ("libcaer_cmp", 16.5, 1, "libcaer_cmp spans 16 s at most"),
        ("evt3", 1e-3, 0, "event_message_size_threshold is 0"),
    ],
)
def test_thresholds_that_cannot_be(encoding: str, threshold_s: float, size: int, says: str) -> None:
    with pytest.raises(EvsError, match=says):
        EventMessageBuilder(encoding, threshold_s, size)


@pytest.mark.parametrize(
    ("node", "namespace", "camera", "path"),
    [
        ("", "", "eye", "/eye"),
        ("event_camera", "", "eye", "/event_camera"),
        ("", "robot/head", "left_2", "/robot/head/left_2"),
        ("cam", "/robot/", "x", "/robot/cam"),
    ],
)
def test_the_path_of_a_node(node: str, namespace: str, camera: str, path: str) -> None:
    assert node_path(node, namespace, camera) == path


@pytest.mark.parametrize(
    ("node", "namespace", "camera", "says"),
    [
        ("", "", "left-eye", "set node = left_eye"),
        ("", "", "2nd", "set node = camera_2nd"),
        ("a__b", "", "x", "set node = a_b"),
        ("", "", "Käfer", "not a valid ROS node name .* set node = K_fer$"),
        ("", "robot head", "x", "namespace 'robot head'"),
        ("a/b", "", "x", "set node = a_b"),
    ],
)
def test_what_is_no_name_in_ros(node: str, namespace: str, camera: str, says: str) -> None:
    with pytest.raises(EvsError, match=says):
        node_path(node, namespace, camera)


@pytest.mark.parametrize("text", ["left-eye", "2nd", "__", "Käfer", "a/b", "DVX 0__1", ""])
def test_any_text_has_a_name_in_ros_near_it(text: str) -> None:
    assert node_path(as_name(text), "", "") == f"/{as_name(text)}"
    assert as_name("left_2") == "left_2"


def test_only_this_machine_is_served_unless_said_otherwise() -> None:
    assert str(interface_of("", False)) == "lo"
    assert interface_of("", False).is_loopback
    assert interface_of("127.0.0.1", False).is_loopback
    assert str(interface_of("", True)) == "any interface"
    assert interface_of("10.1.2.3", True).address == "10.1.2.3"
    with pytest.raises(EvsError, match="set insecure=true"):
        interface_of("10.1.2.3", False)
    with pytest.raises(EvsError, match="no network interface 'eth99' here; there is: "):
        interface_of("eth99", True)


def test_what_is_kept_for_a_slow_reader_is_bounded_as_in_the_drivers() -> None:
    names = (*PRIVATE, *GLOBAL)
    depths = {name: quality_of(name, None, 1000).depth for name in names}
    few = {"image_raw": 10, "camera_info": 10, "/clock": 1, "/tf": 100, "/tf_static": 1}
    assert depths == {name: few.get(name, 1000) for name in names}
    assert quality_of("image_raw", True, 1000) == quality_of("image_raw", None, 1000)


@pytest.mark.parametrize("number", [-1, 233])
def test_domains_have_a_range(number: int) -> None:
    assert checked_domain(232) == 232
    with pytest.raises(EvsError, match=r"give 0 \.\.\. 232"):
        checked_domain(number)


class Network:
    """A writer that waits until it is let go, as a slow link makes one."""

    def __init__(self, is_open: bool = True, takes: bool = True) -> None:
        self.go, self.takes = threading.Event(), takes
        self.came = threading.Event()
        self.got: list[bytes] = []
        self.readers = 1
        if is_open:
            self.go.set()

    def write(self, data: bytes) -> bool:
        self.came.set()
        assert self.go.wait(30)
        self.got.append(data)
        return self.takes

    def wait(self, seconds: float) -> bool:
        return True

    def close(self) -> None:
        """Nothing to close."""


def started(*networks: Network, depth: int = 1000) -> tuple[Sender, list[TopicQueue]]:
    sender = Sender()
    queues = [sender.add_queue(network, depth) for network in networks]
    sender.start()
    return sender, queues


def test_messages_of_all_topics_leave_in_their_order() -> None:
    order: list[bytes] = []
    first, second = Network(), Network()
    first.got = second.got = order
    sender, queues = started(first, second)
    wanted = [b"%d" % k for k in range(100)]
    for k, data in enumerate(wanted):
        sender.put(queues[k % 2], data, k)
    sender.close(30.0)
    assert order == wanted
    assert [queue.counts.sent for queue in queues] == [50, 50]
    assert sum(queue.counts.elements for queue in queues) == sum(range(100))
    sender.close(30.0)


def test_a_network_that_does_not_move_costs_the_oldest_messages_and_no_time() -> None:
    stuck = Network(is_open=False)
    sender, (queue,) = started(stuck, depth=10)
    sender.put(queue, b"first", 1)
    assert stuck.came.wait(30)
    begin = monotonic_s()
    for k in range(1000):
        sender.put(queue, b"%03d" % k, 2)
    # it would be for ever
    assert monotonic_s() - begin < 10
    assert queue.counts.dropped == 990
    assert queue.counts.elements_dropped == 2 * 990
    stuck.go.set()
    sender.close(30.0)
    assert stuck.got == [b"first", *(b"%03d" % k for k in range(990, 1000))]
    assert queue.counts.sent == 11


def test_few_large_messages_are_too_many_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sender_module, "MAX_QUEUE_BYTES", 100)
    stuck = Network(is_open=False)
    sender, (queue,) = started(stuck)
    sender.put(queue, b"first", 1)
    assert stuck.came.wait(30)
    for size in (60, 30, 20, 300):
        sender.put(queue, bytes(size), size)
        assert queue.waiting_bytes <= 100 or len(queue.waiting) == 1
    assert (queue.counts.dropped, queue.counts.elements_dropped) == (3, 110)
    stuck.go.set()
    sender.close(30.0)
    assert [len(data) for data in stuck.got] == [5, 300]


@pytest.mark.slow
def test_closing_waits_no_longer_than_told_and_counts_the_rest() -> None:
    stuck = Network(is_open=False)
    sender, (queue,) = started(stuck)
    for _ in range(5):
        sender.put(queue, b"data", 3)
    assert stuck.came.wait(30)
    sender.close(0.05)
    assert (queue.counts.dropped, queue.counts.elements_dropped) == (4, 12)
    stuck.go.set()


def test_what_the_middleware_refuses_is_counted() -> None:
    sender, (queue,) = started(Network(takes=False))
    sender.put(queue, b"data", 7)
    sender.close(30.0)
    assert (queue.counts.sent, queue.counts.dropped) == (0, 1)
    assert queue.counts.elements_dropped == 7


def test_a_failure_of_the_middleware_reaches_the_camera() -> None:
    class Broken(Network):
        def write(self, data: bytes) -> bool:
            raise RuntimeError("no such luck")

    count = 0

    def put_for_ever(queue: TopicQueue) -> None:
        nonlocal count
        while True:
            sender.put(queue, b"data")
            count += 1

    sender, (queue,) = started(Broken())
    with pytest.raises(EvsError, match="no such luck"):
        put_for_ever(queue)
    sender.close(30.0)
    assert queue.counts.dropped == queue.counts.elements_dropped == count > 0


def test_the_line_of_statistics_is_the_drivers() -> None:
    lines: list[str] = []
    now = [100.0]
    told = Statistics("/robot/eye", 1.0, lines.append, lambda: now[0])
    for k in range(1, 41):
        told.add(1000 * k, 16_000, k, 0 if k < 30 else 3)
        now[0] += 0.0625
    assert lines == [
        "[INFO] [0.017000000] [robot.eye]: bw in:   0.27200 MB/s, msgs/s in:      17, out:      17",
        "[INFO] [0.033000000] [robot.eye]: bw in:   0.25600 MB/s, msgs/s in:      16, out:      16"
        ", dropped: 3",
    ]
    for _ in range(20):
        now[0] += 0.0625
        told.add(3_000_000, 16_000, 41, 3)
    assert lines[2].startswith("[INFO] [3.000000000] [robot.eye]: bw in: ")
    assert "dropped" not in lines[2]


def test_no_interval_no_lines() -> None:
    lines: list[str] = []
    told = Statistics("/eye", 0.0, lines.append, lambda: 1e9)
    told.add(0, 1, 1, 0)
    told.add(10**9, 1, 1, 0)
    assert lines == []
    with pytest.raises(EvsError, match="statistics_print_interval is -1"):
        Statistics("/eye", -1.0)
