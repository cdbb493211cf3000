"""Crazyflow, RotorPy, CasADi, Isaac Lab and Pegasus: files that Python reads.

Crazyflow, a section of params.toml or every world as arrays: crazyflow 0.4,
dynamics/first_principles/params.toml and dynamics.py: thrust and torque are polynomials in RPM;
torque = mixing_matrix (thrust L) about x and y, and mixing_matrix torque about z, so that its rows
are y/L, -x/L (positions from the CoM, FLU) and -1 for a rotor that turns ccw; J is about the CoM;
rotor_dyn_coef = [1/tau_up, 0, 1/tau_down, 0]. dynamics() takes a curve for each rotor, but sim.py
(rotor_vel_limits, Params.create) only one from the file: where rotors differ, the curve is their
mean, and the rows of x and y carry kt_i / kt, so that every torque stays right. A section is of a
drone in drones/__init__.py, each with its MJCF file.

The worlds are for ``sim.data.params`` (Params, utils.leaf_replace): every parameter may have
leading axes (worlds, drones), and the curves may be those of each motor. Joint draws stay joint.

RotorPy, the dictionary `quad_params`: rotorpy/vehicles/multirotor.py and crazyflie_params.py:
vectors are from the CoM, axes FLU; thrust k_eta w^2 along z, torque rotor_directions k_m w^2 about
z (so -1 for a rotor that turns ccw); inertia about the CoM as tensor elements; one time constant
tau_m; its allocation inverts a 4 x N matrix, and takes four rotors only. Its rotor drag, with the
velocity of each rotor, is -w diag(k_d, k_d, k_z) v.

CasADi: the equations are those of the model (`rotorfit.model.regressor`) about the CoM: rotor
inertia with its gyroscopic torque and reaction included. Nothing but casadi is needed to use the
file.

Sources for Isaac Lab: IsaacLab, isaaclab/envs/mdp/events.py (randomize_rigid_body_mass,
randomize_rigid_body_com, randomize_rigid_body_inertia: uniform ranges, one for all elements of an
operation) and isaaclab_contrib/actuators/thruster_cfg.py (ThrusterCfg: thrust_range,
thrust_const_range in N per squared revolution per second, tau_inc_range, tau_dec_range,
torque_to_thrust_ratio). Ranges have no correlations: they are the 95 % of the draws, each by
itself, and the file says so. Names, units and formulas are those of the source of its package
2.3.2.

Source for Pegasus: PegasusSimulator, logic/thrusters/quadratic_thrust_curve.py: a dictionary of
lists, one entry a rotor; thrust rotor_constant w^2, torque rolling_moment_coefficient w^2 rot_dir
about z, with -1 for a rotor that turns counter-clockwise; speeds in rad/s, without lag. Mass,
centre of mass and inertia are of the USD body and set by PhysX's own properties. Pegasus is not on
the package index: its class is evaluated in the tests by its own formulas.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rotorfit.export.file_format import (
    elements,
    hash_comment,
    identifier,
    listed,
    npz,
    per_squared_rpm,
    template_text,
    text,
    with_notes,
)
from rotorfit.export.vehicle import VehicleModel, refuse_no_lag, refuse_no_upright_quad
from rotorfit.flight.airborne import GRAVITY
from rotorfit.model.parameters import INERTIA

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rotorfit.export.variants import Variants


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
    lines = "".join(f"{name} = {value}\n" for name, value in _scalar_entries(model))
    return hash_comment(comment) + f"\n[{identifier(model.name)}]\n{lines}"


def _scalar_entries(model: VehicleModel) -> list[tuple[str, str]]:
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
        ("mass", _toml_float(model.mass)),
        ("J", _toml_matrix(model.inertia_com)),
        ("thrust_min", "0.0"),
        ("thrust_max", _toml_float(model.kt * model.max_speed**2)),
        ("L", _toml_float(arm)),
        ("prop_inertia", _toml_float(model.Jr or 0.0)),
        ("rpm2thrust", _toml_row([0.0, 0.0, per_squared_rpm(model.kt)])),
        ("rpm2torque", _toml_row([0.0, 0.0, per_squared_rpm(model.kd)])),
        ("rotor_dyn_coef", _toml_row([1.0 / model.lag_up, 0.0, 1.0 / model.lag_down, 0.0])),
        ("mixing_matrix", _toml_matrix(mixing)),
        ("drag_matrix", _toml_matrix(np.zeros((3, 3)))),
    ]


def _toml_float(value: float) -> str:
    """Write a TOML float, which has a point or an exponent."""
    shown = text(value)
    return shown if set(".e") & set(shown) else f"{shown}.0"


def _toml_row(values: Sequence[float]) -> str:
    return f"[{', '.join(_toml_float(value) for value in values)}]"


def _toml_matrix(values: np.ndarray) -> str:
    rows = ",\n".join(f"    {_toml_row(row)}" for row in values.tolist())
    return f"[\n{rows}\n]"


def write_crazyflow_worlds(found: Variants, head: Sequence[str]) -> bytes:
    """Write the arrays as npz: one world a vehicle, one drone in each."""
    refuse_no_lag(found.nominal, "Crazyflow")
    refuse_no_upright_quad(found.nominal, "Crazyflow")
    worlds = [_drone_params(model) for model in found.models]
    arrays = {name: np.array([world[name] for world in worlds])[:, None] for name in worlds[0]}
    return npz({"about": np.array("\n".join(head)), **arrays})


def _drone_params(model: VehicleModel) -> dict[str, np.ndarray]:
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


LEFT_OUT = ("c_Dx", "c_Dy", "c_Dz", "k_z", "k_h", "k_flap", "motor_noise_std")
"""What rotorfit identifies has another form: `inflow` ties climb (k_z) and translational lift (k_h)
by Glauert's velocity, the torque of the wakes has no rotor speed in it (k_flap), and drag of the
frame is in proportion to velocity, not to its square (c_D)."""


def write_rotorpy(model: VehicleModel, head: Sequence[str]) -> str:
    """Write the dictionary as a Python module."""
    refuse_no_lag(model, "RotorPy")
    refuse_no_upright_quad(model, "RotorPy")
    comment = with_notes(
        head,
        "positions from the CoM [m]; rI is the IMU's; rotor_directions is the sign of the torque "
        "about z, -1 for a rotor that turns ccw",
        "k_eta is the mean of the rotors, k_m is kd; tau_m is the mean of up and down; Jr has no "
        "place in RotorPy",
        "k_d is rotor_drag: 0 where these flights do not show it",
        f"left out, 0 here: {', '.join(LEFT_OUT)}",
    )
    lines = "".join(f"    {name!r}: {value},\n" for name, value in _quad_params(model))
    return hash_comment(comment) + f"import numpy as np\n\nquad_params = {{\n{lines}}}\n"


def _quad_params(model: VehicleModel) -> list[tuple[str, str]]:
    places = ", ".join(
        f"'r{i}': {_array_text(arm)}" for i, arm in enumerate(model.arms.tolist(), 1)
    )
    return [
        ("mass", text(model.mass)),
        *zip(INERTIA, map(text, elements(model.inertia_com)), strict=True),
        ("num_rotors", str(len(model.rotors))),
        ("rotor_pos", f"{{{places}}}"),
        ("rotor_directions", _array_text([-rotor.spin for rotor in model.rotors])),
        ("rI", _array_text((model.imu - model.com).tolist())),
        ("k_eta", text(model.kt)),
        ("k_m", text(model.kd)),
        ("tau_m", text(model.mean_lag)),
        ("rotor_speed_min", "0.0"),
        ("rotor_speed_max", text(model.max_speed)),
        ("k_d", text(model.air.get("rotor_drag", 0.0))),
        *((name, "0.0") for name in LEFT_OUT),
    ]


def _array_text(values: Sequence[float]) -> str:
    return f"np.array([{', '.join(text(value) for value in values)}])"


def write_casadi(model: VehicleModel, head: Sequence[str]) -> str:
    """Write a Python module with the function `dynamics`."""
    refuse_no_lag(model, "the CasADi function")
    comment = with_notes(
        head,
        "ARMS are the rotors' positions from the CoM, INERTIA is about it; SPINS +1 for ccw",
    )
    constants = (
        ("MASS", text(model.mass)),
        ("GRAVITY", text(GRAVITY)),
        ("INERTIA", _rows_text(model.inertia_com.tolist())),
        ("KT", listed([rotor.kt for rotor in model.rotors])),
        ("KD", text(model.kd)),
        ("JR", text(model.Jr or 0.0)),
        ("LAG_UP", text(model.lag_up)),
        ("LAG_DOWN", text(model.lag_down)),
        ("ARMS", _rows_text(model.arms.tolist())),
        ("AXES", _rows_text([rotor.axis.tolist() for rotor in model.rotors])),
        ("SPINS", listed([rotor.spin for rotor in model.rotors])),
    )
    lines = "".join(f"{name} = {value}\n" for name, value in constants)
    begin = f"{hash_comment(comment)}import casadi as ca\n\n{lines}\n"
    return begin + template_text("casadi_dynamics.py.txt")


def _rows_text(values: Sequence[Sequence[float]]) -> str:
    return f"[{', '.join(listed(row) for row in values)}]"


def write_isaac_lab(found: Variants, head: Sequence[str]) -> bytes:
    """Write a Python file with ``EVENTS``, ``THRUSTER`` and ``event_terms``."""
    remarks = with_notes(
        head,
        "ranges hold 95 % of the draws, each number by itself: Isaac Lab draws uniformly and "
        "independently, so that correlations are lost (samples and crazyflow-worlds keep them)",
        "body terms are changes of the vehicle that was exported (urdf): com_range is added, "
        "inertia is scaled by one range, the widest of Ixx, Iyy, Izz; its products stay, since "
        "Isaac Lab would draw Ixy and Iyx apart",
        "ThrusterCfg(dt=..., thruster_names_expr=[...], **THRUSTER): thrust_const is in N per "
        "squared revolution per second, and raised to 1e-6 there if it is smaller, which changes "
        "the thrust at the start alone",
        "the inertia term needs an Isaac Lab with randomize_rigid_body_inertia (2.3 has none)",
    )
    events, thruster = _table_text(_event_table(found)), _table_text(_thruster_table(found))
    body = f"\nEVENTS = {events}\n\nTHRUSTER = {thruster}\n"
    return (hash_comment(remarks) + body + template_text("isaac_lab_events.py.txt")).encode()


def _event_table(found: Variants) -> dict[str, Any]:
    nominal = found.nominal
    com = np.array([m.com - nominal.com for m in found.models])
    moments = np.diag(nominal.inertia_com)
    relative = np.array([np.diag(m.inertia_com) / moments for m in found.models])
    ends = np.array([_ends_of_draws(column) for column in relative.T])
    widest = int(np.argmax(ends[:, 1] - ends[:, 0]))
    return {
        "com": {
            "func": "randomize_rigid_body_com",
            "params": {"com_range": {a: _ends_of_draws(com[:, i]) for i, a in enumerate("xyz")}},
        },
        "inertia": {
            "func": "randomize_rigid_body_inertia",
            "params": {
                "inertia_distribution_params": tuple(ends[widest].tolist()),
                "operation": "scale",
                "distribution": "uniform",
                "diagonal_only": True,
            },
        },
    }


def _thruster_table(found: Variants) -> dict[str, Any]:
    models = found.models
    per_turn = (2.0 * np.pi) ** 2  # from squared rad/s to squared revolutions per second
    kt = per_turn * np.array([[rotor.kt for rotor in m.rotors] for m in models])
    full = found.nominal.kt * found.nominal.max_speed**2
    return {
        "thrust_range": (0.0, full),
        "thrust_const_range": _ends_of_draws(kt.ravel()),
        "tau_inc_range": _ends_of_draws(np.array([m.lag_up for m in models])),
        "tau_dec_range": _ends_of_draws(np.array([m.lag_down for m in models])),
        "torque_to_thrust_ratio": found.nominal.kd / found.nominal.kt,
    }


def _ends_of_draws(values: np.ndarray) -> tuple[float, float]:
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)


def _table_text(table: dict[str, Any]) -> str:
    rows = "".join(f"    {name!r}: {value!r},\n" for name, value in table.items())
    return f"{{\n{rows}}}"


def write_pegasus(found: Variants, head: Sequence[str]) -> bytes:
    """Write a Python file with the list ``VEHICLES``."""
    remarks = with_notes(
        head,
        "QuadraticThrustCurve(VEHICLES[i]['thrust_curve']); rotors in the order of the log, "
        "which must be that of the vehicle's rotor joints; its motors have no lag",
        "mass, centre of mass (from the origin, FLU) and inertia (about it, tensor) are for the "
        "body's UsdPhysics.MassAPI, which takes principal moments and their axes",
    )
    rows = "".join(f"    {_vehicle_table(model)!r},\n" for model in found.models)
    return f"{hash_comment(remarks)}\nVEHICLES = [\n{rows}]\n".encode()


def _vehicle_table(model: VehicleModel) -> dict[str, Any]:
    count = len(model.rotors)
    return {
        "mass": model.mass,
        "com": model.com.tolist(),
        "inertia": model.inertia_com.tolist(),
        "thrust_curve": {
            "num_rotors": count,
            "rotor_constant": [rotor.kt for rotor in model.rotors],
            "rolling_moment_coefficient": [model.kd] * count,
            "rot_dir": [-int(rotor.spin) for rotor in model.rotors],
            "min_rotor_velocity": [0.0] * count,
            "max_rotor_velocity": [model.max_speed] * count,
        },
    }
