"""DDS: a participant, its writers, and the types of ROS messages. The only door to cyclonedds."""

from __future__ import annotations

import ctypes
import weakref
from functools import cache
from typing import Any
from xml.sax.saxutils import quoteattr

from evs.drivers.files.bags.library import typestore
from evs.drivers.ros2.network import Interface
from evs.msgs import EvsError

QUEUE_BYTES = "1 GB"
"""What a reliable writer may keep for slow readers; how many messages that are is its depth."""

_LOOPBACK_FRAGMENTS = "<MaxMessageSize>65000B</MaxMessageSize><FragmentSize>60000B</FragmentSize>"
"""A datagram on the loopback interface may be as large as UDP permits."""

PLACES = 32
"""Programs that find each other in a domain of the loopback interface without multicast."""

_LOOPBACK_PEERS = (
    "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
    f"<MaxAutoParticipantIndex>{PLACES}</MaxAutoParticipantIndex>"
    '<Peers><Peer address="localhost"/></Peers></Discovery>'
)
"""Nodes that are told to stay on this machine may do without multicast. So they are asked one by
one, at the places where ROS's own middleware looks for its like."""


def load() -> Any:
    """The library; EvsError says how to install it."""
    try:
        import cyclonedds.core
        import cyclonedds.domain
        import cyclonedds.idl.types
        import cyclonedds.internal
        import cyclonedds.pub
        import cyclonedds.topic
    except ImportError:
        raise EvsError(
            "ROS 2 needs cyclonedds (which has no wheel for aarch64, nor for Python 3.14): "
            "pip install 'evs[ros2]'"
        ) from None
    return cyclonedds


class _Bytes(ctypes.Structure):
    """What the types of the library's Python face take for a message: its CDR."""

    _fields_ = (("data", ctypes.c_void_p), ("size", ctypes.c_size_t))


class Writer:
    """Writes the messages of one topic, each as the bytes of its CDR."""

    def __init__(self, participant: Any, name: str, kind: str, reliable: bool, depth: int) -> None:
        """In: name, as ROS has it (/camera/events); kind, as in sensor_msgs/msg/Imu."""
        dds = load()
        policy = dds.core.Policy
        self._is_reliable = reliable
        self.readers = 0
        """that are matched now"""
        quality = dds.core.Qos(
            # a writer that waited would hold up all others
            policy.Reliability.Reliable(0) if reliable else policy.Reliability.BestEffort,
            policy.Durability.Volatile,
            policy.History.KeepLast(depth),
        )
        # asking would wait for a write that is under way
        listener = dds.core.Listener(on_publication_matched=self._matched)
        topic = dds.topic.Topic(participant, f"rt{name}", topic_type(kind), qos=quality)
        self._writer: Any = dds.pub.DataWriter(participant, topic, qos=quality, listener=listener)
        self._failures = (dds.core.DDSException,)
        self._write = dds.internal.DDS._dll_handle.dds_write
        self._write.argtypes, self._write.restype = (
            [ctypes.c_int32, ctypes.c_void_p],
            ctypes.c_int32,
        )

    def write(self, data: bytes) -> bool:
        """Hand one message over; False where the middleware does not take it.

        It waits where a slow link has filled the socket, but without Python's lock: the library's
        own `write` keeps that, and turns bytes into CDR one by one besides (2 ms for 100 kB).
        """
        if self._writer is None:
            return False
        message = _Bytes(ctypes.cast(ctypes.c_char_p(data), ctypes.c_void_p), len(data))
        return int(self._write(self._writer._ref, ctypes.byref(message))) == 0

    def wait(self, seconds: float) -> bool:
        """Until every reliable reader has confirmed what was written; False: not in that time."""
        if not self._is_reliable or self._writer is None:
            return True
        try:
            return bool(self._writer.wait_for_acks(int(seconds * 1e9)))
        except (*self._failures, AttributeError):
            # the library stumbles over a name of its own when the time is up
            return False

    def close(self) -> None:
        """Leave the topic. Safe to call twice."""
        # the library ends an entity with the last reference to it
        self._writer = None
        self.readers = 0

    def _matched(self, _writer: Any, status: Any) -> None:
        self.readers = int(status.current_count)


class Participant:
    """A presence in a DDS domain, on one network interface."""

    def __init__(self, domain_id: int, interface: Interface) -> None:
        """EvsError: the domain is in use by this process otherwise, or the interface is off."""
        dds = load()
        _silence(dds)
        self._domain: Any = _domain(dds, domain_id, _configuration(interface), interface)
        try:
            self._participant: Any = dds.domain.DomainParticipant(domain_id)
        except dds.core.DDSException:
            self._domain = None
            raise _refused(domain_id, interface) from None

    def writer(self, name: str, kind: str, *, reliable: bool, depth: int) -> Writer:
        """A writer for a topic; it has to be closed before the participant is."""
        return Writer(self._participant, name, kind, reliable, depth)

    def close(self) -> None:
        """Leave the domain. Safe to call twice."""
        self._participant = None
        self._domain = None


@cache
def topic_type(kind: str) -> Any:
    """The DDS struct of a ROS message, from the definition that bags use.

    Its name is the one that ROS gives it: sensor_msgs::msg::dds_::Imu_.
    """
    package, name = kind.split("/msg/")
    _, fields = typestore(2).fielddefs[kind]
    members = {field: _member(described) for field, described in fields}
    typename = f"{package}::msg::dds_::{name}_"
    return load().idl.make_idl_struct(f"{name}_", typename, members)


def _member(described: Any) -> Any:
    """The type of a field, as the library annotates it."""
    types = load().idl.types
    node, what = described
    if node.name == "NAME":
        return topic_type(what)
    if node.name == "BASE":
        own = {"string": str, "bool": bool, "byte": types.uint8}
        return own.get(what[0]) or getattr(types, what[0])
    inner, count = what
    return types.array[_member(inner), count] if count else types.sequence[_member(inner)]


_domains: dict[int, tuple[str, Any]] = {}
"""Domains of this process: configured once, shared by its participants."""


def _domain(dds: Any, number: int, configuration: str, interface: Interface) -> Any:
    """The domain, kept while somebody refers to it."""
    known, reference = _domains.get(number, ("", lambda: None))
    shared = reference()
    if shared is not None:
        if known != configuration:
            raise EvsError(
                f"DDS domain {number} is in use by this process on another interface: give both "
                "sinks the same, or another domain_id"
            )
        return shared
    try:
        made = dds.domain.Domain(number, configuration)
    except dds.core.DDSException as reason:
        if reason.code == dds.core.DDSException.DDS_RETCODE_PRECONDITION_NOT_MET:
            raise EvsError(
                f"DDS domain {number} is in use by this process already: open the sink first, or "
                "give it another domain_id"
            ) from None
        raise _refused(number, interface) from None
    _domains[number] = configuration, weakref.ref(made)
    return made


def _refused(number: int, interface: Interface) -> EvsError:
    """The library says no more than that it cannot."""
    places = f", or {PLACES} programs are in it: give another domain_id"
    return EvsError(
        f"cannot enter DDS domain {number} on {interface}: the interface is down (ip link set NAME "
        f"up){places if interface.is_loopback else ''}"
    )


def _configuration(interface: Interface) -> str:
    """The library's configuration; its environment variable counts for nothing."""
    if interface.name:
        chosen = f"name={quoteattr(interface.name)}"
    elif interface.address:
        chosen = f"address={quoteattr(interface.address)}"
    else:
        chosen = 'autodetermine="true"'
    # the loopback interface does not say that it carries multicast, but it does
    chosen += ' multicast="true"' if interface.is_loopback else ""
    fragments, peers = "", ""
    if interface.is_loopback:
        fragments, peers = _LOOPBACK_FRAGMENTS, _LOOPBACK_PEERS
    return (
        "<CycloneDDS><Domain><General>"
        f"<Interfaces><NetworkInterface {chosen}/></Interfaces>{fragments}"
        f"</General>{peers}<Internal><Watermarks>"
        f"<WhcHigh>{QUEUE_BYTES}</WhcHigh><WhcHighInit>{QUEUE_BYTES}</WhcHighInit>"
        "<WhcAdaptive>false</WhcAdaptive></Watermarks></Internal></Domain></CycloneDDS>"
    )


@cache
def _silence(dds: Any) -> None:
    """No lines on stderr: with a cable unplugged the library writes thousands of them."""
    # no Python face of the library has it
    set_mask = dds.internal.DDS._dll_handle.dds_set_log_mask
    set_mask.argtypes, set_mask.restype = [ctypes.c_uint32], None
    set_mask(0)
