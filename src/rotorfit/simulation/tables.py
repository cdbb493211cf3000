"""A simulated flight as a flight table, the plainest log that rotorfit reads."""

from collections.abc import Sequence
from functools import reduce
from io import StringIO
from pathlib import Path
from typing import Final

import numpy as np

from rotorfit.errors import OutputError
from rotorfit.simulation.record import SimulatedFlight
from rotorfit.simulation.views import LoggedChannel, to_flight_log

_COLUMNS: Final[dict[str, tuple[str, ...]]] = {
    "gyro": ("gyro_x", "gyro_y", "gyro_z"),
    "accel": ("accel_x", "accel_y", "accel_z"),
    "velocity": ("vel_x", "vel_y", "vel_z"),
    "reference": ("ref_x", "ref_y", "ref_z"),
    "position": ("pos_x", "pos_y", "pos_z"),
    "attitude": ("quat_w", "quat_x", "quat_y", "quat_z"),
}
_PER_ROTOR: Final = {"rotor_speed": "rotor", "command": "command"}

IMU_AND_SPEED: Final[tuple[LoggedChannel, ...]] = ("gyro", "accel", "rotor_speed")
IMU_AND_COMMAND: Final[tuple[LoggedChannel, ...]] = ("gyro", "accel", "command")


def flight_table(
    flight: SimulatedFlight, *, channels: Sequence[LoggedChannel] = IMU_AND_SPEED
) -> str:
    """Return a flight as measured, as the text of a flight table (CSV).

    Where a channel has no sample at the time of a row, its cells hold nan.

    Parameters
    ----------
    flight
        The flight.
    channels
        What the table has beside ``time``, in this order.
    """
    log = to_flight_log(flight, channels=channels)
    time = reduce(np.union1d, [recorded.time for recorded in log.channels.values()])
    names, columns = ["time"], [time[:, None]]
    for channel, recorded in log.channels.items():
        names += column_names(channel, recorded.values.shape[1])
        cells = np.full((len(time), recorded.values.shape[1]), np.nan)
        cells[np.searchsorted(time, recorded.time)] = recorded.values
        columns.append(cells)
    text = StringIO()
    np.savetxt(
        text, np.hstack(columns), fmt="%.12g", delimiter=",", header=",".join(names), comments=""
    )
    return text.getvalue()


def write_flight_table(
    flight: SimulatedFlight, path: Path, *, channels: Sequence[LoggedChannel] = IMU_AND_SPEED
) -> None:
    """Write a flight as measured to a new flight table (CSV)."""
    try:
        with path.open("x", encoding="utf-8", newline="\n") as file:
            file.write(flight_table(flight, channels=channels))
    except FileExistsError as error:
        raise OutputError(f"{path} exists: give another name or remove it first") from error
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror}") from error


def column_names(channel: str, columns: int) -> list[str]:
    """Return the names of a channel's columns in a flight table."""
    if channel in _PER_ROTOR:
        return [f"{_PER_ROTOR[channel]}_{number}" for number in range(1, columns + 1)]
    return list(_COLUMNS[channel])
