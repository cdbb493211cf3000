"""The names of the targets, apart from what writes them: the command line offers them at once."""

from typing import Literal

TargetName = Literal[
    "gazebo",
    "gazebo-motors",
    "px4",
    "px4-sih",
    "mujoco",
    "urdf",
    "rotorpy",
    "ardupilot",
    "ardupilot-sitl",
    "betaflight",
    "crazyflow",
    "casadi",
]
"""Files of a vehicle."""
AnyTargetName = Literal[TargetName, "table"]
"""And ``table``, which is of flights."""
