"""The targets of `rotorfit export`: the one table of their names, needs, writers and consumers.

The command line and the page offer the names at once; a writer is imported when its file is made.
"""

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from importlib import import_module
from typing import Any, Final, Literal

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
"""And ``table``, which is of flights (`rotorfit.export.table`)."""
Speed = Literal["rad/s", "full-command"]

INERTIA_COM: Final = ("Ixx_com", "Iyy_com", "Izz_com", "Ixy_com", "Ixz_com", "Iyz_com")
MASS: Final = ("mass", "com_x", "com_y", "com_z")
BODY: Final = (*MASS, *INERTIA_COM)
ROTORS: Final = ("kt", "kd", "Izz_com")
"""The scale of kd depends on Izz, its partner in the yaw equation: both or neither."""
LAG: Final = ("motor_lag",)
SPEED: Final = ("max_speed",)
ALL: Final = (*BODY, *ROTORS, *LAG, *SPEED)


@dataclass(frozen=True, slots=True)
class Target:
    """A kind of file.

    Attributes
    ----------
    title
        As the page offers it.
    consumer
        The program that reads the file; the tests load it there where it is installed.
    suffix
        Of the file, where nobody names another.
    needs
        Numbers without which the file cannot be written.
    module
        Of `rotorfit.export`, with the function ``write_TARGET``.
    speed
        Whether the file holds rotor speeds, or only what a rotor does at full command.
    terms
        Optional terms of the model that it holds.
    intervals
        Whether its writer takes drawn vehicles, too, from which it writes intervals.
    """

    title: str
    consumer: str
    suffix: str
    _: KW_ONLY
    needs: tuple[str, ...]
    module: str
    speed: Speed = "rad/s"
    terms: tuple[str, ...] = ()
    intervals: bool = False


TARGETS: Final[Mapping[TargetName, Target]] = {
    "gazebo": Target("Gazebo: a whole model (SDF)", "gz-sim", ".sdf", needs=ALL, module="gazebo"),
    "gazebo-motors": Target(
        "Gazebo: motor plugins to paste into a model",
        "gz-sim",
        ".xml",
        needs=(*ROTORS, *LAG, *SPEED),
        module="gazebo",
    ),
    "px4": Target(
        "PX4: control allocation and thrust curve",
        "PX4",
        ".params",
        needs=(*MASS, *ROTORS),
        module="px4",
        speed="full-command",
    ),
    "px4-sih": Target(
        "PX4: simulation in hardware",
        "PX4",
        ".params",
        needs=ALL,
        module="px4",
        speed="full-command",
        terms=("drag_x", "drag_y", "drag_z", "turn_damping_x", "turn_damping_y", "rotor_drag"),
    ),
    "px4-setpoints": Target(
        "PX4: newton per unit of the setpoints",
        "PX4",
        ".json",
        needs=(*MASS, *ROTORS, *SPEED),
        module="px4",
        speed="full-command",
        intervals=True,
    ),
    "mujoco": Target("MuJoCo: MJCF", "MuJoCo", ".xml", needs=ALL, module="mjcf"),
    "urdf": Target(
        "URDF, gym-pybullet-drones",
        "gym-pybullet-drones",
        ".urdf",
        needs=(*BODY, *ROTORS),
        module="urdf",
    ),
    "rotorpy": Target("RotorPy: quad_params", "RotorPy", ".py", needs=ALL, module="rotorpy"),
    "ardupilot": Target(
        "ArduPilot: thrust curve and hover throttle",
        "ArduPilot",
        ".parm",
        needs=("mass", *ROTORS, *SPEED),
        module="ardupilot",
    ),
    "ardupilot-sitl": Target(
        "ArduPilot: frame of its simulator",
        "ArduPilot",
        ".json",
        needs=(*BODY, *ROTORS),
        module="ardupilot",
        speed="full-command",
    ),
    "betaflight": Target(
        "Betaflight: thrust_linear", "Betaflight", ".txt", needs=SPEED, module="betaflight"
    ),
    "indiflight": Target(
        "INDIflight: control effectiveness",
        "INDIflight",
        ".txt",
        needs=(*BODY, *ROTORS, *SPEED),
        module="betaflight",
        intervals=True,
    ),
    "paparazzi": Target(
        "Paparazzi: control effectiveness",
        "Paparazzi",
        ".xml",
        needs=(*BODY, *ROTORS, *SPEED),
        module="paparazzi",
        intervals=True,
    ),
    "crazyflow": Target(
        "Crazyflow: params.toml", "Crazyflow", ".toml", needs=ALL, module="crazyflow"
    ),
    "casadi": Target(
        "CasADi: dynamics in Python", "CasADi", ".py", needs=(*BODY, *ROTORS, *LAG), module="casadi"
    ),
}
RANDOM_TARGETS: Final[Mapping[RandomTargetName, Target]] = {
    "samples": Target(
        "Vehicles drawn from the result (NumPy arrays)",
        "NumPy",
        ".npz",
        needs=(*BODY, *ROTORS),
        module="samples",
    ),
    "isaac-lab": Target(
        "Isaac Lab: ranges to randomise", "Isaac Lab", ".py", needs=ALL, module="isaac_sim"
    ),
    "pegasus": Target(
        "Pegasus: drawn vehicles",
        "Pegasus",
        ".py",
        needs=(*BODY, *ROTORS, *SPEED),
        module="isaac_sim",
    ),
    "crazyflow-worlds": Target(
        "Crazyflow: drawn worlds",
        "Crazyflow",
        ".npz",
        needs=(*BODY, *ROTORS, *LAG),
        module="crazyflow",
    ),
}
OFFERED: Final[Mapping[str, Target]] = {**TARGETS, **RANDOM_TARGETS}
"""What can be made of a result alone, without its flights."""


def writer_of(target: TargetName | RandomTargetName) -> Any:
    """Import the writer of a target.

    That of a vehicle is ``(VehicleModel, head) -> str``, with the drawn vehicles as a third
    argument where the target has `intervals`; that of drawn vehicles ``(Variants, head) -> bytes``.
    """
    module = import_module(f"rotorfit.export.{OFFERED[target].module}")
    return getattr(module, f"write_{target.replace('-', '_')}")
