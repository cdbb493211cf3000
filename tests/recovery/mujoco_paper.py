"""The paper's experiment flown in MuJoCo: vehicles A and B, commands only, nothing told."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from mujoco_flight import LAW, experiment_text, fly, write_table

from rotorfit.results.result import IdentificationResult
from rotorfit.simulation import Sensors, SimulatedVehicle, Truth, paper_vehicle
from rotorfit.simulation.experiment_files import true_parameters

SENSORS = Sensors(gyro_std=0.01, accel_std=0.15, gyro_bias=(0.012, -0.008, 0.006))
DRAG = (0.12, 0.12, 0.0)
PRESET = '[identification]\npreset = "paper"\n'
LIMITS: Mapping[str, float] = {
    "kt": 0.3e-2,
    "kd": 1.5e-2,
    "Ixx": 0.7e-2,
    "Iyy": 0.7e-2,
    "Izz": 0.7e-2,
    "msx": 1e-4,
    "msy": 1e-4,
    "motor_lag_total": 1.5e-3,
}
"""Largest error: of first moments in kg m, of the lag plus delay in s, of the rest as a share."""
ABSOLUTE = ("msx", "msy", "motor_lag_total")
MOST_RESIDUAL = 0.05
"""Of the validation error of Fz, Mx and My."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Error:
    """Error and half-width of one number, both in the unit of its limit."""

    error: float
    half_width: float
    limit: float

    @property
    def held(self) -> bool:
        """Whether the interval holds the truth."""
        return abs(self.error) <= self.half_width


def paper_in_air(name: str) -> SimulatedVehicle:
    """Return vehicle A or B with lateral drag; its motors lag by 40 ms."""
    truth, vehicle = paper_vehicle("A" if name == "A" else "B")
    return SimulatedVehicle(replace(truth, drag=DRAG), vehicle)


def fly_paper(folder: Path, *, seed: int, seconds: float = 75.0, validation: float = 25.0) -> None:
    """Write one flight of A and of B for the fit, one of each for validation."""
    for number, name in enumerate("AB"):
        truth, vehicle = paper_in_air(name)
        for flight, duration in ((1, seconds), (2, validation)):
            flown = fly(
                truth,
                vehicle,
                seed=100 * seed + 10 * number + flight,
                seconds=duration,
                sensors=SENSORS,
            )
            write_table(flown, folder / f"{name}{flight}.csv", motors="command")


def write_paper(folder: Path, *, extra: str = "") -> Path:
    """Write the experiment: law and masses are told, lag and delay are not."""
    configurations = "".join(
        f'[[configuration]]\nname = "{name}"\nmass = {paper_in_air(name).truth.mass!r}\n'
        f'weight = {weight}\nflights = ["{name}1.csv"]\nvalidation = ["{name}2.csv"]\n'
        for name, weight in (("A", 1.0), ("B", 2.0))
    )
    path = folder / "experiment.toml"
    motors = f'speed = "commanded"\n{LAW}'
    vehicle = paper_in_air("A").vehicle
    path.write_text(
        experiment_text(vehicle, configurations, motors=motors, extra=extra), encoding="utf-8"
    )
    return path


def errors(result: IdentificationResult) -> dict[str, Error]:
    """Return the errors of what has a limit and a value; of a body, by ``Ixx@A``."""
    truths = {name: paper_in_air(name).truth for name in "AB"}
    found: dict[str, Error] = {}
    for number in (*result.parameters, *result.derived):
        if number.name not in LIMITS or number.value is None or number.interval is None:
            continue
        true = _true(number.name, truths[number.configuration or "A"])
        unit = 1.0 if number.name in ABSOLUTE else abs(true)
        owner = f"@{number.configuration}" if number.configuration else ""
        found[number.name + owner] = Error(
            error=(number.value - true) / unit,
            half_width=0.5 * (number.interval[1] - number.interval[0]) / unit,
            limit=LIMITS[number.name],
        )
    return found


def _true(name: str, truth: Truth) -> float:
    if name == "motor_lag_total":
        return truth.motor_lag + truth.motor_delay
    return true_parameters(truth, rotors=4)[name]


def residuals(result: IdentificationResult) -> dict[str, float]:
    """Return the validation error of each configuration and wrench component, by ``Fz@A``."""
    return {
        f"{component}@{row['configuration']}": float(share)
        for row in result.validation
        for component, share in row["relative_error"].items()
    }
