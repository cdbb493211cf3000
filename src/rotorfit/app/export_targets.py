"""The targets of `rotorfit export` as the page offers them."""

from collections.abc import Mapping
from typing import Final

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
    """Return every target with its title, and how its file ends."""
    return [{"target": t, "suffix": SUFFIXES[t], "title": words} for t, words in TITLES.items()]
