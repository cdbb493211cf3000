"""How many files and types lie between `identify` and the printed kd, and does a call go back?

    python -m benchmarks.walk [--source FOLDER]

A simulated flight is identified and printed while every call between modules of rotorfit is noted.
The recipe is the room `identification`. Counted are

- files: the modules of the recipe, and those that it calls itself, down to the printed line;
- types: the classes of rotorfit whose objects are handed between the recipe and those modules;
- steps back: calls of the recipe into an earlier room of the data flow (the layers of
  pyproject.toml) than the one before, once the flights are loaded.

`--source`: the `src` folder of another version, for both figures side by side.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
WORKER = """
import json, sys, tempfile, tomllib, warnings
from pathlib import Path
warnings.simplefilter("ignore")
import rotorfit
from rotorfit.simulation import write_flight_table
import rotorfit.report.text as text_module

SOURCE = str(Path(rotorfit.__file__).parent) + "/"
settings = tomllib.loads((Path(SOURCE).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))
contracts = settings["tool"]["importlinter"]["contracts"]
layers = next(c for c in contracts if c["type"] == "layers")["layers"]
ORDER = {name.strip().removeprefix("rotorfit."): -number
         for number, layer in enumerate(layers) for name in layer.split("|")}
calls, types = [], set()

def named(obj):
    if isinstance(obj, (tuple, list)):
        for one in obj[:8]:
            named(one)
    elif type(obj).__module__.startswith("rotorfit."):
        types.add(type(obj).__name__)

def module_of(frame):
    name = frame.f_code.co_filename
    return name[len(SOURCE):] if name.startswith(SOURCE) else None

def looks(frame, event, arg):
    if event not in ("call", "return") or frame.f_back is None:
        return
    here, there = module_of(frame), module_of(frame.f_back)
    if here is None or there is None or here == there or there != "identification.py":
        return
    if frame.f_code.co_name.startswith("<"):
        return
    if event == "call":
        calls.append((here, frame.f_code.co_name))
        for value in list(frame.f_locals.values()):
            named(value)
    else:
        named(arg)

def main():
    from rotorfit.fit.experiment.experiment import load_experiment
    from rotorfit.identification import identify
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        from tests.flown import simulated, experiment_file
        flight = simulated("A", "real", seed=1, seconds=20.0)
        write_flight_table(flight, folder / "f.csv")
        path = experiment_file(folder / "e.toml", flight.vehicle, [folder / "f.csv"],
                               mass=flight.truth.mass)
        experiment = load_experiment(path)
        sys.setprofile(looks)
        result = identify(experiment)
        sys.setprofile(None)
        line = next(l for l in text_module.result_text(result).splitlines() if "kd" in l)
    files = sorted({m for m, _ in calls} | {"identification.py", "report/text.py"})
    rooms = [(m.split("/")[0].removesuffix(".py"), name) for m, name in calls]
    rooms = [(room, name) for room, name in rooms if room in ORDER]
    rooms = [(room, name) for room, name in rooms if room != "identification"]
    loaded = next((i for i, (room, _) in enumerate(rooms) if room in ("fit", "checks")), 0)
    back = [f"{one} -> {two} ({name})"
            for (one, _), (two, name) in zip(rooms[loaded:], rooms[loaded + 1:])
            if ORDER[two] < ORDER[one]]
    print(json.dumps({"files": files, "types": sorted(types), "back": back, "line": line}))

main()
"""


def counted(source: Path) -> dict[str, object]:
    """Run the worker with one version of the source; its tests' helpers beside it."""
    paths = [str(source), str(source.parent), str(source.parent / "tests")]
    ended = subprocess.run(
        [sys.executable, "-c", WORKER],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), "OPENBLAS_NUM_THREADS": "1"},
        cwd=source.parent,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(ended.stdout.splitlines()[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--source", type=Path, help="src of another version")
    options = parser.parse_args()
    versions = {"here": ROOT / "src", **({"other": options.source} if options.source else {})}
    for name, source in versions.items():
        found = counted(source)
        print(f"{name}: {len(found['files'])} files, {len(found['types'])} types, "  # type: ignore[arg-type]
              f"{len(found['back'])} steps back; {found['line']}")  # type: ignore[arg-type]  # fmt: skip
        for what in ("files", "types", "back"):
            print(f"  {what}: {', '.join(found[what])}")  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
