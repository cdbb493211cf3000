"""NVIDIA Isaac Sim: ranges for Isaac Lab, vehicles for the Pegasus Simulator.

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

from collections.abc import Sequence
from typing import Any

import numpy as np

from rotorfit.export.file_format import hash_comment, template_text, with_notes
from rotorfit.export.variants import Variants
from rotorfit.export.vehicle import VehicleModel


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
    body = f"\nEVENTS = {_written(_events(found))}\n\nTHRUSTER = {_written(_thruster(found))}\n"
    return (hash_comment(remarks) + body + template_text("isaac_lab_events.py.txt")).encode()


def _events(found: Variants) -> dict[str, Any]:
    nominal = found.nominal
    com = np.array([m.com - nominal.com for m in found.models])
    moments = np.diag(nominal.inertia_com)
    relative = np.array([np.diag(m.inertia_com) / moments for m in found.models])
    ends = np.array([_ends(column) for column in relative.T])
    widest = int(np.argmax(ends[:, 1] - ends[:, 0]))
    return {
        "com": {
            "func": "randomize_rigid_body_com",
            "params": {"com_range": {a: _ends(com[:, i]) for i, a in enumerate("xyz")}},
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


def _thruster(found: Variants) -> dict[str, Any]:
    models = found.models
    per_turn = (2.0 * np.pi) ** 2  # from squared rad/s to squared revolutions per second
    kt = per_turn * np.array([[rotor.kt for rotor in m.rotors] for m in models])
    full = found.nominal.kt * found.nominal.max_speed**2
    return {
        "thrust_range": (0.0, full),
        "thrust_const_range": _ends(kt.ravel()),
        "tau_inc_range": _ends(np.array([m.lag_up for m in models])),
        "tau_dec_range": _ends(np.array([m.lag_down for m in models])),
        "torque_to_thrust_ratio": found.nominal.kd / found.nominal.kt,
    }


def _ends(values: np.ndarray) -> tuple[float, float]:
    """Compute the ends between which 95 % of the draws are."""
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)


def _written(table: dict[str, Any]) -> str:
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
    rows = "".join(f"    {_vehicle(model)!r},\n" for model in found.models)
    return f"{hash_comment(remarks)}\nVEHICLES = [\n{rows}]\n".encode()


def _vehicle(model: VehicleModel) -> dict[str, Any]:
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
