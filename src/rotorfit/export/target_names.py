"""The names of the targets, apart from what writes them: the command line offers them at once."""

from typing import Literal

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
