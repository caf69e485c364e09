"""The lifecycle node of a virtual event camera."""

from __future__ import annotations

from collections.abc import Sequence

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import (
    LifecycleNode,
    LifecyclePublisher,
    LifecycleState,
    TransitionCallbackReturn,
)
from rclpy.parameter import Parameter
from rclpy.timer import Timer

from evs.drivers.ros2 import Ros2Publisher
from evs.msgs import EvsError
from evs_camera_ros.connection import NodeConnection
from evs_camera_ros.diagnostics import Diagnostics
from evs_camera_ros.parameters import (
    FIXED,
    PUBLISHER,
    fixed_descriptor,
    pipeline,
    sensor_descriptor,
    sensor_name,
)
from evs_camera_ros.session import Session

SLICE_S = 0.01
"""How long the node steps before it answers services again, s of the wall clock."""

STEP_S = 1e-4
"""Period of the timer that steps: short, so that the next slice is due at once."""

DIAGNOSTICS_S = 1.0

FLUSH_S = 2.0
"""How long a deactivation waits for messages that are on their way, s."""


class CameraNode(LifecycleNode):
    """A camera: configure builds its world, activate steps it and publishes, deactivate pauses.

    Everything runs in callbacks of the default group, which excludes itself: a parameter changes
    between two ticks.
    """

    def __init__(self, node_name: str = "event_camera") -> None:
        """Declare the parameters that are fixed once the node is configured."""
        super().__init__(node_name)
        self._session: Session | None = None
        self._sink: Ros2Publisher | None = None
        self._sensor_keys: dict[str, str] = {}
        """parameter -> key of the sensor"""
        self._status_publisher: LifecyclePublisher | None = None
        self._running_timers: list[Timer] = []
        self._steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        for name, (default, _) in FIXED.items():
            self.declare_parameter(name, default, fixed_descriptor(name))
        self.add_on_set_parameters_callback(self._set)
        self.add_post_set_parameters_callback(self._follow)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Build the world, join the topics, and declare the parameters of the sensor."""
        try:
            self._open()
        except (EvsError, ParameterException) as reason:
            self.get_logger().error(str(reason))
            self._free()
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Step the world and publish from now on."""
        session, sink = self._session, self._sink
        assert session is not None
        assert sink is not None
        session.resume()
        self._diagnostics = Diagnostics(session, lambda: sink.dropped)
        for period_s, callback in ((STEP_S, self._step), (DIAGNOSTICS_S, self._diagnose)):
            timer = self.create_timer(period_s, callback, clock=self._steady_clock)
            self._running_timers.append(timer)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Pause: simulated time stands still, and nothing is published."""
        self._pause()
        if self._sink is not None:
            self._sink.flush(FLUSH_S)
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the world; a later configure builds it anew."""
        result = super().on_cleanup(state)
        self._free()
        return result

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End."""
        result = super().on_shutdown(state)
        self._free()
        return result

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the world after an error of a transition; the node is then unconfigured."""
        self._free()
        return super().on_error(state)

    def destroy_node(self) -> None:
        """Close what is open, then destroy the node."""
        self._free()
        super().destroy_node()

    def _open(self) -> None:
        values = {name: self.get_parameter(name).value for name in FIXED}
        config = pipeline(values)
        self._sink = Ros2Publisher(
            node=self.get_name(),
            namespace=self.get_namespace(),
            connect=lambda: NodeConnection(self),
            **{name: values[name] for name in PUBLISHER},
        )
        self._status_publisher = self.create_lifecycle_publisher(
            DiagnosticArray, "/diagnostics", 10
        )
        self._session = Session(config, self._sink, values["speed"], self.get_logger().warning)
        for line in self._session.camera.left_out:
            self.get_logger().warning(line)
        self._declare_sensor(self._session)

    def _declare_sensor(self, session: Session) -> None:
        self._sensor_keys = {sensor_name(one["key"]): one["key"] for one in session.parameters()}
        for name, key in self._sensor_keys.items():
            # one that was declared before may have changed this one
            (about,) = (one for one in session.parameters() if one["key"] == key)
            self.declare_parameter(name, about["value"], sensor_descriptor(about))

    def _set(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Check parameters, and change the sensor: all of them, or none."""
        session = self._session
        fixed = [one.name for one in parameters if one.name in FIXED]
        if fixed and session is not None:
            return SetParametersResult(
                successful=False, reason=f"{fixed[0]} is fixed now: clean the node up first"
            )
        if session is None:
            return SetParametersResult(successful=True)
        present = {one["key"]: one["value"] for one in session.parameters()}
        wanted = {
            self._sensor_keys[one.name]: one.value
            for one in parameters
            if one.name in self._sensor_keys
        }
        changes = {key: value for key, value in wanted.items() if value != present[key]}
        try:
            if changes:
                session.set(changes)
        except EvsError as reason:
            return SetParametersResult(successful=False, reason=str(reason))
        return SetParametersResult(successful=True)

    def _follow(self, _parameters: Sequence[Parameter]) -> None:
        """Show what else a change has changed, such as thresholds that follow from a bias."""
        if self._session is None:
            return
        present = {one["key"]: one["value"] for one in self._session.parameters()}
        changed = [
            Parameter(name, value=present[key])
            for name, key in self._sensor_keys.items()
            if self.has_parameter(name) and self.get_parameter(name).value != present[key]
        ]
        if changed:
            self.set_parameters_atomically(changed)

    def _step(self) -> None:
        assert self._session is not None
        try:
            self._session.run_for(SLICE_S)
        except EvsError as reason:
            self.get_logger().error(f"deactivated: {reason}")
            self.trigger_deactivate()

    def _diagnose(self) -> None:
        message = DiagnosticArray(status=[self._diagnostics.status(self.get_name())])
        message.header.stamp = self.get_clock().now().to_msg()
        assert self._status_publisher is not None
        self._status_publisher.publish(message)

    def _pause(self) -> None:
        for timer in self._running_timers:
            self.destroy_timer(timer)
        self._running_timers.clear()

    def _free(self) -> None:
        """Close what is open. Safe to call twice."""
        self._pause()
        session, self._session = self._session, None
        if session is not None and (reason := session.close()) is not None:
            self.get_logger().error(str(reason))
        self._sink = None
        if self._status_publisher is not None:
            self.destroy_lifecycle_publisher(self._status_publisher)
            self._status_publisher = None
        for name in self._sensor_keys:
            if self.has_parameter(name):
                self.undeclare_parameter(name)
        self._sensor_keys = {}


def main(args: Sequence[str] | None = None) -> None:
    """Run the node until it is interrupted."""
    rclpy.init(args=args)
    node = CameraNode()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
