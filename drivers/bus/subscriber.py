"""The receiving end of the bus: packets in order, and an exact count of what was lost."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import zmq

from evs.drivers.bus.auxiliary import AuxiliaryMessages, of_topic
from evs.drivers.bus.listener import Listener
from evs.drivers.bus.losses import Gaps, Tally
from evs.drivers.bus.sockets import quick_check, readable, receive_parts
from evs.drivers.clock import monotonic_s
from evs.msgs import (
    CAMERA_INFO,
    CLOCK,
    EVENTS,
    FRAMES,
    IMU,
    LIGHT,
    POSE,
    STATUS,
    TRUTH,
    CameraInfo,
    Clock,
    EventPacket,
    EvsError,
    Frame,
    ImuPacket,
    MessageError,
    Pose,
    Status,
    Truth,
    decode,
    decode_status,
)
from evs.msgs.header_fields import check_name
from evs.msgs.packet import MAX_FRAME_BYTES
from evs.msgs.status import MAX_CAMERAS

END_GRACE_S = 0.5
"""Nothing for this long after the end was announced: what is missing will not come."""

_LATE_SKIPS = 1000
_MOST_PARTS = 3


def subscribe(
    address: str,
    camera: str = "",
    *,
    queue: int = EVENTS.queue,
    timeout_s: float | None = None,
    frames: bool = False,
    imu: bool = False,
    poses: bool = False,
    lights: bool = False,
    truths: bool = False,
    camera_info: bool = False,
    clock: bool = False,
    server_key: str = "",
    key: str = "",
) -> Subscription:
    """Subscribe to a publisher, which may start later.

    Iterate over the result for EventPackets. Iteration ends with the publisher's end status, or
    after `timeout_s` without a packet. The result's attributes `frames`, `imu`, `poses`, `lights`
    and
    `truths` hold the messages of these topics that came with a packet, `camera_info` and `clock`
    the newest ones.

    Args:
        address: Address of the publisher, tcp://HOST:PORT or ipc:///PATH.
        camera: Name of a camera; empty: all.
        queue: Packets to buffer before packets are lost.
        timeout_s: Time that iteration waits for a packet, s; None: for ever.
        frames: Whether to receive intensity frames.
        imu: Whether to receive IMU samples.
        poses: Whether to receive poses.
        lights: Whether to receive pictures of the light.
        truths: Whether to receive ground truth.
        camera_info: Whether to receive calibrations.
        clock: Whether to receive simulated time.
        server_key: The public key of a publisher that has keys, a file or the 40 characters;
            without it nothing is encrypted.
        key: File of your own secret key, if the publisher accepts only listed clients.

    Returns:
        The subscription.

    Raises:
        EvsError: An invalid address, name or key. `receive` raises it if the publisher rejects the
            client.
    """
    return Subscription(
        address,
        camera,
        queue=queue,
        timeout_s=timeout_s,
        frames=frames,
        imu=imu,
        poses=poses,
        lights=lights,
        truths=truths,
        camera_info=camera_info,
        clock=clock,
        server_key=server_key,
        key=key,
    )


class Subscription(Listener):
    """A stream of packets from another process. One thread uses it; close it, or use `with`.

    It has two connections: one for packets and statuses in order, and one for statuses alone, so
    the end of the stream arrives even if the queue of the first one is full.
    """

    def __init__(
        self,
        address: str,
        camera: str = "",
        *,
        queue: int = EVENTS.queue,
        timeout_s: float | None = None,
        frames: bool = False,
        imu: bool = False,
        poses: bool = False,
        lights: bool = False,
        truths: bool = False,
        camera_info: bool = False,
        clock: bool = False,
        server_key: str = "",
        key: str = "",
    ) -> None:
        if queue < 1:
            raise EvsError(f"queue is {queue}: give the packets that may wait, 1 or more")
        if timeout_s is not None and not timeout_s >= 0:
            raise EvsError(f"timeout_s is {timeout_s}: give seconds, 0 or more, or None")
        if camera:
            check_name(camera, "camera name")
        super().__init__(address, server_key, key)
        self.camera = camera
        self.timeout_s = timeout_s
        self.status: Status | None = None
        """The latest status of any camera listened to."""
        self.bad_messages = 0
        """Messages that were not of our format; they were skipped."""
        self.bytes = 0
        """Bytes of the raw frames received: 16 an event, 64 an IMU sample."""
        self.tallies: dict[str, Tally] = {}
        """The counts of each camera that has sent a message."""
        self.frames: tuple[Frame, ...] = ()
        """Intensity frames that came between the last packet received and the one before."""
        self.imu: tuple[ImuPacket, ...] = ()
        """IMU packets that came between the last packet received and the one before."""
        self.poses: tuple[Pose, ...] = ()
        """Poses that came between the last packet received and the one before."""
        self.lights: tuple[Frame, ...] = ()
        """Pictures of the light that came between the last packet received and the one before."""
        self.truths: tuple[Truth, ...] = ()
        """Ground truth that came between the last packet received and the one before."""
        self._auxiliary = AuxiliaryMessages()
        self._quick = quick_check()
        self._cameras: tuple[str, ...] = (camera,) if camera else ()
        self._end_announced_s: float | None = None
        self._ended = False
        requested = {FRAMES: frames, IMU: imu, POSE: poses}
        requested |= {LIGHT: lights, TRUTH: truths}
        requested |= {CAMERA_INFO: camera_info, CLOCK: clock}
        wanted = [EVENTS, *(topic for topic, yes in requested.items() if yes), STATUS]
        topics = [topic.of(camera) for topic in wanted]
        # they travel in alphabetical order: once a status comes, packets are subscribed to as well
        self._main = self._listen(topics, MAX_FRAME_BYTES, {zmq.RCVHWM: queue})
        self._side = self._listen(topics[-1:], MAX_FRAME_BYTES, {zmq.RCVHWM: STATUS.queue})

    @property
    def packets(self) -> int:
        """Packets received, of all cameras."""
        return sum(tally.packets for tally in self.tallies.values())

    @property
    def events(self) -> int:
        """Events received, of all cameras."""
        return sum(tally.events for tally in self.tallies.values())

    @property
    def lost(self) -> int:
        """Packets that were sent during the subscription and did not arrive; exact once `ended`."""
        return sum(tally.lost for tally in self.tallies.values())

    @property
    def restarts(self) -> int:
        """Number of new runs of a camera."""
        return sum(tally.restarts for tally in self.tallies.values())

    @property
    def ended(self) -> bool:
        """Whether every camera has ended, so no message can follow."""
        return self._ended

    def receive(self, timeout_s: float | None = None) -> EventPacket | None:
        """Wait for the next packet, at most `timeout_s` (None: for ever).

        Returns:
            The packet; None if every camera has ended, or none came in time.

        Raises:
            EvsError: The publisher refuses us.
        """
        deadline_s = math.inf if timeout_s is None else monotonic_s() + timeout_s
        patience, waited = _LATE_SKIPS, False
        while self._context is not None and not self._is_over():
            if self._has_news(self._main):
                packet = self._take(receive_parts(self._main), aside=False)
                if packet is not None:
                    self._hand_out()
                    return packet
            elif self._has_news(self._side):
                # only now: the main connection is empty
                self._take(receive_parts(self._side), aside=True)
            elif not waited or monotonic_s() < deadline_s:
                # at least once: only a wait sees what came since the last one
                waited = True
                self._wait(deadline_s)
                continue
            else:
                return None
            # a late packet may follow a few statuses, but not an endless flood of other messages
            if deadline_s < math.inf and monotonic_s() >= deadline_s:
                patience -= 1
                if patience == 0:
                    return None
        # what came after the last packet
        self._hand_out()
        return None

    def _hand_out(self) -> None:
        came = self._auxiliary.hand_out()
        if not came:
            self.frames, self.imu, self.poses, self.lights, self.truths = (), (), (), (), ()
            return
        self.frames, self.imu = of_topic(came, FRAMES, Frame), of_topic(came, IMU, ImuPacket)
        self.poses, self.lights = of_topic(came, POSE, Pose), of_topic(came, LIGHT, Frame)
        self.truths = of_topic(came, TRUTH, Truth)

    @property
    def gaps(self) -> dict[tuple[str, str], Gaps]:
        """The counts of the topics other than events: (topic, camera) -> Gaps."""
        return self._auxiliary.gaps

    @property
    def clock(self) -> Clock | None:
        """The newest clock, if it was requested and has arrived."""
        return self._auxiliary.clock

    @property
    def camera_info(self) -> dict[str, CameraInfo]:
        """The calibration of each camera, if it was requested and has arrived."""
        return self._auxiliary.infos

    def totals(self) -> dict[str, Any]:
        """All counts as plain values."""
        return {
            "address": self.address,
            "camera": self.camera,
            "packets": self.packets,
            "events": self.events,
            "bytes": self.bytes,
            "lost": self.lost,
            "restarts": self.restarts,
            "bad_messages": self.bad_messages,
            **self._auxiliary.totals(),
            "ended": self.ended,
            "status": None if self.status is None else asdict(self.status),
        }

    def __iter__(self) -> Subscription:
        return self

    def __next__(self) -> EventPacket:
        packet = self.receive(self.timeout_s)
        if packet is None:
            raise StopIteration
        return packet

    def _wait(self, deadline_s: float) -> None:
        """Wait for a message until the deadline, or until END_GRACE_S after the announced end."""
        until_s = deadline_s
        if self._end_announced_s is not None:
            until_s = min(until_s, self._end_announced_s + END_GRACE_S)
        self._poll(until_s)

    def _take(self, parts: list[Any], *, aside: bool) -> EventPacket | None:
        """Count one message; return its packet, if it is one."""
        try:
            kind, _, camera = parts[0].decode().partition("/")
            if self.camera and camera not in (self.camera, ""):
                # topics are prefixes: `events/left` also brings `events/left2`
                return None
            if kind == EVENTS.name and len(parts) == 3:
                packet = decode(parts[1], parts[2], self._quick)
                self._tally(camera, packet.camera).on_packet(packet)
                self.bytes += packet.events.nbytes
                # as long as packets come, more may come
                self._end_announced_s = None
                return packet
            if kind == STATUS.name and len(parts) == 2:
                self._take_status(camera, decode_status(parts[1]), aside=aside)
                return None
            if not self._auxiliary.take(kind, camera, parts):
                raise MessageError(f"a message of {len(parts)} parts under {kind!r}")
            self.bytes += len(parts[2]) if len(parts) == _MOST_PARTS else 0
            return None
        except (MessageError, UnicodeDecodeError):
            # the side connection only repeats what the main one brings
            self.bad_messages += 0 if aside else 1
            return None

    def _take_status(self, camera: str, status: Status, *, aside: bool) -> None:
        tally = self._tally(camera, status.camera)
        if aside:
            tally.on_side_status(status)
        else:
            tally.on_status(status)
            self._auxiliary.on_status(status)
        self.status = status
        if not self.camera:
            self._cameras = status.cameras

    def _tally(self, topic_camera: str, camera: str) -> Tally:
        if topic_camera != camera:
            raise MessageError(f"a message of camera {camera!r} under the topic of another")
        if camera not in self.tallies:
            if len(self.tallies) >= MAX_CAMERAS:
                raise MessageError(f"more than {MAX_CAMERAS} cameras on one bus")
            self.tallies[camera] = Tally()
        return self.tallies[camera]

    def _is_over(self) -> bool:
        """Whether every camera has ended and nothing that it sent can still come."""
        if self._ended or not self._cameras:
            return self._ended
        heard = []
        for camera in self._cameras:
            tally = self.tallies.get(camera)
            if tally is None or not (tally.ended or tally.promised_end):
                return False
            heard.append(tally)
        if not all(one.complete for one in heard):
            # the side connection announced it, and packets may still come: wait for them
            now_s = monotonic_s()
            if self._end_announced_s is None:
                self._end_announced_s = now_s
            if readable(self._main):
                self._stirred.add(self._main)
                return False
            if now_s < self._end_announced_s + END_GRACE_S:
                return False
        for one in heard:
            self.status = one.settle() or self.status
        self._ended = True
        # the publisher waits for its subscribers to leave
        self.close()
        return True


class Connection:
    """Warns when the connection to a publisher is lost and when it is restored.

    It does not receive messages itself.
    """

    def __init__(self, stream: Subscription, warn: Callable[[str], None]) -> None:
        """Watch a subscription.

        Args:
            stream: To watch.
            warn: Called with one line for each change.
        """
        self._stream, self._warn = stream, warn
        self._was_there = False
        self._is_cut = False

    def update(self) -> None:
        """Warn of what has changed since the last call."""
        address, status = self._stream.address, self._stream.status
        there = self._stream.connected
        if self._was_there and not there and not (status is not None and status.end):
            self._is_cut = True
            self._warn(f"the connection to {address} is cut: waiting for it (Ctrl-C ends)")
        elif there and self._is_cut:
            self._is_cut = False
            self._warn(f"the connection to {address} is there again")
        self._was_there = there
