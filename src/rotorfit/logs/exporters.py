"""Programs that write flight logs as tables: how to recognise one, and the file to prefer to it.

Each is a table of `exporters.toml`.
"""

from __future__ import annotations

import tomllib
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence


@frozen_dataclass
class Exporter:
    """A program that writes tables with column names of its own.

    - `title`: name of the program and of what it wrote.
    - `original`: the file to give in place of the table, and why.
    - `marks`: sets of column names or beginnings of them (ending in ``*``); one set must be there.
    - `units`: unit by kind of column (``gyro``, ``accel``, ``rotor``, ``command``), where the
      names do not say it.
    - `erpm_scale`: factor from the recorded numbers to electrical revolutions per minute.
    - `dshot`: whether motor columns hold DShot values (48 to 2047) where they are no pulse widths.
    - `refused`: whether such tables never hold a flight that rotorfit can use.
    """

    title: str
    original: str
    marks: tuple[tuple[str, ...], ...]
    units: dict[str, str] = field(default_factory=dict[str, str])
    erpm_scale: float = 1.0
    dshot: bool = False
    refused: bool = False


def _read_exporters() -> Iterator[Exporter]:
    """Read the table beside this module."""
    text = Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
    for row in tomllib.loads(text)["exporter"]:
        yield Exporter(**row | {"marks": tuple(tuple(marks) for marks in row["marks"])})


EXPORTERS: Final = tuple(_read_exporters())
"""Tried in this order."""


def exporter_of(names: Sequence[str]) -> Exporter | None:
    """Return the program whose column names a table has; None if it is not one of `EXPORTERS`."""
    clean = [name.strip() for name in names]
    return next((one for one in EXPORTERS if _has_marks(one, clean)), None)


def _has_marks(exporter: Exporter, names: Sequence[str]) -> bool:
    return any(all(_is_met(mark, names) for mark in marks) for marks in exporter.marks)


def _is_met(mark: str, names: Sequence[str]) -> bool:
    """Return whether a name is the mark, or begins and ends as its parts between ``*`` say."""
    first, *others = mark.split("*")
    if not others:
        return mark in names
    return any(
        name.startswith(first)
        and name.endswith(others[-1])
        and all(part in name[len(first) :] for part in others)
        for name in names
    )


def refuse_export(names: Sequence[str]) -> None:
    """Raise an error if a table is of a kind that never holds what rotorfit needs."""
    found = exporter_of(names)
    if found is not None and found.refused:
        raise LogError(f"this is {found.title}: {found.original}")


def with_original(words: str, names: Sequence[str]) -> str:
    """Add to a complaint about a table what wrote it, and which file to give in its place."""
    found = exporter_of(names)
    return words if found is None else f"{words}; this is {found.title}: {found.original}"
