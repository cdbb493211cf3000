"""The command lines that `benchmarks.commands_speed` measures, and the files that they need."""

import multiprocessing
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

ROOT: Final = Path(__file__).parents[1]
CINERAT: Final = "{made}/cinerat.toml"
TUDELFT: Final = "{data}/tudelft-indiflight"
SITL: Final = "{data}/autopilot-sitl"


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One command line of rotorfit.

    - `arguments`: with {data}, {made} (files of this benchmark) and {out} (empty before each run).
    - `typed`: what a user types at its questions.
    - `reads`: logs, or experiment files whose logs count; empty: the logs among `arguments`.
    - `logs`: how many logs the command identifies, where it does many.
    """

    name: str
    arguments: tuple[str, ...]
    typed: str = ""
    reads: tuple[str, ...] = ()
    logs: int = 0

    @property
    def logs_read(self) -> tuple[str, ...]:
        """Return the logs whose reading is a part of the command."""
        return self.reads or tuple(a for a in self.arguments if a.startswith("{data}/"))

    @property
    def needed(self) -> tuple[str, ...]:
        """Return the files of the data folder without which the case is left out."""
        return tuple(one for one in (*self.arguments, *self.reads) if one.startswith("{data}/"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Flown:
    """Simulated flights: `flights` of each of the paper's vehicles."""

    name: str
    vehicles: tuple[Literal["A", "B"], ...] = ("A",)
    flights: int = 1
    seconds: float = 75.0
    rate: float = 200.0


FLOWN: Final = (
    Flown(name="75 s at 200 Hz"),
    Flown(name="600 s at 200 Hz", seconds=600.0),
    Flown(name="600 s at 1 kHz", seconds=600.0, rate=1000.0),
    Flown(name="two configurations", vehicles=("A", "B")),
    Flown(name="20 flights of 75 s", flights=20),
)


def _quad_x(size: str, order: str) -> str:
    return (
        f'[airframe]\nlayout = "quad-x"\n{size}\norder = "{order}"\n[motors]\nspeed = "commanded"\n'
    )


AIRFRAMES: Final[Mapping[str, str]] = {
    "crazyflie": _quad_x("arm = 0.046", "crazyflie"),
    "ardupilot": _quad_x("arm = 0.35", "ardupilot"),
    "ardupilot-heavy": _quad_x("spacing = [0.42, 0.56]", "ardupilot"),
    "px4-heavy": _quad_x("spacing = [0.42, 0.56]", "px4"),
    "betaflight": """[airframe]
rotors = [
  { position = [-0.12, -0.12, 0.0], spin = "ccw" }, { position = [0.12, -0.12, 0.0], spin = "cw" },
  { position = [-0.12, 0.12, 0.0], spin = "cw" }, { position = [0.12, 0.12, 0.0], spin = "ccw" },
]
[motors]
speed = "measured"
""",
}
THROWS: Final = ("LOG00257", "LOG00267", "LOG00269")
FLEET: Final = ("LOG00267", "LOG00269", "LOG00271", "LOG00275")


def _identify(name: str, log: str, mass: str, airframe: str, *, more: tuple[str, ...] = ()) -> Case:
    arguments = ("identify", log, "--mass", mass, "--airframe", airframe, *more)
    return Case(name=f"identify {name}", arguments=arguments)


LOOKED_AT: Final[Mapping[str, str]] = {
    "LOG00271": f"{TUDELFT}/LOG00271.BFL",
    "LOG00267": f"{TUDELFT}/LOG00267.BFL",
    "LOG00037": "{data}/betaflight/LOG00037.BFL",
    "LOG00007": "{data}/betaflight/LOG00007.BFL",
    "px4-heavy-recommended": f"{SITL}/px4-heavy-recommended.ulg",
    "ap-heavy-recommended": f"{SITL}/ap-heavy-recommended.BIN",
    "log15": "{data}/arplab-crazyflie/log15",
}
"""Logs for the commands that look at one log, by their names in the table."""
ANSWERS: Final[Mapping[str, str]] = {
    "LOG00267": "91\n127\n",
    "LOG00037": "240\n240\n",
    "px4-heavy-recommended": "420\n560\n",
    "ap-heavy-recommended": "420\n560\n",
    "log15": "65\n65\n",
}
"""What a user types at the questions of `airframe`."""
REFUSALS: Final = (
    Case(
        name="refusal: missing file",
        arguments=("identify", "missing.bfl", "--mass", "1", "--airframe", CINERAT),
    ),
    Case(
        name="refusal: no --mass",
        arguments=("identify", LOOKED_AT["LOG00271"], "--airframe", CINERAT),
    ),
)
DOCTOR: Final = (
    *(Case(name=f"inspect {n}", arguments=("inspect", log)) for n, log in LOOKED_AT.items()),
    *(
        Case(
            name=f"airframe {n}",
            arguments=("airframe", LOOKED_AT[n], "-o", "{out}/airframe.toml"),
            typed=typed,
        )
        for n, typed in ANSWERS.items()
    ),
    *(
        Case(name=f"settings {n}", arguments=("settings", LOOKED_AT[n]))
        for n in ("LOG00037", "px4-heavy-recommended", "ap-heavy-recommended", "log15")
    ),
)
IDENTIFY: Final = (
    _identify("LOG00271", LOOKED_AT["LOG00271"], ".428", CINERAT),
    _identify("LOG00267", LOOKED_AT["LOG00267"], ".428", CINERAT),
    Case(
        name="identify three throws",
        arguments=("identify", "{made}/throws.toml"),
        reads=tuple(f"{TUDELFT}/{log}.BFL" for log in THROWS),
    ),
    _identify(
        "LOG00007 --start 10 --end 75",
        LOOKED_AT["LOG00007"],
        "unknown",
        "{made}/betaflight.toml",
        more=("--start", "10", "--end", "75"),
    ),
    _identify("log15", LOOKED_AT["log15"], ".027", "{made}/crazyflie.toml"),
    Case(
        name="identify w28",
        arguments=("identify", "{data}/mujoco-worlds/w28.toml"),
    ),
    _identify(
        "px4-heavy-recommended", LOOKED_AT["px4-heavy-recommended"], "3.2", "{made}/px4-heavy.toml"
    ),
    _identify(
        "ap-heavy-recommended",
        LOOKED_AT["ap-heavy-recommended"],
        "3.2",
        "{made}/ardupilot-heavy.toml",
    ),
    _identify(
        "arducopter-exported", f"{SITL}/arducopter-exported.BIN", "1.4", "{made}/ardupilot.toml"
    ),
    _identify(
        "LOG00271 --start 5 --end 5.5",
        LOOKED_AT["LOG00271"],
        ".428",
        CINERAT,
        more=("--start", "5", "--end", "5.5"),
    ),
)
SIMULATED: Final = tuple(
    Case(
        name=f"identify {flown.name}, {kind}",
        arguments=("identify", f"{{made}}/{flown.name}, {kind}/experiment.toml"),
        reads=(f"{{made}}/{flown.name}, {kind}/experiment.toml",),
    )
    for flown in FLOWN
    for kind in ("measured", "commanded")
)
RESULTS: Final[Mapping[str, str]] = {
    "{made}/LOG00267.json": "identify LOG00267",
    "{made}/ap-heavy.json": "identify ap-heavy-recommended",
}
"""Results that other cases load, with the case that makes each."""
WITH_RESULT: Final = (
    Case(
        name="validate LOG00267 on LOG00271",
        arguments=("validate", "{made}/LOG00267.json", LOOKED_AT["LOG00271"]),
    ),
    Case(
        name="validate ap-heavy on ap-heavy-raw",
        arguments=("validate", "{made}/ap-heavy.json", f"{SITL}/ap-heavy-raw.BIN"),
    ),
    Case(
        name="fly LOG00267",
        arguments=("fly", "{made}/LOG00267.json"),
        reads=(LOOKED_AT["LOG00267"],),
    ),
    Case(
        name="fly LOG00267 on LOG00271",
        arguments=("fly", "{made}/LOG00267.json", "--flight", LOOKED_AT["LOG00271"]),
    ),
    Case(
        name="export LOG00267 --to mujoco",
        arguments=("export", "{made}/LOG00267.json", "--to", "mujoco", "-o", "{out}/model.xml"),
    ),
    Case(
        name="export LOG00267 --to urdf",
        arguments=("export", "{made}/LOG00267.json", "--to", "urdf", "-o", "{out}/model.urdf"),
    ),
)
MANY: Final = (
    Case(
        name=f"fleet of {len(FLEET)} throws",
        arguments=(
            *("fleet", "{made}/fleet", "-o", "{out}/fleet", "--airframe", CINERAT),
            *("--mass", ".428", "--workers", "1"),
        ),
        reads=tuple(f"{TUDELFT}/{log}.BFL" for log in FLEET),
        logs=len(FLEET),
    ),
)
CASES: Final = (*REFUSALS, *DOCTOR, *IDENTIFY, *SIMULATED, *WITH_RESULT, *MANY)


def write_declarations(made: Path, data: Path) -> None:
    """Write the airframes, the experiment of three throws, and the folder of the fleet."""
    for name, text in AIRFRAMES.items():
        (made / f"{name}.toml").write_text(text, encoding="utf-8")
    cinerat = (ROOT / "examples" / "cinerat.toml").read_text(encoding="utf-8")
    (made / "cinerat.toml").write_text(cinerat, encoding="utf-8")
    throws = [str((data / f"tudelft-indiflight/{log}.BFL").resolve()) for log in THROWS]
    flights = f"[[configuration]]\nmass = 0.428\nflights = {throws}\n"
    (made / "throws.toml").write_text(f'name = "three"\n{cinerat}\n{flights}', encoding="utf-8")
    (made / "fleet").mkdir()
    for log in FLEET:
        path = data / f"tudelft-indiflight/{log}.BFL"
        if path.exists():
            (made / "fleet" / path.name).symlink_to(path.resolve())


def write_simulated(flown: Flown, folder: Path, *, commanded: bool) -> None:
    """Fly simulated vehicles in a process of its own, and write tables and experiment file.

    Every process inherits the memory mark of its parent, which therefore stays small.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        pool.submit(_write_flights, flown, folder, commanded=commanded).result()


def _write_flights(flown: Flown, folder: Path, *, commanded: bool) -> None:
    from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight, variant
    from rotorfit.simulation.experiment_files import (
        IMU_AND_COMMAND,
        IMU_AND_SPEED,
        write_flight_table,
    )

    folder.mkdir()
    channels = IMU_AND_COMMAND if commanded else IMU_AND_SPEED
    parts: list[str] = []
    motors, rotors = '[motors]\nspeed = "measured"', ""
    for name in flown.vehicles:
        (truth, vehicle), sensors = variant(paper_vehicle(name), "real")
        scenario = Scenario(sensors=sensors, seconds=flown.seconds, sample_rate=flown.rate)
        files = [f"{name}{seed}.csv" for seed in range(1, flown.flights + 1)]
        for seed, file in enumerate(files, start=1):
            flight = simulate_flight(truth, vehicle, scenario, seed=seed)
            write_flight_table(flight, folder / file, channels=channels)
            if commanded and not parts:
                law = f"{{ linear = [0.0, {flight.max_speed!r}] }}"
                motors = f'[motors]\nspeed = "commanded"\nlaw = {law}'
        parts.append(
            f'[[configuration]]\nname = "{name}"\nmass = {truth.mass!r}\nflights = {files}'
        )
        rotors = ", ".join(
            f'{{ position = {list(r.position)}, spin = "{r.spin}" }}' for r in vehicle.rotors
        )
    airframe = f"[airframe]\nrotors = [{rotors}]\nimu = {{ position = [0.0, 0.0, 0.0] }}"
    text = "\n\n".join([airframe, motors, *parts]) + "\n"
    (folder / "experiment.toml").write_text(text, encoding="utf-8")
