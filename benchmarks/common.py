"""What the studies share: of simulated flights truth and scales, of real logs what is declared."""

import dataclasses
import os
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from jaxtyping import Float
from scipy import signal
from scipy.spatial.transform import Rotation

from rotorfit.errors import FlightWarning, RotorfitError
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify
from rotorfit.logs import ColumnSpec, ReadOptions, read_log
from rotorfit.logs.flight_log import FlightLog
from rotorfit.results.result import IdentificationResult
from rotorfit.simulation import (
    SimulatedFlight,
    SimulatedVehicle,
    layout_vehicle,
    paper_vehicle,
    write_flight_table,
)
from rotorfit.simulation.experiment_files import IMU_AND_SPEED, LoggedChannel, true_parameters

COLUMNS: Final[Mapping[str, str]] = {
    "gyro": "gyro_x gyro_y gyro_z",
    "accel": "accel_x accel_y accel_z",
    "rotor_speed": "rotor_1 rotor_2 rotor_3 rotor_4",
    "command": "command_1 command_2 command_3 command_4",
    "battery": "battery",
    "velocity": "vel_x vel_y vel_z",
    "reference": "ref_x ref_y ref_z",
    "position": "pos_x pos_y pos_z",
    "attitude": "quat_w quat_x quat_y quat_z",
}
"""Of a channel in a flight table."""

Spin = Literal["ccw", "cw"]
Place = tuple[float, float, Spin]

PAPER = '[identification]\npreset = "paper"\n'


def real_data_folder() -> Path:
    """Return where the real logs are: $ROTORFIT_DATA, or ../shared/data beside the repository."""
    beside = Path(__file__).parents[2] / "shared" / "data"
    return Path(os.environ.get("ROTORFIT_DATA") or beside)


def named_vehicle(name: str) -> SimulatedVehicle:
    """Return vehicle A or B of the paper, or a layout."""
    return paper_vehicle(name) if name in ("A", "B") else layout_vehicle(name)


def true_values(flight: SimulatedFlight) -> dict[str, float]:
    """Return what should be found of a flight, by the names of a result."""
    values = true_parameters(flight.truth, rotors=flight.rotor_speed.shape[1])
    bias = zip("xyz", flight.sensors.accel_bias, strict=True)
    values |= {f"accel_bias_{axis}": value for axis, value in bias}
    values["kd_over_kt"] = values["kd"] / values["kt"]
    values["motor_lag_total"] = values["motor_lag"] + values["motor_delay"]
    return values


def scales(flight: SimulatedFlight) -> dict[str, float]:
    """Return what 100 % of each number is: itself, or a size where it may be zero."""
    values = {name: abs(value) for name, value in true_values(flight).items()}
    truth = flight.truth
    Ixx, Iyy, Izz = np.diagonal(truth.com_inertia)
    for name, size in (("xy", Ixx * Iyy), ("xz", Ixx * Izz), ("yz", Iyy * Izz)):
        values[f"I{name}_com"] = values[f"I{name}"] = float(np.sqrt(size))
    values |= {f"com_{a}": 0.2 for a in "xyz"}
    values |= {f"ms{a}": truth.mass * 0.2 for a in "xyz"}
    values |= {f"accel_bias_{a}": 0.2 for a in "xyz"}
    values["Jr"] = values["Jr"] or 1e-3 * float(Izz)
    values["Jr_over_Izz"] = values["Jr_over_Izz"] or 1e-3
    values["rotor_drag"] = 0.1 * truth.mass / 4000.0  # a tenth of the mass per second, four rotors
    values |= {"motor_delay": 0.005, "motor_lag": 0.04, "motor_lag_total": 0.04}
    return values


def experiment_text(flights: Mapping[str, SimulatedFlight], extra: str = "") -> str:
    """Return an experiment with one flight of each configuration, ``A.csv`` of A and so on.

    Parameters
    ----------
    flights
        By the names of the configurations; the vehicle is that of the first.
    extra
        Further tables of the file.
    """
    vehicle = next(iter(flights.values())).vehicle
    rotors = ", ".join(
        f'{{ position = {list(r.position)}, spin = "{r.spin}", axis = {list(r.axis)} }}'
        for r in vehicle.rotors
    )
    place = vehicle.imu_position
    imu = "" if place is None else f"imu = {{ position = {list(place)} }}\n"
    configurations = "".join(
        f'[[configuration]]\nname = "{name}"\nmass = {flight.truth.mass!r}\n'
        f'flights = ["{name}.csv"]\n'
        for name, flight in flights.items()
    )
    return f"[airframe]\nrotors = [{rotors}]\n{imu}{extra}{configurations}"


def identify_flights(
    flights: Mapping[str, SimulatedFlight],
    settings: Sequence[str],
    *,
    channels: Sequence[LoggedChannel] = IMU_AND_SPEED,
) -> Iterator[IdentificationResult | None]:
    """Write the flights, and identify them under each of the settings; None where refused.

    Parameters
    ----------
    flights
        By the names of the configurations.
    settings
        Further tables of the experiment file, one text per result.
    channels
        What the log has.
    """
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", FlightWarning)
        for name, flight in flights.items():
            write_flight_table(flight, Path(folder) / f"{name}.csv", channels=channels)
        path = Path(folder) / "experiment.toml"
        for extra in settings:
            path.write_text(experiment_text(flights, extra), encoding="utf-8")
            try:
                yield identify(load_experiment(path))
            except RotorfitError as error:
                print(f"refused: {error}")
                yield None


@dataclass(frozen=True, slots=True, kw_only=True)
class Declared:
    """What a user says of vehicle and motors: rotors [m], mass [kg], lines of the file."""

    rotors: tuple[Place, ...]
    mass: float | Literal["unknown"]
    motors: str
    source: Literal["imu", "mocap"] = "imu"


@dataclass(frozen=True, slots=True, kw_only=True)
class Sound:
    """A sound log, what is rightly declared of it, and what is known: value, and how well."""

    path: str
    declared: Declared
    known: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    columns: Mapping[str, ColumnSpec] | None = None


def _quad(x: float, y: float, spins: str) -> tuple[Place, ...]:
    """Return rear right, front right, rear left, front left, spins as + for ccw."""
    places = ((-x, -y), (x, -y), (-x, y), (x, y))
    return tuple((*p, "ccw" if s == "+" else "cw") for p, s in zip(places, spins, strict=True))


def _ordered(places: Sequence[Place], order: str) -> tuple[Place, ...]:
    return tuple(places[int(i)] for i in order)


CINERAT: Final = Declared(
    rotors=_quad(0.0455, 0.0635, "-++-"), mass=0.428, motors='speed = "measured"'
)
CRAZY: Final = Declared(
    rotors=_ordered(_quad(0.0325, 0.0325, "-++-"), "1023"),
    mass=0.027,
    motors='speed = "commanded"',
)
SIH: Final = Declared(
    rotors=_ordered(_quad(0.2, 0.2, "-++-"), "1230"),
    mass=1.0,
    motors='speed = "commanded"\nlaw = { sqrt = { full_speed = 1000, thr_mdl_fac = 0.0 } }',
)
EXPORTED: Final = Declared(
    rotors=_ordered(_quad(0.1768, 0.1768, "-++-"), "1230"),
    mass=1.4,
    motors='speed = "commanded"\nlaw = { sqrt = { full_speed = 1450, thr_mdl_fac = 0.0 } }',
)
PROPS_OUT: Final = Declared(
    rotors=_quad(0.12, 0.12, "+--+"), mass="unknown", motors='speed = "commanded"'
)
# From 26 logs of the vehicle together, as far as they agree.
CINERAT_KNOWN: Final = {
    "kt": (2.69e-7, 0.03e-7),
    "kd": (3.66e-9, 0.09e-9),
    "Jr": (8.63e-7, 0.21e-7),
    "Ixx_com": (5.90e-4, 0.08e-4),
    "Iyy_com": (7.23e-4, 0.21e-4),
    "Izz_com": (8.74e-4, 0.16e-4),
    "Ixx_over_kt": (2193.0, 40.0),
    "Iyy_over_kt": (2688.0, 80.0),
    "Izz_over_kt": (3249.0, 70.0),
    "kd_over_Izz": (4.19e-6, 0.12e-6),
    "Jr_over_Izz": (9.87e-4, 0.3e-4),
}


def _exactly(**values: float) -> dict[str, tuple[float, float]]:
    return {name: (value, 0.0) for name, value in values.items()}


SOUND: Final[Mapping[str, Sound]] = {
    "LOG00267": Sound(
        path="tudelft-indiflight/LOG00267.BFL", declared=CINERAT, known=CINERAT_KNOWN
    ),
    "LOG00271": Sound(
        path="tudelft-indiflight/LOG00271.BFL", declared=CINERAT, known=CINERAT_KNOWN
    ),
    "LOG00340": Sound(
        path="tudelft-indiflight/LOG00340.BFL", declared=CINERAT, known=CINERAT_KNOWN
    ),
    "log15": Sound(path="arplab-crazyflie/log15", declared=CRAZY),
    "sih-stock": Sound(
        path="autopilot-sitl/px4-sih-stock.ulg",
        declared=SIH,
        known=_exactly(kt=5e-6, kd=1e-7, Ixx_com=0.025, Iyy_com=0.025, Izz_com=0.030, Jr=0.0),
    ),
    "sih-exported": Sound(
        path="autopilot-sitl/px4-sih-exported.ulg",
        declared=EXPORTED,
        known=_exactly(kt=4e-6, kd=6e-8, Ixx_com=0.0238, Iyy_com=0.0277, Izz_com=0.0439, Jr=0.0),
    ),
    "LOG00037": Sound(path="betaflight/LOG00037.BFL", declared=PROPS_OUT),
    "LOG00007": Sound(
        path="betaflight/LOG00007.BFL",
        declared=dataclasses.replace(PROPS_OUT, motors='speed = "measured"'),
    ),
    "nanobench": Sound(
        path="nanobench-crazyflie/B8_star_fast_rep1.csv",
        declared=dataclasses.replace(CRAZY, source="mocap"),
        columns={
            "time": ColumnSpec(name="t"),
            **{f"pos_{a}": ColumnSpec(name=f"p{a}") for a in "xyz"},
            **{f"quat_{a}": ColumnSpec(name=f"q{a}") for a in "wxyz"},
            **{
                f"command_{i}": ColumnSpec(name=f"motor_motor_m{i}", scale=1 / 65536)
                for i in range(1, 5)
            },
        },
    ),
}


def airframe_text(declared: Declared) -> str:
    """Return the tables of an experiment file that do not belong to a flight."""
    rotors = ", ".join(
        f'{{ position = [{x!r}, {y!r}, 0.0], spin = "{spin}" }}' for x, y, spin in declared.rotors
    )
    return (
        f"[airframe]\nrotors = [{rotors}]\n[motors]\n{declared.motors}\n"
        f'[identification]\nsource = "{declared.source}"\n'
    )


def without_progress(error: str) -> str:
    """Return what a command wrote to stderr, without how long it took so far on a busy machine."""
    lines = error.splitlines(keepends=True)
    return "".join(line for line in lines if not line.rstrip().endswith(" s so far)"))


def read_sound(name: str) -> FlightLog:
    """Return one of `SOUND` as its reader gives it."""
    sound = SOUND[name]
    options = None if sound.columns is None else ReadOptions(columns=sound.columns)
    return read_log(real_data_folder() / sound.path, options=options)


def table_columns(log: FlightLog) -> dict[str, Float[np.ndarray, " n"]]:
    """Return a log as columns of a flight table, every channel on the clock that it has.

    A row a time of any channel, cells of the others empty: nothing is interpolated.
    """
    clocks = [c.time[np.isfinite(c.time)] for c in log.channels.values()]
    time = np.unique(np.concatenate(clocks))
    columns = {"time": time}
    for name, channel in log.channels.items():
        t, first = np.unique(channel.time, return_index=True)
        rows = np.searchsorted(time, t[np.isfinite(t)])
        for column, values in zip(COLUMNS[name].split(), channel.values.T, strict=True):
            columns[column] = np.full(len(time), np.nan)
            columns[column][rows] = values[first][np.isfinite(t)]
    return columns


# Faults of a log: each returns it with channels changed.


def _changed(log: FlightLog, name: str, **fields: Any) -> FlightLog:
    """Return a log with one channel's times or values changed."""
    channel = dataclasses.replace(log.channels[name], **fields)
    return dataclasses.replace(log, channels={**log.channels, name: channel})


def _motors(log: FlightLog) -> str:
    return "rotor_speed" if "rotor_speed" in log.channels else "command"


def late(log: FlightLog, *, name: str, seconds: float) -> FlightLog:
    """Return a log with a channel stamped late."""
    return _changed(log, name, time=log.channels[name].time + seconds)


def scaled(
    log: FlightLog,
    *,
    name: str,
    factor: float,
    columns: Sequence[int] = (0, 1, 2, 3),
    after: float = 0.0,
) -> FlightLog:
    """Return a log with columns of a channel times a factor, from some second on."""
    channel = log.channels[name]
    values, rows = channel.values.copy(), channel.time >= channel.time[0] + after
    for i in columns[: values.shape[1]]:
        values[rows, i] *= factor
    return _changed(log, name, values=values)


def biased(log: FlightLog, *, name: str, by: Sequence[float]) -> FlightLog:
    """Return a log with a constant added to a channel."""
    return _changed(log, name, values=log.channels[name].values + np.array(by))


def clipped(log: FlightLog, *, name: str, limit: float) -> FlightLog:
    """Return a log with a channel cut off at the end of a sensor's range."""
    return _changed(log, name, values=np.clip(log.channels[name].values, -limit, limit))


def filtered(log: FlightLog, *, name: str, cutoff: float) -> FlightLog:
    """Return a log with a channel behind a low-pass of second order, as a sensor has it [Hz]."""
    channel = log.channels[name]
    rate = 1.0 / float(np.median(np.diff(channel.time)))
    b, a = signal.butter(2, cutoff, fs=rate)
    start = signal.lfilter_zi(b, a)[:, None] * channel.values[:1]
    return _changed(log, name, values=signal.lfilter(b, a, channel.values, axis=0, zi=start)[0])


def interpolated(log: FlightLog, *, rate: float, name: str = "rotor_speed") -> FlightLog:
    """Return a log whose rotor speeds come at a rate [Hz], with lines drawn between them."""
    channel = log.channels[name]
    t = np.arange(channel.time[0], channel.time[-1], 1.0 / rate)
    columns = [np.interp(channel.time, t, np.interp(t, channel.time, x)) for x in channel.values.T]
    return _changed(log, name, values=np.column_stack(columns))


def soft_mounted(log: FlightLog, *, frequency: float, damping: float = 0.15) -> FlightLog:
    """Return a log of an IMU that swings on its mount [Hz]."""
    w = 2.0 * np.pi * frequency
    for name in ("gyro", "accel"):
        channel = log.channels[name]
        rate = 1.0 / float(np.median(np.diff(channel.time)))
        b, a = signal.bilinear([2.0 * damping * w, w * w], [1.0, 2.0 * damping * w, w * w], fs=rate)
        start = signal.lfilter_zi(b, a)[:, None] * channel.values[:1]
        values = signal.lfilter(b, a, channel.values, axis=0, zi=start)[0]
        log = _changed(log, name, values=values)
    return log


def turned(log: FlightLog, *, axis: str, degrees: float) -> FlightLog:
    """Return a log of an IMU that is turned in its mounting about a body axis."""
    turn = Rotation.from_euler(axis, degrees, degrees=True)
    for name in ("gyro", "accel"):
        log = _changed(log, name, values=turn.inv().apply(log.channels[name].values))
    return log


def reordered(log: FlightLog, *, order: Sequence[int]) -> FlightLog:
    """Return a log with its motors in another order."""
    name = _motors(log)
    return _changed(log, name, values=log.channels[name].values[:, list(order)])


def unrelated(log: FlightLog, *, column: int, seconds: float) -> FlightLog:
    """Return a log in which one motor's values are those of another moment of the flight."""
    name = _motors(log)
    channel = log.channels[name]
    values = channel.values.copy()
    rows = int(np.searchsorted(channel.time, channel.time[0] + seconds))
    values[:, column] = np.roll(values[:, column], rows)
    return _changed(log, name, values=values)


def held(log: FlightLog, *, names: Sequence[str], times: int) -> FlightLog:
    """Return a log that writes every sample of some channels several times."""
    for name in names:
        values = log.channels[name].values
        log = _changed(log, name, values=values[np.arange(len(values)) // times * times])
    return log


def written_twice(log: FlightLog, *, share: float) -> FlightLog:
    """Return a log that has a share of its rows twice, and counts its rows as time."""
    for name, channel in log.channels.items():
        chance = np.random.default_rng(1)  # the same for channels of the same rows
        rows = np.repeat(
            np.arange(len(channel.time)), 1 + (chance.random(len(channel.time)) < share)
        )
        time = channel.time[0] + float(np.median(np.diff(channel.time))) * np.arange(len(rows))
        log = _changed(log, name, time=time, values=channel.values[rows])
    return log


def jittered(log: FlightLog, *, std: float) -> FlightLog:
    """Return a log whose recorder stamps what it gets when it gets it [s], never backwards."""
    for name, channel in log.channels.items():
        chance = np.random.default_rng(1)  # the same for channels of the same rows
        stamps = channel.time + np.abs(chance.normal(0.0, std, len(channel.time)))
        log = _changed(log, name, time=np.maximum.accumulate(stamps))
    return log


def thinned(log: FlightLog, *, share: float) -> FlightLog:
    """Return a log that lost a share of its rows, wherever they were."""
    for name, channel in log.channels.items():
        chance = np.random.default_rng(2)  # the same for channels of the same rows
        kept = chance.random(len(channel.time)) >= share
        log = _changed(log, name, time=channel.time[kept], values=channel.values[kept])
    return log


def stretched(log: FlightLog, *, factor: float) -> FlightLog:
    """Return a log by a clock that runs at another rate."""
    for name, channel in log.channels.items():
        log = _changed(log, name, time=channel.time * factor)
    return log


def jumping(log: FlightLog, *, angle: float, every: float) -> FlightLog:
    """Return a log whose attitude is off in single frames, as of swapped markers [rad, s]."""
    channel = log.channels["attitude"]
    values, at = channel.values.copy(), np.arange(channel.time[0], channel.time[-1], every)
    rows = np.searchsorted(channel.time, at)
    turn = Rotation.from_rotvec([0.0, angle, 0.0])
    off = Rotation.from_quat(values[rows][:, [1, 2, 3, 0]]) * turn
    values[rows] = off.as_quat()[:, [3, 0, 1, 2]]
    return _changed(log, "attitude", values=values)


def crashed(log: FlightLog, *, at: float) -> FlightLog:
    """Return a log that ends in a crash [s]: half a second of tumbling and blows, then on its side.

    The motors go on until somebody disarms.
    """
    for name, channel in log.channels.items():
        rows = int(np.searchsorted(channel.time, channel.time[0] + at))
        stop = int(np.searchsorted(channel.time, channel.time[0] + at + 2.0))
        since = channel.time[rows:stop] - channel.time[rows]
        after = _after_crash(name, channel.values[rows:stop], since)
        values = np.concatenate([channel.values[:rows], after])
        log = _changed(log, name, time=channel.time[:stop], values=values)
    return log


def _after_crash(
    name: str, values: Float[np.ndarray, "n k"], since: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n k"]:
    """Return what a channel reads from the first blow on [s]."""
    blows = np.random.default_rng(3).standard_normal(values.shape)
    tumbling = (since < 0.5)[:, None]
    if name == "gyro":
        return np.where(tumbling, np.clip(15.0 * blows, -35.0, 35.0), 0.01 * blows)
    if name == "accel":
        rest = np.array([0.0, 9.81, 0.0]) + 0.05 * blows
        return np.where(tumbling, np.clip(80.0 * blows, -157.0, 157.0), rest)
    if name in ("rotor_speed", "command"):
        return np.where((since < 0.8)[:, None], values, 0.0)
    return values
