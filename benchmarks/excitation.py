"""How wrong does too little excitation make the estimates, and do verdicts and intervals tell?

    python benchmarks/excitation.py [--runs 10] [--body mujoco] [--disturbance S2b S2]
        [--level 1 0.3 0.1 0.03 0] [-o RUNS.jsonl]

The paper's vehicle A with rotor inertia (J_r = 2e-5 kg m^2) flies with the pilot's sticks made
smaller, down to hands off, in gusts; its log has measured rotor speed. S2b: gusts of 0.1 N and
6, 6, 1.5 mN m; S2: 0.3 N and 20, 20, 5 mN m (deviation of each component, Gauss-Markov, 3 Hz).

Printed per level: rho of each axis (explained over residual angular-acceleration power), and per
number how often it is given, how often its interval misses the truth, and the error of the estimate
whether given or withheld. Then over all runs, by rho: the error as a share of the truth, times rho.
The body is MuJoCo's (`pip install "rotorfit[test]"`) or the own simulator's.
"""

import argparse
import json
import os
import sys
import tempfile
import warnings
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "recovery"))

import numpy as np

from rotorfit.errors import FlightWarning, RotorfitError
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.identification import identify_flights
from rotorfit.results.result import IdentificationResult
from rotorfit.simulation import (
    Scenario,
    Sensors,
    Stick,
    Sticks,
    Truth,
    paper_vehicle,
    simulate_flight,
    write_flight_table,
)
from rotorfit.simulation.experiment_files import true_parameters

NUMBERS = {
    "Ixx_com": "roll",
    "Iyy_com": "pitch",
    "Izz_com": "yaw",
    "kd": "yaw",
    "Jr": "yaw",
    "kd_over_Izz": "yaw",
    "Jr_over_Izz": "yaw",
}
"""What is looked at besides kt, and the axis that it depends on."""
GUSTS = {
    "none": (0.0, (0.0, 0.0, 0.0)),
    "S2b": (0.1, (6e-3, 6e-3, 1.5e-3)),
    "S2": (0.3, (20e-3, 20e-3, 5e-3)),
}
"""Deviation of force [N] and torque [N m]."""
SENSORS = Sensors(gyro_std=0.02, accel_std=0.4, gyro_bias=(0.012, -0.008, 0.006))
RHO_EDGES = (0.0, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 50.0, 1e9)


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """What is the same in all runs of a study.

    Attributes
    ----------
    body
        Whose engine moves the vehicle: mujoco or own.
    seconds
        Of each flight, take-off and landing left out [s].
    rotor_noise
        Of the logged rotor speeds [rad/s].
    delay_known
        Whether the experiment says that rotor speeds are logged without delay.
    """

    body: str
    seconds: float
    rotor_noise: float
    delay_known: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """One number of one run.

    Attributes
    ----------
    disturbance, level, seed
        Of the run.
    name
        Of the number.
    rho
        Excitation of its axis; nan for kt.
    error, half_width
        Of the estimate before any verdict, as a share of the truth.
    given
        Whether the result gives the number.
    verdict
        Of the parameter; empty for derived numbers.
    """

    disturbance: str
    level: float
    seed: int
    name: str
    rho: float
    error: float
    half_width: float
    given: bool
    verdict: str

    @property
    def missed(self) -> bool:
        """Whether the interval does not hold the truth."""
        return abs(self.error) > self.half_width


def flown_truth(disturbance: str) -> Truth:
    """Return vehicle A with rotor inertia and drag, in gusts."""
    force, torque = GUSTS[disturbance]
    return replace(
        paper_vehicle("A").truth,
        Jr=2e-5,
        drag=(0.12, 0.12, 0.0),
        disturbance_force_std=(force,) * 3,
        disturbance_torque_std=torque,
    )


def sticks_of(level: float) -> Sticks:
    """Return the pilot's sticks, all smaller by one factor."""
    full = Sticks()
    return Sticks(
        roll=_smaller(full.roll, level),
        pitch=_smaller(full.pitch, level),
        yaw=_smaller(full.yaw, level),
        climb=_smaller(full.climb, level),
    )


def _smaller(stick: Stick, level: float) -> Stick:
    return replace(stick, rms=level * stick.rms)


def write_experiment(
    folder: Path, truth: Truth, setting: Setting, *, level: float, seed: int
) -> Path:
    """Fly once, and write log and experiment."""
    vehicle, table = paper_vehicle("A").vehicle, folder / "flight.csv"
    sticks = sticks_of(level)
    sensors = replace(SENSORS, rotor_speed_std=setting.rotor_noise)
    if setting.body == "mujoco":
        import mujoco_flight

        flown = mujoco_flight.fly(
            truth, vehicle, seed=seed, seconds=setting.seconds, sticks=sticks, sensors=sensors
        )
        mujoco_flight.write_table(flown, table)
    else:
        scenario = Scenario(
            seconds=setting.seconds, ground_seconds=2.0, sticks=sticks, sensors=sensors
        )
        write_flight_table(simulate_flight(truth, vehicle, scenario, seed=seed), table)
    rotors = ", ".join(
        f'{{ position = {list(r.position)}, spin = "{r.spin}" }}' for r in vehicle.rotors
    )
    motors = "[motors]\ndelay = 0.0" if setting.delay_known else ""
    path = folder / "experiment.toml"
    path.write_text(
        f"[airframe]\nrotors = [{rotors}]\nimu = {{ position = [0.0, 0.0, 0.0] }}\n"
        f"{motors}\n"
        f'[[configuration]]\nmass = {truth.mass!r}\nflights = ["flight.csv"]\n',
        encoding="utf-8",
    )
    return path


def one_run(
    job: tuple[str, float, int], *, setting: Setting
) -> tuple[tuple[str, float, int], list[Found]]:
    """Fly and identify once."""
    disturbance, level, seed = job
    truth = flown_truth(disturbance)
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore", FlightWarning)
        path = write_experiment(Path(name), truth, setting, level=level, seed=seed)
        try:
            found = identify_flights(load_experiment(path))
        except RotorfitError as error:
            print(f"{disturbance} x {level} seed {seed} refused: {error}", file=sys.stderr)
            return job, []
        except (ValueError, np.linalg.LinAlgError) as error:
            print(f"{disturbance} x {level} seed {seed} BROKE: {error}", file=sys.stderr)
            return job, []
    assert found.fit is not None
    return job, _found(job, truth, found.fit.numbers, found.result)


def _found(
    job: tuple[str, float, int], truth: Truth, numbers: Numbers, result: IdentificationResult
) -> list[Found]:
    true = true_parameters(truth, rotors=4)
    found: list[Found] = []
    for name in ("kt", *NUMBERS):
        full = name if name in numbers.names else f"{name}@A"
        i, rho = numbers.index(full), numbers.rho(full)
        base = name.removesuffix("_com")
        parameter = None if "over" in name else result.parameter(base)
        shown = parameter if name in ("kt", "kd", "Jr") else result.derived_value(name)
        assert shown is not None
        found.append(
            Found(
                disturbance=job[0],
                level=job[1],
                seed=job[2],
                name=name,
                rho=float("nan") if rho is None else float(rho),
                error=float(numbers.values[i]) / true[name] - 1.0,
                half_width=float(numbers.half_width[i]) / abs(true[name]),
                given=shown.value is not None,
                verdict="" if parameter is None else parameter.verdict,
            )
        )
    return found


def level_table(found: Sequence[Found]) -> list[str]:
    """Return one line per disturbance, level and number."""
    lines = [
        f"{'gusts':5s} {'sticks':>6s} {'number':12s} {'rho':>8s} {'given':>6s} {'wrong':>6s} "
        f"{'held':>6s} {'error %: median':>16s} {'|largest|':>10s} {'half-width %':>13s}"
    ]
    for key in dict.fromkeys((f.disturbance, f.level, f.name) for f in found):
        group = [f for f in found if (f.disturbance, f.level, f.name) == key]
        given = [f for f in group if f.given]
        error = 100 * np.array([f.error for f in group])
        lines.append(
            f"{key[0]:5s} {key[1]:6g} {key[2]:12s} {np.median([f.rho for f in group]):8.2f} "
            f"{len(given):3d}/{len(group):<2d} {sum(f.missed for f in given):6d} "
            f"{sum(not f.missed for f in group) / len(group):6.2f} {np.median(error):+16.2f} "
            f"{np.abs(error).max():10.2f} {100 * np.median([f.half_width for f in group]):13.2f}"
        )
    return lines


def rho_table(found: Sequence[Found]) -> list[str]:
    """Return one line per number and range of rho: quantiles of the error times rho."""
    lines = [
        f"{'number':12s} {'rho':>10s} {'runs':>5s} {'given':>6s} {'held':>5s} "
        f"{'error %: 5':>11s} {'50':>7s} {'95':>7s}   {'error x rho: 5':>14s} {'50':>6s} {'95':>6s}"
    ]
    for name in NUMBERS:
        own = [f for f in found if f.name == name]
        for low, high in pairwise(RHO_EDGES):
            group = [f for f in own if low <= f.rho < high]
            if not group:
                continue
            error = np.array([f.error for f in group])
            scaled = error * np.array([f.rho for f in group])
            e, s = (
                np.quantile(100 * error, (0.05, 0.5, 0.95)),
                np.quantile(scaled, (0.05, 0.5, 0.95)),
            )
            lines.append(
                f"{name:12s} {low:4g}-{'' if high > 1e8 else f'{high:g}':5s} {len(group):5d} "
                f"{sum(f.given for f in group):6d} "
                f"{sum(not f.missed for f in group) / len(group):5.2f} "
                f"{e[0]:+11.1f} {e[1]:+7.1f} {e[2]:+7.1f}   {s[0]:+14.2f} {s[1]:+6.2f} {s[2]:+6.2f}"
            )
    return lines


def main() -> None:
    """Run the study, and print its tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=75.0)
    parser.add_argument("--body", choices=("mujoco", "own"), default="mujoco")
    parser.add_argument("--rotor-noise", type=float, default=1.0)
    parser.add_argument("--delay-known", action="store_true")
    parser.add_argument("--disturbance", nargs="+", choices=tuple(GUSTS), default=["S2b", "S2"])
    parser.add_argument("--level", nargs="+", type=float, default=[1.0, 0.3, 0.1, 0.03, 0.0])
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, help="append every number of every run here")
    asked = parser.parse_args()
    seeds = range(asked.first_seed, asked.first_seed + asked.runs)
    jobs = [(d, level, s) for s in seeds for d in asked.disturbance for level in asked.level]
    setting = Setting(
        body=asked.body,
        seconds=asked.seconds,
        rotor_noise=asked.rotor_noise,
        delay_known=asked.delay_known,
    )
    found: list[Found] = []
    with ProcessPoolExecutor(asked.workers) as pool:
        for _, numbers in pool.map(partial(one_run, setting=setting), jobs):
            found += numbers
            if asked.output is not None:
                with asked.output.open("a", encoding="utf-8") as file:
                    file.writelines(json.dumps(asdict(f)) + "\n" for f in numbers)
    found.sort(key=lambda f: (asked.disturbance.index(f.disturbance), -f.level))
    print("\n".join(level_table(found)))
    print()
    print("\n".join(rho_table(found)))


if __name__ == "__main__":
    main()
