"""The files that were dropped on the page: kept under names of our own, shown under theirs.

A name from outside is only ever shown: what it is kept under is drawn at random, so that no name
can lead out of the folder.
"""

import json
import re
import secrets
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

from rotorfit.errors import ExperimentError, OutputError
from rotorfit.logs.files import file_name, write_whole

Progress = Callable[[str, float | None], None]
"""Told the step and how far it is, from 0 to 1; None where that is not known."""
MOST_FILES: Final = 64
"""On one page."""
LONGEST_NAME: Final = 120
NAMELESS: Final = "flight"
_UNSEEN: Final = re.compile(
    r"[\x00-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""Control characters, those that turn the direction of writing, and halves of characters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Dropped:
    """A file of the page.

    Attributes
    ----------
    name
        Under which the page and the experiment file know it.
    path
        Where its bytes are.
    order
        Among the files that came before and after.
    told
        What the page was told of it; empty until it has been looked at.
    """

    name: str
    path: Path
    order: int
    told: Mapping[str, Any]

    @property
    def page(self) -> Path:
        """Where the page with its findings is."""
        return self.path.with_suffix(".html")


def receive(folder: Path, name: str) -> Dropped:
    """Return a new file, its bytes still to be written to its path.

    Parameters
    ----------
    folder
        Of the page.
    name
        As it was dropped.

    Raises
    ------
    OutputError
        If there are too many already.
    """
    place = folder / "files"
    place.mkdir(mode=0o700, exist_ok=True)
    before = dropped(folder)
    taken = {one.name for one in before}
    if len(taken) >= MOST_FILES:
        raise OutputError(f"{len(taken)} files are on the page already: remove some first")
    own = _another(_shown(name), taken)
    suffix = ".toml" if own.lower().endswith(".toml") else ".log"
    path = place / f"{secrets.token_hex(8)}{suffix}"
    new = Dropped(name=own, path=path, order=before[-1].order + 1 if before else 0, told={})
    tell(new, {})
    return new


def tell(one: Dropped, told: Mapping[str, Any]) -> None:
    """Keep what the page was told of a file."""
    note = {"name": one.name, "path": one.path.name, "order": one.order, "told": told}
    write_whole(one.path.with_suffix(".json"), json.dumps(note), force=True)


def dropped(folder: Path) -> list[Dropped]:
    """Return the files of a page, in the order in which they came."""
    return sorted(_kept(folder), key=lambda one: one.order)


def _kept(folder: Path) -> Iterator[Dropped]:
    for note in (folder / "files").glob("*.json"):
        try:
            known = json.loads(note.read_text(encoding="utf-8"))
        except FileNotFoundError:  # removed meanwhile
            continue
        yield Dropped(
            name=known["name"],
            path=note.parent / known["path"],
            order=known["order"],
            told=known["told"],
        )


def file_named(folder: Path, name: str) -> Dropped:
    """Return a file of the page.

    Raises
    ------
    ExperimentError
        If it was not dropped.
    """
    found = next((one for one in dropped(folder) if one.name == name), None)
    if found is None:
        raise ExperimentError(f"no file {name} is on the page: drop it here")
    return found


def forget(one: Dropped) -> None:
    """Remove a file and all that was said of it."""
    for path in (one.path.with_suffix(".json"), one.path, one.page):
        path.unlink(missing_ok=True)


def in_its_name(folder: Path, words: str) -> str:
    """Return text in which each file of the page has the name that the user knows."""
    if f"{folder}" not in words and not re.search(r"[0-9a-f]{16}", words):
        return words
    for one in dropped(folder):
        words = words.replace(str(one.path), one.name).replace(one.path.name, one.name)
        words = words.replace(one.path.stem, one.name)
    return words


def in_their_names(folder: Path, value: Any) -> Any:
    """Return JSON in which each file of the page has the name that the user knows."""
    match value:
        case str():
            return in_its_name(folder, value)
        case Mapping():
            table = cast("Mapping[str, Any]", value)
            return {key: in_their_names(folder, one) for key, one in table.items()}
        case list() | tuple():
            return [in_their_names(folder, one) for one in cast("list[Any]", value)]
        case _:
            return value


def _shown(name: str) -> str:
    """Return the last part of a name, in characters that can be seen."""
    last = _UNSEEN.sub("", file_name(name)).strip(" .") or NAMELESS
    stem, dot, suffix = last.rpartition(".")
    if len(last) <= LONGEST_NAME:
        return last
    return f"{(stem if dot else last)[: LONGEST_NAME - 12]}{dot}{suffix[:8] if dot else ''}"


def _another(name: str, taken: set[str]) -> str:
    """Return a name that no other file has."""
    stem, dot, suffix = name.rpartition(".") if "." in name else (name, "", "")
    names = (f"{stem}-{number}{dot}{suffix}" for number in range(2, MOST_FILES + 2))
    return name if name not in taken else next(one for one in names if one not in taken)
