"""What is planted in a simulated fleet: is it found, and nothing else?

    python -m benchmarks.fleet_study [--seeds 20] [--flights 25] [--identified FOLDER]
    python -m benchmarks.fleet_study --page fleet.html [--vehicles 400]
    python -m benchmarks.fleet_study --logs FOLDER [--vehicles 10] [--flights 12] [--seconds 20]

20 vehicles of 25 flights. Some flights are simulated and identified once; every flight of the
fleet then has the covariance of one of them, and errors drawn from it (whether real errors are as
large as that is printed first). Planted: two propellers that wear by 1 % a flight, one battery that
shifts by 5 mm, one vehicle with other propellers. The same fleets with nothing planted follow.

With --page one such fleet is drawn and its page is written; time and size are printed. With --logs
every flight is simulated into a log of its own and read by `rotorfit fleet`: two propellers that
wear, a shift, other propellers, a log that breaks off, and two that hang.
"""

import argparse
import dataclasses
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pandas
from benchmarks.common import identify_flights, named_vehicle, true_values
from benchmarks.recovery import flown
from jaxtyping import Float

from rotorfit.report.fleet_page import fleet_html
from rotorfit.results.result import IdentificationResult
from rotorfit.simulation import Scenario, Truth, simulate_flight, variant, write_flight_table
from rotorfit.simulation.experiment_files import IMU_AND_SPEED
from rotorfit.tools.fleet.compared import TOGETHER
from rotorfit.tools.fleet.records import KT_WEIGHT, FlightRecord
from rotorfit.tools.fleet.statistics import FleetStatistics, NumberStatistics, fleet_statistics

VEHICLES, FLIGHTS, SECONDS = 20, 25, 40.0
LEVEL: Final = {
    KT_WEIGHT: 4e-6,
    "kt_1": 4.08e-6,
    "kt_2": 3.92e-6,
    "kt_3": 4.04e-6,
    "kt_4": 3.96e-6,
    "kd": 6e-8,
    "Jr": 2e-5,
    "com_x": 8.6e-3,
    "com_y": -5.7e-3,
    "com_z": -11.4e-3,
    "Ixx_com": 0.0238,
    "Iyy_com": 0.0277,
    "Izz_com": 0.0439,
}
"""Of the type."""
BETWEEN: Final = {
    **dict.fromkeys((KT_WEIGHT, "kt_1", "kt_2", "kt_3", "kt_4"), 0.005),
    "kd": 0.005,
    "Jr": 0.005,
    "Ixx_com": 0.002,
    "Iyy_com": 0.002,
    "Izz_com": 0.004,
    "com_x": 3e-4,
    "com_y": 3e-4,
    "com_z": 3e-4,
}
"""Between vehicles of one make: of the level, but in metres for lengths."""
WITHIN: Final = {
    **dict.fromkeys((KT_WEIGHT, "kt_1", "kt_2", "kt_3", "kt_4", "kd"), 5e-4),
    "Jr": 0.0,
    "Ixx_com": 5e-4,
    "Iyy_com": 5e-4,
    "Izz_com": 5e-4,
    "com_x": 1e-4,
    "com_y": 1e-4,
    "com_z": 1e-4,
}
"""Between flights of one: the battery is never put quite the same."""
SIZE: Final = LEVEL | dict.fromkeys(("com_x", "com_y", "com_z"), 0.25)
"""What 100 % is: lengths count by the arm [m]."""
CHANCE: Final = 4e-4
"""Scatter of k_t by the weight between flights, measured on the identified ones."""
WORN: Final = {2: ("kt_2", 5), 10: ("kt_4", 10)}
"""Vehicle: which propeller wears, and from which flight on (both from 0)."""
SHIFTED: Final = (6, "com_x", 12, 5e-3)
OTHER: Final = (14, {**dict.fromkeys(LEVEL, 1.0), "kd": 1.10, "Jr": 1.15})
OTHER_KT: Final = 1.05

Numbers = dict[str, Float[np.ndarray, "v f"]]
"""Every flight's true numbers; with one column each vehicle's level."""


def template(result: IdentificationResult, file: str) -> FlightRecord:
    """Return what a fleet keeps of an identified flight, as far as this study needs it."""
    names = tuple(name for name in LEVEL if name != KT_WEIGHT)
    numbers = {n.name: n for n in (*result.parameters, *result.derived)}
    value = np.array([float(numbers[name].value or np.nan) for name in names])
    ends = np.array([numbers[name].interval or (np.nan, np.nan) for name in names])
    std = (ends[:, 1] - ends[:, 0]) / 3.92
    kt = result.diagnostics["kt_of_weight"]
    names, value = (KT_WEIGHT, *names), np.array([kt, *value])
    std = np.array([CHANCE * kt, *std])
    at = [result.covariance_names.index(n) for n in ("kd", "Jr", "Izz@A")]
    C = result.covariance[np.ix_(at, at)]
    C = C / np.sqrt(np.outer(np.diag(C), np.diag(C)))
    own = [std[names.index(name)] for name in TOGETHER]
    return FlightRecord(
        file=file,
        sha256="",
        vehicle="",
        configuration="A",
        mass=1.4,
        seconds_used=SECONDS,
        names=names,
        values=value,
        std=std,
        low=value - 1.96 * std,
        high=value + 1.96 * std,
        verdicts=("identified",) * len(names),
        compared=TOGETHER,
        covariance=C * np.outer(own, own),
    )


def identified(folder: Path, count: int) -> list[FlightRecord]:
    """Return flights that were simulated and identified; kept in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    out: list[FlightRecord] = []
    for seed in range(count):
        path = folder / f"{seed}.json"
        if not path.exists():
            (result,) = identify_flights(
                {"A": flown("quad-x", "real", seconds=SECONDS, seed=seed)}, ("",)
            )
            if result is None:
                continue
            result.save(path)
        out.append(template(IdentificationResult.load(path), path.name))
    return out


def print_errors(templates: Sequence[FlightRecord]) -> None:
    """Print whether the errors of the identified flights are as large as stated."""
    flight = flown("quad-x", "real", seconds=2.0, seed=0)
    true = true_values(flight) | LEVEL
    print(f"{len(templates)} identified flights: mean error and scatter over the stated deviation")
    for name in LEVEL:
        errors = np.array([(r.value(name) - true[name]) / r.deviation(name) for r in templates])
        print(f"  {name:10s} {errors.mean():+6.2f} {errors.std(ddof=1):5.2f}")


def true_fleet(
    rng: np.random.Generator, flights: int, *, planted: bool, vehicles: int = VEHICLES
) -> tuple[Numbers, Numbers]:
    """Return the true numbers of every flight, and each vehicle's level before any change."""
    truth: Numbers = {}
    levels: Numbers = {}
    for name, level in LEVEL.items():
        unit = 1.0 if name.startswith("com") else level
        own = level + unit * BETWEEN[name] * rng.standard_normal((vehicles, 1))
        levels[name] = own
        truth[name] = own + unit * WITHIN[name] * rng.standard_normal((vehicles, flights))
    if not planted:
        return truth, levels
    for vehicle, (rotor, first) in WORN.items():
        lost = 0.01 * np.maximum(np.arange(flights) - first + 1, 0)
        truth[rotor][vehicle] *= 1.0 - lost
        truth[KT_WEIGHT][vehicle] *= 1.0 - 0.25 * lost
    vehicle, name, first, size = SHIFTED
    truth[name][vehicle, first:] += size
    vehicle, factors = OTHER
    for name, factor in factors.items():
        truth[name][vehicle] *= OTHER_KT if "kt" in name else factor
    return truth, levels


def estimated(
    rng: np.random.Generator, truth: Numbers, templates: Sequence[FlightRecord]
) -> list[FlightRecord]:
    """Return the flights' records: the truth, with errors of an identified flight's covariance."""
    out: list[FlightRecord] = []
    vehicles, flights = next(iter(truth.values())).shape
    for v in range(vehicles):
        for f in range(flights):
            like = templates[int(rng.integers(len(templates)))]
            values = np.array([truth[name][v, f] for name in like.names])
            error = like.std * rng.standard_normal(len(values))
            at = [like.names.index(name) for name in TOGETHER]
            error[at] = np.linalg.cholesky(like.covariance) @ rng.standard_normal(len(at))
            record = dataclasses.replace(
                like, file=f"{v:02d}/{f:02d}", vehicle=f"V{v + 1:02d}", values=values + error
            )
            out.append(record)
    return out


def is_planted(vehicle: int, name: str, kind: str) -> bool:
    """Say whether a number of a vehicle was made to change, or to differ."""
    if kind == "apart":
        return vehicle == OTHER[0] and ("kt" in name or name in ("kd", "Jr"))
    worn = WORN.get(vehicle, ("", 0))[0]
    return (name in (worn, KT_WEIGHT) and bool(worn)) or (vehicle, name) == SHIFTED[:2]


def said(statistics: FleetStatistics) -> Counter[tuple[int, str, str]]:
    """Return everything that is said to have changed or to stand apart."""
    out: Counter[tuple[int, str, str]] = Counter()
    for number in statistics.numbers:
        for place, vehicle in enumerate(number.vehicles):
            if number.changes[place]:
                out[vehicle, number.name, "change"] += 1
            if number.outlying[place]:
                out[vehicle, number.name, "apart"] += 1
    return out


def must() -> set[tuple[int, str, str]]:
    """Return what has to be found."""
    worn = {(v, rotor, "change") for v, (rotor, _) in WORN.items()}
    other = {(OTHER[0], name, "apart") for name in (KT_WEIGHT, "kt_1", "kt_2", "kt_3", "kt_4")}
    return worn | other | {(*SHIFTED[:2], "change")}


Score = dict[str, list[float]]


def level_scores(number: NumberStatistics, levels: Numbers, scores: Mapping[str, Score]) -> None:
    """Add how far the levels of vehicles in which nothing is planted are from the truth."""
    planted = {*WORN, SHIFTED[0], OTHER[0]}
    keep = [i for i, v in enumerate(number.vehicles) if v not in planted]
    true = levels[number.name][[number.vehicles[i] for i in keep], 0]
    for kind in ("own", "shrunk"):
        lone = kind == "own" or number.outlying[keep]
        error = np.where(lone, number.level[keep], number.shrunk[keep]) - true
        std = np.where(lone, number.level_std[keep], number.shrunk_std[keep])
        scores[kind].setdefault(number.name, []).extend(error.tolist())
        scores[f"{kind} held"].setdefault(number.name, []).extend(np.abs(error) <= 1.96 * std)


def study(templates: Sequence[FlightRecord], *, seeds: int, flights: int, planted: bool) -> None:
    """Print what is found over the seeds."""
    scores: dict[str, Score] = {k: {} for k in ("own", "shrunk", "own held", "shrunk held")}
    missed: Counter[str] = Counter()
    false: Counter[str] = Counter()
    fleets_with = Counter[str]()
    dated, seconds = 0, 0.0
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        truth, levels = true_fleet(rng, flights, planted=planted)
        records = estimated(rng, truth, templates)
        start = time.process_time()
        statistics = fleet_statistics(records)
        seconds += time.process_time() - start
        found = said(statistics)
        wrong = [x for x in found if not (planted and is_planted(*x))]
        false.update(f"V{v + 1:02d} {name} {kind}" for v, name, kind in wrong)
        fleets_with.update({kind for _, _, kind in wrong})
        if planted:
            missed.update(f"V{v + 1:02d} {name} {kind}" for v, name, kind in must() - set(found))
            dated += rightly_dated(statistics)
        for number in statistics.numbers:
            level_scores(number, levels, scores)
    print(
        f"{seeds} fleets of {VEHICLES} x {flights} flights, {'' if planted else 'nothing '}planted"
    )
    print(f"  {seconds / seeds:.1f} processor seconds a fleet")
    if planted:
        print(f"  missed: {dict(missed) or 'nothing'}")
        print(f"  first flight of a change within its interval: {dated / seeds / 3:.2f}")
    print(f"  fleets with a false change: {fleets_with['change']} of {seeds}")
    print(f"  fleets with a vehicle falsely apart: {fleets_with['apart']} of {seeds}")
    print(f"  what: {dict(false)}")
    print(f"  {'':10s} {'own held':>9s} {'shrunk held':>11s} {'rmse shrunk / own':>18s}")
    for name, errors in scores["own"].items():
        ratio = _rms(scores["shrunk"][name]) / _rms(errors)
        own, shrunk = (np.mean(scores[k][name]) for k in ("own held", "shrunk held"))
        print(f"  {name:10s} {own:9.3f} {shrunk:11.3f} {ratio:18.2f}")
    held = [
        np.mean([h for x in scores[k].values() for h in x]) for k in ("own held", "shrunk held")
    ]
    own, shrunk = (_rms([_rms(scores[k][n]) / SIZE[n] for n in SIZE]) for k in ("own", "shrunk"))
    print(f"  {'all':10s} {held[0]:9.3f} {held[1]:11.3f} {shrunk / own:18.2f}")
    print(
        f"  rms error over all numbers, own {100 * own:.2f} %, shrunk {100 * shrunk:.2f} %",
        flush=True,
    )


def page(templates: Sequence[FlightRecord], path: Path, *, vehicles: int, flights: int) -> None:
    """Write the page of one fleet."""
    rng = np.random.default_rng(0)
    truth, _ = true_fleet(rng, flights, planted=True, vehicles=vehicles)
    records = estimated(rng, truth, templates)
    start = time.process_time()
    statistics = fleet_statistics(records)
    compared = time.process_time()
    path.write_text(fleet_html(statistics, records, name=path.stem), encoding="utf-8")
    drawn = time.process_time()
    print(f"{len(records)} flights of {vehicles} vehicles: compared in {compared - start:.0f}")
    print(f"processor seconds, drawn in {drawn - compared:.1f}; {path.stat().st_size / 1e6:.1f} MB")


def rightly_dated(statistics: FleetStatistics) -> int:
    """Return how many of the three changes have their first flight within its interval."""
    places = [(v, rotor, first) for v, (rotor, first) in WORN.items()] + [SHIFTED[:3]]
    right = 0
    for vehicle, name, first in places:
        number = statistics.number(name)
        changes = () if number is None else number.changes[number.vehicles.index(vehicle)]
        right += any(c.earliest <= first <= c.latest for c in changes)
    return right


AIRFRAME: Final = """[airframe]
rotors = [{rotors}]
imu = {{ position = {imu} }}
[motors]
speed = "measured"
"""


LOG_WORN: Final = {1: (1, 3), 7: (2, 8)}
"""Of the logs: vehicle, rotor, first flight with a loss, all counted from 0."""


def write_logs(folder: Path, *, vehicles: int, flights: int, seconds: float) -> None:
    """Write a fleet as logs, and their list: two wear, a battery shifts, one vehicle is other."""
    rng = np.random.default_rng(1)
    (truth, vehicle), sensors = variant(named_vehicle("quad-x"), "real")
    for v in range(vehicles):
        own = manufactured(truth, rng, other=v == 5)
        for f in range(flights):
            path = folder / f"V{v + 1:02d}" / f"flight{f + 1}.csv"
            if path.exists():
                continue
            path.parent.mkdir(parents=True, exist_ok=True)
            rotor, first = LOG_WORN.get(v, (0, flights))
            lost = np.where(np.arange(4) == rotor, 0.01 * max(f - first + 1, 0), 0.0)
            moved = own.mass * 5e-3 if v == 3 and f >= flights // 2 else 0.0
            x, y, z = own.first_moments
            flown_one = dataclasses.replace(
                own,
                kt_spread=tuple((np.array(own.kt_spread) * (1.0 - lost)).tolist()),
                first_moments=(x + moved, y, z),
            )
            scenario = Scenario(seconds=seconds, ground_seconds=2.0, sensors=sensors)
            flight = simulate_flight(flown_one, vehicle, scenario, seed=1000 * v + f)
            write_flight_table(flight, path, channels=IMU_AND_SPEED)
    whole = (folder / "V01" / "flight1.csv").read_bytes()
    (folder / "V01" / "broken.csv").write_bytes(whole[: len(whole) // 50])
    for v in (2, 9):  # a pipe that nobody writes into is a log that never ends
        hanging = folder / f"V{v + 1:02d}" / "hanging.csv"
        if not hanging.exists():
            os.mkfifo(hanging)
    listed = sorted(path.relative_to(folder).as_posix() for path in folder.glob("V*/*.csv"))
    (folder / "logs.csv").write_text("\n".join(["file", *listed]) + "\n", encoding="utf-8")
    rotors = ", ".join(
        f'{{ position = {list(r.position)}, spin = "{r.spin}" }}' for r in vehicle.rotors
    )
    text = AIRFRAME.format(rotors=rotors, imu=list(vehicle.imu_position or ()))
    (folder / "airframe.toml").write_text(text, encoding="utf-8")


def print_levels(table: Path, vehicles: int) -> None:
    """Print how far the levels of vehicles in which nothing is planted are from the truth."""
    rows = pandas.read_parquet(table)
    rng = np.random.default_rng(1)
    truth = variant(named_vehicle("quad-x"), "real")[0].truth
    true: dict[str, list[float]] = {}
    for v in range(vehicles):
        own = manufactured(truth, rng, other=v == 5)
        values = own.parameters() | dict(
            zip(("com_x", "com_y", "com_z"), own.center_of_mass.tolist(), strict=True)
        )
        kt = own.rotor_kt(4)
        values |= {f"kt_{i}": float(x) for i, x in enumerate(kt, 1)} | {KT_WEIGHT: kt.mean()}
        for name in LEVEL:
            true.setdefault(name, []).append(values[name])
    quiet = [v for v in range(vehicles) if v not in (*LOG_WORN, 3, 5)]
    print(f"{'':10s} {'error of all':>12s} {'rms about it':>12s} {'stated std':>10s}  [%]")
    held, held_about = list[bool](), list[bool]()
    for name in LEVEL:
        error = (rows[name] - true[name]).to_numpy()[quiet] / SIZE[name] * 100.0
        std = rows[f"{name}_std"].to_numpy()[quiet] / SIZE[name] * 100.0
        about = error - error.mean()
        print(f"{name:10s} {error.mean():+12.2f} {about.std():12.2f} {std.mean():10.2f}")
        held += (np.abs(error) <= 1.96 * std).tolist()
        held_about += (np.abs(about) <= 1.96 * std).tolist()
    print(f"{sum(held)} of {len(held)} intervals hold the truth; without the error common to all,")
    print(f"{sum(held_about)}")


def manufactured(truth: Truth, rng: np.random.Generator, *, other: bool) -> Truth:
    """Return one vehicle of a type: half a percent here, a third of a millimetre there."""
    half = 1.0 + 0.005 * rng.standard_normal(7)
    moved = 3e-4 * truth.mass * rng.standard_normal(3)
    x, y, z = (np.array(truth.first_moments) + moved).tolist()
    spread = np.array(truth.kt_spread) * half[:4]
    kd, Jr, size = (half[4:] * ([1.1, 1.15, 1.0] if other else 1.0)).tolist()
    xx, yy, zz, xy, xz, yz = truth.inertia
    return dataclasses.replace(
        truth,
        first_moments=(x, y, z),
        inertia=(size * xx, size * yy, size * zz, xy, xz, yz),
        kt_spread=tuple((spread * (OTHER_KT if other else 1.0)).tolist()),
        kd=kd * truth.kd,
        Jr=Jr * truth.Jr,
    )


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    """Run the studies that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--flights", type=int, nargs="+", default=[FLIGHTS])
    parser.add_argument("--identified", type=Path, default=Path("build/fleet_study"))
    parser.add_argument("--count", type=int, default=25, help="flights to identify")
    parser.add_argument("--logs", type=Path, help="folder for simulated logs")
    parser.add_argument("--page", type=Path, help="page of one fleet")
    parser.add_argument("--vehicles", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=20.0)
    asked = parser.parse_args()
    if asked.logs is not None:
        logs = asked.logs / "logs"
        flights = asked.flights[0]
        write_logs(logs, vehicles=asked.vehicles, flights=flights, seconds=asked.seconds)
        words = ["--airframe", str(logs / "airframe.toml"), "--mass", "1.4", "--workers", "1"]
        words += ["--time-limit", "60", "-o", str(asked.logs / "fleet"), "--force"]
        table = str(logs / "logs.csv")
        subprocess.run([sys.executable, "-m", "rotorfit", "fleet", table, *words], check=True)
        print_levels(asked.logs / "fleet" / "vehicles.parquet", asked.vehicles)
        return
    templates = identified(asked.identified, asked.count)
    if asked.page is not None:
        page(templates, asked.page, vehicles=asked.vehicles, flights=asked.flights[0])
        return
    print_errors(templates)
    for flights in asked.flights:
        for planted in (True, False):
            study(templates, seeds=asked.seeds, flights=flights, planted=planted)


if __name__ == "__main__":
    main()
