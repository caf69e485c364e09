"""The server of our page: one port of this machine, for HTTP and WebSocket. The door to websockets.

Whoever has the address with its token may look and change parameters. Host has to be this machine,
and Origin the page itself, so that no other page in the same browser gets in, not even by a name
that leads here.
"""

from __future__ import annotations

import asyncio
import json
import secrets
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from http import HTTPStatus
from importlib import resources
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

from evs.drivers.clock import monotonic_s
from evs.drivers.viewer.web.feed import (
    BusFeed,
    CameraFeed,
    PixelNews,
    names_of,
    picture_message,
)
from evs.msgs import EventPacket, EvsError

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

PICTURES_HZ = 30.0
"""of the wall clock, at most"""

MOST_UNDRAWN = 2
"""pictures of a camera that are under way to a page; others wait, the newest events win"""

MOST_TEXTS = 100
"""that wait for a page; of more, the oldest are dropped"""

MOST_PAGES = 16

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")

_MOST_REQUEST_BYTES = 4096
_LINGER_S = 0.5
"""for the pages to learn that the run has ended"""

Ask = Callable[[str, dict[str, object]], dict[str, Any]]
"""Sends a request to the control port: name and arguments -> answer, or EvsError."""


def need_web() -> Any:
    """The websockets library; EvsError with the fix where it is not installed."""
    try:
        import websockets.asyncio.server
    except ImportError:
        raise EvsError("the page needs websockets: pip install 'evs[web]'") from None
    return websockets


@lru_cache(maxsize=1)
def page() -> str:
    """The page, HTML with the place {{nonce}} in it."""
    return resources.files(__package__).joinpath("page.html").read_text(encoding="utf-8")


class _Page:
    """One page in a browser: what it has not got yet, bounded however slow it is."""

    def __init__(self, connection: ServerConnection) -> None:
        self.connection = connection
        self.wake = asyncio.Event()
        """there may be something to send"""
        self.texts: deque[dict[str, object]] = deque(maxlen=MOST_TEXTS)
        self.news: dict[str, PixelNews] = {}
        self.undrawn: dict[str, dict[int, float]] = {}
        """camera -> pictures that the page has not drawn yet: number -> when its events came"""
        self.lights: dict[str, int] = {}
        """camera -> which picture of the light it has"""

    def tell(self, **words: object) -> None:
        """Send text soon."""
        self.texts.append(words)
        self.wake.set()

    def show(self, camera: CameraFeed, packets: list[EventPacket]) -> None:
        """Send new packets soon, as one picture with others that wait."""
        news = self.news.get(camera.name)
        if news is None or news.size != (camera.width, camera.height):
            news = self.news[camera.name] = PixelNews(camera.width, camera.height)
        for packet in packets:
            news.add(packet)
        self.wake.set()


class PageServer:
    """Serves the page to any number of browsers until the run ends."""

    def __init__(self, feed: BusFeed, ask: Ask | None, *, port: int = 0) -> None:
        """Make a server that does not serve yet.

        Args:
            feed: What is shown.
            ask: Requests to the control port; None: there is none, so nothing can be changed.
            port: On 127.0.0.1; 0: any free one.

        Raises:
            EvsError: The extra is not installed.
        """
        need_web()
        self.feed = feed
        """what is shown"""
        self._ask, self._port = ask, port
        self._token = secrets.token_urlsafe(16)
        self._pages: set[_Page] = set()
        self._known: list[dict[str, Any]] = []
        self._number = 0
        self.latencies_s: deque[float] = deque(maxlen=1000)
        """from the arrival of events to their pixels, of the last pictures that were drawn"""

    @property
    def address(self) -> str:
        """What to open in a browser, once it serves."""
        return f"http://127.0.0.1:{self._port}/?token={self._token}"

    def run(self, ready: Callable[[str], None], stop: Callable[[], bool] = lambda: False) -> None:
        """Serve until the feed has ended, or `stop` returns True.

        Args:
            ready: Called with the address once it serves.
            stop: Called again and again.

        Raises:
            EvsError: The port is in use, or the publisher refuses us.
        """
        asyncio.run(self._run(ready, stop))
        if self.feed.failure is not None:
            raise self.feed.failure

    async def _run(self, ready: Callable[[str], None], stop: Callable[[], bool]) -> None:
        from websockets.asyncio.server import serve

        try:
            serving = await serve(
                self._serve_page,
                "127.0.0.1",
                self._port,
                process_request=self._answer,
                compression=None,
                max_size=_MOST_REQUEST_BYTES,
                max_queue=16,
                server_header=None,
            )
        except OSError as reason:
            raise EvsError(
                f"port {self._port} of this machine: {reason.strerror}; give another --port, or 0 "
                "for any free one"
            ) from None
        async with serving:
            self._port = next(iter(serving.sockets)).getsockname()[1]
            ready(self.address)
            while not self.feed.ended and not stop():
                began_s = monotonic_s()
                self._publish()
                await asyncio.sleep(max(0.001, 1.0 / PICTURES_HZ - (monotonic_s() - began_s)))
            self._publish()
            self._tell(ended=True)
            if self._pages:
                await asyncio.sleep(_LINGER_S)

    async def _answer(self, _: ServerConnection, request: Request) -> Response | None:
        """Answer an HTTP request; None: it is one for a WebSocket, which is welcome."""
        try:
            host = request.headers.get("Host", "")
            origin = request.headers.get("Origin")
            address = urlsplit(request.path)
            words = {key: values[0] for key, values in parse_qs(address.query).items()}
        except (ValueError, LookupError):
            # brackets with no IPv6 address between them; the same header twice
            return _response(HTTPStatus.BAD_REQUEST, "text/plain", b"")
        if (
            host.rpartition(":")[0] not in LOOPBACK
            or not secrets.compare_digest(words.get("token", "").encode(), self._token.encode())
            or origin not in (None, f"http://{host}")
        ):
            return _response(HTTPStatus.FORBIDDEN, "text/plain", b"")
        if address.path == "/ws":
            if len(self._pages) >= MOST_PAGES:
                return _response(HTTPStatus.SERVICE_UNAVAILABLE, "text/plain", b"too many pages")
            return None
        if address.path == "/":
            nonce = secrets.token_urlsafe(16)
            text = page().replace("{{nonce}}", nonce).encode()
            policy = (
                f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; "
                f"img-src 'self' blob:; connect-src 'self' ws://{host}; base-uri 'none'; "
                "form-action 'none'; frame-ancestors 'none'"
            )
            return _response(HTTPStatus.OK, "text/html; charset=utf-8", text, policy)
        if address.path == "/clip.aedat4":
            return await self._clip(words)
        return _response(HTTPStatus.NOT_FOUND, "text/plain", b"")

    async def _clip(self, words: dict[str, str]) -> Response:
        try:
            seconds = float(words.get("seconds", "10"))
            clip = await asyncio.to_thread(self.feed.clip, words.get("camera", ""), seconds)
        except (EvsError, ValueError) as error:
            return _response(HTTPStatus.NOT_FOUND, "text/plain", str(error).encode())
        return _response(HTTPStatus.OK, "application/octet-stream", clip)

    async def _serve_page(self, connection: ServerConnection) -> None:
        """Talk to one page until it goes."""
        from websockets.exceptions import ConnectionClosed

        one = _Page(connection)
        one.tell(cameras=self._cameras())
        self._pages.add(one)
        sending = asyncio.create_task(self._send(one))
        try:
            await self._send_parameters(one)
            with suppress(ConnectionClosed):
                async for message in connection:
                    await self._take(one, message)
        finally:
            self._pages.discard(one)
            sending.cancel()

    async def _send(self, one: _Page) -> None:
        """Send a page what waits for it; the other pages do not wait where it is slow."""
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed):
            while True:
                await one.wake.wait()
                one.wake.clear()
                while one.texts:
                    await one.connection.send(json.dumps(one.texts.popleft()))
                for name in tuple(one.news):
                    if len(one.undrawn.setdefault(name, {})) < MOST_UNDRAWN:
                        await self._send_picture(one, name)

    async def _send_picture(self, one: _Page, name: str) -> None:
        with self.feed.lock:
            camera = self.feed.cameras[name]
            t_us, came_s, light, lights = camera.t_us, camera.came_s, camera.light, camera.lights
            counts = {"on": camera.on, "off": camera.off}
        events = one.news.pop(name).take(t_us)
        if lights == one.lights.get(name):
            light = None
        one.lights[name] = lights
        self._number += 1
        one.undrawn[name][self._number] = came_s
        recent = sorted([*self.latencies_s][-30:])
        header = {
            "camera": name,
            "number": self._number,
            "t_us": t_us,
            **counts,
            "lost": self.feed.lost,
            "latency_ms": round(1e3 * recent[len(recent) // 2], 1) if recent else None,
        }
        await one.connection.send(picture_message(header, events, light))

    async def _send_parameters(self, one: _Page) -> None:
        if self._ask is None:
            return
        try:
            answer = await asyncio.to_thread(self._ask, "parameters", {})
        except EvsError as error:
            one.tell(error=str(error))
        else:
            one.tell(parameters=answer["cameras"])

    async def _take(self, one: _Page, message: str | bytes) -> None:
        """Take a message of a page: a picture was drawn, or a parameter is to change."""
        try:
            words = json.loads(message)
            if "drawn" in words:
                came_s = one.undrawn.get(words["camera"], {}).pop(words["drawn"], None)
                if came_s is not None:
                    self.latencies_s.append(monotonic_s() - came_s)
                one.wake.set()
            else:
                wanted = words["set"]
                await self._set(one, {"camera": wanted["camera"], "values": wanted["values"]})
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            one.tell(error="this message is not understood")

    async def _set(self, one: _Page, arguments: dict[str, object]) -> None:
        if self._ask is None:
            one.tell(error="there is no control port: give evs view --control ADDRESS")
            return
        try:
            answer = await asyncio.to_thread(self._ask, "set", arguments)
        except EvsError as error:
            one.tell(error=str(error))
            await self._send_parameters(one)
        else:
            self._tell(parameters=answer["cameras"])

    def _tell(self, **words: object) -> None:
        for one in self._pages:
            one.tell(**words)

    def _cameras(self) -> list[dict[str, Any]]:
        with self.feed.lock:
            return names_of(list(self.feed.cameras.values()))

    def _publish(self) -> None:
        """Hand the newest of each camera to every page."""
        cameras = self._cameras()
        if cameras != self._known:
            self._known = cameras
            self._tell(cameras=cameras)
        with self.feed.lock:
            new = [(one, one.take_new()) for one in self.feed.cameras.values()]
        for camera, packets in new:
            if packets:
                for one in self._pages:
                    one.show(camera, packets)


def _response(status: HTTPStatus, kind: str, body: bytes, policy: str = "") -> Response:
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    headers = Headers()
    headers["Content-Type"] = kind
    headers["Content-Length"] = str(len(body))
    headers["Cache-Control"] = "no-store"
    headers["X-Content-Type-Options"] = "nosniff"
    headers["Referrer-Policy"] = "no-referrer"
    if policy:
        headers["Content-Security-Policy"] = policy
    return Response(int(status), status.phrase, headers, body)
