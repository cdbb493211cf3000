"""Do intervals hold on flights with known truth that nothing here made?

    python -m benchmarks.real_flights [--only cinerat fives swapped worlds autopilots crazyflie
        imrc] [--workers 2] [-o after.json] [--against before.json]

Runs the default estimate on the logs of `$ROTORFIT_DATA` (or `../shared/data`):

- `cinerat`: thirteen flights of one 3-inch quadrotor, each alone, against the consensus of 26;
- `fives`: ten of them in two joint fits that share no flight, against that and one another;
- `swapped`, `squared`: the thirteen, wrongly declared: the frame's sides exchanged or made equal;
- `worlds`: six flights of an independent engine;
- `autopilots`: PX4 and ArduPilot flying simulated vehicles;
- `crazyflie`: the commands-only logs at hand, beside the figures of their sources;
- `imrc`: seven flights of two weighed Crazyflies with measured speed, and five of them together,
  against their thrust stands.

Prints, case by case, value over truth and half-width in percent, marked `!` where the interval does
not hold the truth; then every sentence; then per number how often it holds and its median
half-width. --against prints the same numbers of an earlier run beside them.
"""

import argparse
import json
import os
import warnings
from collections.abc import Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from benchmarks.common import real_data_folder

from rotorfit.errors import RotorfitError
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify

SHOWN = ("kt", "kd", "Ixx_com", "Iyy_com", "Izz_com", "Jr", "kd_over_Izz", "Jr_over_Izz",
         "Ixy_com", "Ixz_com", "Iyz_com", "com_x", "com_y", "com_z", "motor_lag",
         "drag_x", "drag_z")  # fmt: skip
CINERAT = {
    "kt": 2.69e-7, "Ixx_com": 5.90e-4, "Iyy_com": 7.23e-4, "Izz_com": 8.74e-4, "Jr": 8.63e-7,
    "kd": 3.66e-9, "kd_over_Izz": 4.15e-6, "Jr_over_Izz": 9.9e-4,
}  # fmt: skip
COMMANDED = '[motors]\nspeed = "commanded"\n'
FIRST = (230, 232)
"""Flights with other thrust per rpm than those after them (README of the logs)."""
FLIGHTS = (230, 232, 257, 260, 264, 266, 267, 269, 271, 275, 277, 340, 341)
FIVES = {"early": (257, 260, 264, 266, 267), "late": (269, 271, 275, 277, 340)}
SIDES = {"cinerat": (0.0455, 0.0635), "swapped": (0.0635, 0.0455), "squared": (0.0545, 0.0545)}
BRUSHED = ("jana00", "jana02", "jana03", "jana10", "jana11")
"""Flights of a brushed Crazyflie 2.1 on two days."""
PAYLOAD = ("payload_eckart17", "payload_eckart24")
"""Flights of a brushless Crazyflie with a payload on a cable."""
STANDS = {"brushed": 2.02e-8, "payload": 3.775e-8}
"""k_t by their thrust stands (README of the logs) [N s^2]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One log, how it is declared, and what is true of it."""

    name: str
    group: str
    declaration: str
    truth: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What rotorfit says of a case: value, half-width and verdict by number, and its sentences."""

    numbers: Mapping[str, tuple[float, float, str]]
    sentences: tuple[str, ...]
    refused: str = ""


def cases(data: Path) -> Iterable[Case]:
    """Yield every case, for a folder of logs."""
    for group, (x, y) in SIDES.items():
        for number in FLIGHTS:
            log = data / "tudelft-indiflight" / f"LOG{number:05d}.BFL"
            text = _cinerat(x, y) + _configuration(0.428, log)
            truth = {k: v for k, v in CINERAT.items() if number not in FIRST or k != "kt"}
            yield Case(name=f"{group} {number}", group=group, declaration=text, truth=truth)
    for name, numbers in FIVES.items():
        logs = [data / "tudelft-indiflight" / f"LOG{number:05d}.BFL" for number in numbers]
        text = _cinerat(*SIDES["cinerat"]) + _configuration(0.428, *logs)
        yield Case(name=f"fives {name}", group="fives", declaration=text, truth=CINERAT)
    for path in sorted((data / "mujoco-worlds").glob("w*.toml")):
        text = path.read_text(encoding="utf-8").replace(
            f'"{path.stem}.csv"', f'"{path.with_suffix(".csv")}"'
        )
        truth = json.loads(path.with_name(f"{path.stem}.truth.json").read_text(encoding="utf-8"))
        yield Case(name=path.stem, group="worlds", declaration=text, truth=truth)
    yield from _autopilots(data / "autopilot-sitl")
    log15 = data / "arplab-crazyflie" / "log15"
    text = '[airframe]\nlayout = "quad-x"\narm = 0.046\norder = "crazyflie"\n' + COMMANDED
    yield Case(
        name="crazyflie log15", group="crazyflie", declaration=text + _configuration(0.027, log15)
    )
    yield from _weighed_crazyflies(data / "imrc-crazyflie")


def _weighed_crazyflies(folder: Path) -> Iterable[Case]:
    """Yield the flights of two weighed Crazyflies, and five of one of them together."""
    rows = [
        *((name, (name,), 0.0347, 0.046, "brushed") for name in BRUSHED),
        ("five together", BRUSHED, 0.0347, 0.046, "brushed"),
        *((name, (name,), 0.0444, 0.050, "payload") for name in PAYLOAD),
    ]
    for name, logs, mass, arm, vehicle in rows:
        airframe = f'[airframe]\nlayout = "quad-x"\narm = {arm}\norder = "crazyflie"\n'
        motors = '[motors]\nspeed = "measured"\n'
        text = airframe + motors + _configuration(mass, *(folder / log for log in logs))
        truth = {"kt": STANDS[vehicle]}
        yield Case(name=f"imrc {name}", group="imrc", declaration=text, truth=truth)


def _cinerat(x: float, y: float) -> str:
    places = ((-x, -y, "cw"), (x, -y, "ccw"), (-x, y, "ccw"), (x, y, "cw"))
    return _rotors(places) + '[motors]\nspeed = "measured"\n'


def _rotors(places: Iterable[tuple[float, float, str]]) -> str:
    lines = [f'  {{ position = [{x}, {y}, 0.0], spin = "{spin}" }},' for x, y, spin in places]
    return "[airframe]\nrotors = [\n" + "\n".join(lines) + "\n]\n"


def _configuration(mass: float, *logs: Path) -> str:
    files = ", ".join(f'"{log}"' for log in logs)
    return f'[[configuration]]\nname = "A"\nmass = {mass}\nflights = [{files}]\n'


def _quad_x(order: str, arm: float) -> str:
    return f'[airframe]\nlayout = "quad-x"\norder = "{order}"\narm = {arm}\n{COMMANDED}'


def _heavy() -> str:
    """Return a quad-x of .42 x .56 m; PX4 and ArduPilot count its rotors alike."""
    x, y = 0.21, 0.28
    places = ((x, -y, "ccw"), (-x, y, "ccw"), (x, y, "cw"), (-x, -y, "cw"))
    return _rotors(places) + COMMANDED


def _hexarotor() -> str:
    """Return the hexarotor of the log's CA_ROTOR* parameters (FRD), on a circle of .3 m."""
    angles = np.radians([30.0, 90.0, 150.0, 210.0, 270.0, 330.0])
    places = [
        (0.3 * float(np.cos(angle)), -0.3 * float(np.sin(angle)), "cw" if i % 2 else "ccw")
        for i, angle in enumerate(angles)
    ]
    return _rotors(places) + COMMANDED


def _autopilots(folder: Path) -> Iterable[Case]:
    def truth(name: str) -> dict[str, float]:
        found = json.loads((folder / f"{name}.truth.json").read_text(encoding="utf-8"))
        numbers = found["numbers"]
        return {k: v for k, v in numbers.items() if k not in ("Jr", "Jr_over_Izz")}

    inertia = {"Ixx_com": 0.02377, "Iyy_com": 0.02771, "Izz_com": 0.04385}
    exported = {"kt": 4.0e-6 * 1450.0**2, "kd": 6.0e-8 * 1450.0**2, **inertia}
    stock = {"kt": 5.0, "kd": 0.1, "Ixx_com": 0.025, "Iyy_com": 0.025, "Izz_com": 0.03}
    stock["motor_lag"] = -0.004 / float(np.log(1.0 - 0.004 / 0.05))  # of thrust, in steps
    copter = {"Ixx_com": 0.02297, "Iyy_com": 0.02297, "Izz_com": 0.04594}
    rows = (
        ("px4-sih-stock", ".ulg", _quad_x("px4", 0.2828427), 1.0, stock),
        ("px4-sih-exported", ".ulg", _quad_x("px4", 0.25), 1.4, exported),
        ("arducopter-stock", ".BIN", _quad_x("ardupilot", 0.35), 3.0, copter),
        ("arducopter-exported", ".BIN", _quad_x("ardupilot", 0.25), 1.4, exported),
        ("arducopter-default-logging", ".BIN", _quad_x("ardupilot", 0.35), 3.0, copter),
        ("px4-heavy-recommended", ".ulg", _heavy(), 3.2, truth("px4-heavy-recommended")),
        ("px4-hex", ".ulg", _hexarotor(), 1.7, truth("px4-hex")),
        ("ap-heavy-recommended", ".BIN", _heavy(), 3.2, truth("ap-heavy-recommended")),
        ("ap-heavy-raw", ".BIN", _heavy(), 3.2, truth("ap-heavy-recommended")),
    )
    for name, suffix, airframe, mass, known in rows:
        text = airframe + _configuration(mass, folder / f"{name}{suffix}")
        yield Case(name=name, group="autopilots", declaration=text, truth=known)


def outcome(case: Case) -> Outcome:
    """Identify a case."""
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = Path(folder) / "experiment.toml"
        path.write_text(case.declaration, encoding="utf-8")
        try:
            result = identify(load_experiment(path))
        except RotorfitError as error:
            return Outcome(numbers={}, sentences=(), refused=str(error))
    numbers = {
        one.name: (
            one.value,
            0.5 * (one.interval[1] - one.interval[0]),
            getattr(one, "verdict", ""),
        )
        for one in (*result.parameters, *result.derived)
        if one.value is not None and one.interval is not None
    }
    return Outcome(numbers=numbers, sentences=tuple(result.warnings))


def case_lines(case: Case, found: Outcome, before: Outcome | None) -> list[str]:
    """Return what a case found, one number a column, and its sentences."""
    lines = [f"{case.name}", "  now    " + _numbers(case, found)]
    if before is not None:
        lines.append("  before " + _numbers(case, before))
    return [*lines, *(f"    - {sentence}" for sentence in found.sentences)]


def _numbers(case: Case, found: Outcome) -> str:
    if found.refused:
        return f"REFUSED: {found.refused}"
    return "  ".join(
        _number(name, *found.numbers[name], case.truth.get(name))
        for name in SHOWN
        if name in found.numbers
    )


def _number(name: str, value: float, half: float, verdict: str, true: float | None) -> str:
    size = true or value or half
    wrong = true is not None and abs(value - true) > half
    short = {"identified": "", "weak": "w", "": ""}.get(verdict, f"[{verdict}]")
    if true is None:
        return f"{name}={value:.3g}+-{100 * half / abs(size):.1f}%{short}"
    if true == 0.0:
        return f"{name} {value:+.2g}+-{half:.2g}{short}{'!' * wrong}"
    return f"{name} {value / true:.3f}+-{100 * half / abs(size):.1f}%{short}{'!' * wrong}"


def summary(rows: Iterable[tuple[Case, Outcome]]) -> list[str]:
    """Return, group by group, how often each number holds, and its median half-width."""
    rows = list(rows)
    lines: list[str] = []
    for group in dict.fromkeys(case.group for case, _ in rows):
        of_group = [(case, found) for case, found in rows if case.group == group]
        refused = sum(bool(found.refused) for _, found in of_group)
        lines.append(f"{group}: {len(of_group)} flights, {refused} refused")
        for name in SHOWN:
            held, halves, errors = [], [], []
            for case, found in of_group:
                true = case.truth.get(name)
                if not true or name not in found.numbers:
                    continue
                value, half, _ = found.numbers[name]
                held.append(abs(value - true) <= half)
                halves.append(100 * half / abs(true))
                errors.append(100 * abs(value - true) / abs(true))
            if held:
                lines.append(
                    f"  {name:12s} holds {sum(held):2d} of {len(held):2d}, half-width "
                    f"{np.median(halves):6.2f} %, error {np.median(errors):6.2f} % (median)"
                )
    return lines


def agreement(one: Outcome, other: Outcome) -> list[str]:
    """Return by how much two fits to different flights differ, over the interval of that."""
    lines: list[str] = []
    for name in SHOWN:
        if name in one.numbers and name in other.numbers:
            (a, half_a, _), (b, half_b, _) = one.numbers[name], other.numbers[name]
            ratio = abs(a - b) / float(np.hypot(half_a, half_b))
            lines.append(f"  {name:12s} {ratio:5.2f}{' !' * (ratio > 1.0)}")
    return lines


def main() -> None:
    """Run the cases that are asked for, and print what they say."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", default=[], help="groups, or names of cases")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--against", type=Path)
    asked = parser.parse_args()
    chosen = [
        case
        for case in cases(real_data_folder())
        if not asked.only or case.group in asked.only or case.name in asked.only
    ]
    with ProcessPoolExecutor(asked.workers) as pool:
        found = dict(zip((case.name for case in chosen), pool.map(outcome, chosen), strict=True))
    earlier = _read(asked.against) if asked.against else {}
    for case in chosen:
        print("\n".join(case_lines(case, found[case.name], earlier.get(case.name))))
    print("\n".join(summary((case, found[case.name]) for case in chosen)))
    fives = [found[case.name] for case in chosen if case.group == "fives"]
    if len(fives) == 2:
        print("fives: difference over its interval")
        print("\n".join(agreement(*fives)))
    if asked.output:
        written = {name: asdict(one) for name, one in found.items()}
        asked.output.write_text(json.dumps(written, indent=1), encoding="utf-8")


def _read(path: Path) -> dict[str, Outcome]:
    read = json.loads(path.read_text(encoding="utf-8"))
    return {
        name: Outcome(
            numbers={key: tuple(value) for key, value in one["numbers"].items()},
            sentences=tuple(one["sentences"]),
            refused=one["refused"],
        )
        for name, one in read.items()
    }


if __name__ == "__main__":
    main()
