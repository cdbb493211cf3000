"""CasADi: a Python file with the equations of motion as a CasADi function.

The equations are those of the model (`rotorfit.model.regressor`) about the CoM: rotor inertia with
its gyroscopic torque and reaction included. Nothing but casadi is needed to use the file.
"""

from collections.abc import Sequence

from rotorfit.export.file_format import hash_comment, listed, template_text, text, with_notes
from rotorfit.export.vehicle import VehicleModel, refuse_no_lag
from rotorfit.preprocessing.airborne import GRAVITY


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
        ("INERTIA", _rows(model.inertia_com.tolist())),
        ("KT", listed([rotor.kt for rotor in model.rotors])),
        ("KD", text(model.kd)),
        ("JR", text(model.Jr or 0.0)),
        ("LAG_UP", text(model.lag_up)),
        ("LAG_DOWN", text(model.lag_down)),
        ("ARMS", _rows(model.arms.tolist())),
        ("AXES", _rows([rotor.axis.tolist() for rotor in model.rotors])),
        ("SPINS", listed([rotor.spin for rotor in model.rotors])),
    )
    lines = "".join(f"{name} = {value}\n" for name, value in constants)
    begin = f"{hash_comment(comment)}import casadi as ca\n\n{lines}\n"
    return begin + template_text("casadi_dynamics.py.txt")


def _rows(values: Sequence[Sequence[float]]) -> str:
    return f"[{', '.join(listed(row) for row in values)}]"
