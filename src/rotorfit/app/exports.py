"""The targets of `rotorfit export` on the page, and a result as their files.

The engine offers the targets at once; the exporters are imported only when a file is made.
"""

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, cast, get_args

from rotorfit.errors import MissingNumbersError, OutputError
from rotorfit.export.target_names import SUFFIXES, RandomTargetName, TargetName

TITLES: Final[Mapping[TargetName | RandomTargetName, str]] = {
    "gazebo": "Gazebo: a whole model (SDF)",
    "gazebo-motors": "Gazebo: motor plugins to paste into a model",
    "px4": "PX4: control allocation and thrust curve",
    "px4-sih": "PX4: simulation in hardware",
    "px4-setpoints": "PX4: newton per unit of the setpoints",
    "mujoco": "MuJoCo: MJCF",
    "urdf": "URDF, gym-pybullet-drones",
    "rotorpy": "RotorPy: quad_params",
    "ardupilot": "ArduPilot: thrust curve and hover throttle",
    "ardupilot-sitl": "ArduPilot: frame of its simulator",
    "betaflight": "Betaflight: thrust_linear",
    "indiflight": "INDIflight: control effectiveness",
    "paparazzi": "Paparazzi: control effectiveness",
    "crazyflow": "Crazyflow: params.toml",
    "casadi": "CasADi: dynamics in Python",
    "samples": "Vehicles drawn from the result (NumPy arrays)",
    "isaac-lab": "Isaac Lab: ranges to randomise",
    "pegasus": "Pegasus: drawn vehicles",
    "crazyflow-worlds": "Crazyflow: drawn worlds",
}


def targets() -> list[dict[str, str]]:
    """List every target with its title, and how its file ends."""
    return [{"target": t, "suffix": SUFFIXES[t], "title": title} for t, title in TITLES.items()]


def exported(folder: Path, argument: Mapping[str, Any]) -> dict[str, Any]:
    """Make the file of a target from the page's result.

    The argument holds ``target``, and where wanted ``configuration``, ``assume`` and ``project``.
    """
    from rotorfit.export.randomised.targets import drawn_words, randomised
    from rotorfit.export.result_numbers import doubts_in_words
    from rotorfit.export.targets import export
    from rotorfit.results.sound_result import load_sound

    target = argument["target"]
    if target not in TITLES:
        raise OutputError(f"no target {target!r}; targets: {', '.join(TITLES)}")
    path = folder / "result.json"
    if not path.exists():
        raise OutputError("there is no result yet: identify first")
    result = load_sound(path)
    assumed = _assumed(argument.get("assume") or {})
    configuration = argument.get("configuration")
    name = f"{target}{SUFFIXES[target]}"
    if target in get_args(RandomTargetName):
        content, variants = randomised(
            result,
            cast("RandomTargetName", target),
            Path(name),
            configuration=configuration,
            assumed=assumed,
        )
        data = base64.b64encode(content).decode()
        return {"name": name, "base64": data, "notes": drawn_words(variants)}
    file = export(
        result,
        cast("TargetName", target),
        configuration=configuration,
        assumed=assumed,
        project=argument.get("project") is True,
    )
    notes = [*doubts_in_words(file.model.numbers), *file.model.notes]
    return {"name": name, "text": file.text, "notes": notes}


def missing_numbers(error: MissingNumbersError) -> list[dict[str, str]]:
    """List the numbers that the user may supply, with their units."""
    from rotorfit.export.assumptions import unit_of

    return [{"name": name, "unit": unit_of(name)} for name in error.names]


def _assumed(given: Mapping[str, Any]) -> dict[str, float]:
    from rotorfit.export.assumptions import parse_assumptions

    try:
        return parse_assumptions([f"{name}={value}" for name, value in given.items()])
    except ValueError as error:
        raise OutputError(str(error)) from error
