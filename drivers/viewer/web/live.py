"""LivePage: the page of cameras in this process, as an environment shows itself."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import ExitStack

from evs.drivers.bus import Publisher
from evs.drivers.clock import Pacer
from evs.drivers.run.sink_set import AuxiliaryStreams
from evs.drivers.viewer.web.program import PageRequest, page_beside
from evs.msgs import EventPacket

_WAIT_S = 30.0
"""for the page's process to start"""


class LivePage:
    """A page, in a process of its own, and the publisher that feeds it, in real time."""

    def __init__(self, cameras: Sequence[AuxiliaryStreams]) -> None:
        """Start the page and wait for its process; its address is printed.

        Args:
            cameras: Those shown.

        Raises:
            EvsError: The extra is not installed, or the process did not start.
        """
        self._cameras = cameras
        self._pacer = Pacer(1.0)
        self._stack = ExitStack()
        folder = self._stack.enter_context(tempfile.TemporaryDirectory(prefix="evs-view-"))
        address = f"ipc://{folder}/packets"
        self._publisher = Publisher(address, wait_for=1, wait_s=_WAIT_S)
        try:
            self._stack.enter_context(page_beside(PageRequest(address)))
            self._stack.callback(self._publisher.close)
            self._publisher.open([camera.info for camera in cameras])
        except BaseException:
            self._stack.close()
            raise

    def begin(self, t_us: int) -> None:
        """Simulated time starts at t_us, now."""
        self._pacer.start(t_us)

    def show(self, packets: Sequence[EventPacket], t_us: int) -> None:
        """Show packets and the light at t_us, once the wall clock has come there."""
        self._pacer.wait_until(t_us)
        for camera in self._cameras:
            if self._publisher.wants_light(camera.info.camera, t_us):
                self._publisher.write_light(camera.info.camera, t_us, camera.luminance)
        for packet in packets:
            self._publisher.write(packet)

    def close(self) -> None:
        """End the page. Safe to call twice."""
        self._stack.close()
