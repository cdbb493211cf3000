"""Do many flights of one vehicle sharpen its numbers, and do the intervals still hold?

    python -m benchmarks.many_flights [--seeds 10] [--flights 1 5 10 20] [--vehicle small quad-x]
        [--keep build/many_flights] [--workers 1]

Flights of 25 s with gusts, drag, rotor inertia, unequal rotors and measured speeds. What changes
from flight to flight: the centre of mass (.5 mm), k_t and k_d together (1 %: air), how hard the
pilot flies (35 %), the gusts (40 %). What all flights of a seed share: the vehicle and an autopilot
between .6 and 1.6 times the usual gains. Printed per number of flights: median half-width, rms
error and mean error in %, and how often the 95 % interval holds: one flight its own truth, several
that which their vehicle has on average.
"""

import argparse
import json
import os
import warnings
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from benchmarks.common import experiment_text, named_vehicle, true_values
from benchmarks.recovery import Found, found_values

from rotorfit.errors import FlightWarning, RotorfitError
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify
from rotorfit.model.vehicle import Rotor, Vehicle
from rotorfit.simulation import (
    Scenario,
    SimulatedVehicle,
    Truth,
    simulate_flight,
    variant,
    write_flight_table,
)
from rotorfit.simulation.controller import Gains
from rotorfit.simulation.pilot import Stick, Sticks
from rotorfit.simulation.sensors import Sensors

SECONDS: Final = 25.0
LOOKED_AT: Final = (
    *("kt", "kd", "Jr", "Ixx_com", "Iyy_com", "Izz_com", "kd_over_Izz", "Jr_over_Izz", "com_x"),
)
LENGTH: Final = 0.01
"""What 100 % of a place of the centre of mass is [m]."""


def small_vehicle() -> SimulatedVehicle:
    """Return a 3-inch quadrotor, much like the real one of the logs LOG00267 to LOG00340."""
    places = ((-1, -1, "cw"), (1, -1, "ccw"), (-1, 1, "ccw"), (1, 1, "cw"))
    rotors = tuple(Rotor(position=(0.0455 * x, 0.0635 * y, 0.0), spin=s) for x, y, s in places)
    truth = Truth(
        mass=0.428,
        first_moments=(4e-4, -3e-4, 1e-3),
        inertia=(5.93e-4, 7.26e-4, 8.74e-4, 5e-6, -8e-6, 6e-6),
        kt=2.69e-7,
        kd=3.66e-9,
        Jr=8.6e-7,
        motor_lag=0.025,
        drag=(0.1, 0.1, 0.1),
        kt_spread=(1.02, 0.98, 1.01, 0.99),
        disturbance_force_std=(0.05, 0.05, 0.05),
        disturbance_torque_std=(8e-4, 8e-4, 2e-4),
    )
    return SimulatedVehicle(truth, Vehicle(rotors=rotors, imu_position=(0.0, 0.0, 0.0)))


def vehicle_of(name: str) -> tuple[SimulatedVehicle, Sensors]:
    """Return a vehicle and what measures it, as they are in a study of real-like flights."""
    usual, sensors = variant(named_vehicle("quad-x" if name == "small" else name), "real")
    return (small_vehicle() if name == "small" else usual), sensors


def flown_so(rng: np.random.Generator, *, small: bool) -> Sticks:
    """Return a pilot as lively as chance has it; small vehicles turn faster."""
    hard, usual, more = float(np.exp(0.35 * rng.standard_normal())), Sticks(), 2.0 if small else 1.0

    def by(stick: Stick, factor: float, most: float = np.inf) -> Stick:
        return replace(stick, rms=min(hard * factor * stick.rms, most))

    return Sticks(
        roll=by(usual.roll, more**0.5),
        pitch=by(usual.pitch, more**0.5),
        yaw=by(usual.yaw, more, 1.5),
        climb=by(usual.climb, 1.0, 2.0),
    )


def fly_all(folder: Path, name: str, seed: int, count: int) -> None:
    """Write the flights of one vehicle, and what is true of each and on average."""
    folder.mkdir(parents=True, exist_ok=True)
    (truth, vehicle), sensors = vehicle_of(name)
    small = name == "small"
    rng = np.random.default_rng([seed, 7])
    usual = Gains()
    eager = rng.uniform(0.6, 1.6)
    roll, pitch, yaw = usual.rate
    gains = replace(usual, rate=(eager * roll, eager * pitch, eager * yaw))
    true: list[dict[str, float]] = []
    for k in range(count):
        air, place = 1.0 + 0.01 * rng.standard_normal(), 5e-4 * rng.standard_normal(3)
        sticks, gust = flown_so(rng, small=small), float(np.exp(0.4 * rng.standard_normal()))
        x, y, z = (np.array(truth.first_moments) + truth.mass * place).tolist()
        own = replace(
            truth,
            kt=truth.kt * air,
            kd=truth.kd * air,
            first_moments=(x, y, z),
            disturbance_force_std=_times(truth.disturbance_force_std, gust),
            disturbance_torque_std=_times(truth.disturbance_torque_std, gust),
        )
        scenario = Scenario(
            seconds=SECONDS,
            ground_seconds=2.0,
            sensors=sensors,
            sticks=sticks,
            gains=gains,
            thrust_to_weight=4.0 if small else 2.5,
        )
        flight = simulate_flight(own, vehicle, scenario, seed=1000 * seed + k)
        write_flight_table(flight, folder / f"{k:02d}.csv")
        true.append(true_values(flight))
        if k == 0:
            level = replace(flight, truth=truth)
            (folder / "head.txt").write_text(experiment_text({"A": level}), encoding="utf-8")
            true.insert(0, true_values(level))
    (folder / "truth.json").write_text(json.dumps(true), encoding="utf-8")


def _times(values: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    x, y, z = values
    return factor * x, factor * y, factor * z


def one_vehicle(seed: int, *, name: str, counts: Sequence[int], keep: Path) -> dict[int, Found]:
    """Return what so many flights give, errors and half-widths in % of the truth."""
    folder = keep / f"{name}{seed}"
    if not (folder / "truth.json").exists():
        fly_all(folder, name, seed, max(counts))
    true = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    head = (folder / "head.txt").read_text(encoding="utf-8")
    found: dict[int, Found] = {}
    for count in counts:
        files = ", ".join(f'"{k:02d}.csv"' for k in range(count))
        path = folder / f"{os.getpid()}.toml"
        path.write_text(head.replace('"A.csv"', files), encoding="utf-8")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", FlightWarning)
                found[count] = _errors(
                    found_values(identify(load_experiment(path))), true[count == 1]
                )
        except RotorfitError as error:
            print(f"{name} {seed}, {count} flights: refused: {error}")
        path.unlink()
    return found


def _errors(found: Found, true: Mapping[str, float]) -> Found:
    """Return error and half-width of what is looked at, in %."""
    size = {n: LENGTH if n.startswith("com") else abs(true[n]) for n in LOOKED_AT}
    return {
        n: (100.0 * (found[n][0] - true[n]) / size[n], 100.0 * found[n][1] / size[n])
        for n in LOOKED_AT
        if n in found
    }


def table(runs: Sequence[Mapping[int, Found]], counts: Sequence[int]) -> list[str]:
    """Return one line a number: half-width, rms and mean error, held, for so many flights."""
    lines = [f"{'':12s}" + "".join(f"{f'{n} flights':>36s}" for n in counts)]
    lines += [f"{'':12s}" + f"{'half':>12s}{'rms':>7s}{'mean':>7s}{'held':>10s}" * len(counts)]
    for name in LOOKED_AT:
        line = f"{name:12s}"
        for count in counts:
            got = np.array([r[count][name] for r in runs if name in r.get(count, {})])
            if not len(got):
                line += f"{'-':>36s}"
                continue
            error, half = got.T
            held = f"{int((np.abs(error) <= half).sum())} of {len(got)}"
            line += f"{np.median(half):12.2f}{np.sqrt((error**2).mean()):7.2f}"
            line += f"{error.mean():+7.2f}{held:>10s}"
        lines.append(line)
    return lines


def main() -> None:
    """Run the studies that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--flights", type=int, nargs="+", default=[1, 5, 10, 20])
    parser.add_argument("--vehicle", nargs="+", default=["small", "quad-x"])
    parser.add_argument("--keep", type=Path, default=Path("build/many_flights"))
    parser.add_argument("--workers", type=int, default=1)
    asked = parser.parse_args()
    for name in asked.vehicle:
        job = partial(one_vehicle, name=name, counts=asked.flights, keep=asked.keep)
        with ProcessPoolExecutor(asked.workers) as pool:
            runs = list(pool.map(job, range(asked.seeds)))
        print(f"{name}, {asked.seeds} vehicles, flights of {SECONDS:g} s, in %")
        print("\n".join(table(runs, asked.flights)), flush=True)


if __name__ == "__main__":
    main()
