"""RotorPy: a Python file with the dictionary `quad_params`.

Source: RotorPy, rotorpy/vehicles/multirotor.py and crazyflie_params.py: vectors are from the CoM,
axes FLU; thrust k_eta w^2 along z, torque rotor_directions k_m w^2 about z (so -1 for a rotor that
turns ccw); inertia about the CoM as tensor elements; one time constant tau_m; its allocation
inverts a 4 x N matrix, and takes four rotors only.
"""

from collections.abc import Sequence

from rotorfit.export.file_format import elements, hash_comment, text, with_notes
from rotorfit.export.vehicle import VehicleModel, refuse_no_lag, refuse_no_upright_quad
from rotorfit.model.parameters import INERTIA

LEFT_OUT = ("c_Dx", "c_Dy", "c_Dz", "k_d", "k_z", "k_h", "k_flap", "motor_noise_std")


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
        f"left out, 0 here: {', '.join(LEFT_OUT)}",
    )
    lines = "".join(f"    {name!r}: {value},\n" for name, value in _entries(model))
    return hash_comment(comment) + f"import numpy as np\n\nquad_params = {{\n{lines}}}\n"


def _entries(model: VehicleModel) -> list[tuple[str, str]]:
    places = ", ".join(f"'r{i}': {_array(arm)}" for i, arm in enumerate(model.arms.tolist(), 1))
    return [
        ("mass", text(model.mass)),
        *zip(INERTIA, map(text, elements(model.inertia_com)), strict=True),
        ("num_rotors", str(len(model.rotors))),
        ("rotor_pos", f"{{{places}}}"),
        ("rotor_directions", _array([-rotor.spin for rotor in model.rotors])),
        ("rI", _array((model.imu - model.com).tolist())),
        ("k_eta", text(model.kt)),
        ("k_m", text(model.kd)),
        ("tau_m", text(model.mean_lag)),
        ("rotor_speed_min", "0.0"),
        ("rotor_speed_max", text(model.max_speed)),
        *((name, "0.0") for name in LEFT_OUT),
    ]


def _array(values: Sequence[float]) -> str:
    return f"np.array([{', '.join(text(value) for value in values)}])"
