"""An attitude controller tuned on vehicles drawn from the posterior, beside hand-set ranges.

    python benchmarks/randomisation.py [--seeds 4] [--seconds 30] [--evaluations 80]

Per seed: the quadrotor of  rotorfit simulate single --variant noisy  flies (commands only, lag
unknown) and is identified. Four gains of the stock autopilot (attitude, rate and damping of roll
and pitch, rate of yaw) are tuned in MuJoCo, each time from the stock ones, by Nelder and Mead: what
is minimised is the mean, over the vehicles of a set, of the mean error in steps of roll, pitch and
yaw rate, as a share of the step. The sets differ:

    estimate   the identified vehicle alone
    posterior  vehicles drawn from the result, as  rotorfit export --to mujoco --samples  does
    +-20 %     thrust, drag torque, lag and moments of inertia within 20 % of the estimate, each by
               itself and uniformly; the CoM within 2 % of the arm
    guess      the same ranges about a guess that is itself so far off the truth, CoM in the middle

The autopilot takes the vehicle for the middle of the set. The gains are then flown on the true
vehicle, on 20 other draws from the posterior and on 20 vehicles within 20 % of the true one, of
which the worst counts. A flight that turns over costs as much as one that never moved.
"""

import argparse
import os
import tempfile
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.optimize import minimize

from rotorfit.errors import FlightWarning
from rotorfit.export.mujoco import FREE, fly_manoeuvre
from rotorfit.export.variants import variants
from rotorfit.export.vehicle import VehicleModel, is_possible
from rotorfit.export.vehicle_model import vehicle_model
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify
from rotorfit.results.validation.fly_outcome import BEFORE, STEPS, is_lost
from rotorfit.simulation.controller import Gains
from rotorfit.simulation.experiment_files import simulate
from rotorfit.simulation.experiments import FULL_SPEED, plan_experiment
from rotorfit.simulation.truth import Truth

SHARE = 0.2
COM_SHARE = 0.02
TESTED = 20
STOCK = np.log([5.8, 25.0, 1.0, 3.0])
Cost = Callable[[np.ndarray], float]


def gains_of(logs: np.ndarray) -> Gains:
    """Return the autopilot's gains of the four that are tuned."""
    attitude, rate, damping, yaw = np.exp(logs).tolist()
    return replace(
        FREE,
        attitude=(attitude, attitude, FREE.attitude[2]),
        rate=(rate, rate, yaw),
        damping=(damping, damping, 0.0),
    )


def cost(logs: np.ndarray, model: VehicleModel, believed: VehicleModel) -> float:
    """Return the mean error of the steps, as a share of their size."""
    total = 0.0
    for step in STEPS:
        flight = fly_manoeuvre(model, step, believed=believed, gains=gains_of(logs))
        late = flight.time >= BEFORE
        error = np.abs(flight.flown - flight.asked)[late].mean() / flight.asked[-1]
        total += 1.0 if is_lost(flight) else min(float(error), 1.0)
    return total / len(STEPS)


def tuned(models: Sequence[VehicleModel], believed: VehicleModel, evaluations: int) -> np.ndarray:
    """Return the logarithms of the gains that fly a set of vehicles best on average."""
    found = minimize(
        lambda logs: float(np.mean([cost(logs, model, believed) for model in models])),
        STOCK,
        method="Nelder-Mead",
        options={
            "maxfev": evaluations,
            "initial_simplex": STOCK + np.vstack([[0] * 4, np.eye(4) / 3]),
        },
    )
    return found.x


def true_model(nominal: VehicleModel, truth: Truth) -> VehicleModel:
    """Return the vehicle that really flew, as the export writes one."""
    spread = truth.kt_spread or (1.0,) * len(nominal.rotors)
    return replace(
        nominal,
        com=np.array(truth.first_moments) / truth.mass,
        inertia_com=truth.com_inertia,
        rotors=tuple(
            replace(rotor, kt=truth.kt * own)
            for rotor, own in zip(nominal.rotors, spread, strict=True)
        ),
        kd=truth.kd,
        lag_up=truth.motor_lag,
        lag_down=truth.motor_lag,
        max_speed=FULL_SPEED,
    )


def near(middle: VehicleModel, chance: np.random.Generator) -> VehicleModel:
    """Return a vehicle within the hand-set ranges, one that can exist."""
    while True:
        kt, kd, lag, *moments = chance.uniform(1.0 - SHARE, 1.0 + SHARE, 6)
        scale = np.sqrt(np.array(moments))
        arm = float(np.linalg.norm(middle.arms[:, :2], axis=1).mean())
        drawn = replace(
            middle,
            com=middle.com + COM_SHARE * arm * chance.uniform(-1.0, 1.0, 3),
            inertia_com=middle.inertia_com * np.outer(scale, scale),
            rotors=tuple(replace(rotor, kt=kt * rotor.kt) for rotor in middle.rotors),
            kd=kd * middle.kd,
            lag_up=lag * middle.lag_up,
            lag_down=lag * middle.lag_down,
        )
        if is_possible(drawn):
            return drawn


def identified(seed: int, seconds: float):
    """Return the result of a simulated flight, and what flew."""
    plan = plan_experiment("single", "noisy", seed=seed, seconds=seconds)
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore", FlightWarning)
        path = simulate(Path(name) / "flown", "single", variant="noisy", seed=seed, seconds=seconds)
        return identify(load_experiment(path)), plan.configurations[0].simulated.truth


def one_seed(
    seed: int, *, seconds: float, count: int, evaluations: int
) -> dict[str, tuple[float, ...]]:
    """Return by set: cost on the true vehicle, worst of the posterior, worst within 20 %; gains."""
    result, truth = identified(seed, seconds)
    nominal = vehicle_model(result, needs=TARGETS["mujoco"].needs)
    chance = np.random.default_rng(seed)
    real = true_model(nominal, truth)
    guess = replace(near(real, chance), com=np.array([0.0, 0.0, 0.0]))
    sets = {
        "stock": (nominal, ()),
        "estimate": (nominal, (nominal,)),
        "posterior": (nominal, variants(result, nominal, count=count, seed=seed).models),
        "+-20 %": (nominal, tuple(near(nominal, chance) for _ in range(count))),
        "guess": (guess, tuple(near(guess, chance) for _ in range(count))),
        "truth": (real, (real,)),
    }
    others = variants(result, nominal, count=TESTED, seed=1000 + seed).models
    around = [near(real, chance) for _ in range(TESTED)]
    rows: dict[str, tuple[float, ...]] = {}
    for name, (believed, models) in sets.items():
        logs = tuned(models, believed, evaluations) if models else STOCK
        worst = [max(cost(logs, m, believed) for m in group) for group in (others, around)]
        rows[name] = (cost(logs, real, believed), *worst, *np.exp(logs).tolist())
    return rows


def table(runs: Sequence[dict[str, tuple[float, ...]]]) -> list[str]:
    """Return one line per set: medians over the seeds, and how often it beats the hand-set one."""
    lines = [
        f"{'tuned on':10s} {'true':>7s} {'(range)':>15s} {'posterior':>10s} {'+-20 %':>7s}"
        f"  {'attitude':>8s} {'rate':>6s} {'damping':>7s} {'yaw':>5s}   better than +-20 %: "
        "true, posterior, +-20 %"
    ]
    for name in runs[0]:
        rows = np.array([run[name] for run in runs])
        hand = np.array([run["+-20 %"] for run in runs])
        true, posterior, wide, *gains = np.median(rows, axis=0)
        ends = f"{rows[:, 0].min():.4f}-{rows[:, 0].max():.4f}"
        wins = [int(n) for n in (rows < hand)[:, :3].sum(axis=0)]
        lines.append(
            f"{name:10s} {true:7.4f} {ends:>15s} {posterior:10.4f} {wide:7.4f}"
            f"  {gains[0]:8.2f} {gains[1]:6.1f} {gains[2]:7.2f} {gains[3]:5.2f}   {wins}"
        )
    return lines


def main() -> None:
    """Run the seeds, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--vehicles", type=int, default=6)
    parser.add_argument("--evaluations", type=int, default=80)
    parser.add_argument("--workers", type=int, default=1)
    asked = parser.parse_args()
    seeds = range(asked.first_seed, asked.first_seed + asked.seeds)
    runs: list[dict[str, tuple[float, ...]]] = []
    with ProcessPoolExecutor(asked.workers) as pool:
        study = partial(
            one_seed, seconds=asked.seconds, count=asked.vehicles, evaluations=asked.evaluations
        )
        for seed, run in zip(seeds, pool.map(study, seeds), strict=True):
            runs.append(run)
            costs = (f"{name} {' '.join(f'{v:.4g}' for v in row)}" for name, row in run.items())
            print(f"seed {seed}: {'; '.join(costs)}", flush=True)
    print(f"{asked.seeds} flights of {asked.seconds:g} s, {asked.vehicles} vehicles in each set")
    print("\n".join(table(runs)))


if __name__ == "__main__":
    main()
