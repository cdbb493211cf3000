"""The server of the page in a thread, and a plain client that may send anything."""

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http.client import HTTPConnection, HTTPResponse
from threading import Thread
from time import monotonic, sleep
from urllib.parse import quote, urlsplit

from rotorfit.app.engine import Engine
from rotorfit.app.server import Served, ready

FORM = {
    "name": "page",
    "airframe": {
        "layout": "quad-plus",
        "arm": 0.2,
        "order": "paper",
        "imu": {"position": [0.0, 0.0, 0.0]},
    },
    "identification": {"method": "ols"},
    "configuration": [{"name": "A", "mass": 1.285, "flights": [{"file": "flight.csv"}]}],
}
MOST = 20_000_000
PATIENCE = 120.0
"""For what comes at last on a busy machine [s]."""


def quiet(step: str, share: float | None) -> None:
    """Hear of progress, and say nothing."""
    del step, share


def dropped(engine: Engine, name: str, content: bytes) -> dict:
    """Drop a file on the page's engine; return what the engine says of it."""
    own, path = engine.receive(name)
    path.write_bytes(content)
    return engine.call("add_file", {"name": own}, quiet)


@contextmanager
def served(**options) -> Iterator[Served]:
    """Run a server until the block ends."""
    one = ready(**options)
    thread = Thread(target=one.server.run, kwargs={"sockets": one.sockets})
    thread.start()
    try:
        wait_for(lambda: one.server.started)
        yield one
    finally:
        one.server.should_exit = True
        thread.join(PATIENCE)
        assert not thread.is_alive()


def wait_for(done) -> None:
    end = monotonic() + PATIENCE
    while not done():
        assert monotonic() < end, "waited in vain"
        sleep(0.02)


@dataclass(frozen=True)
class Client:
    """A browser's part: one page of a server."""

    address: str
    page: str = ""

    @property
    def host(self) -> str:
        return urlsplit(self.address).netloc

    def send(self, method: str, path: str, body=None, **headers) -> tuple[int, bytes, dict]:
        """Return status, body and headers of a request; headers of None are left out."""
        own = {"host": self.host, "origin": f"http://{self.host}"}
        own |= {name.replace("_", "-"): value for name, value in headers.items()}
        connection = HTTPConnection(self.host, timeout=PATIENCE)
        try:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in own.items():
                if value is not None:
                    connection.putheader(name, value)
            pieces = [body] if isinstance(body, bytes) else body
            if isinstance(body, bytes) and "content_length" not in headers:
                connection.putheader("content-length", str(len(body)))
            chunked = body is not None and not isinstance(body, bytes)
            if chunked:
                connection.putheader("transfer-encoding", "chunked")
            connection.endheaders()
            self._write(connection, pieces or (), chunked=chunked)
            reply: HTTPResponse = connection.getresponse()
            return reply.status, reply.read(), dict(reply.getheaders())
        finally:
            connection.close()

    @staticmethod
    def _write(connection: HTTPConnection, pieces: Iterable[bytes], *, chunked: bool) -> None:
        try:
            for piece in pieces:
                connection.send(b"%x\r\n%s\r\n" % (len(piece), piece) if chunked else piece)
            if chunked:
                connection.send(b"0\r\n\r\n")
        except (BrokenPipeError, ConnectionResetError):
            pass  # refused before all was sent: the answer says why

    def path(self, rest: str) -> str:
        return f"{urlsplit(self.address).path}{rest}"

    def opened(self) -> "Client":
        """Return a client with a page of its own."""
        _, body, _ = self.send("POST", self.path("open"), b"{}")
        return Client(self.address, json.loads(body)["page"])

    def call(self, name: str, argument=None) -> dict:
        """Return the answer of a call, a long one's after all its progress."""
        body = json.dumps(argument or {}).encode()
        return answer(self.send("POST", self.path(f"page/{self.page}/{name}"), body)[1])

    def drop(self, name: str, content) -> dict:
        """Return what is said of a file; its content may come in pieces without end."""
        path = self.path(f"page/{self.page}/add_file?name={quote(name, safe='')}")
        return answer(self.send("POST", path, content)[1])


def answer(body: bytes) -> dict:
    last = json.loads(body.strip().splitlines()[-1])
    return last.get("answer", last)
