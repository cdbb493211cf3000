"""Crazyflow: the parameters of every world, as arrays for ``sim.data.params``.

Source: crazyflow 0.4, dynamics/first_principles/dynamics.py (Params, dynamics) and
utils.leaf_replace: every parameter may have leading axes (worlds, drones); thrust and torque curves
may be those of each motor. Joint draws stay joint.
"""

import io
from typing import Final

import numpy as np

from rotorfit.export.randomised.variants import Variants
from rotorfit.export.units import per_squared_rpm
from rotorfit.export.vehicle import (
    BODY,
    LAG,
    ROTORS,
    VehicleModel,
    refuse_no_lag,
    refuse_no_upright_quad,
)

NEEDS: Final = (*BODY, *ROTORS, *LAG)


def crazyflow_worlds(found: Variants, head: list[str]) -> bytes:
    """Return the arrays as npz: one world a vehicle, one drone in each."""
    refuse_no_lag(found.nominal, "Crazyflow")
    refuse_no_upright_quad(found.nominal, "Crazyflow")
    worlds = [_params(model) for model in found.models]
    arrays = {name: np.array([world[name] for world in worlds])[:, None] for name in worlds[0]}
    room = io.BytesIO()
    np.savez(room, allow_pickle=False, about=np.array("\n".join(head)), **arrays)
    return room.getvalue()


def _params(model: VehicleModel) -> dict[str, np.ndarray]:
    """Return the parameters of one drone, in the shapes that Crazyflow has per motor."""
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
