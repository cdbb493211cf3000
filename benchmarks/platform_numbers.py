"""What the readers find in every real log, and one identification: to compare two platforms.

    python benchmarks/platform_numbers.py DATA -o numbers.json [--against other.json]

Called by thirty_two_bits.sh on a platform whose integers have 32 bits. With --against it prints
what differs: a channel by more than rounding, a parameter by the largest step in its deviations.
"""

import argparse
import json
import platform
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from rotorfit.errors import RotorfitError
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify
from rotorfit.logs import read_log

NO_LOGS = (".md", ".toml", ".json", ".py", ".txt")
LARGEST = 12_000_000
IDENTIFIED = "tudelft-indiflight/LOG00267.BFL"
EXPERIMENT = """[airframe]
rotors = [
  { position = [-0.0455, -0.0635, 0.0], spin = "cw" },
  { position = [0.0455, -0.0635, 0.0], spin = "ccw" },
  { position = [-0.0455, 0.0635, 0.0], spin = "ccw" },
  { position = [0.0455, 0.0635, 0.0], spin = "cw" },
]
[[configuration]]
mass = 0.428
flights = [FILE]
"""
ROUNDING = 1e-9


def channels_of(path: Path, folder: Path) -> dict[str, Any]:
    """Return size and sums of every channel of a log, or why it is refused."""
    try:
        log = read_log(path)
    except RotorfitError as error:
        return {"refused": str(error).replace(str(folder), "")}
    return {
        name: [*c.values.shape, float(np.nansum(np.abs(c.values))), float(np.nansum(c.time))]
        for name, c in log.channels.items()
    }


def parameters_of(path: Path) -> dict[str, Any]:
    """Return value and deviation of every parameter that one log gives."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        file = Path(folder) / "experiment.toml"
        file.write_text(EXPERIMENT.replace("FILE", json.dumps(str(path.absolute()))))
        result = identify(load_experiment(file))
    return {p.full_name: [p.value, p.std] for p in result.parameters}


def numbers_of(folder: Path) -> dict[str, Any]:
    paths = [p for p in sorted(folder.rglob("*")) if p.is_file() and p.suffix not in NO_LOGS]
    logs = [p for p in paths if p.stat().st_size < LARGEST and not p.name.startswith("LICENSE")]
    return {
        "logs": {str(p.relative_to(folder)): channels_of(p, folder) for p in logs},
        "parameters": parameters_of(folder / IDENTIFIED),
    }


def compare(here: dict[str, Any], there: dict[str, Any]) -> list[str]:
    """Return what is another in words."""
    words: list[str] = []
    for name, found in there["logs"].items():
        mine = here["logs"].get(name, {})
        if "refused" in found or found.keys() != mine.keys():
            words += [] if found == mine else [f"{name}: {list(found)} there, {list(mine)} here"]
            continue
        far = [k for k in found if not np.allclose(mine[k], found[k], rtol=ROUNDING, atol=0.0)]
        words += [f"{name}: {channel} differs" for channel in far]
    if here["parameters"].keys() != there["parameters"].keys():
        words.append("other parameters")
    return words


def largest_step(here: dict[str, Any], there: dict[str, Any]) -> float:
    """Return the largest step of a parameter, in deviations."""
    pairs = [(here[name], there[name]) for name in there if name in here]
    return max(abs(a[0] - b[0]) / b[1] for a, b in pairs if b[1] and a[0] is not None)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("data", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--against", type=Path)
    asked = parser.parse_args()
    found = numbers_of(asked.data)
    asked.output.write_text(json.dumps(found))
    integers = 8 * np.dtype(np.intp).itemsize
    print(f"{len(found['logs'])} logs, integers of {integers} bits, Python "
          f"{platform.python_version()}, NumPy {np.__version__}")  # fmt: skip
    if asked.against is not None:
        there = json.loads(asked.against.read_text())
        differ = compare(found, there)
        step = largest_step(found["parameters"], there["parameters"])
        print("\n".join(differ or ["every channel is the same"]))
        print(f"largest step of a parameter: {step:.2g} deviations")
        raise SystemExit(bool(differ))


if __name__ == "__main__":
    main()
