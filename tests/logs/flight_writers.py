"""Writes one simulated flight in every format that rotorfit reads, for tests and benchmarks."""

import dataclasses
from pathlib import Path

import numpy as np
from blackbox_encoder import Recorder, encode_fields
from crazyflie_encoder import FIXED, Event, encode_header
from dataflash_encoder import write_dataflash
from mocap_writers import write_motive, write_qualisys, write_trajectory, write_vicon
from rosbag_writers import write_mcap, write_ros1, write_ros2
from ulog_encoder import write_ulog

from rotorfit.logs.units import STANDARD_GRAVITY
from rotorfit.simulation import SimulatedFlight, write_flight_table

RPM = 2.0 * np.pi / 60.0
START = 3_000_000
"""Of a log's clock when the flight begins [us]."""
GYRO_STEP = 1e-4
"""Angular velocity of one count of the Blackbox log [deg/s]; flights count in 0.06."""
COUNTS_PER_G = 1_000_000
"""Of the Blackbox log's accelerometer; flights count 2048."""
FULL_OUTPUT = 1_000_000
"""Motor output of the Blackbox log at full command; flights count to 2047."""
POLES = 200
"""Of the motors: so many that one count of eRPM, 100 electrical rpm, is one of the rotor."""


def in_whole_rpm(flight: SimulatedFlight) -> SimulatedFlight:
    """Return the flight with rotor speeds as telemetry counts them, which every format can hold."""
    speed = np.round(flight.rotor_speed_measured / RPM) * RPM
    return dataclasses.replace(flight, rotor_speed_measured=speed)


def write_parquet(flight: SimulatedFlight, path: Path) -> None:
    """Write the flight table as Parquet, from the text of its CSV."""
    from pyarrow import csv, parquet

    text = path.with_suffix(".text")
    write_flight_table(flight, text)
    parquet.write_table(csv.read_csv(text), path)
    text.unlink()


def write_crazyflie(flight: SimulatedFlight, path: Path) -> None:
    """Write a micro-SD log: deg/s, g, whole rpm, commands of 16 bits."""
    variables = [
        *((f"gyro.{axis}", "f") for axis in "xyz"),
        *((f"acc.{axis}", "f") for axis in "xyz"),
        *((f"rpm.m{n}", "H") for n in (1, 2, 3, 4)),
        *((f"motor.m{n}", "H") for n in (1, 2, 3, 4)),
    ]
    event = Event(FIXED, "fixedFrequency", variables)
    numpy_types = {"f": "<f4", "H": "<u2"}
    record = [("event", "<u2"), ("time", "<u8"), *((n, numpy_types[k]) for n, k in variables)]
    rows = np.zeros(len(flight.time), dtype=record)
    rows["event"] = FIXED
    rows["time"] = START + np.round(1e6 * flight.time)
    columns = np.concatenate(
        [
            np.degrees(flight.gyro),
            flight.accel / STANDARD_GRAVITY,
            np.round(flight.rotor_speed_measured / RPM),
            np.round(65535 * flight.command),
        ],
        axis=1,
    )
    for (name, _), values in zip(variables, columns.T, strict=True):
        rows[name] = values
    # Without the checksum, as of a log that was not closed: nothing here depends on it.
    path.write_bytes(encode_header([event]) + rows.tobytes())


def write_blackbox(flight: SimulatedFlight, path: Path) -> None:
    """Write a Blackbox log whose counts are finer than a flight controller's, eRPM whole rpm."""
    fields = [
        ("loopIteration", 0, 0, 1, 6, 9),
        ("time", 0, 0, 1, 1, 0),
        *((f"gyroADC[{axis}]", 1, 0, 0, 1, 0) for axis in range(3)),
        *((f"accSmooth[{axis}]", 1, 0, 0, 1, 0) for axis in range(3)),
        *((f"motor[{n}]", 0, 0, 1, 1, 0) for n in range(4)),
        *((f"eRPM[{n}]", 0, 0, 1, 1, 0) for n in range(4)),
    ]
    step = np.float32(GYRO_STEP)
    entries = {
        "Firmware revision": "Betaflight 4.5.0 (norevision) TEST",
        "gyro_scale": f"0x{int(step.view(np.uint32)):08x}",
        "acc_1G": str(COUNTS_PER_G),
        "motorOutput": f"0,{FULL_OUTPUT}",
        "motor_poles": str(POLES),
    }
    recorder = Recorder(p_interval="1/1", entries=entries, main_fields=fields)
    counts = np.concatenate(
        [
            np.arange(len(flight.time))[:, None],
            START + np.round(1e6 * flight.time)[:, None],
            np.degrees(flight.gyro) / float(step),
            COUNTS_PER_G * flight.accel / STANDARD_GRAVITY,
            FULL_OUTPUT * flight.command,
            flight.rotor_speed_measured / RPM,
        ],
        axis=1,
    )
    path.write_bytes(recorder.header() + frames(np.round(counts).astype(np.int64), recorder))


def frames(counts: np.ndarray, recorder: Recorder) -> bytes:
    """Return one main frame for each row: all counts in I frames, their steps in P frames."""
    steps = np.diff(counts, axis=0, prepend=0)
    _, _, _, intra, _, inter = zip(*recorder.main_fields, strict=True)
    parts: list[bytes] = []
    for number, (whole, step) in enumerate(zip(counts.tolist(), steps.tolist(), strict=True)):
        if number % recorder.i_interval == 0:
            parts.append(b"I" + encode_fields(whole, list(intra), recorder.version))
        else:
            parts.append(b"P" + encode_fields(step, list(inter), recorder.version))
    return b"".join([*parts, b"E\xffEnd of log\x00"])


def write_nexus(flight: SimulatedFlight, path: Path, *, start: float = 0.0) -> None:
    """Write a recording of segments, their rotation vectors in degrees."""
    write_vicon(flight, path, start=start, block="Segments", rotation="deg")


WRITERS = {
    "table": ("flight.csv", write_flight_table),
    "parquet": ("flight.parquet", write_parquet),
    "ulog": ("flight.ulg", write_ulog),
    "dataflash": ("flight.bin", write_dataflash),
    "crazyflie": ("log00", write_crazyflie),
    "blackbox": ("flight.bbl", write_blackbox),
    "ros1": ("flight.bag", write_ros1),
    "ros2": ("flight_db", write_ros2),
    "mcap": ("flight_mcap", write_mcap),
}
"""Logs with IMU and rotor speed: the name of the file, and what writes it."""

RECORDING_WRITERS = {
    "qualisys": ("take.tsv", write_qualisys),
    "motive": ("take.csv", write_motive),
    "trajectory": ("take.txt", write_trajectory),
    "vicon": ("objects.csv", write_vicon),
    "nexus": ("segments.csv", write_nexus),
}
"""Motion capture beside a log."""
