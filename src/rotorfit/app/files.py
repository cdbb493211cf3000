"""The files that were dropped on the page: stored under random names, shown under their own.

No name from outside can lead out of the folder: it is only ever shown.
"""

from __future__ import annotations

import json
import re
import secrets
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, cast

from rotorfit.errors import ExperimentError, OutputError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import file_name, write_whole

if TYPE_CHECKING:
    from pathlib import Path

Progress = Callable[[str, float | None], None]
"""Receives the step and its share done, from 0 to 1; None where that is not known."""
MOST_FILES: Final = 64
"""Most files on one page."""
LONGEST_NAME: Final = 120
NAMELESS: Final = "flight"
_UNSEEN: Final = re.compile(
    r"[\x00-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""Control characters, those that turn the direction of writing, and halves of characters."""


@frozen_dataclass
class Dropped:
    """A file of the page, known to page and experiment file by its name; files are in order.

    The description is what the page shows of it; empty until it has been inspected.
    """

    name: str
    path: Path
    order: int
    description: Mapping[str, Any]

    @property
    def page(self) -> Path:
        """The path of the page with its findings."""
        return self.path.with_suffix(".html")


def receive(folder: Path, name: str) -> Dropped:
    """Create the entry of a file dropped under a name; its bytes are still to be written."""
    place = folder / "files"
    place.mkdir(mode=0o700, exist_ok=True)
    before = dropped(folder)
    taken = {one.name for one in before}
    if len(taken) >= MOST_FILES:
        raise OutputError(f"{len(taken)} files are on the page already: remove some first")
    unique = _make_unique(_shorten_name(name), taken)
    suffix = ".toml" if unique.lower().endswith(".toml") else ".log"
    path = place / f"{secrets.token_hex(8)}{suffix}"
    order = before[-1].order + 1 if before else 0
    new = Dropped(name=unique, path=path, order=order, description={})
    save_description(new, {})
    return new


def save_description(one: Dropped, description: Mapping[str, Any]) -> None:
    """Save what the page shows of a file."""
    note = {
        "name": one.name,
        "path": one.path.name,
        "order": one.order,
        "description": description,
    }
    write_whole(one.path.with_suffix(".json"), json.dumps(note), force=True)


def dropped(folder: Path) -> list[Dropped]:
    """List the files of a page, in the order in which they came."""
    return sorted(_stored_files(folder), key=lambda one: one.order)


def _stored_files(folder: Path) -> Iterator[Dropped]:
    for note in (folder / "files").glob("*.json"):
        try:
            entry = json.loads(note.read_text(encoding="utf-8"))
        except FileNotFoundError:  # removed meanwhile
            continue
        yield Dropped(
            name=entry["name"],
            path=note.parent / entry["path"],
            order=entry["order"],
            description=entry["description"],
        )


def file_named(folder: Path, name: str) -> Dropped:
    """Find a file of the page; raise ExperimentError if it was not dropped."""
    found = next((one for one in dropped(folder) if one.name == name), None)
    if found is None:
        raise ExperimentError(f"no file {name} is on the page: drop it here")
    return found


def forget(one: Dropped) -> None:
    """Remove a file, its description and its page."""
    for path in (one.path.with_suffix(".json"), one.path, one.page):
        path.unlink(missing_ok=True)


def with_shown_names(folder: Path, text: str) -> str:
    """Replace the stored name of each file of the page by the one that the user knows."""
    if f"{folder}" not in text and not re.search(r"[0-9a-f]{16}", text):
        return text
    for one in dropped(folder):
        text = text.replace(str(one.path), one.name).replace(one.path.name, one.name)
        text = text.replace(one.path.stem, one.name)
    return text


def json_with_shown_names(folder: Path, value: Any) -> Any:
    """Replace the stored names in every text of a JSON value."""
    match value:
        case str():
            return with_shown_names(folder, value)
        case Mapping():
            table = cast("Mapping[str, Any]", value)
            return {key: json_with_shown_names(folder, one) for key, one in table.items()}
        case list() | tuple():
            return [json_with_shown_names(folder, one) for one in cast("list[Any]", value)]
        case _:
            return value


def _shorten_name(name: str) -> str:
    """Reduce a name to its last part, in characters that can be seen."""
    last = _UNSEEN.sub("", file_name(name)).strip(" .") or NAMELESS
    stem, dot, suffix = last.rpartition(".")
    if len(last) <= LONGEST_NAME:
        return last
    return f"{(stem if dot else last)[: LONGEST_NAME - 12]}{dot}{suffix[:8] if dot else ''}"


def _make_unique(name: str, taken: set[str]) -> str:
    """Append a number to a name that another file has."""
    stem, dot, suffix = name.rpartition(".") if "." in name else (name, "", "")
    names = (f"{stem}-{number}{dot}{suffix}" for number in range(2, MOST_FILES + 2))
    return name if name not in taken else next(one for one in names if one not in taken)
