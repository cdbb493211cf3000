"""Crazyflow: a section for crazyflow/dynamics/first_principles/params.toml.

Source: crazyflow 0.4, dynamics/first_principles/params.toml and dynamics.py: thrust and torque are
polynomials in RPM; torque = mixing_matrix (thrust L) about x and y, and mixing_matrix torque about
z, so that its rows are y/L, -x/L (positions from the CoM, FLU) and -1 for a rotor that turns ccw; J
is about the CoM; rotor_dyn_coef = [1/tau_up, 0, 1/tau_down, 0]. dynamics() takes a curve for each
rotor, but sim.py (rotor_vel_limits, Params.create) only one from the file: where rotors differ, the
curve is their mean, and the rows of x and y carry kt_i / kt, so that every torque stays right. A
section is of a drone in drones/__init__.py, each with its MJCF file.
"""

from collections.abc import Sequence

import numpy as np

from rotorfit.export.header import hash_comment, identifier, noted
from rotorfit.export.units import per_squared_rpm, text
from rotorfit.export.vehicle import (
    BODY,
    LAG,
    ROTORS,
    SPEED,
    VehicleModel,
    refuse_no_lag,
    refuse_no_upright_quad,
)

NEEDS = (*BODY, *ROTORS, *LAG, *SPEED)


def write_crazyflow(model: VehicleModel, head: Sequence[str]) -> str:
    """Return the section of a drone."""
    refuse_no_lag(model, "Crazyflow")
    refuse_no_upright_quad(model, "Crazyflow")
    comment = noted(
        head,
        "paste into crazyflow/dynamics/first_principles/params.toml under the name of a drone that "
        "crazyflow has (crazyflow.drones.Drone), in place of its section; thrust [N] and torque "
        "[N m] are polynomials in RPM, lowest power first; J is about the CoM",
        "drag is left out: 0; prop_inertia 0 leaves out gyroscopic torque where Jr is not known",
    )
    if len({rotor.kt for rotor in model.rotors}) > 1:
        comment = noted(
            comment,
            "rpm2thrust is the mean of the rotors; what each differs by is in the rows of x and y "
            "of mixing_matrix, so that torques are those of the numbers above",
        )
    lines = "".join(f"{name} = {value}\n" for name, value in _entries(model))
    return hash_comment(comment) + f"\n[{identifier(model.name)}]\n{lines}"


def _entries(model: VehicleModel) -> list[tuple[str, str]]:
    arm = float(np.abs(model.arms[:, :2]).mean())
    share = np.array([rotor.kt for rotor in model.rotors]) / model.kt
    mixing = np.array(
        [
            share * model.arms[:, 1] / arm,
            -share * model.arms[:, 0] / arm,
            [-rotor.spin for rotor in model.rotors],
        ]
    )
    return [
        ("mass", _real(model.mass)),
        ("J", _matrix(model.inertia_com)),
        ("thrust_min", "0.0"),
        ("thrust_max", _real(model.kt * model.max_speed**2)),
        ("L", _real(arm)),
        ("prop_inertia", _real(model.Jr or 0.0)),
        ("rpm2thrust", _row([0.0, 0.0, per_squared_rpm(model.kt)])),
        ("rpm2torque", _row([0.0, 0.0, per_squared_rpm(model.kd)])),
        ("rotor_dyn_coef", _row([1.0 / model.lag_up, 0.0, 1.0 / model.lag_down, 0.0])),
        ("mixing_matrix", _matrix(mixing)),
        ("drag_matrix", _matrix(np.zeros((3, 3)))),
    ]


def _real(value: float) -> str:
    """Return a TOML float, which has a point or an exponent."""
    shown = text(value)
    return shown if set(".e") & set(shown) else f"{shown}.0"


def _row(values: Sequence[float]) -> str:
    return f"[{', '.join(_real(value) for value in values)}]"


def _matrix(values: np.ndarray) -> str:
    rows = ",\n".join(f"    {_row(row)}" for row in values.tolist())
    return f"[\n{rows}\n]"
