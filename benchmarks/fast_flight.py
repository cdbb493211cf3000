"""Predict force and moment of fast flights that the fit has not seen (NeuroBEM, 2 to 14 m/s).

Each flight in turn is left out, the coefficients are fitted to the other flights, and the rms
error of force under 3 Hz and of moment under 18 Hz is printed, with NeuroBEM's own prediction.

Three fits are least squares of the equations, which shows what each set of terms can explain at
best, whatever weights and priors an identification has. The fourth is `rotorfit identify` of the
other flights together, whose result predicts as `rotorfit validate` does. Its inertia is its own:
the error of its angular acceleration, times the published inertia, stands beside the others.

    ROTORFIT_DATA=... python -m benchmarks.fast_flight
    ROTORFIT_DATA=... python -m benchmarks.fast_flight --terms  # with one more group of terms each
"""

import argparse
import os
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.signal import butter, sosfiltfilt

from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify
from rotorfit.results.result import IdentificationResult
from rotorfit.results.validation.validate import validate_file

FLIGHTS: Final = ("20210218170320seg2", "20210218171908seg2", "20210218172600seg1")
MASS: Final = 0.772
BEM_MASS: Final = 0.752
"""Mass that the forces of `bem_*` were made with [kg]."""
INERTIA: Final = np.diag([0.0025, 0.0021, 0.0043])
"""Published inertia [kg m^2], which turns angular acceleration into moment."""
SPACING: Final = (0.15, 0.20)
"""Distance of the rotors along x and y [m]."""
SPINS: Final = np.array([-1.0, 1.0, 1.0, -1.0])
PROPELLER: Final = 0.127
"""Diameter of the propellers [m]."""
AIR_DENSITY: Final = 1.2
"""Density of the air [kg/m^3]."""
GRAVITY: Final = 9.81
RATE: Final = 400.0
FORCE_BAND: Final = 3.0
"""Highest frequency of the force [Hz]: above it the logged acceleration is smoothed."""
MOMENT_BAND: Final = 18.0
EXPERIMENT: Final = f"""name = "neurobem"
[airframe]
layout = "quad-x"
spacing = {list(SPACING)}
order = "betaflight"
propeller = {PROPELLER}
[motors]
speed = "measured"
[[configuration]]
mass = {MASS}
"""
MODELS: Final = ("kt O^2", "linear drag and inflow", "rotor drag, Glauert, wake")
COMPONENTS: Final = ("Fx [N]", "Fy [N]", "Fz [N]", "Mx [mN m]", "My [mN m]")


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight: velocity and rates in body axes, with the measured and NeuroBEM's wrench."""

    speeds: Float[np.ndarray, "n 4"]
    velocity: Float[np.ndarray, "n 3"]
    rates: Float[np.ndarray, "n 3"]
    force: Float[np.ndarray, "n 3"]
    moment: Float[np.ndarray, "n 3"]
    bem: Float[np.ndarray, "n 6"]


def read_flight(path: Path) -> Flight:
    """Read one file of the data set."""
    rows = np.genfromtxt(path, delimiter=",", names=True)

    def stack(*names: str) -> Float[np.ndarray, "n k"]:
        return np.column_stack([rows[name] for name in names])

    w = stack("gyro_x", "gyro_y", "gyro_z")
    L = w @ INERTIA.T
    return Flight(
        speeds=stack("rotor_1", "rotor_2", "rotor_3", "rotor_4"),
        velocity=stack("vel_x", "vel_y", "vel_z"),
        rates=w,
        force=MASS * stack("accel_x", "accel_y", "accel_z"),
        moment=np.gradient(w, 1.0 / RATE, axis=0) @ INERTIA.T + np.cross(w, L),
        bem=np.hstack(
            [
                stack("bem_fx", "bem_fy", "bem_fz") * MASS / BEM_MASS,
                stack("bem_mx", "bem_my", "bem_mz"),
            ]
        ),
    )


def filter_below(signal: Float[np.ndarray, "n k"], cutoff: float) -> Float[np.ndarray, "n k"]:
    """Low-pass without phase [Hz]."""
    return sosfiltfilt(butter(4, cutoff, fs=RATE, output="sos"), signal, axis=0)


def rotor_places() -> Float[np.ndarray, "4 2"]:
    """Return the rotors' places: back right, front right, back left, front left."""
    x, y = (0.5 * s for s in SPACING)
    return np.array([[-x, -y], [x, -y], [-x, y], [x, y]])


def solve_induced_velocity(
    across: Float[np.ndarray, "n k"],
    along: Float[np.ndarray, "n k"],
    still: Float[np.ndarray, "n 1"],
) -> Float[np.ndarray, "n k"]:
    """Solve Glauert's v_i = v_h^2 / sqrt(v_perp^2 + (u + v_i)^2) by halving, from 0 to 3 v_h.

    `still`: v_h, the induced velocity in still air.
    One root in a climb and in descents slower than v_h, as in all flights here.
    """
    low, high = np.zeros_like(across), 3.0 * still + np.zeros_like(across)
    for _ in range(40):
        middle = 0.5 * (low + high)
        above = middle * np.hypot(across, along + middle) > still**2
        high, low = np.where(above, middle, high), np.where(above, low, middle)
    return 0.5 * (low + high)


def induced_velocities(flight: Flight) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n 1"]]:
    """Return the velocity that each rotor induces, and what the same thrust does in still air."""
    # Momentum theory: in still air the thrust T of all rotors induces sqrt(T / (2 rho A)).
    total = (flight.speeds**2).sum(axis=1)
    thrust = total * flight.force[:, 2].mean() / total.mean()
    still = np.sqrt(thrust / (2.0 * AIR_DENSITY * np.pi * PROPELLER**2))[:, None]
    vx, vy, u = rotor_velocities(flight)
    return solve_induced_velocity(np.hypot(vx, vy), u, still), still


def rotor_velocities(flight: Flight) -> tuple[Float[np.ndarray, "n 4"], ...]:
    """Return the velocity of each rotor along x, y and z."""
    v, w, r = flight.velocity, flight.rates, rotor_places()
    return (
        v[:, :1] - w[:, 2:] * r[:, 1],
        v[:, 1:2] + w[:, 2:] * r[:, 0],
        v[:, 2:] + w[:, :1] * r[:, 1] - w[:, 1:2] * r[:, 0],
    )


def make_columns(flight: Flight, model: str) -> list[Float[np.ndarray, "n k"]]:
    """Return the columns of Fx, Fy, Fz, Mx, My, Mz; each component has coefficients of its own."""
    O, v, w, r = flight.speeds, flight.velocity, flight.rates, rotor_places()
    squares, one = O**2, np.ones(len(O))
    total = squares.sum(axis=1)
    columns = [
        [one],
        [one],
        [total],
        [squares @ r[:, 1], total],
        [-squares @ r[:, 0], total],
        [squares @ SPINS, one],
    ]
    vx, vy, u = rotor_velocities(flight)
    more: list[list[np.ndarray]] = [[] for _ in columns]
    if model == MODELS[1]:
        lift = (v[:, :2] ** 2).sum(axis=1)
        more = [[v[:, 0]], [v[:, 1]], [(O * u).sum(axis=1), lift]]
        more += [[(O * u) @ r[:, 1], v[:, 1]], [-(O * u) @ r[:, 0], v[:, 0]], [w[:, 2]]]
    elif model == MODELS[2]:
        induced, still = induced_velocities(flight)
        lost = O * (u - (still - induced))
        mean = induced.mean(axis=1)
        more = [
            [(O * vx).sum(axis=1)],
            [(O * vy).sum(axis=1)],
            [lost.sum(axis=1)],
            [lost @ r[:, 1], mean * v[:, 1]],
            [-lost @ r[:, 0], mean * v[:, 0]],
            [(O * vy) @ r[:, 0] - (O * vx) @ r[:, 1]],
        ]
    return [np.column_stack([*c, *m]) for c, m in zip(columns, more, strict=True)]


def make_further_columns(flight: Flight) -> dict[str, list[list[Float[np.ndarray, " n"]]]]:
    """Return groups of further terms, by name: columns of Fx, Fy, Fz, Mx, My; none of some."""
    v, force = flight.velocity, flight.force
    x, y, z = v.T
    fast, speeds = np.linalg.norm(v, axis=1), flight.speeds.sum(axis=1)
    total, induced = (flight.speeds**2).sum(axis=1), induced_velocities(flight)[0].mean(axis=1)
    flapping = [speeds * x, speeds * y]
    return {
        "none": [[], [], [], [], []],
        "body drag, speed times velocity": [[fast * x], [fast * y], [fast * z], [], []],
        "frame drag, linear": [[x], [y], [z], [], []],
        "thrust that leans": [[total], [total], [], [], []],
        "force over induced times forward velocity": [
            [induced * x],
            [induced * y],
            [induced * x, induced * y, induced * z],
            [],
            [],
        ],
        "thrust over squared forward velocity": [[], [], [x**2, y**2], [], []],
        "moment over rotor speed times velocity (flapping)": [[], [], [], flapping, flapping],
        "moment over force (another centre of mass)": [
            [],
            [],
            [],
            [force[:, 1], force[:, 2]],
            [force[:, 0], force[:, 2]],
        ],
    }


def measure_errors(error: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "4"]:
    """Return the mean squares of Fxy, Fz [N^2], Mxy, Mz [N^2 m^2]."""
    square = (error**2).mean(axis=0)
    return np.array([square[:2].mean(), square[2], square[3:5].mean(), square[5]])


def predict_left_out(flights: list[Flight], left_out: int, model: str) -> Float[np.ndarray, "4"]:
    """Fit the other flights and return the mean squares of the error in the one left out."""
    columns = [make_columns(flight, model) for flight in flights]
    errors = [
        component_error(flights, left_out, k, [one[k] for one in columns])
        for k in range(len(columns[0]))
    ]
    return measure_errors(np.column_stack(errors))


def component_error(
    flights: list[Flight], left_out: int, k: int, columns: list[Float[np.ndarray, "n k"]]
) -> Float[np.ndarray, " n"]:
    """Fit a component of the other flights by its columns; return the error in the one left out."""
    band = FORCE_BAND if k < 3 else MOMENT_BAND
    fits = [filter_below(one, band) for one in columns]
    felt = [filter_below(np.hstack([f.force, f.moment])[:, k], band) for f in flights]
    others = [i for i in range(len(flights)) if i != left_out]
    X, y = (np.concatenate([part[i] for i in others]) for part in (fits, felt))
    theta = np.linalg.lstsq(X, y, rcond=None)[0]
    return felt[left_out] - fits[left_out] @ theta


def compare_further_terms(flights: list[Flight]) -> dict[str, list[float]]:
    """Return the rms errors of Fx, Fy, Fz, Mx, My with each group of further terms."""
    usual = [make_columns(flight, MODELS[2]) for flight in flights]
    further = [make_further_columns(flight) for flight in flights]
    found: dict[str, list[float]] = {}
    for name in further[0]:
        found[name] = []
        for k in range(len(COMPONENTS)):
            if name != "none" and not further[0][name][k]:
                found[name].append(found["none"][k])
                continue
            own = [
                np.column_stack([a[k], *b[name][k]]) for a, b in zip(usual, further, strict=True)
            ]
            squares = [
                (component_error(flights, i, k, own) ** 2).mean() for i in range(len(flights))
            ]
            found[name].append(float(np.sqrt(np.mean(squares))))
    return found


def compare_bem(flight: Flight) -> Float[np.ndarray, "4"]:
    """Return the mean squares of NeuroBEM's error in the same bands."""
    felt = np.hstack([flight.force, flight.moment]) - flight.bem
    force, moment = filter_below(felt[:, :3], FORCE_BAND), filter_below(felt[:, 3:], MOMENT_BAND)
    return measure_errors(np.hstack([force, moment]))


def identify_together(paths: list[Path]) -> IdentificationResult:
    """Identify flights as one experiment."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = Path(folder) / "experiment.toml"
        files = ", ".join(f'"{one.resolve()}"' for one in paths)
        path.write_text(f"{EXPERIMENT}flights = [{files}]\n", encoding="utf-8")
        return identify(load_experiment(path))


def predict_by_rotorfit(paths: list[Path], left_out: int) -> Float[np.ndarray, "4"]:
    """Identify the other flights and return the mean squares of the error in the one left out.

    Of Mz not a number: these flights do not show the drag torque.
    """
    result = identify_together([p for i, p in enumerate(paths) if i != left_out])
    force, moment = (
        validate_file(result, paths[left_out], cutoff=band) for band in (FORCE_BAND, MOMENT_BAND)
    )
    error = (force.body_wrench - force.rotor_wrench)[:, :3]
    turning = (moment.body_wrench - moment.rotor_wrench)[:, 3:5]
    found = [result.derived_value(name).value or np.nan for name in ("Ixx_com", "Iyy_com")]
    turning = turning * np.diag(INERTIA)[:2] / found
    return np.array(
        [(error[:, :2] ** 2).mean(), (error[:, 2] ** 2).mean(), (turning**2).mean(), np.nan]
    )


def print_further_terms(flights: list[Flight]) -> None:
    """Print the table of rms errors with one more group of terms, and NeuroBEM's."""
    rows = compare_further_terms(flights)
    bands = [FORCE_BAND] * 3 + [MOMENT_BAND] * 2
    wrenches = [np.hstack([f.force, f.moment]) - f.bem for f in flights]
    rows["NeuroBEM"] = [
        float(np.sqrt(np.mean([(filter_below(one[:, k], band) ** 2).mean() for one in wrenches])))
        for k, band in enumerate(bands)
    ]
    print(f"| more terms | {' | '.join(COMPONENTS)} |\n|---|---|---|---|---|---|")
    for name, found in rows.items():
        forces = " | ".join(f"{value:.3f}" for value in found[:3])
        moments = " | ".join(f"{1e3 * value:.1f}" for value in found[3:])
        print(f"| {name} | {forces} | {moments} |", flush=True)


def main() -> None:
    """Print the table of rms errors over all flights."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--terms", action="store_true")
    asked = parser.parse_args()
    folder = Path(os.environ["ROTORFIT_DATA"]) / "neurobem"
    paths = [folder / f"{name}.csv" for name in FLIGHTS]
    flights = [read_flight(path) for path in paths]
    if asked.terms:
        print_further_terms(flights)
        return
    rows = {m: [predict_left_out(flights, i, m) for i in range(len(flights))] for m in MODELS}
    rows["rotorfit identify"] = [predict_by_rotorfit(paths, i) for i in range(len(flights))]
    rows["NeuroBEM"] = [compare_bem(flight) for flight in flights]
    print("| terms | Fxy [N] | Fz [N] | Mxy [mN m] | Mz [mN m] |\n|---|---|---|---|---|")
    for name, squares in rows.items():
        a, b, c, d = np.sqrt(np.mean(squares, axis=0)) * [1.0, 1.0, 1e3, 1e3]
        yaw = f"{d:.1f}" if np.isfinite(d) else "-"
        print(f"| {name} | {a:.2f} | {b:.2f} | {c:.1f} | {yaw} |")


if __name__ == "__main__":
    main()
