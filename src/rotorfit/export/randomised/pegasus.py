"""Pegasus Simulator: one vehicle a draw, as configurations of its thrust curve and its body.

Source: PegasusSimulator, logic/thrusters/quadratic_thrust_curve.py: a dictionary of lists, one
entry a rotor; thrust rotor_constant w^2, torque rolling_moment_coefficient w^2 rot_dir about z,
with -1 for a rotor that turns counter-clockwise; speeds in rad/s, without lag. Mass, centre of mass
and inertia are of the USD body and set by PhysX's own properties. Pegasus runs inside Isaac Sim and
is not on the package index: its class is evaluated in the tests by its own formulas.
"""

from typing import Any, Final

from rotorfit.export.header import hash_comment, noted
from rotorfit.export.randomised.variants import Variants
from rotorfit.export.vehicle import BODY, ROTORS, SPEED, VehicleModel

NEEDS: Final = (*BODY, *ROTORS, *SPEED)


def pegasus_vehicles(found: Variants, head: list[str]) -> bytes:
    """Return a Python file with the list ``VEHICLES``."""
    remarks = noted(
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
