"""Crazyflow: a section for crazyflow/dynamics/first_principles/params.toml.

Source: crazyflow 0.4, dynamics/first_principles/params.toml and dynamics.py: thrust and torque are
polynomials in RPM; torque = mixing_matrix (thrust L) about x and y, and mixing_matrix torque about
z, so that its rows are y/L, -x/L (positions from the CoM, FLU) and -1 for a rotor that turns ccw; J
is about the CoM; rotor_dyn_coef = [1/tau_up, 0, 1/tau_down, 0].
"""

from collections.abc import Sequence

import numpy as np

from rotorfit.errors import OutputError
from rotorfit.export.header import hash_comment, identifier, noted
from rotorfit.export.units import per_squared_rpm, text
from rotorfit.export.vehicle import BODY, LAG, ROTORS, SPEED, VehicleModel, refuse_no_lag

NEEDS = (*BODY, *ROTORS, *LAG, *SPEED)


def write_crazyflow(model: VehicleModel, head: Sequence[str]) -> str:
    """Return the section of a drone."""
    refuse_no_lag(model, "Crazyflow")
    if len(model.rotors) != 4 or not model.vertical:
        raise OutputError(
            "Crazyflow flies four rotors with upright thrust; these are others: export to mujoco "
            "or gazebo instead"
        )
    comment = noted(
        head,
        "paste into crazyflow/dynamics/first_principles/params.toml; thrust [N] and torque [N m] "
        "are polynomials in RPM, lowest power first; J is about the CoM",
        "drag is left out: 0; prop_inertia 0 leaves out gyroscopic torque where Jr is not known",
    )
    lines = "".join(f"{name} = {value}\n" for name, value in _entries(model))
    return hash_comment(comment) + f"\n[{identifier(model.name)}]\n{lines}"


def _entries(model: VehicleModel) -> list[tuple[str, str]]:
    arm = float(np.abs(model.arms[:, :2]).mean())
    mixing = np.array(
        [
            model.arms[:, 1] / arm,
            -model.arms[:, 0] / arm,
            [-rotor.spin for rotor in model.rotors],
        ]
    )
    curves = np.array([[0.0, 0.0, per_squared_rpm(rotor.kt)] for rotor in model.rotors])
    same = len({rotor.kt for rotor in model.rotors}) == 1
    full = min(rotor.kt for rotor in model.rotors) * model.max_speed**2
    return [
        ("mass", text(model.mass)),
        ("J", _matrix(model.inertia_com)),
        ("thrust_min", "0.0"),
        ("thrust_max", text(full)),
        ("L", text(arm)),
        ("prop_inertia", _real(model.Jr or 0.0)),
        ("rpm2thrust", _row(curves[0].tolist()) if same else _matrix(curves)),
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
