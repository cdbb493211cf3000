"""The engine where Python runs in the browser itself: what static/worker.js calls."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Protocol, runtime_checkable

from rotorfit.app.engine import CALLS, Engine, Reply
from rotorfit.errors import RotorfitError

FOLDER: Final = Path("/tmp/rotorfit-page")
"""In the memory of the browser's tab."""
MOST_BYTES: Final = 500_000_000
"""Of all files together: they are in memory, which is at most 4 GB there."""
Told = Callable[[str, float | None], Any]


@runtime_checkable
class Bytes(Protocol):
    """An array of JavaScript."""

    def to_bytes(self) -> bytes:
        """Return it as Python has it."""
        ...


def call(name: str, argument: str, progress: Told, sent: Bytes | None = None) -> str:
    """Return the answer of a call as JSON text.

    Parameters
    ----------
    name, argument
        As protocol.md has them, the argument as JSON text; and ``document``, with ``kind`` and
        ``name``, for what a server would answer at an address.
    progress
        Told what is being done.
    sent
        The bytes of a file, for ``add_file``.
    """
    FOLDER.mkdir(exist_ok=True)
    engine = Engine(folder=FOLDER, most_bytes=MOST_BYTES)
    return json.dumps(_answer(engine, name, json.loads(argument), progress, sent))


def _answer(
    engine: Engine, name: str, argument: dict[str, Any], progress: Told, sent: Bytes | None
) -> Reply:
    if name == "document":
        return _document(engine, argument)
    if name == "follow" or name not in CALLS:
        return {"refused": f"no call {name!r} here"}
    if sent is not None:
        try:
            argument = {"name": _received(engine, argument["name"], sent.to_bytes())}
        except RotorfitError as error:
            return {"refused": str(error)}
    return engine.call(name, argument, progress)


def _received(engine: Engine, name: str, content: bytes) -> str:
    """Return the name under which a file is kept."""
    if engine.bytes_held() + len(content) > engine.most_bytes:
        raise RotorfitError(
            f"{name} is too large: in the browser all files together may have "
            f"{engine.most_bytes / 1e6:.0f} MB; rotorfit app takes more"
        )
    own, path = engine.receive(name)
    path.write_bytes(content)
    return own


def _document(engine: Engine, asked: dict[str, Any]) -> Reply:
    path = engine.document(asked["kind"], asked.get("name"))
    if path is None:
        return {"refused": "there is no such document yet"}
    kind = "text/html" if path.suffix == ".html" else "text/plain"
    return {"text": path.read_text(encoding="utf-8"), "type": f"{kind};charset=utf-8"}
