"""What the experiment file says of a log, as the log's reader takes it."""

from collections.abc import Mapping

from rotorfit.experiment.experiment import (
    ColumnEntry,
    FlightEntry,
    MotorsEntry,
    RecordingEntry,
)
from rotorfit.logs import ColumnSpec, ReadOptions


def read_options_of(flight: FlightEntry, motors: MotorsEntry) -> ReadOptions:
    """Return what the log's reader is told."""
    return ReadOptions(
        log_number=flight.log,
        columns=_columns(flight.columns),
        axes=flight.axes,
        motor_poles=motors.poles,
    )


def recording_options_of(recording: RecordingEntry) -> ReadOptions:
    """Return what the reader of a motion-capture file is told."""
    return ReadOptions(columns=_columns(recording.columns), axes=recording.axes)


def _columns(entries: Mapping[str, ColumnEntry | str] | None) -> dict[str, ColumnSpec] | None:
    return None if entries is None else {key: _column(value) for key, value in entries.items()}


def _column(entry: ColumnEntry | str) -> ColumnSpec:
    if isinstance(entry, str):
        return ColumnSpec(name=entry)
    return ColumnSpec(**entry.model_dump())
