"""Two flights through rotorfit and through others: errors, intervals, processor time and memory.

    pip install "mujoco[sysid]"
    python benchmarks/peers.py [--seconds 75] [--seed 1] [--only WORDS]

The paper's vehicle A flown by MuJoCo (`tests/recovery/mujoco_flight.py`), once in still air, once
with lateral drag of 0.12 N s/m in gusts of 0.1 N and (6, 6, 1.5) mN m; gyro noise 0.01 rad/s and
bias, accelerometer noise 0.15 m/s^2, commands alone, 40 ms motor lag that nobody tells. Through
rotorfit's default, its ordinary least squares, the paper's preset, and through `mujoco.sysid`, each
in a process of its own; the last is left out, and said to be, where it is not installed.

mujoco.sysid fits simulated to measured gyro and accelerometer in half-second windows of the
flight, weighted by the noise, one thread. Free are inertia (its pseudo-inertia with the mass held),
centre of mass, kt, kd / kt, the motor lag (the commands are filtered before the rollout, as its
own states know no square of a speed), what the mean on the ground leaves of the gyro's bias, and,
where the flight has drag, drag along x and y. Its intervals are those of its covariance, carried to
our numbers by their derivatives. It is given what rotorfit is not: MuJoCo itself as the model, that
there is no delay, when the vehicle is in the air, the noise, and attitude and velocity at the start
of every window without error. Its rates there are, in "exact", without error too, which no log has;
in "measured", the gyro's, low-passed without delay at 20 Hz, their mean on the ground taken off.

Printed of each flight: per number the error and the half-width of the 95 % interval, with a ! where
it does not hold the truth (in % of the truth, products of inertia in % of the geometric mean of
their axes' inertia, centre of mass in um; inertia about the body origin); how many hold of those
that are told; processor seconds of reading and identifying, and the most memory that the process
had.
"""

import argparse
import importlib
import importlib.util
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "recovery"))

import mujoco
import mujoco_flight
import numpy as np
from jaxtyping import Float
from mujoco_flight import FULL_SPEED, LAW, SAMPLE_RATE
from mujoco_paper import DRAG, SENSORS
from scipy import signal

from rotorfit.errors import FlightWarning
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify
from rotorfit.model.vehicle import Vehicle
from rotorfit.simulation import SimulatedVehicle, Truth, paper_vehicle
from rotorfit.simulation.experiment_files import true_parameters

Told = dict[str, tuple[float, float]]
"""Value and half-width of the interval, by the names of rotorfit's results."""

SETTINGS: Final[Mapping[str, str]] = {
    "rotorfit": "",
    "its OLS": '[identification]\nmethod = "ols"\n',
    "paper": '[identification]\npreset = "paper"\n',
}
SYSID: Final = ("sysid, exact", "sysid, measured")
WINDOW: Final = 100
"""Samples of a window: half a second."""
START: Final = {"kt": 1.2, "kd": 0.8, "inertia": 1.25, "motor_lag": 0.75}
"""Where mujoco.sysid starts, as shares of the truth; the centre of mass in the origin, no drag."""
SPEED: Final = 1000.0
"""Unit of rotor speed in the rollouts, so that no parameter is tiny [rad/s]."""
NAMES: Final = (
    *("kt", "kd", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"),
    *("com_x", "com_y", "com_z", "motor_lag_total", "drag_x", "drag_y"),
)


def flights() -> dict[str, SimulatedVehicle]:
    """Return what flies, by the name of the flight."""
    truth, vehicle = paper_vehicle("A")
    windy = replace(
        truth,
        drag=DRAG,
        disturbance_force_std=(0.1, 0.1, 0.1),
        disturbance_torque_std=(6e-3, 6e-3, 1.5e-3),
    )
    return {
        "still air": SimulatedVehicle(truth, vehicle),
        "drag and gusts": SimulatedVehicle(windy, vehicle),
    }


def truths(truth: Truth) -> dict[str, float]:
    """Return what should be found, of `NAMES`; drag only where there is any."""
    values = true_parameters(truth, rotors=4)
    values["motor_lag_total"] = truth.motor_lag + truth.motor_delay
    if any(truth.drag):
        values |= {"drag_x": truth.drag[0], "drag_y": truth.drag[1]}
    return {name: values[name] for name in NAMES if name in values}


def units(truth: Truth) -> dict[str, float]:
    """Return what an error is divided by: 1 % of the truth or of its axes' inertia, or 1 um."""
    values = {name: abs(value) / 100 for name, value in truths(truth).items()}
    I = truth.inertia_tensor
    for name, i, j in (("Ixy", 0, 1), ("Ixz", 0, 2), ("Iyz", 1, 2)):
        values[name] = float(np.sqrt(I[i, i] * I[j, j])) / 100
    return values | {f"com_{axis}": 1e-6 for axis in "xyz"}


def write_flight(flown: SimulatedVehicle, folder: Path, *, seed: int, seconds: float) -> None:
    """Fly, and write the flight table and, for mujoco.sysid, the arrays with the exact state."""
    flight = mujoco_flight.fly(*flown, seed=seed, seconds=seconds, sensors=SENSORS)
    mujoco_flight.write_table(flight, folder / "flight.csv", motors="command")
    np.savez(
        folder / "flight.npz",
        command=flight.command,
        imu=np.hstack([flight.gyro, flight.accel]),
        state=flight.state,
    )


def by_rotorfit(folder: Path, flown: SimulatedVehicle, settings: str) -> Told:
    """Identify the flight table under settings of the experiment file."""
    configuration = (
        f'[[configuration]]\nname = "A"\nmass = {flown.truth.mass!r}\nflights = ["flight.csv"]\n'
    )
    motors = f'speed = "commanded"\n{LAW}'
    path = folder / "experiment.toml"
    path.write_text(
        mujoco_flight.experiment_text(flown.vehicle, configuration, motors=motors, extra=settings),
        encoding="utf-8",
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FlightWarning)
        result = identify(load_experiment(path))
    said = {
        number.name: (number.value, 0.5 * (number.interval[1] - number.interval[0]))
        for number in (*result.parameters, *result.derived)
        if number.value is not None and number.interval is not None
    }
    mass = flown.truth.mass  # the preset gives first moments alone
    for axis in "xyz":
        if f"ms{axis}" in said:
            value, half = said[f"ms{axis}"]
            said[f"com_{axis}"] = value / mass, half / mass
    return {name: numbers for name, numbers in said.items() if name in NAMES}


@dataclass(frozen=True, slots=True, kw_only=True)
class Windows:
    """What mujoco.sysid is given of a flight.

    Attributes
    ----------
    command
        All rotor speeds asked for [SPEED], of the whole log.
    imu
        Gyro and accelerometer as measured, the gyro's mean on the ground taken off.
    starts
        First row of each window.
    state
        Position, attitude, velocity and rates (as `MujocoFlight.state`) that windows start from.
    """

    command: Float[np.ndarray, "n N"]
    imu: Float[np.ndarray, "n 6"]
    starts: list[int]
    state: Float[np.ndarray, "n 13"]


def windows(folder: Path, *, exact: bool) -> Windows:
    """Cut a flight into windows, the first a second after the ground is left."""
    with np.load(folder / "flight.npz") as arrays:
        command, imu, state = (arrays[name] for name in ("command", "imu", "state"))
    rate = round(SAMPLE_RATE)
    airborne = np.flatnonzero(state[:, 2] > mujoco_flight.FEET + 0.3)
    starts = range(airborne[0] + rate, airborne[-1] - rate - WINDOW, WINDOW)
    ground = round(mujoco_flight.GROUND_SECONDS * rate)
    standing = slice(ground // 2, ground)  # the feet have settled
    imu[:, :3] -= imu[standing, :3].mean(axis=0)
    if not exact:
        sections = signal.butter(2, 20.0, fs=SAMPLE_RATE, output="sos")
        state[:, 10:] = signal.sosfiltfilt(sections, imu[:, :3], axis=0)
    command *= FULL_SPEED / SPEED
    return Windows(command=command, imu=imu, starts=list(starts), state=state)


def squared_speeds(command: Float[np.ndarray, "n N"], motor_lag: float) -> Float[np.ndarray, "n N"]:
    """Return the squared speeds in the middle between each row and the next."""
    whole, half = np.exp(-np.array([1.0, 0.5]) / (SAMPLE_RATE * motor_lag))
    speed = signal.lfilter([0.0, 1.0 - whole], [1.0, -whole], command, axis=0)
    return (command + (speed - command) * half) ** 2


def sysid_guess(truth: Truth) -> Truth:
    """Return what mujoco.sysid starts from."""
    return replace(
        truth,
        kt=START["kt"] * truth.kt,
        kd=START["kd"] * truth.kd,
        first_moments=(0.0, 0.0, 0.0),
        inertia=tuple(START["inertia"] * x * (i < 3) for i, x in enumerate(truth.inertia)),
        motor_lag=START["motor_lag"] * truth.motor_lag,
        drag=(0.0, 0.0, 0.0),
    )


def sysid_spec(guess: Truth, vehicle: Vehicle) -> mujoco.MjSpec:
    """Return the model that mujoco.sysid starts from, a step per sample."""
    spec = mujoco.MjSpec.from_string(mujoco_flight.mjcf(guess, vehicle))
    spec.option.timestep = 1.0 / SAMPLE_RATE
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return spec


def sysid_parameters(
    spec: mujoco.MjSpec, guess: Truth, vehicle: Vehicle, *, with_drag: bool
) -> Any:
    """Return the free parameters, with how each changes the model, in mujoco.sysid's own type."""
    from mujoco import sysid

    whole = sysid.body_inertia_param(
        spec, spec.compile(), "frame", inertia_type=sysid.InertiaType.Pseudo
    )

    def inertia(spec: mujoco.MjSpec, parameter: Any) -> None:
        held = sysid.Parameter("whole", whole.nominal, whole.min_value, whole.max_value)
        held.inertia_type = sysid.InertiaType.Pseudo
        held.update_from_vector(np.concatenate([whole.nominal[:1], parameter.value]))
        sysid.apply_body_inertia(spec, "frame", held)
        # It leaves the axes undefined: MuJoCo (3.17, 4.0) then takes the body to have no inertia.
        spec.body("frame").iquat = [1.0, 0.0, 0.0, 0.0]

    def thrust(spec: mujoco.MjSpec, parameter: Any) -> None:
        for actuator in spec.actuators[6:]:
            actuator.gainprm[0] = parameter.value[0]

    def torque(spec: mujoco.MjSpec, parameter: Any) -> None:
        for actuator, spin in zip(spec.actuators[6:], vehicle.spins, strict=True):
            actuator.gear[5] = -spin * parameter.value[0]

    def drag(spec: mujoco.MjSpec, parameter: Any) -> None:
        for actuator, value in zip(spec.actuators, parameter.value, strict=False):
            actuator.biasprm[2] = -value

    kt, ratio, lag = guess.kt * SPEED**2, guess.kd / guess.kt, guess.motor_lag
    found = [
        sysid.Parameter(
            "inertia", whole.nominal[1:], whole.min_value[1:], whole.max_value[1:], modifier=inertia
        ),
        sysid.Parameter("kt", kt, kt / 3, kt * 3, modifier=thrust),
        sysid.Parameter("kd_over_kt", ratio, ratio / 5, ratio * 5, modifier=torque),
        sysid.Parameter("motor_lag", lag, 2e-3, 0.2),
        sysid.Parameter("gyro_bias", np.zeros(3), np.full(3, -0.1), np.full(3, 0.1)),
    ]
    if with_drag:
        found.append(
            sysid.Parameter("drag", guess.drag[:2], [-1.0, -1.0], [1.0, 1.0], modifier=drag)
        )
    return sysid.ParameterDict({parameter.name: parameter for parameter in found})


def sysid_numbers(spec: mujoco.MjSpec, parameters: Any) -> dict[str, float]:
    """Return the numbers by the names of rotorfit's results."""
    from mujoco.sysid import apply_param_modifiers

    model = apply_param_modifiers(parameters, spec)
    frame, axes = model.body("frame"), np.empty(9)
    mujoco.mju_quat2Mat(axes, frame.iquat)
    R = axes.reshape(3, 3)
    c = frame.ipos
    I = R @ np.diag(frame.inertia) @ R.T + float(frame.mass[0]) * (
        c @ c * np.eye(3) - np.outer(c, c)
    )
    kt = parameters["kt"].value[0] / SPEED**2
    found = {"kt": kt, "kd": kt * parameters["kd_over_kt"].value[0]}
    found |= {f"com_{axis}": float(x) for axis, x in zip("xyz", c, strict=True)}
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        found[f"I{'xyz'[i]}{'xyz'[j]}"] = float(I[i, j])
    found["motor_lag_total"] = parameters["motor_lag"].value[0]
    if "drag" in parameters:
        found |= dict(zip(("drag_x", "drag_y"), parameters["drag"].value.tolist(), strict=True))
    return found


def sysid_residual(given: Windows, spec: mujoco.MjSpec) -> Callable[..., Any]:
    """Return mujoco.sysid's residual function of all windows, in deviations of the noise."""
    from mujoco import sysid

    model = spec.compile()
    std = np.repeat([SENSORS.gyro_std, SENSORS.accel_std], 3)

    def rollout(*, control_signal: Any, param_dicts: Any, **others: Any) -> Any:
        lags = [parameters["motor_lag"].value[0] for parameters in param_dicts]
        squares = [squared_speeds(given.command, lag) for lag in lags]
        each = len(control_signal) // len(squares)
        control: list[Any] = []
        for i, series in enumerate(control_signal):
            first = round(series.times[0] * SAMPLE_RATE)
            data = np.zeros((len(series.times), model.nu))
            data[:, 6:] = squares[i // each][first : first + len(data)]
            control.append(sysid.TimeSeries(series.times, data))
        return sysid.sysid_rollout(control_signal=control, **others)

    def difference(free: Any, predicted: Any, measured: Any, *_model: Any, **_state: Any) -> Any:
        # Each step's thrust is that of its middle: the accelerometer's at a row, half of each side.
        rows = predicted.data[1:].copy()
        rows[:, 3:] = 0.5 * (predicted.data[:-1, 3:] + predicted.data[1:, 3:])
        rows[:, :3] += free["gyro_bias"].value
        return (rows - measured.data[1 : len(rows) + 1]) / std, measured, measured

    control, measured, states = [], [], []
    for start in given.starts:
        rows = slice(start, start + WINDOW + 1)
        times = np.arange(rows.start, rows.stop) / SAMPLE_RATE
        control.append(sysid.TimeSeries(times, np.zeros((WINDOW + 1, model.nu))))
        measured.append(sysid.TimeSeries.from_names(times, given.imu[rows], model))
        state = given.state[start]
        states.append(sysid.create_initial_state(model, state[:7], state[7:]))
    sequences = sysid.ModelSequences(
        "flight", spec, [str(start) for start in given.starts], states, control, measured
    )
    return sysid.build_residual_fn(
        models_sequences=[sequences],
        custom_rollout=rollout,
        modify_residual=difference,
        resample_true=False,
        n_threads=1,
    )


def by_sysid(folder: Path, flown: SimulatedVehicle, *, exact: bool) -> Told:
    """Fit the windows by mujoco.sysid."""
    from mujoco import sysid

    guess = sysid_guess(flown.truth)
    spec = sysid_spec(guess, flown.vehicle)
    start = sysid_parameters(spec, guess, flown.vehicle, with_drag=any(flown.truth.drag))
    residual = sysid_residual(windows(folder, exact=exact), spec)
    # With its own 1e-8 it spends most of its time on steps that rounding lets no more improve.
    found, fit = sysid.optimize(start, residual, verbose=False, xtol=1e-6)
    left, _, _ = residual(found.as_vector(), found)
    covariance, _ = sysid.calculate_intervals([np.ravel(r) for r in left], fit.jac)
    values = sysid_numbers(spec, found)
    slopes: list[Float[np.ndarray, " m"]] = []
    for i, x in enumerate(fit.x):
        step = 1e-5 * max(abs(x), 0.1)
        moved = found.copy()
        moved.update_from_vector(fit.x + step * (np.arange(len(fit.x)) == i))
        ahead = sysid_numbers(spec, moved)
        slopes.append(np.array([ahead[name] - values[name] for name in values]) / step)
    J = np.array(slopes)
    half = 1.96 * np.sqrt(np.diagonal(J.T @ covariance @ J))
    return {name: (values[name], float(h)) for name, h in zip(values, half, strict=True)}


def spent(folder: Path, *arguments: str) -> Any:
    """Return what one task printed last, run in a process of its own.

    A process has the memory of the one that starts it in its own account: this one only starts.
    """
    own = [sys.executable, str(Path(__file__)), "--task", str(folder), *arguments]
    done = subprocess.run(own, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def task(folder: Path, name: str, asked: argparse.Namespace) -> None:
    """Fly, or identify by one method, and print the numbers, seconds [s] and memory [MB]."""
    flown = flights()[name]
    if asked.method is None:
        write_flight(flown, folder, seed=asked.seed, seconds=asked.seconds)
        print("{}")
        return
    start = time.process_time()
    if asked.method in SYSID:
        said = by_sysid(folder, flown, exact=asked.method == SYSID[0])
    else:
        said = by_rotorfit(folder, flown, SETTINGS[asked.method])
    seconds = time.process_time() - start
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps({"told": said, "seconds": seconds, "memory": memory}))


def table(truth: Truth, found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the lines of one flight's table: a number each, then what is held and spent."""
    true, unit = truths(truth), units(truth)
    lines = [f"{'':16s} unit " + "".join(f"{method:>18s}" for method in found)]
    held = {method: [0, 0] for method in found}
    for name in true:
        cells: list[str] = []
        for method, run in found.items():
            if name not in run["told"]:
                cells.append("-")
                continue
            value, half = run["told"][name]
            error = value - true[name]
            holds = abs(error) <= half
            held[method][0] += holds
            held[method][1] += 1
            mark = " " if holds else "!"
            cells.append(f"{error / unit[name]:+.2f} / {half / unit[name]:.2f}{mark}")
        kind = "um" if name.startswith("com_") else "%"
        lines.append(f"{name:16s} {kind:4s} " + "".join(f"{cell:>18s}" for cell in cells))
    for word, of in (
        ("held", lambda m: "{} of {} ".format(*held[m])),
        ("processor s", lambda m: f"{found[m]['seconds']:.1f} "),
        ("memory MB", lambda m: f"{found[m]['memory']:.0f} "),
    ):
        lines.append(f"{word:21s} " + "".join(f"{of(method):>18s}" for method in found))
    return lines


def sysid_is_there() -> bool:
    """Say whether mujoco.sysid has what its extra brings; the folder is there without it."""
    return importlib.util.find_spec("mujoco.sysid") is not None and hasattr(
        importlib.import_module("mujoco.sysid"), "optimize"
    )


def methods(only: str) -> list[str]:
    """Return the methods to run, after saying which cannot be."""
    names = [name for name in (*SETTINGS, *SYSID) if only in name]
    if sysid_is_there():
        return names
    print('mujoco.sysid is not installed, and left out: pip install "mujoco[sysid]"')
    return [name for name in names if name not in SYSID]


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly both flights, and print a table of each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=75.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="methods with these words in their name")
    parser.add_argument("--task", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--method", help=argparse.SUPPRESS)
    asked = parser.parse_args(arguments)
    if asked.task:
        task(Path(asked.task[0]), asked.task[1], asked)
        return
    chosen = methods(asked.only)
    for name, (truth, _) in flights().items():
        with tempfile.TemporaryDirectory() as folder:
            flying = ("--seed", str(asked.seed), "--seconds", str(asked.seconds))
            spent(Path(folder), name, *flying)
            found = {m: spent(Path(folder), name, "--method", m) for m in chosen}
        print(f"{name}, {asked.seconds:g} s: error / half-width")
        print("\n".join(table(truth, found)), flush=True)


if __name__ == "__main__":
    main()
