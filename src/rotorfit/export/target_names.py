"""The names of the targets, apart from what writes them: the command line offers them at once."""

from collections.abc import Mapping
from typing import Final, Literal

TargetName = Literal[
    "gazebo",
    "gazebo-motors",
    "px4",
    "px4-sih",
    "px4-setpoints",
    "mujoco",
    "urdf",
    "rotorpy",
    "ardupilot",
    "ardupilot-sitl",
    "betaflight",
    "indiflight",
    "paparazzi",
    "crazyflow",
    "casadi",
]
"""Files of a vehicle."""
RandomTargetName = Literal["samples", "isaac-lab", "pegasus", "crazyflow-worlds"]
"""Files of many vehicles, drawn from the posterior."""
AnyTargetName = Literal[TargetName, RandomTargetName, "table"]
"""And ``table``, which is of flights."""

SUFFIXES: Final[Mapping[AnyTargetName, str]] = {
    "gazebo": ".sdf",
    "gazebo-motors": ".xml",
    "px4": ".params",
    "px4-sih": ".params",
    "px4-setpoints": ".json",
    "mujoco": ".xml",
    "urdf": ".urdf",
    "rotorpy": ".py",
    "ardupilot": ".parm",
    "ardupilot-sitl": ".json",
    "betaflight": ".txt",
    "indiflight": ".txt",
    "paparazzi": ".xml",
    "crazyflow": ".toml",
    "casadi": ".py",
    "samples": ".npz",
    "isaac-lab": ".py",
    "pegasus": ".py",
    "crazyflow-worlds": ".npz",
    "table": ".csv",
}
"""How the file of a target ends, where nobody says otherwise."""
