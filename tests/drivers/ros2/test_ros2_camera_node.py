"""The lifecycle node of evs_camera_ros, on stubs of rclpy: transitions, parameters, messages."""

from __future__ import annotations

import re
import runpy
import threading
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import ros_stub
import yaml
from ros_stub import Graph, Parameter, TransitionCallbackReturn

from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.files.bags.library import PACKET, TRANSFORMS
from evs.drivers.files.bags.messages import IMAGE, INFO, SAMPLE
from evs.drivers.ros2.names import GLOBAL, PRIVATE, quality_of
from evs.drivers.run.config import load
from evs.emulator.simulation.world import World
from evs.msgs import EvsError
from evs.msgs.codecs import PayloadReader

CHECKOUT = Path(__file__).parents[3]
FOLDER = CHECKOUT / "drivers/ros2/evs_camera_ros"
SCENE = str(CHECKOUT / "config/scenes/pendulum.xml")
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
SMALL = ["sensor.width=64", "sensor.height=48"]
TICKS = 30

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Iterator[Graph]:
    """ROS, initialized, with a scene and a small sensor."""
    monkeypatch.syspath_prepend(str(FOLDER))
    with ros_stub.ros() as graph:
        graph.initialized = True
        graph.overrides = {
            "scene": SCENE,
            "overrides": SMALL,
            "sensor": "imx636",
            "seed": 3,
            "threads": 1,
            "speed": 0.0,
        }
        yield graph


def make_node(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A node that steps one tick in each callback of its timer."""
    from evs_camera_ros import node

    monkeypatch.setattr(node, "SLICE_S", 0.0)
    return node.CameraNode()


@pytest.fixture
def node(graph: Graph, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A node that is not configured."""
    made = make_node(monkeypatch)
    yield made
    made.destroy_node()
    assert graph.publishers == {}


def fire(node: Any, period_s: float, times: int = 1) -> None:
    """Let a timer of this period elapse."""
    for _ in range(times):
        for timer in tuple(node._timers):
            if timer.timer_period_ns == int(period_s * 1e9):
                assert timer.clock.clock_type == ros_stub.ClockType.STEADY_TIME
                timer.callback()


def step(node: Any, ticks: int = TICKS) -> None:
    fire(node, 1e-4, ticks)


def start(node: Any) -> None:
    assert node.trigger_configure() == SUCCESS, ros_stub.GRAPH.log
    assert node.trigger_activate() == SUCCESS


def run(node: Any, ticks: int = TICKS) -> None:
    """Activate, step and deactivate, which waits for all messages."""
    assert node.trigger_activate() == SUCCESS
    step(node, ticks)
    assert node.trigger_deactivate() == SUCCESS


def events_of(graph: Graph) -> Any:
    """All events that were published, and the messages."""
    messages = graph.of("/event_camera/events", PACKET)
    reader = PayloadReader(messages[0].encoding)
    parts = [reader.events(one.events.tobytes(), one.time_base) for one in messages]
    return np.concatenate(parts), messages


def set_all(node: Any, **values: Any) -> Any:
    """Set parameters by the service that sets all or none."""
    return node.set_parameters_atomically([Parameter(k, value=v) for k, v in values.items()])


def test_it_publishes_what_the_sink_publishes(graph: Graph, node: Any) -> None:
    set_all(node, imu=True, frames=True, sensor="davis346")
    assert node.trigger_configure() == SUCCESS
    run(node)
    kinds = {f"/event_camera/{name}": kind for name, kind in PRIVATE.items()} | GLOBAL
    assert {topic for topic, _ in graph.published} == set(kinds)
    for topic, kind in kinds.items():
        graph.of(topic, kind)
        name = topic.removeprefix("/event_camera/")
        profile, quality = graph.publishers[topic].qos_profile, quality_of(name, None, 1000)
        assert profile.depth == quality.depth
        assert profile.reliability.name == ("RELIABLE" if quality.reliable else "BEST_EFFORT")
        assert profile.durability.name == (
            "TRANSIENT_LOCAL" if quality.transient_local else "VOLATILE"
        )
    image, info = (graph.of(f"/event_camera/{name}", kind)[0] for name, kind in
                   (("image_raw", IMAGE), ("camera_info", INFO)))  # fmt: skip
    assert (image.width, image.height) == (info.width, info.height) == (64, 48)
    assert image.header.frame_id == "event_camera_optical_frame"
    assert graph.of("/event_camera/imu", SAMPLE)[0].header.frame_id == "event_camera_imu_frame"
    (static,) = graph.of("/tf_static", TRANSFORMS)
    assert {one.child_frame_id for one in static.transforms} == {
        "event_camera_optical_frame",
        "event_camera_imu_frame",
    }


def test_the_events_are_those_of_the_same_world(graph: Graph, node: Any) -> None:
    assert node.trigger_configure() == SUCCESS
    run(node)
    found, messages = events_of(graph)
    words = [("scene.file", SCENE), ("sensor.preset", "imx636"), ("seed", "3")]
    words += [tuple(word.split("=")) for word in SMALL]
    world = World.from_config(load(None, words))
    expected = np.concatenate([world.step()[0].events for _ in range(TICKS)])
    assert len(expected) > 100
    for name in ("x", "y", "p"):
        np.testing.assert_array_equal(found[name], expected[name])
    assert [one.seq for one in messages] == list(range(len(messages)))
    assert messages[0].header.stamp.nanosec == 1000 * int(expected["t"][0])


def test_names_and_frames_follow_the_parameters(graph: Graph, monkeypatch: Any) -> None:
    graph.namespace = "/robot/head"
    graph.overrides |= {"camera_frame_id": "lens", "encoding": "mono", "clock": False, "tf": False}
    node = make_node(monkeypatch)
    assert node.trigger_configure() == SUCCESS
    run(node)
    assert not {"/clock", "/tf"} & set(graph.publishers)
    first = graph.of("/robot/head/event_camera/events", PACKET)[0]
    assert (first.encoding, first.header.frame_id) == ("mono", "lens")
    node.destroy_node()


def test_what_nobody_subscribes_to_is_not_published(graph: Graph, node: Any) -> None:
    graph.subscriptions = {"/event_camera/events": 0, "/clock": 0}
    assert node.trigger_configure() == SUCCESS
    run(node)
    topics = {topic for topic, _ in graph.published}
    assert "/event_camera/pose" in topics
    assert not {"/event_camera/events", "/clock"} & topics


def test_it_is_silent_unless_it_is_active(graph: Graph, node: Any) -> None:
    assert node.trigger_configure() == SUCCESS
    step(node)
    fire(node, 1.0)
    # messages leave by a thread, which a busy machine may hold up
    until_s = monotonic_s() + 10
    while not graph.published and monotonic_s() < until_s:
        sleep_s(0.01)
    assert {topic for topic, _ in graph.published} == {"/tf_static"}
    run(node)
    managed = [one for one in graph.publishers.values() if hasattr(one, "is_activated")]
    assert {one.is_activated for one in managed} == {False}
    count, t_us = len(graph.published), node._session.world.t_us
    assert count > TICKS
    step(node)
    fire(node, 1.0)
    assert (len(graph.published), node._session.world.t_us) == (count, t_us)
    # it goes on from where it was
    run(node, 1)
    assert node._session.world.t_us == t_us + 1000
    assert len(graph.published) > count


def test_a_pause_leaves_no_gap(graph: Graph, monkeypatch: pytest.MonkeyPatch) -> None:
    def published(*pieces: int) -> list[tuple[str, bytes]]:
        node = make_node(monkeypatch)
        assert node.trigger_configure() == SUCCESS
        for ticks in pieces:
            run(node, ticks)
        node.destroy_node()
        found = [one for one in graph.published if one[0] != "/diagnostics"]
        graph.published.clear()
        return found

    assert published(10, 20) == published(30)


def test_after_a_cleanup_it_is_as_new(graph: Graph, node: Any) -> None:
    def once() -> list[tuple[str, bytes]]:
        assert node.trigger_configure() == SUCCESS
        run(node)
        found = list(graph.published)
        graph.published.clear()
        return found

    first = once()
    assert set_all(node, pos_thres=0.5).successful
    run(node)
    graph.published.clear()
    assert node.trigger_cleanup() == SUCCESS
    assert graph.publishers == {}
    assert not node.has_parameter("pos_thres")
    assert node._session is None
    assert once() == first


@pytest.mark.parametrize("active", [False, True])
def test_shutdown_ends_it(graph: Graph, node: Any, active: bool) -> None:
    assert node.trigger_configure() == SUCCESS
    if active:
        assert node.trigger_activate() == SUCCESS
        step(node, 3)
    assert node.trigger_shutdown() == SUCCESS
    assert graph.publishers == {}
    assert node._timers == []


def test_a_parameter_changes_the_events_from_the_next_tick_on(
    graph: Graph, monkeypatch: Any
) -> None:
    def rate(**values: Any) -> tuple[int, int]:
        """Events before and after a change."""
        node = make_node(monkeypatch)
        assert node.trigger_configure() == SUCCESS
        run(node)
        before = len(events_of(graph)[0])
        if values:
            assert set_all(node, **values).successful
        run(node)
        both = len(events_of(graph)[0])
        node.destroy_node()
        graph.published.clear()
        return before, both - before

    before, after = rate()
    assert rate(pos_thres=2.0, neg_thres=2.0) == (before, pytest.approx(0, abs=after // 4))
    first, second = rate(bias_diff_on=100)
    assert first == before
    assert second < after


def test_descriptors_have_the_ranges_of_the_sensor(graph: Graph, node: Any) -> None:
    assert node.trigger_configure() == SUCCESS
    about = node._session.parameters()
    assert {"pos_thres", "biases.bias_diff_on"} <= {one["key"] for one in about}
    for one in about:
        name = one["key"].removeprefix("biases.")
        described = node.describe_parameter(name)
        limits = (described.floating_point_range + described.integer_range)[0]
        assert (limits.from_value, limits.to_value) == (one["lowest"], one["highest"])
        assert described.description.startswith(one["text"])
        assert node.get_parameter(name).value == one["value"]
    assert node.describe_parameter("bias_diff_on").type == Parameter.Type.INTEGER
    assert node.describe_parameter("pos_thres").type == Parameter.Type.DOUBLE


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"pos_thres": 0.4, "neg_thres": 99.0}, "out of range"),
        ({"pos_thres": 0.4, "bias_diff_on": 141}, "out of range"),
        ({"pos_thres": 0.4, "cutoff_hz": 0.0}, "cutoff_hz"),
        ({"pos_thres": 0.4, "neg_thres": 1}, "Wrong parameter type"),
        ({"pos_thres": 0.4, "encoding": "mono"}, "encoding is fixed now: clean the node up first"),
    ],
)
def test_a_refused_value_changes_nothing(
    graph: Graph, node: Any, values: dict[str, Any], reason: str
) -> None:
    start(node)
    before = {name: one.value for name, one in node._parameters.items()}
    sensor = node._session.camera.sensor
    result = set_all(node, **values)
    assert not result.successful
    assert reason in result.reason
    assert "\n" not in result.reason
    assert {name: one.value for name, one in node._parameters.items()} == before
    assert node._session.camera.sensor == sensor


def test_thresholds_follow_a_bias(graph: Graph, node: Any) -> None:
    start(node)
    before = node.get_parameter("pos_thres").value
    assert set_all(node, bias_diff_on=50).successful
    shown = node.get_parameter("pos_thres").value
    assert shown == node._session.camera.sensor.pos_thres > before


def test_the_sensor_starts_with_values_of_a_file(graph: Graph, monkeypatch: Any) -> None:
    graph.overrides |= {"pos_thres": 0.41, "bias_fo": 10}
    node = make_node(monkeypatch)
    for _ in range(2):
        assert node.trigger_configure() == SUCCESS
        assert node._session.camera.sensor.pos_thres == 0.41
        assert node.get_parameter("bias_fo").value == 10
        assert {"pos_thres": 0.41} in [one["values"] for one in node._session._sensors.changes]
        assert node.trigger_cleanup() == SUCCESS
    node.destroy_node()


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"scene": ""}, "no scene: set the parameter scene"),
        ({"scene": "missing.xml"}, "missing.xml"),
        ({"renderer": "pth"}, "path"),
        ({"encoding": "evt9"}, "evt9"),
        ({"speed": -1.0}, "speed"),
        ({"overrides": ["sensor.cutof_hz=3"]}, "cutoff_hz"),
        ({"overrides": ["record=run.aedat4"]}, "this node publishes by itself"),
        ({"overrides": ["pace=lockstep"]}, "this node has no controllers"),
        ({"pos_thres": 99.0}, "out of range"),
        ({"pos_thres": "high"}, "pos_thres"),
        ({"link_frame_id": "eye", "camera_frame_id": "eye"}, "link_frame_id"),
    ],
)
def test_what_cannot_be_configured_is_one_line_and_can_be_corrected(
    graph: Graph, monkeypatch: Any, values: dict[str, Any], line: str
) -> None:
    from evs_camera_ros.parameters import FIXED

    given = dict(graph.overrides)
    graph.overrides = given | values
    node = make_node(monkeypatch)
    assert node.trigger_configure() == FAILURE
    (error,) = [text for severity, text in graph.log if severity == "error"]
    assert line in error
    assert "\n" not in error
    assert graph.publishers == {}
    assert not node.has_parameter("neg_thres")
    # the same node, with what it should have been given
    node._parameter_overrides = {}
    for name in set(values) & set(node._parameters):
        good = given.get(name, FIXED[name][0])
        assert set_all(node, **{name: good}).successful
    assert node.trigger_configure() == SUCCESS
    node.destroy_node()


def test_physics_that_break_down_deactivate_it(graph: Graph, node: Any, monkeypatch: Any) -> None:
    start(node)
    step(node, 3)

    def unstable() -> None:
        raise EvsError("the simulation is unstable")

    monkeypatch.setattr(node._session.world, "step", unstable)
    step(node, 1)
    assert node._state_machine == "inactive"
    assert ("error", "deactivated: the simulation is unstable") in graph.log
    assert node._timers == []
    # and it can be cleaned up and started again
    assert node.trigger_cleanup() == SUCCESS
    start(node)
    step(node, 3)
    assert node._state_machine == "active"


def test_an_error_of_a_transition_frees_everything(graph: Graph, node: Any) -> None:
    def broken(*_: Any) -> None:
        raise RuntimeError("no memory")

    node._declare_sensor = broken
    assert node.trigger_configure() == TransitionCallbackReturn.ERROR
    assert node._state_machine == "unconfigured"
    assert graph.publishers == {}
    del node._declare_sensor
    start(node)


def test_diagnostics_once_a_second(graph: Graph, node: Any, monkeypatch: Any) -> None:
    from evs_camera_ros import node as module

    wall = iter((0.0, 0.5, 2.5, 3.5))
    made = module.Diagnostics
    monkeypatch.setattr(
        module, "Diagnostics", lambda *given: made(*given, clock=lambda: next(wall))
    )
    start(node)
    step(node)
    fire(node, 1.0)
    node._session.late_ticks += 2
    node._sink._sender.queues[0].counts.elements_dropped += 7
    events = next(
        q for q in node._sink._sender.queues if q.writer._publisher.topic.endswith("events")
    )
    events.counts.elements_dropped += 7
    events.counts.dropped += 1
    step(node, 10)
    fire(node, 1.0)
    node._session._pacer.slips += 1
    fire(node, 1.0)
    messages = graph.of("/diagnostics", DIAGNOSTICS)
    assert [one.header.stamp.sec for one in messages] == [12] * 3
    statuses = [one.status[0] for one in messages]
    assert {one.name for one in statuses} == {"event_camera: event camera"}
    assert {one.hardware_id for one in statuses} == {"evs imx636"}
    assert [(one.level, one.message) for one in statuses] == [
        (0, "running"),
        (1, "7 events dropped"),
        (1, "too slow: simulated time slips behind"),
    ]
    values = [{pair.key: pair.value for pair in one.values} for one in statuses]
    node.trigger_deactivate()
    total = node._session.events
    assert [one["real-time factor"] for one in values] == ["0.060", "0.005", "0.000"]
    rates = [float(one["events per second"]) for one in values]
    assert 0.5 * rates[0] + 2.0 * rates[1] == pytest.approx(total, abs=2)
    assert rates[0] > 0
    assert [one["late ticks"] for one in values] == ["0", "2", "0"]
    assert [one["events dropped"] for one in values] == ["0", "7", "0"]
    assert [one["messages dropped in total"] for one in values] == ["0", "1", "1"]


def test_late_ticks_are_those_that_leave_a_tick_late(graph: Graph, node: Any) -> None:
    start(node)
    for late_s in (0.0, 0.0009, 0.0011, 0.5):
        node._session._pacer = SimpleNamespace(
            late_s=late_s, wait_until=lambda t_us: None, slips=0, start=None
        )
        node._session._monitor.update = lambda: None
        step(node, 1)
    assert node._session.late_ticks == 2


def test_main_spins_a_node_and_leaves_nothing(graph: Graph) -> None:
    from evs_camera_ros.node import main

    seen = []

    def interrupted(node: Any) -> None:
        start(node)
        seen.append(node)
        # as rclpy's signal handler does, in the midst of a slice
        graph.is_up = False
        for _ in range(3):
            step(node, 3)
            node._sink.flush(2.0)
        raise ros_stub.ExternalShutdownException

    graph.initialized, graph.spun = False, interrupted
    main()
    (node,) = seen
    assert node.is_destroyed
    assert "ros2" not in {thread.name for thread in threading.enumerate()}
    assert graph.publishers == {}
    assert [line for severity, line in graph.log if severity == "error"] == []


def test_its_names_are_none_of_rclpys(graph: Graph, node: Any) -> None:
    own = set(vars(type(node))) | (set(vars(node)) - set(vars(ros_stub.LifecycleNode("other"))))
    assert "_session" in own
    assert own & ros_stub.OWN_NAMES == set()


def test_the_package_lists_what_it_needs() -> None:
    tree = ET.parse(FOLDER / "package.xml").getroot()
    assert tree.get("format") == "3"
    assert tree.findtext("export/build_type") == "ament_python"
    listed = {one.text for one in tree.iter("exec_depend")}
    text = "\n".join(path.read_text() for path in FOLDER.rglob("*.py") if path.name != "setup.py")
    found = set(re.findall(r"^(?:from|import) ([a-z_0-9]+)", text, re.MULTILINE))
    assert found - {"__future__", "collections", "dataclasses", "typing", "evs"} == (
        listed | {"evs_camera_ros"}
    )
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
    assert tree.findtext("version") == project["version"]
    assert tree.findtext("name") == FOLDER.name


def test_setup_installs_every_file(monkeypatch: pytest.MonkeyPatch) -> None:
    import setuptools

    given: dict[str, Any] = {}
    monkeypatch.setattr(setuptools, "setup", given.update)
    runpy.run_path(str(FOLDER / "setup.py"))
    installed = {name for _, names in given["data_files"] for name in names}
    assert installed == {
        "package.xml",
        "resource/evs_camera_ros",
        *(f"launch/{path.name}" for path in (FOLDER / "launch").glob("*.py")),
        *(f"config/{path.name}" for path in (FOLDER / "config").iterdir()),
    }
    assert all((FOLDER / name).is_file() for name in installed)
    assert given["version"] == ET.parse(FOLDER / "package.xml").findtext("version")
    assert given["entry_points"] == {"console_scripts": ["camera = evs_camera_ros.node:main"]}


def test_the_launch_file_configures_and_activates_the_node(graph: Graph) -> None:
    made = runpy.run_path(str(FOLDER / "launch/camera.launch.py"))
    *arguments, node, activate, configure = made["generate_launch_description"]().entities
    defaults = {one.name: one.default_value for one in arguments}
    assert defaults == {
        "scene": None,
        "name": "event_camera",
        "namespace": "",
        "params_file": "/opt/share/evs_camera_ros/config/camera.yaml",
        "autostart": "true",
    }
    assert (node.package, node.executable) == ("evs_camera_ros", "camera")
    for one in (activate, configure):
        assert one.condition == ros_stub.Condition(ros_stub.Substitution("autostart"))
    assert configure.event.transition_id == 1
    handler = activate.event_handler
    assert (handler.start_state, handler.goal_state) == ("configuring", "inactive")
    assert [one.event.transition_id for one in handler.entities] == [3]
    for event in (configure.event, handler.entities[0].event):
        assert event.lifecycle_node_matcher(node)
        assert not event.lifecycle_node_matcher(arguments[0])


def test_the_parameters_of_the_file_are_those_of_the_node(graph: Graph, monkeypatch: Any) -> None:
    (node_name,) = (tables := yaml.safe_load((FOLDER / "config/camera.yaml").read_text()))
    graph.overrides |= tables[node_name]["ros__parameters"]
    node = make_node(monkeypatch)
    assert set(tables[node_name]["ros__parameters"]) <= set(node._parameters)
    assert node.trigger_configure() == SUCCESS
    node.destroy_node()
