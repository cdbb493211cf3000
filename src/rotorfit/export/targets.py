"""The targets of `rotorfit export`: names, and the table `targets.toml` of needs and writers.

The command line and the page offer the names at once; a writer is imported when its file is made.
"""

from __future__ import annotations

import tomllib
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

TargetName = Literal[
    "gazebo",
    "gazebo-motors",
    "px4",
    "px4-gazebo",
    "px4-sih",
    "px4-setpoints",
    "mujoco",
    "urdf",
    "gym-pybullet-drones",
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
"""Every target, and ``table``, which is of flights (`rotorfit.export.write`)."""
Speed = Literal["rad/s", "full-command", "nominal"]

INERTIA_COM: Final = ("Ixx_com", "Iyy_com", "Izz_com", "Ixy_com", "Ixz_com", "Iyz_com")
MASS: Final = ("mass", "com_x", "com_y", "com_z")
BODY: Final = (*MASS, *INERTIA_COM)
ROTORS: Final = ("kt", "kd")
LAG: Final = ("motor_lag",)
SPEED: Final = ("max_speed",)
ALL: Final = (*BODY, *ROTORS, *LAG, *SPEED)
_GROUPS: Final = dict(
    MASS=MASS,
    MOMENTS=INERTIA_COM[:3],
    INERTIA=INERTIA_COM,
    BODY=BODY,
    ROTORS=ROTORS,
    LAG=LAG,
    SPEED=SPEED,
    ALL=ALL,
)
"""Groups of numbers by their names in the file."""


@frozen_dataclass
class Target:
    """A kind of file.

    - `title`: as the page offers it.
    - `consumer`: the program that reads the file; the tests load it there where it is installed.
    - `suffix`: of the file, where nobody names another.
    - `needs`: numbers without which the file cannot be written.
    - `tilted_needs`: more of them, where a rotor is not upright.
    - `module`: of `rotorfit.export`, with the function ``write_TARGET``.
    - `speed`: whether the file holds rotor speeds, only what a rotor does at full command, or
      speeds of which a nominal one will do, since the consumer flies by thrust and torque alone.
    - `terms`: optional terms of the model that it holds.
    - `intervals`: whether its writer takes drawn vehicles, too, from which it writes intervals.
    """

    title: str
    consumer: str
    suffix: str
    needs: tuple[str, ...]
    module: str
    speed: Speed = "rad/s"
    terms: Sequence[str] = ()
    intervals: bool = False
    tilted_needs: tuple[str, ...] = ()


def _read_targets(kind: str) -> dict[Any, Target]:
    """Read the targets of vehicles or of random ones, their groups of needs written out."""
    rows = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))[kind]
    for row in rows.values():
        row["needs"] = tuple(name for one in row["needs"] for name in _GROUPS.get(one, (one,)))
        row["tilted_needs"] = tuple(row.get("tilted_needs", ()))
    return {name: Target(**row) for name, row in rows.items()}


TARGETS: Final[Mapping[TargetName, Target]] = _read_targets("vehicle")
RANDOM_TARGETS: Final[Mapping[RandomTargetName, Target]] = _read_targets("random")
OFFERED: Final[Mapping[str, Target]] = {**TARGETS, **RANDOM_TARGETS}
"""What can be made of a result alone, without its flights."""


def writer_of(target: TargetName | RandomTargetName) -> Any:
    """Import the writer of a target.

    That of a vehicle is ``(VehicleModel, head) -> str``, with the drawn vehicles as a third
    argument where the target has `intervals`; that of drawn vehicles ``(Variants, head) -> bytes``.
    """
    module = import_module(f"rotorfit.export.{OFFERED[target].module}")
    return getattr(module, f"write_{target.replace('-', '_')}")
