"""Terms of the rigid body, of its accelerometer, and of torques that do not change."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.airborne import GRAVITY
from rotorfit.model.terms.term import (
    FX,
    FY,
    FZ,
    MX,
    MY,
    MZ,
    Motion,
    Move,
    ParameterInfo,
    Rule,
    Significance,
    Size,
    Term,
    block,
)

if TYPE_CHECKING:
    from rotorfit.model.signals import SignalLayout
    from rotorfit.model.terms.term import Block
    from rotorfit.model.vehicle import Vehicle

ACCEL_BIAS_STD: Final = 0.2
"""What is known of a calibrated accelerometer before the flight [m/s^2]: 20 mg."""
MOUNTING_STD: Final = 0.5
"""The same sideways, where 3 degrees between IMU and rotor plane look like a bias [m/s^2]."""
BIAS_STD: Final = {"x": MOUNTING_STD, "y": MOUNTING_STD, "z": ACCEL_BIAS_STD}
BODY_STD: Final = 10.0
"""Prior deviation of moments of inertia over mass and squared arm: a hundred times that of usual
bodies (.1), which moves a moment that is known to 10 % by less than a millionth."""
OFFSET_STD: Final = 0.05
"""Prior deviation of a constant torque, as a share of the weight at the end of an arm."""


def body_mass(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Mass: force m alpha (the paper's D_m)."""
    del vehicle
    return {"mass": block(layout, {(FX, "ax"): 1.0, (FY, "ay"): 1.0, (FZ, "az"): 1.0})}


def body_first_moments(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """First moments ms = m c: force [dw]x ms + [w]x[w]x ms, torque ms x alpha."""
    del vehicle
    msx = {
        (FX, "wywy"): -1.0, (FX, "wzwz"): -1.0, (FY, "wxwy"): 1.0, (FY, "dwz"): 1.0,
        (FZ, "wxwz"): 1.0, (FZ, "dwy"): -1.0, (MY, "az"): -1.0, (MZ, "ay"): 1.0,
    }  # fmt: skip
    msy = {
        (FX, "wxwy"): 1.0, (FX, "dwz"): -1.0, (FY, "wxwx"): -1.0, (FY, "wzwz"): -1.0,
        (FZ, "wywz"): 1.0, (FZ, "dwx"): 1.0, (MX, "az"): 1.0, (MZ, "ax"): -1.0,
    }  # fmt: skip
    msz = {
        (FX, "wxwz"): 1.0, (FX, "dwy"): 1.0, (FY, "wywz"): 1.0, (FY, "dwx"): -1.0,
        (FZ, "wxwx"): -1.0, (FZ, "wywy"): -1.0, (MX, "ay"): -1.0, (MY, "ax"): 1.0,
    }  # fmt: skip
    return {
        "msx": block(layout, msx),
        "msy": block(layout, msy),
        "msz": block(layout, msz),
    }


def body_inertia(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Inertia at the body origin, tensor elements: torque I dw + w x I w."""
    del vehicle
    entries = {
        "Ixx": {(MX, "dwx"): 1.0, (MY, "wxwz"): 1.0, (MZ, "wxwy"): -1.0},
        "Iyy": {(MX, "wywz"): -1.0, (MY, "dwy"): 1.0, (MZ, "wxwy"): 1.0},
        "Izz": {(MX, "wywz"): 1.0, (MY, "wxwz"): -1.0, (MZ, "dwz"): 1.0},
        "Ixy": {
            (MX, "dwy"): 1.0, (MX, "wxwz"): -1.0, (MY, "dwx"): 1.0, (MY, "wywz"): 1.0,
            (MZ, "wxwx"): 1.0, (MZ, "wywy"): -1.0,
        },
        "Ixz": {
            (MX, "dwz"): 1.0, (MX, "wxwy"): 1.0, (MY, "wzwz"): 1.0, (MY, "wxwx"): -1.0,
            (MZ, "dwx"): 1.0, (MZ, "wywz"): -1.0,
        },
        "Iyz": {
            (MX, "wywy"): 1.0, (MX, "wzwz"): -1.0, (MY, "dwz"): 1.0, (MY, "wxwy"): -1.0,
            (MZ, "dwy"): 1.0, (MZ, "wxwz"): 1.0,
        },
    }  # fmt: skip
    return {name: block(layout, entry) for name, entry in entries.items()}


def constant_wrench(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Force and torque that do not change: what an accelerometer bias leaves, or a trim."""
    del vehicle
    # The equations are inertia less wrench = 0: what acts on the body stands with a minus.
    names = ("Fx_0", "Fy_0", "Fz_0", "Mx_0", "My_0", "Mz_0")
    return {name: block(layout, {(row, "one"): -1.0}) for row, name in enumerate(names)}


def largest_inertia(size: Size) -> float:
    """Return the prior deviation of moments and products of inertia [kg m^2]."""
    # Flights that hardly turn are likeliest with an endless inertia, which takes all numbers of the
    # turns with it, up to where rounding decides about k_t.
    return BODY_STD * size.mass * size.arm**2


def product_scale(one: float, other: float) -> float:
    """Return the size of a product of inertia that matters, by the moments about its two axes."""
    return float(np.sqrt(abs(one) * abs(other))) / 20.0


def _first_moment(axis: str) -> ParameterInfo:
    sideways = axis != "z"
    return ParameterInfo(
        "kg m",
        1,
        f"first moment, mass times CoM {axis}",
        title=f"First moment {axis} (mass times CoM {axis})",
        motion="place" if sideways else "height",
        relevant=lambda s: s.mass * s.arm / 50.0,
        step=lambda s: s.mass * s.arm,
        between_flights="moves" if sideways else None,
    )


def _moment_parameter(name: str, motion: Motion, axis: str) -> ParameterInfo:
    return ParameterInfo(
        "kg m^2",
        1,
        "inertia at the body origin",
        title=f"{axis} inertia at the origin",
        motion=motion,
        prior=largest_inertia,
        on_yaw_scale=name == "Izz",
    )


def _product_parameter(name: str, motion: Motion, relevant: Rule) -> ParameterInfo:
    return ParameterInfo(
        "kg m^2",
        1,
        "product of inertia at the body origin (tensor element)",
        title=f"Product of inertia {name[1:]} at the origin",
        motion=motion,
        relevant=relevant,
        prior=largest_inertia,
    )


def _bias_parameter(axis: str) -> ParameterInfo:
    tilt = "" if axis == "z" else ", mounting tilt included"
    return ParameterInfo(
        "m/s^2",
        0,
        f"accelerometer bias{tilt}",
        title=f"Accelerometer bias {axis}",
        relevant=lambda s: 0.2,
        prior=lambda s: BIAS_STD[axis],
        step=lambda s: 1.0,
    )


MASS: Final = Term(
    name="mass",
    parameters={"mass": ParameterInfo("kg", 1, "mass", title="Mass")},
    owner="configuration",
    entries=body_mass,
)
FIRST_MOMENTS: Final = Term(
    name="first_moments",
    parameters={f"ms{axis}": _first_moment(axis) for axis in "xyz"},
    owner="configuration",
    entries=body_first_moments,
)
INERTIA: Final = Term(
    name="inertia",
    parameters={
        "Ixx": _moment_parameter("Ixx", "roll", "Roll"),
        "Iyy": _moment_parameter("Iyy", "pitch", "Pitch"),
        "Izz": _moment_parameter("Izz", "yaw", "Yaw"),
        "Ixy": _product_parameter(
            "Ixy", "roll", lambda s: product_scale(s.moments[0], s.moments[1])
        ),
        "Ixz": _product_parameter(
            "Ixz", "roll", lambda s: product_scale(s.moments[0], s.moments[2])
        ),
        "Iyz": _product_parameter(
            "Iyz", "pitch", lambda s: product_scale(s.moments[1], s.moments[2])
        ),
    },
    owner="configuration",
    entries=body_inertia,
)
ACCEL_BIAS: Final = Term(
    name="accel_bias",
    words="the bias of the accelerometer",
    when="default",
    parameters={f"accel_bias_{axis}": _bias_parameter(axis) for axis in "xyz"},
    owner="configuration",
    # Force m (alpha - b), torque ms x (alpha - b).
    moves=(
        *(Move(f"F{axis}_0", f"accel_bias_{axis}", "mass") for axis in "xyz"),
        *(Move("Mx_0", "accel_bias_z", "msy"), Move("Mx_0", "accel_bias_y", "msz", -1.0)),
        *(Move("My_0", "accel_bias_x", "msz"), Move("My_0", "accel_bias_z", "msx", -1.0)),
        *(Move("Mz_0", "accel_bias_y", "msx"), Move("Mz_0", "accel_bias_x", "msy", -1.0)),
    ),
    of_sensor=True,
)
TORQUE_OFFSET: Final = Term(
    name="torque_offset",
    words="a constant torque",
    when="likelihood",
    parameters={
        f"torque_offset_{axis}": ParameterInfo(
            "N m",
            1,
            "torque that does not change",
            title=f"Constant torque about {axis}",
            relevant=lambda s: s.mass * GRAVITY * s.arm / 50.0,
            prior=lambda s: OFFSET_STD * s.mass * GRAVITY * s.arm,
        )
        for axis in "xyz"
    },
    owner="configuration",
    entries=constant_wrench,
    moves=tuple(Move(f"M{axis}_0", f"torque_offset_{axis}") for axis in "xyz"),
    significance=Significance(
        parameters=tuple(f"torque_offset_{axis}" for axis in "xyz"),
        least=lambda s: s.trace_torque,
        brakes=False,
    ),
    replayed=lambda values, vehicle: {
        "offset": np.stack([values[f"torque_offset_{axis}"] for axis in "xyz"], axis=1)
    },
)
