"""Do the intervals of fast flights hold the truth, and is a filtered accelerometer found?

    python -m benchmarks.fast_worlds --seed 48 --worlds 40 -o fast.jsonl  # goes on
    python -m benchmarks.fast_worlds --show fast.jsonl

Each world is a quadrotor of random size that flies fast (5 to 15 m/s, to and fro, in circles or
eights) through air at rest, with the drag of its rotors, inflow, moments of the wakes, a little
drag of the frame, gusts, unequal rotors and a biased accelerometer, which in half of the worlds
passes a low-pass of 3 to 20 Hz. The velocity is that of motion capture, or an autopilot's estimate
with .15 m/s of error; the propellers' diameter is declared or not. Prints for every number how
often its interval holds the truth where it is given, how wide it is, and the worst misses; then
how many low-passes are found within 20 %.
"""

import argparse
import json
import os
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import cos, pi, sin
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import rotorfit.identification as recipe
from rotorfit.errors import FlightWarning, RotorfitError
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.fit.sensors import known_faults
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.model.vehicle import Rotor, Vehicle
from rotorfit.simulation import (
    GRAVITY,
    Course,
    Scenario,
    Sensors,
    Stick,
    Sticks,
    Truth,
    simulate_flight,
    write_flight_table,
)
from rotorfit.simulation.experiment_files import true_parameters
from rotorfit.simulation.truth import steiner, tensor_elements

Row = dict[str, Any]
SAID: Final = ("identified", "weak")
AIR_DENSITY: Final = 1.2
WITHIN: Final = 0.2
"""Share of a low-pass by which the one found may be off."""
LARGEST_PUSH: Final = 4.5
"""Largest acceleration of a course [m/s^2]: with its drag, a lean of 45 degrees at 15 m/s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """A vehicle, how it is flown and measured, and what the user declares.

    - `estimated`: whether the velocity is an autopilot's estimate.
    - `declared`: whether the propellers' diameter is in the experiment.
    """

    index: int
    truth: Truth
    vehicle: Vehicle
    scenario: Scenario
    estimated: bool
    declared: bool


def draw_world(seed: int, index: int, *, seconds: float) -> World:
    """Draw a world; one seed and index give one world."""
    rng = np.random.default_rng([seed, index])
    mass, arm = _draw_size(rng)
    vehicle, propeller = _draw_vehicle(rng, arm)
    truth = _draw_truth(rng, mass=mass, arm=arm, propeller=propeller)
    speed = float(rng.uniform(5.0, 15.0))
    course = Course(
        route=rng.choice(["to-and-fro", "circles", "eights"]).item(),
        speed=speed,
        size=max(2.0 * speed**2 / LARGEST_PUSH, 5.0) * float(rng.uniform(0.6, 1.2)),
        lean=4.0 * truth.rotor_drag * _hover_speed(truth) / mass,
    )
    estimated = bool(rng.random() < 0.5)
    sensors = Sensors(
        gyro_std=0.02,
        accel_std=0.4,
        rotor_speed_std=3.0,
        accel_bias=(*rng.normal(0.0, 0.1, 3).tolist(),),
        accel_cutoff=float(np.exp(rng.uniform(*np.log([3.0, 20.0])))) * bool(rng.random() < 0.5),
        velocity_std=0.15 if estimated else 0.0,
    )
    sticks = Sticks(
        roll=Stick(band=(0.2, 1.3), rms=0.08),
        pitch=Stick(band=(0.2, 1.1), rms=0.08),
        climb=Stick(band=(0.3, 1.5), rms=1.3),
    )
    scenario = Scenario(
        seconds=seconds,
        ground_seconds=1.0,
        sticks=sticks,
        course=course,
        sensors=sensors,
        physics_rate=200.0,
        thrust_to_weight=3.5,
    )
    return World(
        index=index,
        truth=truth,
        vehicle=vehicle,
        scenario=scenario,
        estimated=estimated,
        declared=bool(rng.random() < 0.5),
    )


def _draw_size(rng: np.random.Generator) -> tuple[float, float]:
    """Draw mass [kg] and arm [m]: larger vehicles are heavier."""
    arm = float(np.exp(rng.uniform(*np.log([0.09, 0.28]))))
    return 45.0 * arm**2 * float(rng.uniform(0.7, 1.4)), arm


def _draw_vehicle(rng: np.random.Generator, arm: float) -> tuple[Vehicle, float]:
    """Draw the places of four rotors, with the diameter of their propellers [m]."""
    angle = rng.uniform(38.0, 52.0) * pi / 180.0
    x, y = arm * cos(angle), arm * sin(angle)
    places = ((x, -y, "ccw"), (-x, y, "ccw"), (x, y, "cw"), (-x, -y, "cw"))
    rotors = tuple(Rotor(position=(px, py, 0.0), spin=spin) for px, py, spin in places)
    propeller = 2.0 * min(x, y) * float(rng.uniform(0.7, 0.9))
    imu = (*(0.1 * arm * rng.normal(size=3)).tolist(),)
    return Vehicle(rotors=rotors, imu_position=imu), propeller


def _draw_truth(rng: np.random.Generator, *, mass: float, arm: float, propeller: float) -> Truth:
    """Draw what the vehicle is, and what the air does to it."""
    hover = 120.0 / propeller * rng.uniform(0.8, 1.2)  # tips at 60 m/s
    kt = mass * GRAVITY / (4.0 * hover**2)
    speeds = 4.0 * hover
    disks = 4.0 * np.pi * propeller**2 / 4.0
    com = arm * np.array([0.03, 0.03, 0.1]) * rng.normal(size=3)
    roll = rng.uniform(0.2, 0.3)
    shape = np.diag([roll, roll * rng.uniform(1.0, 1.3), rng.uniform(0.4, 0.5)])
    inertia = mass * arm**2 * shape + mass * steiner(com)
    weight = mass * GRAVITY
    # A quarter to half of the rotors' power becomes lift: T v_h over kd O^3 (figure of merit).
    induced = (weight / (2.0 * AIR_DENSITY * disks)) ** 0.5
    return Truth(
        mass=mass,
        first_moments=(*(mass * com).tolist(),),
        inertia=tensor_elements(inertia),
        kt=float(kt),
        kd=float(kt * induced / (hover * rng.uniform(0.25, 0.5))),
        Jr=float(mass * arm**2 * rng.uniform(2e-4, 8e-4)),
        kt_spread=(*(1.0 + 0.015 * rng.normal(size=4)).tolist(),),
        motor_lag=float(rng.uniform(0.025, 0.05)),
        drag=(*(mass * rng.uniform(0.0, 0.1, 3)).tolist(),),
        rotor_drag=float(mass * rng.uniform(0.15, 0.6) / speeds),
        inflow=float(mass * rng.uniform(0.3, 1.0) / speeds),
        wake_moment=(*(AIR_DENSITY * disks * arm * rng.uniform(0.1, 0.6, 2)).tolist(),),
        propeller=propeller,
        disturbance_force_std=(0.01 * weight,) * 3,
        disturbance_torque_std=(0.004 * weight * arm,) * 2 + (0.001 * weight * arm,),
    )


def _hover_speed(truth: Truth) -> float:
    """Return the speed of each of four rotors in hover [rad/s]."""
    return float((truth.mass * GRAVITY / (4.0 * truth.kt)) ** 0.5)


def row_of(world: World, folder: Path) -> Row:
    """Fly and identify a world."""
    flight = simulate_flight(world.truth, world.vehicle, world.scenario, seed=world.index)
    speed = np.linalg.norm(flight.velocity[flight.airborne], axis=1)
    row: Row = {
        "index": world.index,
        "course": world.scenario.course.route if world.scenario.course else None,
        "speed": [float(speed.mean()), float(speed.max())],
        "cutoff": world.scenario.sensors.accel_cutoff,
        "estimated": world.estimated,
        "declared": world.declared,
        "truth": true_parameters(world.truth, rotors=4)
        | dict(zip(("drag_x", "drag_y", "drag_z"), world.truth.drag, strict=True)),
    }
    table = folder / "flight.csv"
    table.unlink(missing_ok=True)
    write_flight_table(flight, table, channels=("gyro", "accel", "rotor_speed", "velocity"))
    (folder / "world.toml").write_text(experiment_text(world), encoding="utf-8")
    return row | _identified(folder / "world.toml", estimated=world.estimated)


def experiment_text(world: World) -> str:
    """Write the experiment that a user of this vehicle would write."""
    rotors = ", ".join(
        f'{{ position = {list(rotor.position)}, spin = "{rotor.spin}" }}'
        for rotor in world.vehicle.rotors
    )
    size = f"propeller = {world.truth.propeller}\n" if world.declared else ""
    return (
        f"[airframe]\nrotors = [{rotors}]\n{size}"
        f"imu = {{ position = {list(world.vehicle.imu_position or ())} }}\n"
        f'[[configuration]]\nmass = {world.truth.mass}\nflights = ["flight.csv"]\n'
    )


def _identified(path: Path, *, estimated: bool) -> Row:
    """Identify; return numbers, terms, findings and the accelerometer's bandwidth.

    `estimated`: the table stands for the log of an autopilot, whose velocity is an estimate.
    """
    found: Row = {}

    def keep(dataset: TimedDataset) -> TimedDataset:
        measured: TimedDataset = timed(dataset)
        flight = measured.configurations[0].flights[0]
        band = flight.bandwidths.get("accel")
        found["bandwidth"] = None if band is None else [band.cutoff, *band.interval]
        return measured

    timed, began = recipe.measured_at_timing, time.process_time()
    with (
        warnings.catch_warnings(),
        patch.object(recipe, "measured_at_timing", keep),
        patch.object(known_faults, "is_estimate", lambda form: estimated),
    ):
        warnings.simplefilter("ignore", FlightWarning)
        try:
            result = recipe.identify(load_experiment(path))
        except RotorfitError as error:
            return found | {"refused": str(error)}
    return found | {
        "seconds": time.process_time() - began,
        "terms": result.settings["used"]["terms"],
        "findings": [[one.kind, one.severity] for one in result.findings],
        "numbers": {
            n.name: [n.value, 0.5 * (n.interval[1] - n.interval[0]), n.verdict]
            for n in (*result.parameters, *result.derived)
            if n.value is not None and n.interval is not None
        },
    }


def misses(row: Row) -> Iterator[tuple[str, float, float, str]]:
    """Yield each number that is given: its error over its half-width, the latter over its size."""
    for name, (value, half, verdict) in row.get("numbers", {}).items():
        true = row["truth"].get(name)
        if true is None or not half > 0.0 or verdict == "given":
            continue
        yield name, (value - true) / half, half / max(abs(true), 1e-12), verdict


def report(rows: Sequence[Row]) -> list[str]:
    """Return the tables of a study."""
    refused = [row for row in rows if "numbers" not in row]
    lines = [f"{len(rows)} worlds, {len(refused)} refused"]
    lines += [f"  world {row['index']}: {row['refused']}" for row in refused]
    every = [(row, *one) for row in rows for one in misses(row)]
    for title, kept in (
        ("identified", [one for one in every if one[4] == "identified"]),
        ("identified or weak", [one for one in every if one[4] in SAID]),
    ):
        if kept:
            holds = np.mean([abs(one[2]) <= 1.0 for one in kept])
            lines += [f"{title}: {holds:.3f} of {len(kept)} hold"]
    lines += [
        "number           holds (of)  identified  half-width %  error/half-width: median, worst"
    ]
    for name in dict.fromkeys(one[1] for one in every if one[4] in SAID):
        own = [one for one in every if one[1] == name and one[4] in SAID]
        off = np.array([one[2] for one in own])
        holds, width = np.mean(np.abs(off) <= 1.0), np.median([one[3] for one in own])
        sure = sum(one[4] == "identified" for one in own)
        worst = off[np.argmax(np.abs(off))]
        lines += [
            f"{name:15} {holds:5.2f} ({len(own):3}) {sure:9} {100 * width:12.1f}"
            f"  {np.median(off):+7.2f} {worst:+7.2f}"
        ]
    for key in ("estimated", "declared"):
        for value in (False, True):
            own = [one for one in every if one[4] == "identified" and one[0][key] is value]
            if own:
                holds = np.mean([abs(one[2]) <= 1.0 for one in own])
                lines += [f"{key} {value}: {holds:.3f} of {len(own)} identified hold"]
    return lines + _report_bandwidths(rows)


def _report_bandwidths(rows: Sequence[Row]) -> list[str]:
    """Return how many low-passes are found, and how many where there is none."""
    known = [row for row in rows if "bandwidth" in row]
    there = [row for row in known if row["cutoff"]]
    near = [
        row
        for row in there
        if row["bandwidth"] and abs(row["bandwidth"][0] / row["cutoff"] - 1.0) <= WITHIN
    ]
    none = [row for row in known if not row["cutoff"]]
    found = [row["bandwidth"] for row in there if row["bandwidth"]]
    held = [row for row in there if row["bandwidth"]]
    held = [row for row in held if row["bandwidth"][1] <= row["cutoff"] <= row["bandwidth"][2]]
    lines = [
        f"accelerometer's low-pass found in {len(found)} of {len(there)}, its interval holds in "
        f"{len(held)}, within {100 * WITHIN:.0f} %: {len(near)}; "
        f"found where there is none: {sum(bool(r['bandwidth']) for r in none)} of {len(none)}"
    ]
    return lines + [
        f"  world {row['index']}: {row['cutoff']:.1f} Hz, found {row['bandwidth']}"
        for row in there
        if row not in near
    ]


def read_rows(path: Path) -> list[Row]:
    """Read the rows of a study that has begun."""
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def main() -> None:
    """Fly the worlds that are not in the file yet, and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=48)
    parser.add_argument("--worlds", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=25.0)
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--show", type=Path)
    asked = parser.parse_args()
    path = asked.show or asked.output
    rows = read_rows(path) if path else []
    for index in range(0 if asked.show else asked.worlds):
        if index in {row["index"] for row in rows}:
            continue
        world = draw_world(asked.seed, index, seconds=asked.seconds)
        with tempfile.TemporaryDirectory() as folder:
            rows.append(row_of(world, Path(folder)))
        if path:
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    print("\n".join(report(rows)))


if __name__ == "__main__":
    main()
