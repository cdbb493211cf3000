"""One long call of the engine in a process of its own: ``python -m rotorfit.app.job FOLDER``.

It reads one line of JSON, ``{"name", "argument", "most_bytes"}``, and writes lines: progress, then
the response. It can be ended at any time, and ends by itself where nobody reads it any more.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from threading import Thread
from typing import Any, TextIO


def main() -> None:
    """Run the call in the first line of stdin."""
    request = json.loads(sys.stdin.buffer.readline())
    # Messages alone go to where stdout was: what a library prints must not come between them.
    stream = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    Thread(target=_end_with_the_server, daemon=True).start()
    _write_message(stream, {"answer": _respond_to_request(request, stream)})


def _respond_to_request(request: dict[str, Any], stream: TextIO) -> dict[str, Any]:
    from rotorfit.app.engine import Engine

    def progress(step: str, share: float | None) -> None:
        _write_message(stream, {"progress": {"step": step, "share": share}})

    engine = Engine(folder=Path(sys.argv[1]), most_bytes=request["most_bytes"])
    try:
        return engine.call(request["name"], request["argument"], progress)
    except MemoryError:
        return {"refused": "there is not enough memory for this: use shorter logs, or fewer"}
    except Exception as error:  # a fault of ours: the page says so, and stays alive
        fault = " ".join(f"{type(error).__name__}: {error}".split())
        return {"refused": f"internal error ({fault}); please report it with the log"}


def _write_message(stream: TextIO, message: dict[str, Any]) -> None:
    stream.write(f"{json.dumps(message, allow_nan=False)}\n")
    stream.flush()


def _end_with_the_server() -> None:
    """End where the server has ended, however it did: its end of the pipe closes."""
    sys.stdin.buffer.read()
    os._exit(1)


if __name__ == "__main__":
    main()
