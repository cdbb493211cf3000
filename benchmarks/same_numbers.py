"""Do two versions of rotorfit say the same? Every number and message, on real logs and simulated.

    python -m benchmarks.same_numbers -o before.json
    (change the code)
    python -m benchmarks.same_numbers -o after.json --against before.json [--table table.md]

Runs the command line on every log of the real data ($ROTORFIT_DATA, ../shared/data) and on
`simulate paper` in all variants, and keeps what was printed and how it ended. With --against it
prints, case by case, whether the two are equal to the last bit, but for keys that are new (`NEW`),
and where not, the largest step of a parameter in units of its standard deviation before. --table
writes what both find on the real logs side by side, values with half of their intervals.
"""

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from benchmarks.common import real_data_folder

NEW = ("findings", "interval_terms", "schema", "imu_tilt_std_deg")
"""Keys of a result that older versions do not have."""
PROGRESS = re.compile(r"\(\d+ s so far\)$")
"""End of a line that is printed every few seconds: how many there are tells of the machine."""
VARIANTS = ("clean", "lag", "noisy", "real")
CRAZYFLIE = '[airframe]\nlayout = "quad-x"\narm = 0.046\norder = "crazyflie"\n'
COMMANDED = '[motors]\nspeed = "commanded"\n'
MEASURED = '[motors]\nspeed = "measured"\n'
PROPS_OUT = """[airframe]
rotors = [
  { position = [-0.12, -0.12, 0.0], spin = "ccw" }, { position = [0.12, -0.12, 0.0], spin = "cw" },
  { position = [-0.12, 0.12, 0.0], spin = "cw" }, { position = [0.12, 0.12, 0.0], spin = "ccw" },
]
"""


def _quad_x(arm: float, order: str) -> str:
    return f'[airframe]\nlayout = "quad-x"\narm = {arm}\norder = "{order}"\n'


AIRFRAMES = {
    "crazyflie.toml": CRAZYFLIE + COMMANDED,
    "props-out.toml": PROPS_OUT + COMMANDED,
    "props-out-measured.toml": PROPS_OUT + MEASURED,
    "px4.toml": _quad_x(0.25, "px4") + COMMANDED,
    "sih.toml": _quad_x(0.2828427, "px4") + COMMANDED,
    "ardupilot.toml": _quad_x(0.25, "ardupilot") + COMMANDED,
    "sitl.toml": _quad_x(0.35, "ardupilot") + COMMANDED,
}

# log -> weighed mass, airframe; the vehicles' own READMEs say so.
LOGS = {
    "tudelft-indiflight/LOG00267.BFL": ("0.428", "cinerat.toml"),
    "tudelft-indiflight/LOG00271.BFL": ("0.428", "cinerat.toml"),
    "tudelft-indiflight/LOG00340.BFL": ("0.428", "cinerat.toml"),
    "arplab-crazyflie/log15": ("0.027", "crazyflie.toml"),
    "betaflight/LOG00007.BFL": ("unknown", "props-out-measured.toml"),
    "betaflight/LOG00037.BFL": ("unknown", "props-out.toml"),
    "px4-ulog/quadrotor_local.ulg": ("1.5", "px4.toml"),
    "px4-ulog/sample_appended_multiple.ulg": ("1.5", "px4.toml"),
    "ardupilot-dronekit/log171.bin": ("1.5", "ardupilot.toml"),
    "autopilot-sitl/px4-sih-stock.ulg": ("1.0", "sih.toml"),
    "autopilot-sitl/px4-sih-exported.ulg": ("1.4", "sih.toml"),
    "autopilot-sitl/arducopter-stock.BIN": ("3.0", "sitl.toml"),
    "autopilot-sitl/arducopter-exported.BIN": ("1.4", "sitl.toml"),
    "autopilot-sitl/arducopter-default-logging.BIN": ("3.0", "sitl.toml"),
}
TABLES = {
    "nanobench-crazyflie/B8_star_fast_rep1.csv": 'time = "t", '
    + ", ".join(f'pos_{a} = "p{a}"' for a in "xyz")
    + ", "
    + ", ".join(f'quat_{a} = "q{a}"' for a in "wxyz")
    + ", "
    + ", ".join(
        f'command_{i} = {{ name = "motor_motor_m{i}", scale = {1 / 65536} }}' for i in range(1, 5)
    ),
    "optitrack-airgarage/20240824_00_08_07.csv": 'time = "t", '
    + ", ".join(f'pos_{a} = "{a}"' for a in "xyz")
    + ", "
    + ", ".join(f'quat_{a} = "q{a}"' for a in "wxyz"),
}
ALL_THREE = """name = "all three"
[[configuration]]
mass = 0.428
flights = [
  "data/tudelft-indiflight/LOG00267.BFL",
  "data/tudelft-indiflight/LOG00271.BFL",
  "data/tudelft-indiflight/LOG00340.BFL",
]
"""
THREE_FLIGHTS = """name = "three flights"
[[configuration]]
mass = 0.428
flights = [ "data/tudelft-indiflight/LOG00267.BFL", "data/tudelft-indiflight/LOG00271.BFL" ]
validation = [ "data/tudelft-indiflight/LOG00340.BFL" ]
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One command after another, in one folder; what the last one said is kept."""

    name: str
    commands: tuple[tuple[str, ...], ...]


def prepared(folder: Path, data: Path, seconds: float) -> list[Case]:
    """Write experiments and airframes into a folder beside the logs; return the cases."""
    (folder / "data").symlink_to(data.resolve())
    cinerat = Path("examples/cinerat.toml").read_text(encoding="utf-8")
    for name, text in {**AIRFRAMES, "cinerat.toml": cinerat}.items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "three.toml").write_text(
        THREE_FLIGHTS.replace("[[conf", f"{cinerat}[[conf", 1), encoding="utf-8"
    )
    (folder / "all.toml").write_text(
        ALL_THREE.replace("[[conf", f"{cinerat}[[conf", 1), encoding="utf-8"
    )
    return [*_real_cases(folder, data), *_table_cases(folder, data), *_simulated_cases(seconds)]


def _real_cases(folder: Path, data: Path) -> list[Case]:
    cases = [_case("plan", "plan", "cinerat.toml", "--mass", "0.428")]
    for log, (mass, airframe) in LOGS.items():
        stated = (f"data/{log}", "--mass", mass, "--airframe", airframe)
        cases += [_case(f"inspect {log}", "inspect", f"data/{log}"),
                  _case(f"identify {log}", "identify", *stated)]  # fmt: skip
    for folder_of_logs in ("crazypad",):
        for log in sorted((data / folder_of_logs).glob("*_log*")):
            name = f"{folder_of_logs}/{log.name}"
            stated = (f"data/{name}", "--mass", "0.03", "--airframe", "crazyflie.toml")
            cases += [_case(f"inspect {name}", "inspect", f"data/{name}"),
                      _case(f"identify {name}", "identify", *stated)]  # fmt: skip
    cases.append(_case("identify LOG00267, 271 and 340 together", "identify", "all.toml"))
    made = ("identify", "three.toml", "-o", "three.json")
    paper = ("identify", "three.toml", "--preset", "paper", "-o", "paper.json")
    for what, *rest in (
        ("validate", "data/tudelft-indiflight/LOG00340.BFL"),
        ("fly",),
        ("compare", "paper.json"),
    ):
        commands = (made, paper, (what, "three.json", *rest))
        cases.append(Case(name=f"three flights: {what}", commands=commands))
    table = ("export", "three.json", "--to", "table", "-o", "table.md")
    cases.append(Case(name="three flights: export", commands=(made, table)))
    after = ("plan", "cinerat.toml", "--mass", "0.428", "--after", "three.json")
    cases.append(Case(name="three flights: plan --after", commands=(made, after)))
    for method in ("ols", "tls"):
        cases.append(
            _case(f"three flights: {method}", "identify", "three.toml", "--method", method)
        )
    return cases


def _table_cases(folder: Path, data: Path) -> list[Case]:
    cases = []
    for log, columns in TABLES.items():
        path = folder / f"{Path(log).stem}.toml"
        path.write_text(
            f'{CRAZYFLIE}{COMMANDED}[identification]\nsource = "mocap"\n[[configuration]]\n'
            f'mass = 0.027\nflights = [{{ file = "data/{log}", columns = {{ {columns} }} }}]\n',
            encoding="utf-8",
        )
        cases += [_case(f"{what} {log}", what, path.name) for what in ("inspect", "identify")]
    return cases


def _simulated_cases(seconds: float) -> list[Case]:
    cases = []
    for variant in VARIANTS:
        made = ("simulate", "paper", "--variant", variant, "--seconds", f"{seconds:g}",
                "-o", variant)  # fmt: skip
        for options in ((), ("--method", "ols"), ("--method", "tls"), ("--preset", "paper")):
            fit = ("identify", f"{variant}/experiment.toml", *options)
            name = f"simulate paper {variant} {' '.join(options)}".rstrip()
            cases.append(Case(name=name, commands=(made, fit)))
    return cases


def _case(name: str, *command: str) -> Case:
    return Case(name=name, commands=(command,))


def said(case: Case, folder: Path) -> dict[str, object]:
    """Run a case in a folder of its own and return what was printed and how it ended."""
    with tempfile.TemporaryDirectory(dir=folder) as own:
        for shared in folder.glob("*.toml"):
            (Path(own) / shared.name).symlink_to(shared)
        (Path(own) / "data").symlink_to(folder / "data")
        for command in case.commands:
            last = command is case.commands[-1]
            asked = [*command, "--json"] if last and command[0] != "export" else command
            ended = subprocess.run(
                [sys.executable, "-m", "rotorfit", *asked],
                cwd=own,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "100"},
                capture_output=True,
                text=True,
                check=False,
            )
        written = [path.read_text(encoding="utf-8") for path in Path(own).glob("*.md")]
        said = [text.replace(own, "FOLDER") for text in (ended.stdout, *written, ended.stderr)]
    return {"code": ended.returncode, "out": said[:-1], "err": said[-1]}


def comparable(run: dict[str, object]) -> dict[str, object]:
    """Return a run without what is not said of the log: order of keys, new keys, progress."""
    said = [line for line in str(run["err"]).splitlines() if not PROGRESS.search(line)]
    return {**run, "err": said, "out": [_read(text) for text in run["out"]]}  # type: ignore[attr-defined]


def _read(text: str) -> object:
    try:
        read = json.loads(text)
    except ValueError:
        return text
    return _without_new(read)


def _without_new(read: object) -> object:
    """Leave out the new keys, however deep."""
    match read:
        case dict():
            return {k: _without_new(v) for k, v in read.items() if k not in NEW}
        case list():
            return [_without_new(one) for one in read]
        case _:
            return read


def difference(before: dict[str, object], after: dict[str, object]) -> str:
    """Return "equal", or in words what differs between two runs of a case."""
    if comparable(before) == comparable(after):
        return "equal to the last bit"
    if before["code"] != after["code"]:
        return f"ended with {before['code']}, now {after['code']}"
    steps = _steps(before, after)
    words = "other messages" if before["err"] != after["err"] else "other numbers or words"
    if not steps:
        return words
    name = max(steps, key=lambda n: steps[n])
    return f"{words}; largest step of a parameter: {steps[name]:.2g} of its std ({name})"


def _steps(before: dict[str, object], after: dict[str, object]) -> dict[str, float]:
    """Return by how many of its standard deviations each parameter moved."""
    old, new = _parameters(before), _parameters(after)
    return {
        name: abs(new[name][0] - value) / std
        for name, (value, std) in old.items()
        if name in new and std
    }


def _parameters(run: dict[str, object]) -> dict[str, tuple[float, float]]:
    try:
        result = json.loads(run["out"][0])  # type: ignore[index]
        return {
            " ".join(filter(None, (entry["name"], entry["configuration"]))): (
                entry["value"],
                entry["std"],
            )
            for entry in result["parameters"]
            if entry["value"] is not None
        }
    except (ValueError, KeyError, TypeError):
        return {}


SHOWN = ("kt", "kd", "Jr", "Ixx_com", "Iyy_com", "Izz_com", "motor_lag", "motor_delay")


def table(before: dict[str, dict[str, object]], after: dict[str, dict[str, object]]) -> str:
    """Return what two versions find on the real logs, as Markdown."""
    lines = ["| log | | " + " | ".join(SHOWN) + " |", "|---|---|" + "---|" * len(SHOWN)]
    for name, run in after.items():
        if not name.startswith("identify ") or name not in before:
            continue
        for version, of in (("before", before[name]), ("after", run)):
            found = _shown(of)
            said = [found.get(n, "") for n in SHOWN] if found else ["refused", *[""] * 7]
            log = f"`{name.removeprefix('identify ')}`" if version == "before" else ""
            lines.append(f"| {log} | {version} | " + " | ".join(said) + " |")
    return "\n".join(lines) + "\n"


def _shown(run: dict[str, object]) -> dict[str, str]:
    try:
        result = json.loads(run["out"][0])  # type: ignore[index]
    except (ValueError, KeyError, TypeError):
        return {}
    found = {}
    for entry in (*result["parameters"], *result["derived"]):
        if entry["value"] is None or entry["interval"] is None:
            continue
        half = 0.5 * (entry["interval"][1] - entry["interval"][0])
        share = 100.0 * half / max(abs(entry["value"]), 1e-300)
        times = entry["name"].startswith("motor_")
        shown = f"{1e3 * half:.2g} ms" if times else f"{share:.2g} %"
        value = f"{1e3 * entry['value']:.3g} ms" if times else f"{entry['value']:.3g}"
        found[entry["name"]] = f"{value} +- {shown}"
    return found or {"kt": "nothing"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--against", type=Path, help="an earlier output")
    parser.add_argument("--table", type=Path, help="real logs side by side, as Markdown")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seconds", type=float, default=75.0, help="of each simulated flight")
    parser.add_argument("--only", default="", help="cases with this in their name")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        cases = [
            c
            for c in prepared(folder, real_data_folder(), options.seconds)
            if options.only in c.name
        ]
        with ThreadPoolExecutor(options.workers) as pool:
            found = dict(
                zip(
                    (c.name for c in cases),
                    pool.map(lambda case: said(case, folder), cases),
                    strict=True,
                )
            )
    options.output.write_text(json.dumps(found, indent=1), encoding="utf-8")
    before = json.loads(options.against.read_text(encoding="utf-8")) if options.against else {}
    if options.table:
        options.table.write_text(table(before, found), encoding="utf-8")
    for name, run in found.items():
        digest = hashlib.sha256(json.dumps(run).encode()).hexdigest()[:12]
        compared = difference(before[name], run) if name in before else ""
        print(f"{digest}  exit {run['code']}  {name:70}  {compared}")
    if before:
        same = sum(
            name in before and comparable(before[name]) == comparable(run)
            for name, run in found.items()
        )
        print(f"{same} of {len(found)} cases equal to the last bit")


if __name__ == "__main__":
    main()
