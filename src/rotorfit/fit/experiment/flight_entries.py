"""One flight in the experiment file: its log, its columns, and what is used of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field, PrivateAttr, model_validator

from rotorfit.fit.experiment.airframe_table import Axes
from rotorfit.fit.experiment.strict_tables import (
    Finite,
    Strict,
)
from rotorfit.fit.experiment.toml_files import (
    file_as_table,
)

if TYPE_CHECKING:
    from pathlib import Path

Source = Literal["imu", "mocap"]


class ColumnEntry(Strict):
    """A column of the file: its name, its unit, and a factor applied before the unit."""

    name: str
    unit: str | None = None
    scale: Finite = 1.0
    offset: Finite = 0.0
    range: tuple[Finite, Finite] | None = None


class RecordingEntry(Strict):
    """A motion-capture file of a flight, and how it is read."""

    file: str
    axes: Axes = "FLU"
    columns: dict[str, ColumnEntry | str] | None = None


class FlightEntry(Strict):
    """One flight: a file, and what is used of it; the pose from a second file where named."""

    file: str
    log: int | None = Field(default=None, ge=1)
    start: Finite | None = None
    end: Finite | None = None
    axes: Axes = "FLU"
    columns: dict[str, ColumnEntry | str] | None = None
    mocap: RecordingEntry | None = None
    # The file as the user wrote it, where `file` was made absolute.
    _written: str | None = PrivateAttr(default=None)

    @property
    def written(self) -> str:
        """The file's name as given in the experiment file or on the command line."""
        return self.file if self._written is None else self._written

    def placed(self, file: Path) -> FlightEntry:
        """Replace the file by its absolute path."""
        entry = self.model_copy(update={"file": str(file.absolute())})
        entry._written = self.written
        return entry

    @model_validator(mode="before")
    @classmethod
    def _plain_recording(cls, data: Any) -> Any:
        return file_as_table(data, "mocap")

    @model_validator(mode="after")
    def _check_order(self) -> FlightEntry:
        if self.start is not None and self.end is not None and self.end <= self.start:
            raise ValueError(f"end = {self.end} is not after start = {self.start}")
        return self

    def overlaps(self, other: FlightEntry) -> bool:
        """Decide whether both use some of the same time, if their files have the same content."""
        if (self.log or 1) != (other.log or 1):
            return False
        ends = [math.inf if entry.end is None else entry.end for entry in (self, other)]
        return max(self.start or 0.0, other.start or 0.0) < min(ends)
