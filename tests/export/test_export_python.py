"""RotorPy flies the dictionary, CasADi evaluates the function, as Newton-Euler says."""

import runpy

import numpy as np
import pytest
from export_material import (
    COM,
    IMU,
    INERTIA_COM,
    KD,
    KT,
    KT_EACH,
    LAG,
    MASS,
    RATES,
    ROTORS,
    SPEEDS,
    a_result,
    body_of,
    com_acceleration,
    flat,
    motion,
    saved,
    text_of,
    vehicle,
)

from rotorfit.errors import OutputError


def test_the_dictionary_has_the_vehicle(tmp_path):
    found = runpy.run_path(str(saved(tmp_path, flat(), "rotorpy", "params.py")))["quad_params"]
    assert found["mass"] == pytest.approx(MASS, rel=1e-9)
    assert found["rotor_pos"]["r2"] == pytest.approx(np.array(ROTORS[1][0]) - COM, abs=1e-12)
    assert [found[f"I{a}"] for a in ("xx", "yy", "zz")] == pytest.approx(np.diag(INERTIA_COM))
    assert (found["k_eta"], found["k_m"], found["tau_m"]) == pytest.approx((KT, KD, LAG))


def test_the_dictionary_turns_as_the_vehicle_in_rotorpy(tmp_path):
    """multirotor.py: M = sum r x k_eta w^2 z + rotor_directions k_m w^2 z; + is a cw rotor."""
    p = runpy.run_path(str(saved(tmp_path, flat(), "rotorpy", "params.py")))["quad_params"]
    thrust = np.outer(p["k_eta"] * SPEEDS**2, [0.0, 0.0, 1.0])
    places = np.array([p["rotor_pos"][f"r{i}"] for i in range(1, 5)])
    torque = np.cross(places, thrust).sum(axis=0)
    torque[2] += float(p["rotor_directions"] @ (p["k_m"] * SPEEDS**2))
    x, y, z = (p[f"I{a}"] for a in ("xx", "yy", "zz"))
    I = np.array([[x, p["Ixy"], p["Ixz"]], [p["Ixy"], y, p["Iyz"]], [p["Ixz"], p["Iyz"], z]])
    _, dw = motion(body_of(kt=np.full(4, KT), Jr=0.0), vehicle())
    np.testing.assert_allclose(
        np.linalg.solve(I, torque - np.cross(RATES, I @ RATES)), dw, rtol=1e-9, atol=1e-8
    )
    np.testing.assert_allclose(p["rI"], IMU - COM, atol=1e-12)


def test_rotorpy_flies_it(tmp_path):
    multirotor = pytest.importorskip(
        "rotorpy.vehicles.multirotor", reason="rotorpy is not installed"
    )
    params = runpy.run_path(str(saved(tmp_path, flat(), "rotorpy", "params.py")))["quad_params"]
    quad = multirotor.Multirotor(params)
    np.testing.assert_allclose(quad.inertia, INERTIA_COM, rtol=0, atol=1e-9 * INERTIA_COM.max())
    state = {
        "x": np.zeros(3),
        "v": np.zeros(3),
        "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": RATES,
        "wind": np.zeros(3),
        "rotor_speeds": SPEEDS,
    }
    rate = quad.statedot(state, {"cmd_motor_speeds": SPEEDS}, 0.01)
    body = body_of(kt=np.full(4, KT), Jr=0.0)
    alpha, dw = motion(body, vehicle())
    expected = com_acceleration(body, alpha, dw) - [0, 0, 9.81]  # RotorPy's gravity
    np.testing.assert_allclose(rate["vdot"], expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(rate["wdot"], dw, rtol=1e-9, atol=1e-8)


def test_rotorpy_refuses_what_it_cannot_fly():
    hexa = [
        ((np.cos(a), np.sin(a), 0.0), s) for a, s in zip(range(6), ["ccw", "cw"] * 3, strict=True)
    ]
    hexa = [((float(x), float(y), z), s) for (x, y, z), s in hexa]
    with pytest.raises(OutputError, match="RotorPy flies four rotors with upright thrust"):
        text_of(a_result(rotors=hexa), "rotorpy")
    with pytest.raises(OutputError, match="the motors' lag is 0, and RotorPy divides by it"):
        text_of(a_result(), "rotorpy", assumed={"motor_lag": 0.0})


def test_casadi_is_newton_eulers_with_rotor_inertia(tmp_path):
    pytest.importorskip("casadi", reason="casadi is not installed")
    module = runpy.run_path(str(saved(tmp_path, a_result(), "casadi", "vehicle.py")))
    dynamics = module["dynamics"]()
    angle = 0.7
    q = np.array([np.cos(angle / 2), np.sin(angle / 2), 0.0, 0.0])  # rolled
    command = SPEEDS + np.array([30.0, -20.0, 10.0, 40.0])
    state = np.concatenate([np.zeros(6), q, RATES, SPEEDS])
    rate = np.array(dynamics(state, command)).ravel()
    spin_up = (command - SPEEDS) / LAG
    body = body_of()
    alpha, dw = motion(body, vehicle(), spin_up=spin_up)
    c, s = np.cos(angle), np.sin(angle)
    to_world = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    expected = to_world @ com_acceleration(body, alpha, dw) - [0, 0, 9.80665]
    np.testing.assert_allclose(rate[3:6], expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(rate[10:13], dw, rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(rate[13:], spin_up, rtol=1e-9)
    turning = np.array([0, *RATES])
    product = 0.5 * np.array(
        [
            -q[1:] @ turning[1:],
            *(q[0] * turning[1:] + np.cross(q[1:], turning[1:])),
        ]
    )
    np.testing.assert_allclose(rate[6:10], product, atol=1e-12)


def test_casadi_knows_each_rotor(tmp_path):
    text = text_of(a_result(), "casadi")
    line = next(row for row in text.splitlines() if row.startswith("KT = "))
    assert eval(line.removeprefix("KT = ")) == pytest.approx(KT_EACH, rel=1e-9)
