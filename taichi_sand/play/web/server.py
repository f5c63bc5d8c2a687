"""The server of the page: one address, one token, one who drives and others who watch.

It runs in a thread of its own and never waits for anybody: what is published stands in slots, of which a client is sent the newest once it
has answered to what it was sent before. A client that stalls is sent nothing, one that does not answer pings for KEEP is closed.
"""

import asyncio
import hmac
import http
import json
import queue
import secrets
import threading
import time
from collections import deque
from typing import Any
from urllib.parse import parse_qs, urlsplit

from taichi_sand.errors import SandError
from taichi_sand.play.web.messages import is_message

LOOPBACK = ("127.0.0.1", "localhost", "::1")
IN_FLIGHT = 2
"""A client is sent no more than so many messages that it has not answered: more would only be old when they arrive."""
MOST_CLIENTS, MOST_WAITING, MOST_MOVES = 64, 256, 128
"""Clients at a time, and messages of the driver that the loop has not taken yet; others are dropped."""
MOST_BYTES = 2**18
"""Of a message; files come in parts."""
MOST_UPLOAD = 2**26
"""Of a file that the driver sends."""
KEEP = 20.0
"""A client is asked whether it is there, and has so long to answer [s]."""
OPENING = 5.0
"""A handshake takes no longer [s]."""
SLOTS = ("panel", "state", "roster", "frame", "scenes")
"""What is published, in the order in which a client needs it."""


class Client:
    """Somebody who has the page open."""

    def __init__(self, socket: Any) -> None:
        self.socket = socket
        self.wake = asyncio.Event()
        self.sent = dict.fromkeys(SLOTS, 0)
        self.ahead = 0  # messages that it has not answered
        self.mail: deque[str | bytes] = deque(maxlen=8)  # for it alone
        self.upload: tuple[str, int, bytearray] | None = None


class Server:
    """Serves `page` (bytes of HTML) at host:port; SandError if the address cannot be had. Port 0 is any that is free."""

    def __init__(self, page: bytes, host: str, port: int) -> None:
        try:
            from websockets.asyncio.server import serve
        except ImportError:
            raise SandError("playing in a browser needs the library websockets: pip install 'taichi-sand[web]'") from None
        self.serve, self.page, self.host, self.port = serve, page, host, port
        self.token = secrets.token_urlsafe(16)
        self.inputs: queue.Queue[list] = queue.Queue(MOST_WAITING)
        self.place: tuple[float, float] | None = None  # where the driver's hand is
        self.slots: dict[str, tuple[int, str | bytes]] = dict.fromkeys(SLOTS, (0, b""))
        self.clients: list[Client] = []
        self.seconds = 0.0  # of CPU time that its thread has taken
        self.loop = asyncio.new_event_loop()
        self.ended = asyncio.Event()
        self.ready: queue.Queue[BaseException | None] = queue.Queue()
        self.thread = threading.Thread(target=self._run, name="web", daemon=True)
        self.thread.start()
        if (wrong := self.ready.get()) is not None:
            reason = getattr(wrong, "strerror", None) or str(wrong)
            raise SandError(f"--host {host} --port {port}: cannot be served: {reason}") from None

    @property
    def url(self) -> str:
        """What to open."""
        name = f"[{self.host}]" if ":" in self.host else "127.0.0.1" if self.host == "0.0.0.0" else self.host
        return f"http://{name}:{self.port}/?token={self.token}"

    # called by the loop that plays

    def publish(self, slot: str, data: str | bytes) -> None:
        """Takes the place of what stood in the slot."""
        self.slots[slot] = (self.slots[slot][0] + 1, data)
        self.loop.call_soon_threadsafe(self._wake)

    def mail(self, data: str | bytes) -> None:
        """For the driver alone."""
        self.loop.call_soon_threadsafe(self._post, data)

    def close(self) -> None:
        """The end, for all who are there."""
        if self.thread.is_alive():
            self.loop.call_soon_threadsafe(self.ended.set)
            self.thread.join(5.0)

    # in its thread

    def _run(self) -> None:
        asyncio.set_event_loop(self.loop)
        try:
            self.loop.run_until_complete(self._serve())
        except BaseException as error:
            self.ready.put(error)
        finally:
            self.loop.close()

    async def _serve(self) -> None:
        options = {"compression": None, "max_size": MOST_BYTES, "max_queue": 8, "open_timeout": OPENING, "server_header": None}
        options |= {"ping_interval": KEEP, "ping_timeout": KEEP, "close_timeout": 1.0, "logger": quiet(), "write_limit": 2**16}
        async with self.serve(self._client, self.host, self.port, process_request=self._request, **options) as server:
            self.port = next(iter(server.sockets)).getsockname()[1]
            self.ready.put(None)
            await self.ended.wait()

    def _request(self, connection: Any, request: Any) -> Any:
        """Answers to a request: the page, or an upgrade; refuses who has no token, or comes from another page."""
        parts = urlsplit(request.path)
        given = parse_qs(parts.query).get("token", [""])[-1]
        if not self._at_home(request.headers.get("Host", "")) or not hmac.compare_digest(given.encode(), self.token.encode()):
            return connection.respond(http.HTTPStatus.FORBIDDEN, "Open the address that `taichi-sand play --web` printed, token and all.\n")
        if parts.path == "/socket":
            host = request.headers.get("Host", "")
            if request.headers.get("Origin") not in (f"http://{host}", f"https://{host}"):
                return connection.respond(http.HTTPStatus.FORBIDDEN, "Another page may not play.\n")
            if len(self.clients) >= MOST_CLIENTS:
                return connection.respond(http.HTTPStatus.SERVICE_UNAVAILABLE, "Too many watch already.\n")
            return None
        if parts.path != "/":
            return connection.respond(http.HTTPStatus.NOT_FOUND, "There is one page, /.\n")
        answer = connection.respond(http.HTTPStatus.OK, "")
        answer.body = self.page
        for name in ("Content-Type", "Content-Length"):
            del answer.headers[name]
        answer.headers["Content-Type"] = "text/html; charset=utf-8"
        answer.headers["Content-Length"] = str(len(self.page))
        answer.headers["Cache-Control"] = "no-store"
        answer.headers["X-Frame-Options"] = "SAMEORIGIN"
        answer.headers["X-Content-Type-Options"] = "nosniff"
        return answer

    def _at_home(self, host: str) -> bool:
        """Whether a request names this machine as it is reached: a name that somebody made to lead here is refused."""
        if self.host not in LOOPBACK:
            return True
        return host in {f"{f'[{name}]' if ':' in name else name}:{self.port}" for name in LOOPBACK}

    async def _client(self, socket: Any) -> None:
        client = Client(socket)
        self.clients.append(client)
        self._roles()
        feeder = asyncio.create_task(self._feed(client))
        try:
            async for message in socket:
                self._take(client, message)
        except Exception:  # gone, or nothing of this protocol: nobody else notices
            pass
        finally:
            feeder.cancel()
            drove = self.clients[0] is client
            self.clients.remove(client)
            if drove:
                self._ask(["gone"])
                self._roles()

    def _roles(self) -> None:
        for number, client in enumerate(self.clients):
            client.mail.append(json.dumps({"role": "watch" if number else "drive"}))
        self._wake()

    def _wake(self) -> None:
        for client in self.clients:
            client.wake.set()

    def _post(self, data: str | bytes) -> None:
        if self.clients:
            self.clients[0].mail.append(data)
            self._wake()

    async def _feed(self, client: Client) -> None:
        try:
            while True:
                await client.wake.wait()
                client.wake.clear()
                while client.ahead < IN_FLIGHT and (data := self._newest(client)) is not None:
                    client.ahead += 1
                    await client.socket.send(data)
                    self.seconds = time.thread_time()
        except Exception:  # gone
            pass

    def _newest(self, client: Client) -> str | bytes | None:
        """What the client has not got yet."""
        if client.mail:
            return client.mail.popleft()
        for name in SLOTS:
            number, data = self.slots[name]
            if number != client.sent[name]:
                client.sent[name] = number
                return data
        return None

    def _take(self, client: Client, message: str | bytes) -> None:
        """A message: an answer, or an input of the driver. What it is not does nothing."""
        if isinstance(message, bytes):
            self._part(client, message)
            return
        try:
            said = json.loads(message)
        except (ValueError, RecursionError):
            return
        if said == ["ack"]:
            client.ahead = max(0, client.ahead - 1)
            client.wake.set()
        elif self.clients[0] is client and is_message(said):
            if said[0] in ("press", "move", "release"):
                self.place = (float(said[1]), float(said[2]))
            if said[0] == "upload":
                client.upload = (said[1], said[2], bytearray()) if 0 < said[2] <= MOST_UPLOAD else None
            elif said[0] != "move" or self.inputs.qsize() < MOST_MOVES:  # what else is done must find room
                self._ask(said)

    def _part(self, client: Client, data: bytes) -> None:
        """A part of a file."""
        if client.upload is None or self.clients[0] is not client:
            return
        name, size, got = client.upload
        got += data
        if len(got) >= size:
            client.upload = None
            self._ask(["file", name, bytes(got[:size])])

    def _ask(self, said: list) -> None:
        try:
            self.inputs.put_nowait(said)
        except queue.Full:
            pass


def quiet() -> Any:
    """A logger that says nothing: what strangers send is no news."""
    import logging

    logger = logging.getLogger("taichi_sand.web")
    logger.addHandler(logging.NullHandler())
    logger.propagate = False
    logger.setLevel(logging.CRITICAL)
    return logger
