"""Writes simulated flights as motion-capture programs export them, for tests."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from rotorfit.simulation import SimulatedFlight

QUALISYS_COLUMNS = (
    "X",
    "Y",
    "Z",
    "Roll",
    "Pitch",
    "Yaw",
    "Residual",
    *(f"Rot[{k}]" for k in range(9)),
)


def recorded(
    flight: SimulatedFlight, mounting: Rotation | None = None, start: float = 0.0
) -> tuple[np.ndarray, np.ndarray, Rotation]:
    """Time, position, attitude of the tracked body; mounting is from its axes to the flight's."""
    attitude = Rotation.from_quat(np.roll(flight.attitude_wxyz_measured, -1, axis=1))
    turned = attitude * (mounting or Rotation.identity())
    return flight.pose_time + start, flight.position_measured, turned


def write_qualisys(
    flight: SimulatedFlight,
    path: Path,
    *,
    mounting: Rotation | None = None,
    start: float = 0.0,
    names: tuple[str, ...] = ("Quad",),
    timed: bool = True,
) -> None:
    time, position, attitude = recorded(flight, mounting, start)
    rate = 1.0 / float(np.median(np.diff(time)))
    matrices = attitude.as_matrix().transpose(0, 2, 1).reshape(-1, 9)
    angles = attitude.as_euler("xyz", degrees=True)
    body = np.column_stack([1e3 * position, angles, np.full(len(time), 0.4), matrices])
    header = [
        f"NO_OF_FRAMES\t{len(time)}",
        "NO_OF_CAMERAS\t8",
        f"NO_OF_BODIES\t{len(names)}",
        f"FREQUENCY\t{rate:.10g}",
        "NO_OF_ANALOG\t0",
        "ANALOG_FREQUENCY\t0",
        "DESCRIPTION\t--",
        "TIME_STAMP\t2024-03-01, 10:00:00\t22107.99179716",
        "DATA_INCLUDED\t6D",
        "\t".join(["BODY_NAMES", *names]),
    ]
    columns = [cell for name in names for cell in (f"{name} X", *QUALISYS_COLUMNS[1:])]
    header.append("\t".join([*(("Frame", "Time") if timed else ()), *columns]))
    rows = [
        "\t".join(
            [
                *((str(k + 1), f"{time[k]:.6f}") if timed else ()),
                *(f"{value:.6f}" for value in np.tile(body[k], len(names))),
            ]
        )
        for k in range(len(time))
    ]
    path.write_text("\r\n".join([*header, *rows, ""]), encoding="utf-8", newline="")


def write_motive(
    flight: SimulatedFlight,
    path: Path,
    *,
    mounting: Rotation | None = None,
    start: float = 0.0,
    unit: str = "Meters",
    names: tuple[str, ...] = ("Quad",),
    version: str = "1.23",
) -> None:
    """Write y-up poses, each body followed by its error and one of its markers."""
    time, position, attitude = recorded(flight, mounting, start)
    scale = {"Meters": 1.0, "Millimeters": 1e3}[unit]
    q = attitude.as_quat()
    position, q[:, :3] = scale * y_up(position), y_up(q[:, :3])
    settings = (
        f"Format Version,{version},Take Name,Take 1,Take Notes,,Capture Frame Rate,100.000000,"
        "Export Frame Rate,100.000000,Capture Start Time,2024-03-01 10.00.00.000 AM,"
        f"Total Frames in Take,{len(time)},Total Exported Frames,{len(time)},"
        f"Rotation Type,Quaternion,Length Units,{unit},Coordinate Space,Global"
    )
    kinds = [*["Rigid Body"] * 8, *["Rigid Body Marker"] * 4]
    what = [*["Rotation"] * 4, *["Position"] * 3, "Mean Marker Error", *["Position"] * 3, "Quality"]
    axes = [*"XYZW", *"XYZ", "", *"XYZ", ""]
    label = "Type" if version > "1.22" else ""
    owners = [[name] * 8 + [f"{name}:Marker1"] * 4 for name in names]
    header = [
        settings,
        "",
        ",".join(["", label, *kinds * len(names)]),
        ",".join(["", "Name" if label else "", *(f'"{o}"' for owner in owners for o in owner)]),
        ",".join(["", "ID" if label else "", *["7A"] * (12 * len(names))]),
        ",".join(["", "", *what * len(names)]),
        ",".join(["Frame", "Time (Seconds)", *axes * len(names)]),
    ]
    body = np.column_stack([q, position, np.full(len(time), 2e-4), position, np.ones(len(time))])
    rows = [
        ",".join([str(k), f"{time[k]:.6f}", *(f"{v:.9f}" for v in np.tile(body[k], len(names)))])
        for k in range(len(time))
    ]
    path.write_text("\n".join([*header, *rows, ""]), encoding="utf-8")


def write_trajectory(
    flight: SimulatedFlight,
    path: Path,
    *,
    mounting: Rotation | None = None,
    start: float = 0.0,
) -> None:
    time, position, attitude = recorded(flight, mounting, start)
    columns = np.column_stack([time, position, attitude.as_quat()])
    np.savetxt(path, columns, fmt="%.9f", header="timestamp tx ty tz qx qy qz qw")


def write_vicon(
    flight: SimulatedFlight,
    path: Path,
    *,
    mounting: Rotation | None = None,
    start: float = 0.0,
    names: tuple[str, ...] = ("Quad",),
    block: str = "Objects",
    rotation: str = "quaternion",
    delimiter: str = ",",
    markers: bool = True,
) -> None:
    """Write poses as Tracker does (Objects) or Nexus (Segments), and below them a marker.

    The clock counts frames from 1: it knows no start but that of a frame.
    """
    time, position, attitude = recorded(flight, mounting, start)
    rate = 1.0 / float(np.median(np.diff(time)))
    labels, unit, turned = {
        "quaternion": (["RX", "RY", "RZ", "RW"], "", attitude.as_quat()),
        "deg": (["RX", "RY", "RZ"], "deg", attitude.as_rotvec(degrees=True)),
        "rad": (["RX", "RY", "RZ"], "rad", attitude.as_rotvec()),
    }[rotation]
    prefix = "Global Angle " if block == "Objects" else ""
    frames = np.round(rate * time).astype(int) + 1

    def lines(kind, owners, columns, units, values):
        yield kind
        yield f"{rate:.10g}"
        yield delimiter.join(["", "", *owners])
        yield delimiter.join(["Frame", "Sub Frame", *columns])
        yield delimiter.join(["", "", *units])
        for frame, row in zip(frames, values, strict=True):
            yield delimiter.join([str(frame), "0", *(f"{value:.9g}" for value in row)])
        yield ""

    columns = [*labels, "TX", "TY", "TZ"]
    owners = [cell for n in names for cell in (f"{prefix}{n}:{n}", *[""] * (len(columns) - 1))]
    units = [*[unit] * len(labels), *["mm"] * 3]
    body = np.concatenate([turned, 1e3 * position], axis=1)
    count = len(names)
    text = [*lines(block, owners, columns * count, units * count, np.tile(body, count))]
    if markers:
        marker = [f"{names[0]}:Marker1", "", ""]
        text += lines("Trajectories", marker, ["X", "Y", "Z"], ["mm"] * 3, body[:, -3:])
    path.write_text("\r\n".join([*text, ""]), encoding="utf-8", newline="")


def y_up(vectors: np.ndarray) -> np.ndarray:
    x, y, z = vectors.T
    return np.column_stack([x, z, -y])
