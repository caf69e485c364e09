"""The part of rclpy that evs_camera_ros uses, without ROS: signatures and checks as in its sources.

Read from rclpy (branches jazzy and rolling), its modules node, lifecycle, parameter, qos, timer and
publisher; for launch files, from ros2/launch and ros2/launch_ros. A wrong name of an argument, type
of a value or order of calls fails as there. Messages are classes made of the definitions that
rosbags has; published messages are kept as the bytes of their CDR.
"""

# ruff: noqa: N818 - rclpy's names

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum, IntEnum
from functools import cache
from types import ModuleType
from typing import Any, NamedTuple

from evs.drivers.files.bags.library import typestore

INTEGERS = {f"{sign}int{bits}": bits for sign in ("", "u") for bits in (8, 16, 32, 64)}


@cache
def message(kind: str) -> Any:
    """The class of a message, as rosidl_generator_py makes it: it takes keywords and checks types.

    Raises an AssertionError for a value of another type, as rosidl's setters do.
    """
    constants, fields = typestore(2).fielddefs[kind]
    described = dict(fields)

    def __init__(self: Any, **values: Any) -> None:  # noqa: N807
        assert set(values) <= set(described), f"{kind} has no {set(values) - set(described)}"
        for name, about in described.items():
            setattr(self, name, values[name] if name in values else default(about))

    def __setattr__(self: Any, name: str, value: Any) -> None:  # noqa: N807
        assert name in described, f"{kind} has no field {name}"
        assert fits(described[name], value), f"{kind}.{name} cannot be {value!r}"
        object.__setattr__(self, name, value)

    members = {"__init__": __init__, "__setattr__": __setattr__, "KIND": kind}
    for name, base, value in constants:
        members[name] = bytes([value]) if base == "byte" else value
    return type(kind.rpartition("/")[2], (), members)


def default(about: Any) -> Any:
    """The value of a field that is not given."""
    node, what = about
    if node.name == "NAME":
        return message(what)()
    if node.name == "BASE":
        return {"string": "", "bool": False, "byte": b"\0", "float32": 0.0, "float64": 0.0}.get(
            what[0], 0
        )
    return []


def fits(about: Any, value: Any) -> bool:
    """Whether a value has the type of a field."""
    node, what = about
    if node.name == "NAME":
        return isinstance(value, message(what))
    if node.name == "BASE":
        base = what[0]
        if base in INTEGERS:
            bits, low = INTEGERS[base], 0 if base[0] == "u" else -(2 ** (INTEGERS[base] - 1))
            return isinstance(value, int) and low <= value < low + 2**bits
        if base == "byte":
            return isinstance(value, bytes) and len(value) == 1
        return isinstance(value, {"string": str, "bool": bool}.get(base, float))
    inner, most = what
    return (
        isinstance(value, list)
        and len(value) <= (most or len(value))
        and all(fits(inner, one) for one in value)
    )


def cdr(value: Any) -> bytes:
    """Serialize a message."""
    return bytes(typestore(2).serialize_cdr(plain(value), value.KIND))


def plain(value: Any) -> Any:
    """The message of rosbags for one of ours."""
    if isinstance(value, list):
        return [plain(one) for one in value]
    if not hasattr(value, "KIND"):
        return value[0] if isinstance(value, bytes) else value
    _, fields = typestore(2).fielddefs[value.KIND]
    return typestore(2).types[value.KIND](**{k: plain(getattr(value, k)) for k, _ in fields})


class Graph:
    """All of ROS that a test sees and sets."""

    def __init__(self) -> None:
        self.published: list[tuple[str, bytes]] = []
        """(topic, message)"""
        self.publishers: dict[str, Publisher] = {}
        self.subscriptions: dict[str, int] = {}
        """topic -> how many; one each if not given"""
        self.overrides: dict[str, Any] = {}
        """-p NAME:=VALUE"""
        self.namespace = "/"
        self.is_up = True
        self.log: list[tuple[str, str]] = []
        """(severity, line)"""
        self.spun: Callable[[Any], None] = lambda node: None
        """what happens while a node spins"""
        self.initialized = False

    def of(self, topic: str, kind: str) -> list[Any]:
        """The messages of a topic, decoded by rosbags."""
        store = typestore(2)
        return [store.deserialize_cdr(data, kind) for name, data in self.published if name == topic]


GRAPH = Graph()


class NotInitializedException(Exception):
    """See `rclpy.exceptions`."""


class ParameterException(Exception):
    """See `rclpy.exceptions`."""

    def __init__(self, error_msg: str, parameters: Any, *args: Any) -> None:
        super().__init__(f"{error_msg}: {parameters}", *args)


class ParameterNotDeclaredException(ParameterException):
    """See `rclpy.exceptions`."""

    def __init__(self, parameters: Any) -> None:
        super().__init__("Invalid access to undeclared parameter(s)", parameters)


class ParameterAlreadyDeclaredException(ParameterException):
    """See `rclpy.exceptions`."""

    def __init__(self, parameters: Any) -> None:
        super().__init__("Parameter(s) already declared", parameters)


class InvalidParameterTypeException(ParameterException):
    """See `rclpy.exceptions`."""

    def __init__(self, parameter: Any, expected: str) -> None:
        super().__init__(f"Trying to set parameter to a type other than {expected}", parameter.name)


class InvalidParameterValueException(ParameterException):
    """See `rclpy.exceptions`."""

    def __init__(self, parameter: str, value: Any, reason: str) -> None:
        super().__init__(
            f"Invalid parameter value ({value}) for parameter. Reason: {reason}", parameter
        )


class ExternalShutdownException(Exception):
    """See `rclpy.executors`."""


class Parameter:
    """See `rclpy.parameter`."""

    class Type(IntEnum):
        """Types of values."""

        NOT_SET = 0
        BOOL = 1
        INTEGER = 2
        DOUBLE = 3
        STRING = 4
        BYTE_ARRAY = 5
        BOOL_ARRAY = 6
        INTEGER_ARRAY = 7
        DOUBLE_ARRAY = 8
        STRING_ARRAY = 9

        @classmethod
        def from_parameter_value(cls, parameter_value: Any) -> Parameter.Type:
            """The type of a value."""
            types = (
                (bool, cls.BOOL),
                (int, cls.INTEGER),
                (float, cls.DOUBLE),
                (str, cls.STRING),
            )
            if parameter_value is None:
                return cls.NOT_SET
            for kind, found in types:
                if isinstance(parameter_value, kind):
                    return found
            if isinstance(parameter_value, list | tuple):
                # an empty list is an array of bytes, as in rclpy
                arrays = [(bytes, cls.BYTE_ARRAY)]
                arrays += [(kind, cls(found + 5)) for kind, found in types]
                for kind, found in arrays:
                    if all(isinstance(one, kind) for one in parameter_value):
                        return found
            raise TypeError(f"The given value is not one of the allowed types '{parameter_value}'.")

    def __init__(self, name: str, type_: Parameter.Type | None = None, value: Any = None) -> None:
        found = Parameter.Type.from_parameter_value(value)
        if type_ is not None and type_ != found:
            raise ValueError(f"Type '{type_}' and value '{value}' do not agree")
        self._name, self._type_, self._value = name, found, value

    @property
    def name(self) -> str:
        """Its name."""
        return self._name

    @property
    def type_(self) -> Parameter.Type:
        """Its type."""
        return self._type_

    @property
    def value(self) -> Any:
        """Its value."""
        return self._value


class HistoryPolicy(IntEnum):
    """See `rclpy.qos`."""

    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2


class ReliabilityPolicy(IntEnum):
    """See `rclpy.qos`."""

    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2


class DurabilityPolicy(IntEnum):
    """See `rclpy.qos`."""

    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2


class QoSProfile:
    """See `rclpy.qos`."""

    def __init__(
        self,
        history: HistoryPolicy | None = None,
        depth: int | None = None,
        reliability: ReliabilityPolicy | None = None,
        durability: DurabilityPolicy | None = None,
    ) -> None:
        assert history is not None or depth is not None
        assert depth is None or isinstance(depth, int)
        self.history = HistoryPolicy(history or HistoryPolicy.KEEP_LAST)
        self.depth = depth
        self.reliability = ReliabilityPolicy(reliability or ReliabilityPolicy.RELIABLE)
        self.durability = DurabilityPolicy(durability or DurabilityPolicy.VOLATILE)


class ClockType(IntEnum):
    """See `rclpy.clock`."""

    ROS_TIME = 1
    SYSTEM_TIME = 2
    STEADY_TIME = 3


class Time:
    """See `rclpy.time`."""

    def to_msg(self) -> Any:
        """A fixed time."""
        return message("builtin_interfaces/msg/Time")(sec=12, nanosec=34)


class Clock:
    """See `rclpy.clock`."""

    def __init__(self, *, clock_type: ClockType = ClockType.SYSTEM_TIME) -> None:
        assert isinstance(clock_type, ClockType)
        self.clock_type = clock_type

    def now(self) -> Time:
        """The time."""
        return Time()


class Timer:
    """See `rclpy.timer`; a test calls its callback."""

    def __init__(self, callback: Callable[[], None], period_ns: int, clock: Clock) -> None:
        self.callback, self.timer_period_ns, self.clock = callback, period_ns, clock


class Publisher:
    """See `rclpy.publisher`."""

    def __init__(self, msg_type: Any, topic: str, qos_profile: QoSProfile) -> None:
        self.msg_type, self.topic, self.qos_profile = msg_type, topic, qos_profile
        self.is_destroyed = False
        assert topic not in GRAPH.publishers, f"{topic} has a publisher of this node"
        GRAPH.publishers[topic] = self

    def publish(self, msg: Any) -> None:
        """Keep a message."""
        if self.is_destroyed or not GRAPH.is_up:
            raise RuntimeError(
                "InvalidHandle: cannot use Destroyable because destruction was requested"
            )
        if isinstance(msg, self.msg_type):
            msg = cdr(msg)
        elif not isinstance(msg, bytes):
            raise TypeError(f"Expected {self.msg_type}, got {type(msg)}")
        GRAPH.published.append((self.topic, msg))

    def get_subscription_count(self) -> int:
        """How many subscriptions it has."""
        return GRAPH.subscriptions.get(self.topic, 1)

    def destroy(self) -> None:
        """Leave the topic."""
        self.is_destroyed = True
        del GRAPH.publishers[self.topic]


class TransitionCallbackReturn(Enum):
    """See `rclpy.lifecycle`; pybind11's enum has these values."""

    SUCCESS = 97
    FAILURE = 98
    ERROR = 99


class LifecycleState(NamedTuple):
    """See `rclpy.lifecycle`."""

    label: str
    state_id: int


class LifecyclePublisher(Publisher):
    """See `rclpy.lifecycle`: silent unless its node is active."""

    is_activated = False

    def publish(self, msg: Any) -> None:
        """Keep a message of an active node."""
        if self.is_activated:
            super().publish(msg)


class Context:
    """See `rclpy.context`."""

    def ok(self) -> bool:
        """Whether ROS was not shut down."""
        return GRAPH.is_up


class Logger:
    """See `rclpy.impl.rcutils_logger`."""

    def info(self, message: str) -> None:
        """Log a line."""
        GRAPH.log.append(("info", message))

    def warning(self, message: str) -> None:
        """Log a line."""
        GRAPH.log.append(("warning", message))

    def error(self, message: str) -> None:
        """Log a line."""
        GRAPH.log.append(("error", message))


STATES = ("unconfigured", "inactive", "active", "finalized")

TRANSITIONS = {
    "configure": ("unconfigured", "on_configure", "inactive"),
    "activate": ("inactive", "on_activate", "active"),
    "deactivate": ("active", "on_deactivate", "inactive"),
    "cleanup": ("inactive", "on_cleanup", "unconfigured"),
}
"""transition -> from, callback, to"""

OWN_NAMES = {
    *("_allow_undeclared_parameters", "_apply_descriptor", "_apply_descriptors"),
    *("_callbacks", "_clients", "_clock", "_context", "_declare_parameter_common"),
    *("_default_callback_group", "_descriptors", "_guards", "_logger", "_logger_service"),
    *("_managed_entities", "_on_set_parameters_callbacks", "_parameter_event_publisher"),
    *("_parameter_overrides", "_parameter_service", "_parameters"),
    *("_post_set_parameters_callbacks", "_pre_set_parameters_callbacks", "_publishers"),
    *("_rate_group", "_service_change_state", "_service_get_available_states"),
    *("_service_get_available_transitions", "_service_get_state"),
    *("_service_get_transition_graph", "_services", "_set_parameters_atomically"),
    *("_state_machine", "_set_parameters_atomically_common", "_subscriptions"),
    *("_time_source", "_timers", "_type_description_service", "_wake_executor"),
}
"""private names of rclpy's Node and LifecycleNodeMixin, which a subclass must not take"""


class LifecycleNode:
    """See `rclpy.lifecycle` and rclpy.node. Private names are those of rclpy."""

    PARAM_REL_TOL = 1e-6

    def __init__(
        self,
        node_name: str,
        *,
        enable_communication_interface: bool = True,
        namespace: str | None = None,
        parameter_overrides: list[Parameter] | None = None,
    ) -> None:
        if not GRAPH.initialized:
            raise NotInitializedException("cannot create node")
        self.__name = node_name
        self._logger, self._clock, self._context = Logger(), Clock(), Context()
        self._clock.clock_type = ClockType.ROS_TIME
        self._parameters: dict[str, Parameter] = {}
        self._descriptors: dict[str, Any] = {}
        self._parameter_overrides = {
            name: Parameter(name, value=value) for name, value in GRAPH.overrides.items()
        }
        self._on_set_parameters_callbacks: list[Callable[[list[Parameter]], Any]] = []
        self._post_set_parameters_callbacks: list[Callable[[list[Parameter]], None]] = []
        self._timers: list[Timer] = []
        self._publishers: list[Publisher] = []
        self._managed_entities: set[LifecyclePublisher] = set()
        self._state_machine = "unconfigured"
        self.is_destroyed = False

    # -- a node

    def get_name(self) -> str:
        """Its name."""
        return self.__name

    def get_namespace(self) -> str:
        """Its namespace."""
        return GRAPH.namespace

    def get_logger(self) -> Logger:
        """Its logger."""
        return self._logger

    def get_clock(self) -> Clock:
        """Its clock."""
        return self._clock

    @property
    def context(self) -> Context:
        """Its context."""
        return self._context

    def destroy_node(self) -> None:
        """Destroy what it has."""
        self.is_destroyed = True
        for publisher in tuple(self._publishers):
            self.destroy_publisher(publisher)
        self._timers.clear()

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[[], None],
        callback_group: None = None,
        clock: Clock | None = None,
    ) -> Timer:
        """Make a timer, which runs at once."""
        timer = Timer(callback, int(float(timer_period_sec) * 1e9), clock or self._clock)
        self._timers.append(timer)
        return timer

    def destroy_timer(self, timer: Timer) -> bool:
        """Destroy a timer."""
        if timer in self._timers:
            self._timers.remove(timer)
            return True
        return False

    def create_publisher(
        self,
        msg_type: Any,
        topic: str,
        qos_profile: QoSProfile | int,
        *,
        publisher_class: type[Publisher] = Publisher,
    ) -> Publisher:
        """Make a publisher."""
        assert isinstance(qos_profile, QoSProfile | int)
        assert topic.startswith("/"), "this stub resolves no relative names"
        profile = QoSProfile(depth=qos_profile) if isinstance(qos_profile, int) else qos_profile
        self._publishers.append(publisher_class(msg_type, topic, profile))
        return self._publishers[-1]

    def destroy_publisher(self, publisher: Publisher) -> bool:
        """Destroy a publisher."""
        if publisher in self._publishers:
            self._publishers.remove(publisher)
            publisher.destroy()
            return True
        return False

    def create_lifecycle_publisher(
        self, msg_type: Any, topic: str, qos_profile: QoSProfile | int
    ) -> LifecyclePublisher:
        """Make a publisher that is silent unless the node is active."""
        made = self.create_publisher(
            msg_type, topic, qos_profile, publisher_class=LifecyclePublisher
        )
        assert isinstance(made, LifecyclePublisher)
        self._managed_entities.add(made)
        return made

    def destroy_lifecycle_publisher(self, publisher: LifecyclePublisher) -> bool:
        """Destroy a publisher."""
        self._managed_entities.discard(publisher)
        return self.destroy_publisher(publisher)

    # -- parameters

    def declare_parameter(
        self,
        name: str,
        value: Any = None,
        descriptor: Any = None,
        ignore_override: bool = False,
    ) -> Parameter:
        """Declare a parameter; an override stands for its value."""
        descriptor = (
            message("rcl_interfaces/msg/ParameterDescriptor")()
            if descriptor is None
            else descriptor
        )
        assert isinstance(descriptor, message("rcl_interfaces/msg/ParameterDescriptor"))
        descriptor.type = Parameter.Type.from_parameter_value(value).value
        if descriptor.type == Parameter.Type.NOT_SET:
            raise ValueError(
                "Cannot declare a statically typed parameter with default value of type NOT_SET"
            )
        if not ignore_override and name in self._parameter_overrides:
            value = self._parameter_overrides[name].value
        if name in self._parameters:
            raise ParameterAlreadyDeclaredException([name])
        parameter = Parameter(name, value=value)
        result = self._set_parameters_atomically_common([parameter], {name: descriptor})
        if not result.successful:
            if result.reason.startswith("Wrong parameter type"):
                raise InvalidParameterTypeException(parameter, Parameter.Type(descriptor.type).name)
            raise InvalidParameterValueException(name, value, result.reason)
        return self._parameters[name]

    def undeclare_parameter(self, name: str) -> None:
        """Forget a parameter."""
        if name not in self._parameters:
            raise ParameterNotDeclaredException(name)
        del self._parameters[name], self._descriptors[name]

    def has_parameter(self, name: str) -> bool:
        """Whether a parameter is declared."""
        return name in self._parameters

    def get_parameter(self, name: str) -> Parameter:
        """A parameter."""
        if name not in self._parameters:
            raise ParameterNotDeclaredException(name)
        return self._parameters[name]

    def describe_parameter(self, name: str) -> Any:
        """The descriptor of a parameter."""
        if name not in self._parameters:
            raise ParameterNotDeclaredException(name)
        return self._descriptors[name]

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        """Set all parameters, or none: what the parameter services call."""
        assert all(isinstance(one, Parameter) for one in parameter_list)
        undeclared = [one.name for one in parameter_list if one.name not in self._parameters]
        if undeclared:
            raise ParameterNotDeclaredException(undeclared)
        return self._set_parameters_atomically_common(parameter_list)

    def add_on_set_parameters_callback(self, callback: Callable[[list[Parameter]], Any]) -> None:
        """Add a check of new values."""
        self._on_set_parameters_callbacks.insert(0, callback)

    def add_post_set_parameters_callback(self, callback: Callable[[list[Parameter]], None]) -> None:
        """Add what follows after new values."""
        self._post_set_parameters_callbacks.insert(0, callback)

    def _set_parameters_atomically_common(
        self, parameter_list: list[Parameter], descriptors: dict[str, Any] | None = None
    ) -> Any:
        result = message("rcl_interfaces/msg/SetParametersResult")
        for one in parameter_list:
            about = (descriptors or self._descriptors)[one.name]
            about.name = one.name
            reason = self._apply_descriptor(one, about, descriptors is None)
            if reason:
                return result(successful=False, reason=reason)
        for callback in self._on_set_parameters_callbacks:
            found = callback(parameter_list)
            assert isinstance(found, result)
            if not found.successful:
                return found
        self._descriptors.update(descriptors or {})
        self._parameters.update({one.name: one for one in parameter_list})
        for follow in self._post_set_parameters_callbacks:
            follow(parameter_list)
        return result(successful=True)

    def _apply_descriptor(self, parameter: Parameter, about: Any, check_read_only: bool) -> str:
        """The reason why a value is refused; empty if it is not."""
        name, value = parameter.name, parameter.value
        if check_read_only and about.read_only:
            return f"Trying to set a read-only parameter: {name}."
        if parameter.type_ != about.type:
            return (
                f"Wrong parameter type, expected '{Parameter.Type(about.type)}' "
                f"got '{parameter.type_}'"
            )
        for limits in about.integer_range:
            if not limits.from_value <= value <= limits.to_value:
                return f"Parameter {name} out of range. {_between(limits, value)}"
        for limits in about.floating_point_range:
            ends = (limits.from_value, limits.to_value)
            at_end = any(math.isclose(value, end, rel_tol=self.PARAM_REL_TOL) for end in ends)
            if not at_end and not ends[0] < value < ends[1]:
                return f"Parameter {name} out of range {_between(limits, value)}"
        return ""

    # -- the life cycle

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Nothing."""
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Nothing."""
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Nothing."""
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Nothing."""
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let publishers publish."""
        for publisher in self._managed_entities:
            publisher.is_activated = True
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Silence publishers."""
        for publisher in self._managed_entities:
            publisher.is_activated = False
        return TransitionCallbackReturn.SUCCESS

    def trigger_configure(self) -> TransitionCallbackReturn:
        """Configure."""
        return self.__change_state("configure")

    def trigger_activate(self) -> TransitionCallbackReturn:
        """Activate."""
        return self.__change_state("activate")

    def trigger_deactivate(self) -> TransitionCallbackReturn:
        """Deactivate."""
        return self.__change_state("deactivate")

    def trigger_cleanup(self) -> TransitionCallbackReturn:
        """Clean up."""
        return self.__change_state("cleanup")

    def trigger_shutdown(self) -> TransitionCallbackReturn:
        """Shut down, from any state but the last."""
        if self._state_machine == "finalized":
            raise RuntimeError("Shutdown transtion not possible")
        return self.__transition(self._state_machine, "on_shutdown", "finalized")

    def __change_state(self, transition: str) -> TransitionCallbackReturn:
        start, callback, goal = TRANSITIONS[transition]
        if self._state_machine != start:
            self._logger.error(
                f"Unable to start transition {transition} from {self._state_machine}"
            )
            return TransitionCallbackReturn.ERROR
        return self.__transition(start, callback, goal)

    def __transition(self, start: str, callback: str, goal: str) -> TransitionCallbackReturn:
        state = LifecycleState(label=start, state_id=STATES.index(start) + 1)
        try:
            result = getattr(self, callback)(state)
        except Exception as error:  # rclpy takes any exception for an error, silently
            self._logger.error(f"{callback}: {error!r}")
            result = TransitionCallbackReturn.ERROR
        assert isinstance(result, TransitionCallbackReturn), f"{callback} returned {result!r}"
        if result == TransitionCallbackReturn.SUCCESS:
            self._state_machine = goal
        elif result == TransitionCallbackReturn.ERROR:
            ended = self.on_error(state)
            fine = ended == TransitionCallbackReturn.SUCCESS
            self._state_machine = "unconfigured" if fine else "finalized"
        return result


def _between(limits: Any, value: Any) -> str:
    return f"Min: {limits.from_value}, Max: {limits.to_value}, value: {value}"


def init(*, args: Any = None) -> None:
    """See `rclpy`."""
    GRAPH.initialized = True


def spin(node: LifecycleNode) -> None:
    """See `rclpy`."""
    GRAPH.spun(node)


def try_shutdown() -> None:
    """See `rclpy`."""
    GRAPH.is_up = False


@dataclass(frozen=True)
class Substitution:
    """As launch.substitutions.LaunchConfiguration: the value of an argument."""

    name: str


@dataclass(frozen=True)
class Condition:
    """As launch.conditions.IfCondition."""

    predicate_expression: Substitution


class Action:
    """As launch.Action."""

    def __init__(self, *, condition: Condition | None = None) -> None:
        assert condition is None or isinstance(condition, Condition)
        self.condition = condition


class DeclareLaunchArgument(Action):
    """See `launch.actions`."""

    def __init__(
        self,
        name: str,
        *,
        default_value: str | None = None,
        description: str | None = None,
        choices: list[str] | None = None,
        **more: Any,
    ) -> None:
        super().__init__(**more)
        self.name, self.default_value = name, default_value


class EmitEvent(Action):
    """See `launch.actions`."""

    def __init__(self, *, event: ChangeState, **more: Any) -> None:
        super().__init__(**more)
        assert isinstance(event, ChangeState)
        self.event = event


class RegisterEventHandler(Action):
    """See `launch.actions`."""

    def __init__(self, event_handler: OnStateTransition, **more: Any) -> None:
        super().__init__(**more)
        assert isinstance(event_handler, OnStateTransition)
        self.event_handler = event_handler


class LifecycleNodeAction(Action):
    """As launch_ros.actions.LifecycleNode."""

    def __init__(
        self,
        *,
        name: Any,
        namespace: Any,
        executable: str,
        package: str,
        parameters: list[Any],
        output: str,
    ) -> None:
        super().__init__()
        self.executable, self.package, self.parameters = executable, package, parameters


@dataclass(frozen=True, kw_only=True)
class ChangeState:
    """See `launch_ros.events.lifecycle`."""

    lifecycle_node_matcher: Callable[[Any], bool]
    transition_id: int


@dataclass(frozen=True, kw_only=True)
class OnStateTransition:
    """See `launch_ros.event_handlers`."""

    entities: list[Action]
    target_lifecycle_node: LifecycleNodeAction
    start_state: str | None = None
    goal_state: str | None = None


class ParameterValue:
    """See `launch_ros.parameter_descriptions`."""

    def __init__(self, value: Substitution, *, value_type: type | None = None) -> None:
        self.value, self.value_type = value, value_type


@dataclass(frozen=True)
class LaunchDescription:
    """See `launch`."""

    entities: list[Action]


LAUNCH: dict[str, dict[str, Any]] = {
    "ament_index_python": {},
    "ament_index_python.packages": {
        "get_package_share_directory": lambda package_name: f"/opt/share/{package_name}"
    },
    "launch": {"LaunchDescription": LaunchDescription},
    "launch.actions": {
        "DeclareLaunchArgument": DeclareLaunchArgument,
        "EmitEvent": EmitEvent,
        "RegisterEventHandler": RegisterEventHandler,
    },
    "launch.conditions": {"IfCondition": Condition},
    "launch.events": {"matches_action": lambda target: lambda action: action == target},
    "launch.substitutions": {"LaunchConfiguration": Substitution},
    "launch_ros": {},
    "launch_ros.actions": {"LifecycleNode": LifecycleNodeAction},
    "launch_ros.event_handlers": {"OnStateTransition": OnStateTransition},
    "launch_ros.events": {},
    "launch_ros.events.lifecycle": {"ChangeState": ChangeState},
    "launch_ros.parameter_descriptions": {"ParameterValue": ParameterValue},
}

MODULES: dict[str, dict[str, Any]] = {
    "rclpy": {"init": init, "spin": spin, "try_shutdown": try_shutdown},
    "rclpy.clock": {"Clock": Clock, "ClockType": ClockType},
    "rclpy.exceptions": {"ParameterException": ParameterException},
    "rclpy.executors": {"ExternalShutdownException": ExternalShutdownException},
    "rclpy.lifecycle": {
        "LifecycleNode": LifecycleNode,
        "LifecyclePublisher": LifecyclePublisher,
        "LifecycleState": LifecycleState,
        "TransitionCallbackReturn": TransitionCallbackReturn,
    },
    "rclpy.parameter": {"Parameter": Parameter},
    "rclpy.qos": {
        "DurabilityPolicy": DurabilityPolicy,
        "HistoryPolicy": HistoryPolicy,
        "QoSProfile": QoSProfile,
        "ReliabilityPolicy": ReliabilityPolicy,
    },
    "rclpy.timer": {"Timer": Timer},
    **LAUNCH,
}
"""module -> what the package imports from it"""

MESSAGES = (
    *("lifecycle_msgs/msg/Transition", "rcl_interfaces/msg/FloatingPointRange"),
    *("rcl_interfaces/msg/IntegerRange", "rcl_interfaces/msg/ParameterDescriptor"),
    "rcl_interfaces/msg/SetParametersResult",
    *("diagnostic_msgs/msg/DiagnosticArray", "diagnostic_msgs/msg/DiagnosticStatus"),
    *("diagnostic_msgs/msg/KeyValue", "event_camera_msgs/msg/EventPacket"),
    *("geometry_msgs/msg/PoseStamped", "rosgraph_msgs/msg/Clock", "sensor_msgs/msg/CameraInfo"),
    *("sensor_msgs/msg/Image", "sensor_msgs/msg/Imu", "tf2_msgs/msg/TFMessage"),
)


@contextmanager
def ros() -> Iterator[Graph]:
    """Stand in for ROS; what was imported meanwhile from it is forgotten afterwards."""
    before = dict(sys.modules)
    GRAPH.__init__()  # type: ignore[misc]
    for name, members in MODULES.items():
        sys.modules[name] = ModuleType(name)
        vars(sys.modules[name]).update(members)
    for kind in MESSAGES:
        package, _, name = kind.split("/")
        module = sys.modules.setdefault(f"{package}.msg", ModuleType(f"{package}.msg"))
        sys.modules.setdefault(package, ModuleType(package))
        setattr(module, name, message(kind))
    ours = {name.split(".")[0] for name in (*MODULES, *(k.split("/")[0] for k in MESSAGES))}
    try:
        yield GRAPH
    finally:
        for name in tuple(sys.modules):
            if name.split(".")[0] in {*ours, "evs_camera_ros"}:
                del sys.modules[name]
                if name in before:
                    sys.modules[name] = before[name]
