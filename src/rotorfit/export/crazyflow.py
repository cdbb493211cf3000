"""Crazyflow: a section for its params.toml, or the parameters of every world as arrays.

Source: crazyflow 0.4, dynamics/first_principles/params.toml and dynamics.py: thrust and torque are
polynomials in RPM; torque = mixing_matrix (thrust L) about x and y, and mixing_matrix torque about
z, so that its rows are y/L, -x/L (positions from the CoM, FLU) and -1 for a rotor that turns ccw; J
is about the CoM; rotor_dyn_coef = [1/tau_up, 0, 1/tau_down, 0]. dynamics() takes a curve for each
rotor, but sim.py (rotor_vel_limits, Params.create) only one from the file: where rotors differ, the
curve is their mean, and the rows of x and y carry kt_i / kt, so that every torque stays right. A
section is of a drone in drones/__init__.py, each with its MJCF file.

The worlds are for ``sim.data.params`` (Params, utils.leaf_replace): every parameter may have
leading axes (worlds, drones), and the curves may be those of each motor. Joint draws stay joint.
"""

import io
from collections.abc import Sequence

import numpy as np

from rotorfit.export.file_format import (
    hash_comment,
    identifier,
    per_squared_rpm,
    text,
    with_notes,
)
from rotorfit.export.variants import Variants
from rotorfit.export.vehicle import VehicleModel, refuse_no_lag, refuse_no_upright_quad


def write_crazyflow(model: VehicleModel, head: Sequence[str]) -> str:
    """Write the section of a drone."""
    refuse_no_lag(model, "Crazyflow")
    refuse_no_upright_quad(model, "Crazyflow")
    comment = with_notes(
        head,
        "paste into crazyflow/dynamics/first_principles/params.toml under the name of a drone that "
        "crazyflow has (crazyflow.drones.Drone), in place of its section; thrust [N] and torque "
        "[N m] are polynomials in RPM, lowest power first; J is about the CoM",
        "drag is left out: 0; prop_inertia 0 leaves out gyroscopic torque where Jr is not known",
    )
    if len({rotor.kt for rotor in model.rotors}) > 1:
        comment = with_notes(
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
    """Write a TOML float, which has a point or an exponent."""
    shown = text(value)
    return shown if set(".e") & set(shown) else f"{shown}.0"


def _row(values: Sequence[float]) -> str:
    return f"[{', '.join(_real(value) for value in values)}]"


def _matrix(values: np.ndarray) -> str:
    rows = ",\n".join(f"    {_row(row)}" for row in values.tolist())
    return f"[\n{rows}\n]"


def write_crazyflow_worlds(found: Variants, head: Sequence[str]) -> bytes:
    """Write the arrays as npz: one world a vehicle, one drone in each."""
    refuse_no_lag(found.nominal, "Crazyflow")
    refuse_no_upright_quad(found.nominal, "Crazyflow")
    worlds = [_params(model) for model in found.models]
    arrays = {name: np.array([world[name] for world in worlds])[:, None] for name in worlds[0]}
    room = io.BytesIO()
    np.savez(room, allow_pickle=False, about=np.array("\n".join(head)), **arrays)
    return room.getvalue()


def _params(model: VehicleModel) -> dict[str, np.ndarray]:
    """Collect the parameters of one drone, in the shapes that Crazyflow has per motor."""
    arms = model.arms[:, :2]
    length = float(np.abs(arms).mean())
    curve = np.array([[0.0, 0.0, per_squared_rpm(rotor.kt)] for rotor in model.rotors])
    spin = np.array([-rotor.spin for rotor in model.rotors])
    return {
        "mass": np.array([model.mass]),
        "L": np.array([length]),
        "prop_inertia": np.array([model.Jr or 0.0]),
        "J": model.inertia_com,
        "J_inv": np.linalg.inv(model.inertia_com),
        "rpm2thrust": curve,
        "rpm2torque": np.array([[0.0, 0.0, per_squared_rpm(model.kd)]]),
        "mixing_matrix": np.array([arms[:, 1] / length, -arms[:, 0] / length, spin]),
        "drag_matrix": np.zeros((3, 3)),
        "rotor_dyn_coef": np.array([[1.0 / model.lag_up, 0.0, 1.0 / model.lag_down, 0.0]]),
    }
