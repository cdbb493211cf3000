"""Predict force and moment of fast flights that the fit has not seen (NeuroBEM, 2 to 14 m/s).

Each flight in turn is left out, the coefficients are fitted to the other flights, and the rms
error of force under 3 Hz and of moment under 18 Hz is printed, with NeuroBEM's own prediction.

Three fits are least squares of the equations, which shows what each set of terms can explain at
best, whatever weights and priors an identification has. The fourth is `rotorfit identify` of the
other flights together, whose result predicts as `rotorfit validate` does. Its inertia is its own:
the error of its angular acceleration, times the published inertia, stands beside the others.

    ROTORFIT_DATA=... python -m benchmarks.fast_flight
"""

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
    u = v[:, 2:] + w[:, :1] * r[:, 1] - w[:, 1:2] * r[:, 0]
    more: list[list[np.ndarray]] = [[] for _ in columns]
    if model == MODELS[1]:
        lift = (v[:, :2] ** 2).sum(axis=1)
        more = [[v[:, 0]], [v[:, 1]], [(O * u).sum(axis=1), lift]]
        more += [[(O * u) @ r[:, 1], v[:, 1]], [-(O * u) @ r[:, 0], v[:, 0]], [w[:, 2]]]
    elif model == MODELS[2]:
        # Momentum theory: in still air the thrust T of all rotors induces sqrt(T / (2 rho A)).
        thrust = total * flight.force[:, 2].mean() / total.mean()
        still = np.sqrt(thrust / (2.0 * AIR_DENSITY * np.pi * PROPELLER**2))[:, None]
        vx, vy = v[:, :1] - w[:, 2:] * r[:, 1], v[:, 1:2] + w[:, 2:] * r[:, 0]
        induced = solve_induced_velocity(np.hypot(vx, vy), u, still)
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


def measure_errors(error: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "4"]:
    """Return the mean squares of Fxy, Fz [N^2], Mxy, Mz [N^2 m^2]."""
    square = (error**2).mean(axis=0)
    return np.array([square[:2].mean(), square[2], square[3:5].mean(), square[5]])


def predict_left_out(flights: list[Flight], left_out: int, model: str) -> Float[np.ndarray, "4"]:
    """Fit the other flights and return the mean squares of the error in the one left out."""
    errors: list[np.ndarray] = []
    for k in range(6):
        band = FORCE_BAND if k < 3 else MOMENT_BAND
        fits = [filter_below(make_columns(f, model)[k], band) for f in flights]
        felt = [filter_below(np.hstack([f.force, f.moment])[:, k], band) for f in flights]
        others = [i for i in range(len(flights)) if i != left_out]
        X, y = (np.concatenate([part[i] for i in others]) for part in (fits, felt))
        theta = np.linalg.lstsq(X, y, rcond=None)[0]
        errors.append(felt[left_out] - fits[left_out] @ theta)
    return measure_errors(np.column_stack(errors))


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


def main() -> None:
    """Print the table of rms errors over all flights."""
    folder = Path(os.environ["ROTORFIT_DATA"]) / "neurobem"
    paths = [folder / f"{name}.csv" for name in FLIGHTS]
    flights = [read_flight(path) for path in paths]
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
