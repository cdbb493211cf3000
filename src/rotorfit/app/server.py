"""The server of the page: bound to this computer alone, each long call in a process of its own.

A page of another site may send requests here, and a name of another site may be made to lead here:
the token in the address, the Host and the Origin distinguish them.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import mimetypes
import secrets
import signal
import socket
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from rotorfit.app.engine import CALLS, LONG, MOST_BYTES, JsonObject
from rotorfit.app.pages import STOPPED, Job, Page, Pages
from rotorfit.errors import OutputError, RotorfitError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, Callable, Iterable
    from types import FrameType

    from starlette.types import ASGIApp, Message, Receive, Scope, Send

POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; frame-src 'self' blob:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
DOCUMENT_POLICY: Final = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'self'; sandbox allow-scripts"
)
"""The policy of a report: its own script and style, and no address to speak to."""
HEADERS: Final = {
    "cache-control": "no-store",
    "content-security-policy": POLICY,
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}


class Guard:
    """Passes on the requests of the page itself, with the token taken off the address."""

    def __init__(self, app: ASGIApp, *, token: str, port: int) -> None:
        self._app = app
        self._token = token.encode()
        self._hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self._origins = {f"http://{host}" for host in self._hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it in one line."""
        if scope["type"] != "http":
            return  # no other kind is served

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        refusal = self._refusal_reason(scope)
        if refusal is not None:
            response = PlainTextResponse(f"{refusal}\n", status_code=403)
            await response(scope, receive, send_guarded)
            return
        path = "/" + scope["path"].split("/", maxsplit=2)[2]
        inner = {**scope, "path": path, "raw_path": path.encode(), "root_path": ""}
        await self._app(inner, receive, send_guarded)

    def _refusal_reason(self, scope: Scope) -> str | None:
        """Return the reason to refuse a request; None if there is none."""
        headers: Iterable[tuple[bytes, bytes]] = scope["headers"]
        hosts = [value.decode("latin-1") for name, value in headers if name == b"host"]
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return "refused: this server answers to 127.0.0.1 and localhost only"
        parts = scope["path"].split("/", maxsplit=2)
        given = parts[1].encode(errors="replace") if len(parts) == 3 else b""
        if not hmac.compare_digest(given, self._token):
            return "refused: use the whole address that rotorfit app printed"
        if scope["method"] not in ("GET", "POST"):
            return "refused: GET and POST only"
        origins = [value.decode("latin-1") for name, value in headers if name == b"origin"]
        if scope["method"] == "POST" and not (origins and set(origins) <= self._origins):
            return "refused: another site's page may not send anything here"
        return None


STATIC: Final = Path(__file__).parent / "static"
LONGEST_CALL: Final = 1_000_000
"""Longest JSON of a call [bytes]."""
SLOWEST: Final = 60.0
"""Longest time between two pieces of what is sent [s]."""
MOST_CONNECTIONS: Final = 40
GONE: Final = "this page was closed: load it anew"
TYPES: Final = {".js": "text/javascript", ".html": "text/html", ".css": "text/css"}
ENDED: Final = {"type": "http.response.body", "body": b"", "more_body": False}


@frozen_dataclass
class Served:
    """A server that listens already; the address is that of the page, token included."""

    address: str
    server: uvicorn.Server
    sockets: list[socket.socket]
    pages: Pages


class _Server(uvicorn.Server):
    """Ends quietly at a signal, with all that runs for the pages."""

    def __init__(self, config: uvicorn.Config, pages: Pages) -> None:
        super().__init__(config)
        self._pages = pages

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End; uvicorn would raise the signal once more, before the pages are removed."""
        del sig, frame
        self.should_exit = True

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Close what is open, then end."""
        await self._pages.end()
        await super().shutdown(sockets)


def ready(*, port: int = 0, most_bytes: int = MOST_BYTES) -> Served:
    """Prepare a server that listens on a port of this computer; 0: any that is free."""
    try:
        listening = socket.create_server(("127.0.0.1", port))
    except (OSError, OverflowError) as error:
        raise OutputError(
            f"port {port} cannot be used ({error}): choose another, or leave --port out"
        ) from error
    port = listening.getsockname()[1]
    token = secrets.token_urlsafe(32)
    pages = Pages(most_bytes=most_bytes)
    config = uvicorn.Config(
        Guard(_build_application(pages), token=token, port=port),
        http="h11",
        loop="asyncio",
        ws="none",
        lifespan="off",
        log_config=None,
        log_level="critical",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        limit_concurrency=MOST_CONNECTIONS,
        timeout_graceful_shutdown=2,
    )
    return Served(
        address=f"http://127.0.0.1:{port}/{token}/",
        server=_Server(config, pages),
        sockets=[listening],
        pages=pages,
    )


def serve(served: Served) -> None:
    """Run a server until a signal ends it, then remove all of its pages."""
    hangup_signal = getattr(signal, "SIGHUP", None)  # the terminal was closed; Windows has none
    if hangup_signal is not None:
        signal.signal(hangup_signal, served.server.handle_exit)
    try:
        served.server.run(sockets=served.sockets)
    finally:
        served.pages.clear()


def _build_application(pages: Pages) -> Starlette:
    """Route the requests that the guard has let through."""

    async def open_page(request: Request) -> Response:
        argument = await _json_of(request)
        page = pages.open(argument.get("page"))
        if page is None:
            return _refused_response("too many pages are open: close one of them", 429)
        return JSONResponse({"page": page.key, "engine": "server"})

    async def call(request: Request) -> Response:
        page, name = pages.get(request.path_params["page"]), request.path_params["call"]
        if page is None:
            return _refused_response(GONE, 404)
        if name == "add_file":
            return await _add_file(pages, page, request)
        return _respond_to_call(pages, page, name, await _json_of(request))

    async def present(request: Request) -> Response:
        page = pages.get(request.path_params["page"])
        return _refused_response(GONE, 404) if page is None else _Presence(pages, page)

    async def document(request: Request) -> Response:
        page = pages.get(request.path_params["page"])
        return _refused_response(GONE, 404) if page is None else _serve_document(page, request)

    routes = [
        Route("/", _serve_static),
        Route("/open", open_page, methods=["POST"]),
        Route("/page/{page}/present", present),
        Route("/page/{page}/document/{kind}", document),
        Route("/page/{page}/{call}", call, methods=["POST"]),
        Route("/{name}", _serve_static),
    ]
    handlers: dict[Any, Callable[..., Any]] = {RotorfitError: _refused_error}
    return Starlette(routes=routes, exception_handlers=handlers)


async def _refused_error(request: Request, error: Exception) -> Response:
    del request
    return _refused_response(str(error), 400)


def _refused_response(message: str, status: int) -> Response:
    # What was not read of a request is not waited for.
    return JSONResponse({"refused": message}, status_code=status, headers={"connection": "close"})


async def _serve_static(request: Request) -> Response:
    """Serve a file of the page: one of those in its folder, whatever is asked for."""
    name = request.path_params.get("name", "index.html")
    if name == "engine.json":
        return JSONResponse({"engine": "server"})
    found = {path.name: path for path in STATIC.iterdir() if path.is_file()}.get(name)
    if found is None:
        return _refused_response(f"no file {name!r} belongs to the page", 404)
    kind = TYPES.get(found.suffix) or mimetypes.guess_type(name)[0]
    return Response(found.read_bytes(), media_type=kind)


async def _json_of(request: Request) -> dict[str, Any]:
    """Read the table that was sent; raise OutputError if it is too long, too slow, or none."""
    sent = bytearray()
    async for piece in _receive_pieces(request):
        sent += piece
        if len(sent) > LONGEST_CALL:
            raise OutputError(f"a call of over {LONGEST_CALL} bytes: the form is too long")
    try:
        found = json.loads(sent or b"{}", parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise OutputError(f"a call that is not JSON ({error})") from error
    if not isinstance(found, dict):
        raise OutputError("a call that is not a table of JSON")
    return found  # pyright: ignore[reportUnknownVariableType]


def _no_number(word: str) -> float:
    raise ValueError(f"{word} is no number of JSON")


async def _receive_pieces(request: Request) -> AsyncGenerator[bytes]:
    """Yield the pieces received; raise OutputError if nothing comes for too long."""
    pieces = aiter(request.stream())
    while True:
        try:
            async with asyncio.timeout(SLOWEST):
                piece = await anext(pieces, None)
        except TimeoutError as error:
            raise OutputError(f"nothing was sent for {SLOWEST:.0f} s: send it again") from error
        except ClientDisconnect as error:
            raise OutputError("the sender has gone before all was sent") from error
        if piece is None:
            return
        yield piece


def _respond_to_call(pages: Pages, page: Page, name: str, argument: dict[str, Any]) -> Response:
    """Respond to a call: at once, or line by line where it takes long."""
    if name == "stop":
        page.stop()
        return JSONResponse({})
    if name == "follow":
        job = page.running("identify")
        return JSONResponse(STOPPED) if job is None else _Lines(job, pages)
    if name in LONG:
        return _Lines(pages.begin(page, name, argument), pages)
    if name not in CALLS:
        return _refused_response(f"no call {name!r}", 404)
    if name == "remove_file":
        return JSONResponse(_remove_file(page, argument))
    response = page.engine.call(name, argument, _ignore_progress)
    if name == "restore":
        response["running"] = page.running("identify") is not None
    return JSONResponse(response)


async def _add_file(pages: Pages, page: Page, request: Request) -> Response:
    """Receive a file, then inspect it."""
    name, path = page.engine.receive(request.query_params.get("name", ""))
    try:
        await _write_sent(page, path, request)
    except (OutputError, OSError) as error:
        page.engine.call("remove_file", {"name": name}, _ignore_progress)
        return _refused_response(f"{name}: {error}", 413)
    return _Lines(pages.begin(page, "add_file", {"name": name}), pages)


async def _write_sent(page: Page, path: Path, request: Request) -> None:
    """Write what is sent into a file; raise OutputError if it is more than the page may hold."""
    most = page.engine.most_bytes
    limit = f"too large: the files of a page may hold {most / 1e6:.0f} MB (see --limit)"
    announced = request.headers.get("content-length", "0")
    if announced.isdecimal() and page.held + int(announced) > most:
        raise OutputError(limit)
    received = 0
    try:
        with path.open("xb") as file:
            async for piece in _receive_pieces(request):
                received += len(piece)
                page.held += len(piece)
                if page.held > most:
                    raise OutputError(limit)
                file.write(piece)
    except (OutputError, OSError):
        page.held -= received
        raise


def _remove_file(page: Page, argument: dict[str, Any]) -> JsonObject:
    """Remove a file, and end the inspections of it."""
    page.stop(str(argument.get("name")))
    before = page.engine.bytes_held()
    response = page.engine.call("remove_file", argument, _ignore_progress)
    page.held += page.engine.bytes_held() - before
    return response


def _ignore_progress(step: str, share: float | None) -> None:
    del step, share


def _serve_document(page: Page, request: Request) -> Response:
    """Serve a report, a result or a page of findings, which may connect to nothing."""
    path = page.engine.document(request.path_params["kind"], request.query_params.get("name"))
    if path is None:
        return _refused_response("there is no such document yet", 404)
    kind = "text/html" if path.suffix == ".html" else "text/plain; charset=utf-8"
    return FileResponse(path, media_type=kind, headers={"content-security-policy": DOCUMENT_POLICY})


class _Lines(Response):
    """The events of a long call, a line of JSON each; the call goes on where nobody listens."""

    media_type = "application/x-ndjson"

    def __init__(self, job: Job, pages: Pages) -> None:
        super().__init__()
        del self.headers["content-length"]
        self._job, self._closing = job, pages.closing

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send line after line."""
        del scope
        start = {"type": "http.response.start", "status": 200, "headers": self.raw_headers}
        await send(start)

        async def lines() -> None:
            async for event in self._job.events():
                line = f"{json.dumps(event)}\n".encode()
                await send({"type": "http.response.body", "body": line, "more_body": True})
            await send(ENDED)

        await _first_of(lines(), _wait_for_disconnect(receive))


class _Presence(Response):
    """An empty response that lasts as long as the page is open."""

    def __init__(self, pages: Pages, page: Page) -> None:
        super().__init__()
        del self.headers["content-length"]
        self._pages, self._page = pages, page

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Stay open until the page or the server ends."""
        del scope
        with self._pages.present(self._page):
            start = {"type": "http.response.start", "status": 200, "headers": self.raw_headers}
            await send(start)
            await send({"type": "http.response.body", "body": b"\n", "more_body": True})
            await _first_of(self._pages.closing.wait(), _wait_for_disconnect(receive))
        with suppress(OSError):
            await send(ENDED)


async def _wait_for_disconnect(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


async def _first_of(*works: Any) -> None:
    """Wait until the first of several has ended, then end the others."""
    tasks = [asyncio.ensure_future(work) for work in works]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
