"""One long call of the engine in a process of its own: ``python -m rotorfit.app.job FOLDER``.

It takes one line of JSON, ``{"name", "argument", "most_bytes"}``, and answers in lines: progress,
then the answer. It can be ended at any time, and ends by itself where nobody reads it any more.
"""

import json
import os
import sys
from pathlib import Path
from threading import Thread
from typing import Any, TextIO


def main() -> None:
    """Do what the first line of stdin asks for."""
    asked = json.loads(sys.stdin.buffer.readline())
    # Answers alone go to where stdout was: what a library prints must not come between them.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    Thread(target=_end_with_the_server, daemon=True).start()
    _say(answers, {"answer": _answer(asked, answers)})


def _answer(asked: dict[str, Any], answers: TextIO) -> dict[str, Any]:
    from rotorfit.app.engine import Engine

    def progress(step: str, share: float | None) -> None:
        _say(answers, {"progress": {"step": step, "share": share}})

    engine = Engine(folder=Path(sys.argv[1]), most_bytes=asked["most_bytes"])
    try:
        return engine.call(asked["name"], asked["argument"], progress)
    except MemoryError:
        return {"refused": "there is not enough memory for this: use shorter logs, or fewer"}
    except Exception as error:  # a fault of ours: the page is told, and stays alive
        words = " ".join(f"{type(error).__name__}: {error}".split())
        return {"refused": f"internal error ({words}); please report it with the log"}


def _say(answers: TextIO, words: dict[str, Any]) -> None:
    answers.write(f"{json.dumps(words, allow_nan=False)}\n")
    answers.flush()


def _end_with_the_server() -> None:
    """End where the server has ended, however it did: its end of the pipe closes."""
    sys.stdin.buffer.read()
    os._exit(1)


if __name__ == "__main__":
    main()
