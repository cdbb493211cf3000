"""The engine where Python runs in the browser itself: what static/worker.js calls."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, runtime_checkable

from rotorfit.app.engine import CALLS, Engine, JsonObject
from rotorfit.errors import RotorfitError

if TYPE_CHECKING:
    from rotorfit.app.files import Progress

FOLDER: Final = Path("/tmp/rotorfit-page")
"""A folder in the memory of the browser's tab."""
MOST_BYTES: Final = 500_000_000
"""Most bytes of all files together: they are in memory, which is at most 4 GB there."""


@runtime_checkable
class Bytes(Protocol):
    """An array of JavaScript."""

    def to_bytes(self) -> bytes:
        """Convert to bytes of Python."""
        ...


def call(
    name: str,
    argument: str,
    progress: Progress,
    sent: Bytes | None = None,
    *,
    folder: Path = FOLDER,
    most_bytes: int = MOST_BYTES,
) -> str:
    """Run a call of protocol.md, its argument and its response being JSON text.

    ``document``, with ``kind`` and ``name``, stands for what a server has at an address; `sent` are
    the bytes of a file, for ``add_file``.
    """
    folder.mkdir(exist_ok=True)
    engine = Engine(folder=folder, most_bytes=most_bytes)
    return json.dumps(_respond_to_call(engine, name, json.loads(argument), progress, sent))


def _respond_to_call(
    engine: Engine, name: str, argument: dict[str, Any], progress: Progress, sent: Bytes | None
) -> JsonObject:
    if name == "document":
        path = engine.document(argument["kind"], argument.get("name"))
        if path is None:
            return {"refused": "there is no such document yet"}
        kind = "text/html" if path.suffix == ".html" else "text/plain"
        return {"text": path.read_text(encoding="utf-8"), "type": f"{kind};charset=utf-8"}
    if name == "follow" or name not in CALLS:
        return {"refused": f"no call {name!r} here"}
    if sent is not None:
        try:
            argument = {"name": _store_file(engine, argument["name"], sent.to_bytes())}
        except RotorfitError as error:
            return {"refused": str(error)}
    return engine.call(name, argument, progress)


def _store_file(engine: Engine, name: str, content: bytes) -> str:
    """Store a file, and return the name under which it is kept."""
    if engine.bytes_held() + len(content) > engine.most_bytes:
        raise RotorfitError(
            f"{name} is too large: in the browser all files together may have "
            f"{engine.most_bytes / 1e6:.0f} MB; rotorfit app takes more"
        )
    new_name, path = engine.receive(name)
    path.write_bytes(content)
    return new_name
