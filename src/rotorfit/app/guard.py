"""Who may speak to the server: this computer's browser, on the page whose address it was told.

A page of another site may send requests here, and a name of another site may be made to lead here:
the token in the address, the Host and the Origin tell them apart.
"""

import hmac
from collections.abc import Iterable
from typing import Final

from starlette.datastructures import MutableHeaders
from starlette.responses import PlainTextResponse
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
"""Of a report: its own script and style, and no address at all that they could speak to."""
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

        refusal = self._refusal(scope)
        if refusal is not None:
            response = PlainTextResponse(f"{refusal}\n", status_code=403)
            await response(scope, receive, send_guarded)
            return
        path = "/" + scope["path"].split("/", maxsplit=2)[2]
        inner = {**scope, "path": path, "raw_path": path.encode(), "root_path": ""}
        await self._app(inner, receive, send_guarded)

    def _refusal(self, scope: Scope) -> str | None:
        """Return the reason to refuse a request; None where there is none."""
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
