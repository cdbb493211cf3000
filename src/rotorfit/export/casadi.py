"""CasADi: a Python file with the equations of motion as a CasADi function.

The equations are those of the model (`rotorfit.model.regressor`) about the CoM: rotor inertia with
its gyroscopic torque and reaction included. Nothing but casadi is needed to use the file.
"""

from collections.abc import Sequence

from rotorfit.export.file_format import hash_comment, listed, text, with_notes
from rotorfit.export.vehicle import VehicleModel, refuse_no_lag
from rotorfit.preprocessing.airborne import GRAVITY

FUNCTION = '''
def dynamics():
    """Return the CasADi function (state, command) -> rate of change of the state.

    state: position of the CoM and its velocity, world axes with z up [m, m/s]; quaternion w, x, y,
    z, body to world; body rates [rad/s]; rotor speeds [rad/s]. command: rotor speeds [rad/s].
    """
    N = len(KT)
    v, q, w, O = ca.SX.sym("v", 3), ca.SX.sym("q", 4), ca.SX.sym("w", 3), ca.SX.sym("O", N)
    p, command = ca.SX.sym("p", 3), ca.SX.sym("command", N)
    tau = ca.if_else(command > O, LAG_UP, LAG_DOWN)
    dO = (command - O) / tau
    force, torque = ca.SX.zeros(3), ca.SX.zeros(3)
    H, dH = ca.SX.zeros(3), ca.SX.zeros(3)
    for i in range(N):
        n, r = ca.DM(AXES[i]), ca.DM(ARMS[i])
        thrust = KT[i] * O[i] ** 2 * n
        force += thrust
        torque += ca.cross(r, thrust) - SPINS[i] * KD * O[i] ** 2 * n
        H += SPINS[i] * JR * O[i] * n
        dH += SPINS[i] * JR * dO[i] * n
    inertia = ca.DM(INERTIA)
    torque += -dH - ca.cross(w, H)
    dw = ca.solve(inertia, torque - ca.cross(w, inertia @ w))
    qw, qv = q[0], q[1:]
    rotated = force + 2 * ca.cross(qv, ca.cross(qv, force) + qw * force)
    dv = rotated / MASS + ca.DM([0, 0, -GRAVITY])
    dq = 0.5 * ca.vertcat(-ca.dot(qv, w), qw * w + ca.cross(qv, w))
    state = ca.vertcat(p, v, q, w, O)
    rate = ca.vertcat(v, dv, dq, dw, dO)
    return ca.Function("dynamics", [state, command], [rate], ["state", "command"], ["rate"])
'''


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
    return hash_comment(comment) + f"import casadi as ca\n\n{lines}\n{FUNCTION}"


def _rows(values: Sequence[Sequence[float]]) -> str:
    return f"[{', '.join(listed(row) for row in values)}]"
