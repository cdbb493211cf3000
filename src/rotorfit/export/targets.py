"""The targets by name, and the way from a result to the text of a file."""

import datetime
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from rotorfit.errors import EstimationError, OutputError
from rotorfit.export import (
    ardupilot,
    ardupilot_sitl,
    betaflight,
    casadi,
    crazyflow,
    gazebo,
    gazebo_motors,
    mjcf,
    px4,
    px4_sih,
    rotorpy,
    urdf,
)
from rotorfit.export.control import indiflight, paparazzi, px4_setpoints
from rotorfit.export.header import header_lines
from rotorfit.export.randomised.variants import variants
from rotorfit.export.target_names import TargetName
from rotorfit.export.vehicle import Speed, VehicleModel
from rotorfit.export.vehicle_model import terms_left_out, vehicle_model
from rotorfit.results.result import IdentificationResult

Writer = Callable[[VehicleModel, Sequence[str]], str]
IntervalWriter = Callable[[VehicleModel, Sequence[str], Sequence[VehicleModel]], str]
DRAWN = 1000
"""Vehicles drawn for the intervals of what is written: their ends are within 2 % of a width."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A kind of file.

    Attributes
    ----------
    write
        What writes it.
    needs
        The numbers without which it cannot be.
    speed
        Whether it holds rotor speeds, or only what a rotor does at full command.
    terms
        Optional terms of the model that it holds.
    write_intervals
        What writes it with intervals, from vehicles drawn beside it; None: it has no room for them.
    """

    write: Writer
    needs: tuple[str, ...]
    speed: Speed = "rad/s"
    terms: tuple[str, ...] = ()
    write_intervals: IntervalWriter | None = None


TARGETS: Final[Mapping[TargetName, Target]] = {
    "gazebo": Target(write=gazebo.write_gazebo, needs=gazebo.NEEDS),
    "gazebo-motors": Target(write=gazebo_motors.write_gazebo_motors, needs=gazebo_motors.NEEDS),
    "px4": Target(write=px4.write_px4, needs=px4.NEEDS, speed="full-command"),
    "px4-sih": Target(
        write=px4_sih.write_px4_sih,
        needs=px4_sih.NEEDS,
        speed="full-command",
        terms=px4_sih.TERMS,
    ),
    "px4-setpoints": Target(
        write=px4_setpoints.write_px4_setpoints,
        needs=px4_setpoints.NEEDS,
        speed="full-command",
        write_intervals=px4_setpoints.write_px4_setpoints,
    ),
    "mujoco": Target(write=mjcf.write_mujoco, needs=mjcf.NEEDS),
    "urdf": Target(write=urdf.write_urdf, needs=urdf.NEEDS),
    "rotorpy": Target(write=rotorpy.write_rotorpy, needs=rotorpy.NEEDS),
    "ardupilot": Target(write=ardupilot.write_ardupilot, needs=ardupilot.NEEDS),
    "betaflight": Target(write=betaflight.write_betaflight, needs=betaflight.NEEDS),
    "indiflight": Target(
        write=indiflight.write_indiflight,
        needs=indiflight.NEEDS,
        write_intervals=indiflight.write_indiflight,
    ),
    "paparazzi": Target(
        write=paparazzi.write_paparazzi,
        needs=paparazzi.NEEDS,
        write_intervals=paparazzi.write_paparazzi,
    ),
    "ardupilot-sitl": Target(
        write=ardupilot_sitl.write_ardupilot_sitl, needs=ardupilot_sitl.NEEDS, speed="full-command"
    ),
    "crazyflow": Target(write=crazyflow.write_crazyflow, needs=crazyflow.NEEDS),
    "casadi": Target(write=casadi.write_casadi, needs=casadi.NEEDS),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Export:
    """The text of a file, and the vehicle it describes."""

    text: str
    model: VehicleModel


def export(
    result: IdentificationResult,
    target: TargetName,
    *,
    configuration: str | None = None,
    assumed: Mapping[str, float] | None = None,
    project: bool = False,
    date: datetime.date | None = None,
) -> Export:
    """Return a result as a file of another tool.

    Parameters
    ----------
    result
        What `identify` returned, or `IdentificationResult.load`.
    target
        Which tool's file.
    configuration
        Which of the result's configurations; may be left out where there is one.
    assumed
        Values that the user stands for, by name, SI (`parse_assumptions`).
    project
        Replace inertia that no body has by the nearest that one can have.
    date
        Written into the file; today's if None.

    Raises
    ------
    OutputError
        If something that the file needs is not known, or the target cannot hold the vehicle.
    """
    chosen = TARGETS[target]
    model = vehicle_model(
        result,
        configuration=configuration,
        needs=chosen.needs,
        assumed=assumed,
        speed=chosen.speed,
        project=project,
    )
    terms = terms_left_out(result, model.configuration, written=chosen.terms)
    if terms:
        words = f"identified, but left out of this file: {', '.join(terms)}"
        model = replace(model, notes=(*model.notes, words))
    drawn: Sequence[VehicleModel] = ()
    if chosen.write_intervals is not None:
        try:
            drawn = variants(result, model, count=DRAWN, seed=0).models
        except (EstimationError, OutputError) as error:
            model = replace(model, notes=(*model.notes, f"without intervals: {error}"))
    head = header_lines(model, result, target=target, date=date or datetime.date.today())
    if chosen.write_intervals is not None:
        return Export(text=chosen.write_intervals(model, head, drawn), model=model)
    return Export(text=chosen.write(model, head), model=model)
