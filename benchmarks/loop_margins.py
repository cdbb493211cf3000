"""Do the intervals of a loop's margins hold? Simulated flights of known controllers and vehicles.

    python -m benchmarks.loop_margins [--flights 40] [--seed 1]
    python -m benchmarks.loop_margins --logs DATA

Flies worlds of `benchmarks.worlds` without hazards (an engine and a rate loop of their own, gains
over a factor of four, one in five close to oscillating), identifies each from its commands, judges
its roll and pitch loops, and compares with the margins of the exact loop: controller and filter as
discrete responses, motors, mixer and body as the engine has them. Prints how often each interval
holds, with its median half-width and error, how many loops were proved, and the doubts of others.
With --logs: the table of docs/loop.md, of the logs of real autopilot programs in a folder of data.
"""

import argparse
import dataclasses
import os
import warnings
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from benchmarks.real_flights import cases
from benchmarks.worlds.engine import Batch, Record, low_pass
from benchmarks.worlds.pilot import STEP
from benchmarks.worlds.sensing import write_world
from benchmarks.worlds.world import World, draw_world

from rotorfit.errors import RotorfitError
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify
from rotorfit.logs import read_log
from rotorfit.logs.controller_log import ControllerLog
from rotorfit.tools.control_loop.controllers import RateController
from rotorfit.tools.control_loop.loop import AxisLoop, judge_flight, loop_margins
from rotorfit.tools.control_loop.margins import margins
from rotorfit.tools.control_loop.plant import GyroFilter, Response, hold

MEASURES = ("crossover", "phase", "gain", "delay", "sensitivity")
SHORT = 30.0
"""Length of a flight [s]."""


class Recorded(Batch):
    """A batch that keeps what its rate loops were asked and answered."""

    def __init__(self, worlds: list[World]) -> None:
        super().__init__(worlds)
        self.missed: list[np.ndarray] = []
        self.answered: list[np.ndarray] = []

    def _torque(self, miss: np.ndarray, gyro: np.ndarray) -> np.ndarray:
        torque = super()._torque(miss, gyro)
        self.missed.append((miss + gyro).astype(np.float32))
        self.answered.append((torque / self.believed).astype(np.float32))
        return torque


def world_of(seed: int, index: int) -> World:
    """Draw a quiet world with commands in its log, and gains of its own."""
    world = draw_world(seed, index, {}, SHORT)
    rng = np.random.default_rng([seed, index, 99])
    factor = rng.uniform(2.2, 3.0) if index % 5 == 4 else np.exp(rng.uniform(-0.7, 0.7))
    return dataclasses.replace(
        world,
        autopilot=dataclasses.replace(world.autopilot, rate=factor * world.autopilot.rate),
        flight=dataclasses.replace(world.flight, manoeuvre="lively"),
        log=dataclasses.replace(
            world.log, driven="commanded", has=("gyro", "accel", "command"), rate=500
        ),
    )


def controller_of(world: World) -> RateController:
    """Return the rate controller of roll and pitch."""
    a = world.autopilot
    return RateController(
        P=a.rate, I=a.rate * a.integral, D=0.0, FF=0.0, angle=a.attitude, period=STEP,
        gyro_filters=(GyroFilter(frequency=a.lowpass, order=a.order),),
    )  # fmt: skip


def gyro_filter(world: World, z: Response) -> Response:
    """Compute the response of the low-pass that the rate loop hears through."""
    b0, b1, b2, a1, a2 = low_pass(world.autopilot.lowpass, world.autopilot.order)
    return (b0 + b1 / z + b2 / z**2) / (1.0 + a1 / z + a2 / z**2)


def true_loop(world: World, axis: int, frequency: np.ndarray) -> Response:
    """Compute the exact open loop of an axis, with its attitude loop."""
    v = world.vehicle
    arm = float(v.kd.mean() / v.kt.mean())
    asked = np.column_stack(
        [np.ones(len(v.spins)), v.places[:, 1], -v.places[:, 0], -arm * v.spins]
    )
    share = np.linalg.pinv(asked.T)[:, 1 + axis] * world.autopilot.believed[axis]
    square = share * v.inertia[axis, axis] / v.kt.mean()
    torque = (np.cross(v.places - v.com, v.axes) * v.kt[:, None]).T @ square
    gain = np.linalg.solve(v.inertia, torque)[axis]
    s, z = 2j * np.pi * frequency, np.exp(2j * np.pi * frequency * STEP)
    motors = np.exp(-1e-3 * world.motors.delay_ms * s) / (1.0 + world.motors.lag_up * s)
    plant = gain / s * motors * hold(frequency, STEP) * gyro_filter(world, z)
    controller = controller_of(world)
    return plant * (controller.from_rate(frequency) + controller.from_angle(frequency))


def judged(world: World, record: Record, batch: Recorded, i: int, folder: Path) -> list[AxisLoop]:
    """Identify a world, and judge its loops of roll and pitch."""
    path = write_world(world, record, folder)
    result = identify(load_experiment(path))
    rows = slice(10, len(record.gyro) - 30)
    log = ControllerLog(
        autopilot="PX4",
        firmware="simulated",
        parameters={},
        changed=(),
        time=STEP * np.arange(rows.stop - rows.start),
        set_point=np.array([row[:, i] for row in batch.missed[rows]], dtype=float),
        rate=record.filtered[rows],
        output=np.array([row[:, i] for row in batch.answered[rows]], dtype=float),
    )
    flight = read_log(path.with_suffix(".csv"))
    outcome = judge_flight(result, "A", flight, log, read=lambda _log, _axis: controller_of(world))
    return list(outcome.axes[:2])


def table_of_logs(data: Path) -> None:
    """Print replay, agreement by bands, and margins of the logs of autopilots."""
    heads = ("log", "axis", "replay", "size and phase at 1, 3, 8, 17 Hz", "crossover", "phase")
    heads = (*heads, "gain", "peak")
    print(f"| {' | '.join(heads)} |\n|{' --- |' * len(heads)}")
    for case in (one for one in cases(data) if one.group == "autopilots"):
        with TemporaryDirectory() as folder:
            path = Path(folder) / "experiment.toml"
            path.write_text(case.declaration, encoding="utf-8")
            experiment = load_experiment(path)
            log = Path(str(experiment.configuration[0].flights[0].file))
            try:
                outcome = loop_margins(identify(experiment), log)
            except RotorfitError as error:
                print(f"| {case.name} | | {str(error).partition(': ')[2]} | | | | | |")
                continue
        for loop in outcome.axes[:2]:
            print(f"| {case.name} | {loop.axis} | {_row(loop)} |")


def _row(loop: AxisLoop) -> str:
    found = loop.with_attitude
    near = [next(b for b in loop.bands if b.low <= at < b.high) for at in (1.0, 3.0, 8.0, 17.0)]
    return " | ".join(
        [
            f"{loop.replay.slope:.3f}, {100 * loop.replay.left:.1f} % left",
            ", ".join(
                f"{b.ratio:.2f} {b.degrees:+.0f}" if b.uncertainty < 0.25 else "-" for b in near
            ),
            f"{found.crossover.value:.1f} Hz",
            f"{found.phase.value:.0f} ({found.phase.low:.0f}..{found.phase.high:.0f})",
            f"{found.gain.value:.1f} ({found.gain.low:.1f}..{found.gain.high:.1f})",
            f"{found.sensitivity.value:.2f}" if not loop.doubts else f"unproved: {loop.doubts[0]}",
        ]
    )


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--flights", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--logs", type=Path, metavar="DATA")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    if asked.logs is not None:
        table_of_logs(asked.logs)
        return
    worlds = [world_of(asked.seed, i) for i in range(asked.flights)]
    batch = Recorded(worlds)
    records = batch.flown()
    held: dict[str, list[tuple[bool, float, float]]] = {name: [] for name in MEASURES}
    said = Counter[str]()
    with TemporaryDirectory() as folder:
        for i, (world, record) in enumerate(zip(worlds, records, strict=True)):
            try:
                if record.lost:
                    said["out of control"] += 2
                    continue
                loops = judged(world, record, batch, i, Path(folder))
            except RotorfitError as error:
                said[f"refused: {error.finding.kind}"] += 2
                continue
            for axis, loop in enumerate(loops):
                said[loop.doubts[0][:60] if loop.doubts else "proved"] += 1
                if loop.doubts:
                    continue
                exact = margins(loop.frequency, true_loop(world, axis, loop.frequency)[None, :])
                for name in MEASURES:
                    true = float(getattr(exact, name)[0])
                    found = getattr(loop.with_attitude, name)
                    if np.isfinite(true) and np.isfinite(found.value):
                        half = 0.5 * (found.high - found.low)
                        inside = found.low <= true <= found.high
                        held[name].append((inside, half / true, abs(found.value / true - 1.0)))
    for words, count in said.most_common():
        print(f"{count:4d} loops: {words}")
    for name, rows in held.items():
        if rows:
            inside, half, error = np.array(rows, dtype=float).T
            print(
                f"{name:12s} holds {inside.mean():.2f} of {len(rows)}, half-width "
                f"{100 * np.median(half):.1f} %, error {100 * np.median(error):.1f} % (median)"
            )


if __name__ == "__main__":
    main()
