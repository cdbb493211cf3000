"""A real flight replayed in half-second windows: identified parameters beside the bench's.

    python benchmarks/replay.py LOG00267.BFL [--fit OTHER.BFL ...]

The logs of TU Delft's CineRat (`examples/cinerat.toml`, 0.428 kg); their paper has a propeller
bench, a pendulum and a scale. Each window starts with the measured rates, and is flown by Newton
and Euler from the measured rotor speeds alone. Beside the identified parameters: the bench's kt,
kd, inertia and rotor inertia with all else as identified; the same with the CoM in the middle of
the rotors and no products of inertia, as one has it without any flight; the rate held. The rotors
are equal in all of them: a result that gives only some rotors a coefficient of their own, as these
logs do, has lost the trim of hover, which CoM and rotors make together.
With --fit the parameters come from other logs than the one that is replayed.
"""

import argparse
import os
import warnings
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from rotorfit.errors import RotorfitWarning
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify
from rotorfit.results.result import IdentificationResult
from rotorfit.results.validation.replay import (
    HOLD,
    Replay,
    band_growth,
    error_growth,
    force_errors,
    growth_time,
)
from rotorfit.results.validation.replay_vehicle import ReplayVehicle, replay_vehicle
from rotorfit.results.validation.replayed_flights import Timed, replay_flights
from rotorfit.results.validation.validate import fitted_response

AIRFRAME = Path(__file__).parents[1] / "examples" / "cinerat.toml"
MASS = 0.428
BENCH = {
    "kt": 2.66e-7,
    "kd": 2.66e-9,
    "Ixx_com": 7.206e-4,
    "Iyy_com": 7.757e-4,
    "Izz_com": 8.860e-4,
    "Jr": 8.96e-7,
}
TERMS = '[identification]\nterms = ["rotor_inertia", "accel_bias", "twist", "rotor_drag"]\n'
TIMES = (0.1, 0.5)
LOGS_SHOWN = ("LOG00267.BFL", "LOG00271.BFL", "LOG00340.BFL")


def fitted(logs: Sequence[Path], folder: Path) -> IdentificationResult:
    """Identify the vehicle from logs; a file of the experiment is left in the folder."""
    files = ", ".join(f'"{log.absolute()}"' for log in logs)
    path = folder / "experiment.toml"
    entry = f'[[configuration]]\nname = "A"\nmass = {MASS}\nflights = [{files}]\n'
    path.write_text(f"{AIRFRAME.read_text(encoding='utf-8')}\n{TERMS}{entry}", encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RotorfitWarning)
        return identify(load_experiment(path))


def candidates(result: IdentificationResult, draws: int = 40) -> dict[str, ReplayVehicle]:
    """Return the identified vehicle with its draws, and the bench's two."""
    plain = {name: 0.0 for name in ("Ixy_com", "Ixz_com", "Iyz_com", "twist", "com_z")}
    for axis in "xy":
        center = result.parameter(f"rotor_center_{axis}").value
        plain[f"com_{axis}"] = 0.0 if center is None else center
    return {
        "identified": replay_vehicle(result, "A", draws=draws),
        "bench": replay_vehicle(result, "A", assumed=BENCH),
        "bench, CoM in the middle": replay_vehicle(result, "A", assumed=BENCH | plain),
    }


def replayed(result: IdentificationResult, log: Path) -> list[Replay]:
    """Replay a log with all candidates."""
    response = fitted_response(result)
    timed = {n: Timed(vehicle=v, response=response) for n, v in candidates(result).items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RotorfitWarning)
        return replay_flights(result, "A", timed, others=[log])


def table(replays: Sequence[Replay]) -> list[str]:
    """Return the errors, one line a candidate: rates after each time, then specific force."""
    at = [int(np.argmin(np.abs(growth_time(replays) - t))) for t in TIMES]
    names = [p.label for p in replays[0].predicted]
    rows = [
        (name, [*error_growth(replays, name)[at].ravel(), *force_errors(replays, name)])
        for name in (*names, HOLD)
    ]
    rows.append(("95 % band", [*band_growth(replays, names[0])[at].ravel()]))
    head = "".join(f"{axis:>8}" for axis in ("roll", "pitch", "yaw") * 2 + ("x", "y", "z"))
    return [
        f"{'':26}{TIMES[0]:>20g} s [rad/s]{TIMES[1]:>14g} s [rad/s]{'[m/s^2]':>17}",
        f"{'':26}{head}",
        *(f"{name:26}" + "".join(f"{value:8.2f}" for value in values) for name, values in rows),
    ]


def main() -> None:
    """Identify, replay, print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("log", type=Path)
    parser.add_argument("--fit", type=Path, nargs="*", default=[])
    asked = parser.parse_args()
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        result = fitted(asked.fit or [asked.log], Path(folder))
    replays = replayed(result, asked.log)
    said = ", ".join(path.name for path in asked.fit) or "the same log"
    print(f"{asked.log.name}, {len(replays[0].time)} windows of 0.5 s, parameters from {said}")
    print("\n".join(table(replays)))


if __name__ == "__main__":
    main()
