"""DDS: the network interface, a participant, its writers, and the types of ROS messages.

This is the only door to cyclonedds. DDS uses the loopback interface, unless others are meant to
listen.
"""

from __future__ import annotations

import ctypes
import ipaddress
import socket
import weakref
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from evs.drivers.files.bags.library import typestore
from evs.drivers.ros2.names import Quality
from evs.msgs import EvsError, nearest_first

_FLAG_LOOPBACK = 0x8

MAX_DOMAIN_ID = 232
"""Higher domains would need ports that do not exist."""


@dataclass(frozen=True)
class Interface:
    """One interface, by name or address; with neither, the middleware chooses."""

    name: str = ""
    address: str = ""
    is_loopback: bool = False

    def __str__(self) -> str:
        return self.name or self.address or "any interface"


def interface_of(word: str, insecure: bool) -> Interface:
    """The interface for a configuration value.

    Args:
        word: Name or address of an interface; empty: the loopback one, or any if `insecure`.
        insecure: Whether other machines may read what is published.

    Raises:
        EvsError: There is no such interface, or other machines could read it without `insecure`.
    """
    chosen = _found(word or ("" if insecure else "lo"))
    if not (chosen.is_loopback or insecure):
        raise EvsError(
            f"cannot publish for ROS 2 on {chosen}: DDS has no keys here, whoever is on that "
            "network sees what the camera sees; leave interface out, or set insecure=true"
        )
    return chosen


def checked_domain(number: int) -> int:
    """The domain's number, unchanged. EvsError: it is out of the range of ROS_DOMAIN_ID."""
    if not 0 <= number <= MAX_DOMAIN_ID:
        raise EvsError(f"domain_id is {number}: give 0 ... {MAX_DOMAIN_ID}")
    return number


def _found(word: str) -> Interface:
    if not word:
        return Interface()
    try:
        address = ipaddress.ip_address(word)
    except ValueError:
        known = [name for _, name in socket.if_nameindex()]
        if word not in known:
            names = ", ".join(nearest_first(word, known))
            raise EvsError(f"no network interface '{word}' here; there is: {names}") from None
        return Interface(name=word, is_loopback=_is_loopback(word))
    return Interface(address=word, is_loopback=address.is_loopback)


def _is_loopback(name: str) -> bool:
    flags = Path("/sys/class/net", name, "flags")
    try:
        return bool(int(flags.read_text(), 16) & _FLAG_LOOPBACK)
    except OSError:
        return name == "lo"


QUEUE_BYTES = "1 GB"
"""Most bytes that a reliable writer holds for slow readers; its depth limits the messages."""

_LOOPBACK_FRAGMENTS = "<MaxMessageSize>65000B</MaxMessageSize><FragmentSize>60000B</FragmentSize>"
"""A datagram on the loopback interface may be as large as UDP permits."""

PLACES = 32
"""Most programs that discover each other on the loopback interface without multicast."""

_LOOPBACK_PEERS = (
    "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
    f"<MaxAutoParticipantIndex>{PLACES}</MaxAutoParticipantIndex>"
    '<Peers><Peer address="localhost"/></Peers></Discovery>'
)
"""Nodes that stay on this machine may have no multicast. They are therefore discovered one by one,
at the ports that ROS's own middleware uses."""


def load() -> Any:
    """Import the library. EvsError: it is not installed; the message has the pip command."""
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
    """A message as the library's C interface takes it: its CDR."""

    _fields_ = (("data", ctypes.c_void_p), ("size", ctypes.c_size_t))


class Writer:
    """Writes the messages of one topic, each as the bytes of its CDR."""

    def __init__(self, participant: Any, name: str, kind: str, quality: Quality) -> None:
        """Join a topic.

        Args:
            participant: The library's participant.
            name: Name of the topic in ROS, such as /camera/events.
            kind: Type of its messages, such as sensor_msgs/msg/Imu.
            quality: Its quality of service.
        """
        dds = load()
        policy = dds.core.Policy
        self._is_reliable = quality.reliable
        self.readers = 0
        """number of readers that are matched now"""
        durability, reliability = policy.Durability, policy.Reliability
        policies = dds.core.Qos(
            # a writer that blocks would delay all others
            reliability.Reliable(0) if quality.reliable else reliability.BestEffort,
            durability.TransientLocal if quality.transient_local else durability.Volatile,
            policy.History.KeepLast(quality.depth),
        )
        # a query would wait for a write in progress
        listener = dds.core.Listener(on_publication_matched=self._matched)
        topic = dds.topic.Topic(participant, f"rt{name}", topic_type(kind), qos=policies)
        self._writer: Any = dds.pub.DataWriter(participant, topic, qos=policies, listener=listener)
        self._failures = (dds.core.DDSException,)
        self._write = dds.internal.DDS._dll_handle.dds_write
        self._write.argtypes, self._write.restype = (
            [ctypes.c_int32, ctypes.c_void_p],
            ctypes.c_int32,
        )

    def write(self, data: bytes) -> bool:
        """Write one message; return False where the middleware does not take it.

        It blocks where a slow link has filled the socket, but without Python's lock. The library's
        own `write` holds that lock, and converts bytes into CDR one by one (2 ms for 100 kB).
        """
        if self._writer is None:
            return False
        message = _Bytes(ctypes.cast(ctypes.c_char_p(data), ctypes.c_void_p), len(data))
        return int(self._write(self._writer._ref, ctypes.byref(message))) == 0

    def wait(self, seconds: float) -> bool:
        """Wait until reliable readers have confirmed all messages; return False on a timeout."""
        if not self._is_reliable or self._writer is None:
            return True
        try:
            return bool(self._writer.wait_for_acks(int(seconds * 1e9)))
        except (*self._failures, AttributeError):
            # the library itself raises an AttributeError on a timeout
            return False

    def close(self) -> None:
        """Leave the topic. Safe to call twice."""
        # the library deletes an entity with the last reference to it
        self._writer = None
        self.readers = 0

    def _matched(self, _writer: Any, status: Any) -> None:
        self.readers = int(status.current_count)


class Participant:
    """A presence in a DDS domain, on one network interface."""

    def __init__(self, domain_id: int, interface: Interface) -> None:
        """Enter a domain. EvsError: this process uses it differently, or the interface is down."""
        dds = load()
        _silence(dds)
        self._domain: Any = _domain(dds, domain_id, _configuration(interface), interface)
        try:
            self._participant: Any = dds.domain.DomainParticipant(domain_id)
        except dds.core.DDSException:
            self._domain = None
            raise _refused(domain_id, interface) from None

    def writer(self, name: str, kind: str, quality: Quality) -> Writer:
        """A writer for a topic; it has to be closed before the participant is."""
        return Writer(self._participant, name, kind, quality)

    def close(self) -> None:
        """Leave the domain. Safe to call twice."""
        self._participant = None
        self._domain = None


@cache
def topic_type(kind: str) -> Any:
    """The DDS struct of a ROS message, from the definition that bags use.

    It has the name that ROS gives it, such as sensor_msgs::msg::dds_::Imu_.
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
"""The domains of this process, each configured once and shared by its participants."""


def _domain(dds: Any, number: int, configuration: str, interface: Interface) -> Any:
    """The domain of this number; it lives as long as something refers to it."""
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
    """The error for a domain that the library cannot enter, for which it gives no reason."""
    places = f", or {PLACES} programs are in it: give another domain_id"
    return EvsError(
        f"cannot enter DDS domain {number} on {interface}: the interface is down (ip link set NAME "
        f"up){places if interface.is_loopback else ''}"
    )


def _configuration(interface: Interface) -> str:
    """The library's configuration, which overrides its environment variable."""
    if interface.name:
        chosen = f"name={quoteattr(interface.name)}"
    elif interface.address:
        chosen = f"address={quoteattr(interface.address)}"
    else:
        chosen = 'autodetermine="true"'
    # the loopback interface carries multicast without declaring it
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
    """Turn off the library's log on stderr, thousands of lines with a cable unplugged."""
    # the library's Python interface has no such function
    set_mask = dds.internal.DDS._dll_handle.dds_set_log_mask
    set_mask.argtypes, set_mask.restype = [ctypes.c_uint32], None
    set_mask(0)
