"""MuJoCo loads the model, and it moves as Newton-Euler says."""

import numpy as np
import pytest
from export_material import (
    COM,
    IMU,
    INERTIA_COM,
    KD,
    KT_EACH,
    LAG,
    MASS,
    RATES,
    SPEEDS,
    a_result,
    body_of,
    motion,
    text_of,
    vehicle,
)

mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
GRAVITY = np.array([0.0, 0.0, -9.80665])
TILTED = [
    (0.1, 0.0, np.sqrt(0.99)),
    (0.0, -0.15, np.sqrt(1 - 0.15**2)),
    (-0.05, 0.1, np.sqrt(1 - 0.0125)),
    (0.0, 0.0, 1.0),
]


def loaded(result):
    model = mujoco.MjModel.from_xml_string(text_of(result, "mujoco"))
    return model, mujoco.MjData(model)


def with_motion(model, data, thrusts, rates):
    """Set attitude level, rates and settled thrusts; return acceleration of origin and body."""
    mujoco.mj_resetData(model, data)
    data.qvel[3:6] = rates
    data.act[:] = data.ctrl[:] = thrusts
    mujoco.mj_forward(model, data)
    return data.qacc[:3].copy(), data.qacc[3:6].copy()


def test_mass_com_and_inertia_are_read_back():
    model, data = loaded(a_result())
    mujoco.mj_forward(model, data)
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "vehicle")
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    turn = turn.reshape(3, 3)
    inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
    assert model.body_mass[body] == pytest.approx(MASS, rel=1e-9)
    assert model.body_ipos[body] == pytest.approx(COM, abs=1e-9)
    np.testing.assert_allclose(inertia, INERTIA_COM, rtol=0, atol=1e-9 * INERTIA_COM.max())
    assert model.site_pos[0] == pytest.approx(IMU)


@pytest.mark.parametrize("axes", [None, TILTED], ids=["upright", "tilted"])
def test_one_moment_of_motion_is_newton_eulers(axes):
    axes = axes and [tuple(float(c) for c in n) for n in axes]
    model, data = loaded(a_result(axes=axes))
    linear, angular = with_motion(model, data, KT_EACH * SPEEDS**2, RATES)
    alpha, dw = motion(body_of(Jr=0.0), vehicle(axes=axes))
    np.testing.assert_allclose(linear - GRAVITY, alpha, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(angular, dw, rtol=1e-9, atol=1e-8)


def test_hover_and_the_sign_of_yaw():
    upright = np.diag(np.diag(INERTIA_COM))  # yaw moves nothing else
    result = a_result(com=np.zeros(3), imu=np.zeros(3), inertia_com=upright)
    model, data = loaded(result)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert data.ctrl.sum() == pytest.approx(MASS * 9.80665, rel=1e-9)
    assert data.qacc[2] == pytest.approx(0.0, abs=1e-9)
    # Equal speeds: the reactions of the two that turn ccw and the two that turn cw cancel.
    assert data.qacc[5] == pytest.approx(0.0, abs=1e-9)
    thrusts = data.ctrl.copy()
    thrusts[:2] += 0.1  # of the two rotors that turn ccw
    _, angular = with_motion(model, data, thrusts, np.zeros(3))
    torque = -0.1 * (KD / KT_EACH[0] + KD / KT_EACH[1])
    assert angular[2] * upright[2, 2] == pytest.approx(torque, rel=1e-9)
    assert torque < 0  # the body turns clockwise seen from above


def test_thrust_lags_as_the_motors_do():
    model, data = loaded(a_result())
    data.ctrl[0] = 2.0
    steps = round(LAG / model.opt.timestep)
    for _ in range(steps):
        mujoco.mj_step(model, data)
    expected = 2.0 * (1 - np.exp(-steps * model.opt.timestep / LAG))
    assert data.act[0] == pytest.approx(expected, rel=1e-9)


def test_an_accelerometer_at_the_imu_reads_specific_force():
    model, data = loaded(a_result())
    with_motion(model, data, KT_EACH * SPEEDS**2, RATES)
    alpha, dw = motion(body_of(Jr=0.0), vehicle())
    there = alpha + np.cross(dw, IMU) + np.cross(RATES, np.cross(RATES, IMU))
    np.testing.assert_allclose(data.sensor("accelerometer").data, there, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(data.sensor("gyro").data, RATES, rtol=1e-12)


def test_randomly_turned_flat_bodies_load():
    """MuJoCo 3.17 and 4.0 demand A + B >= C without a tolerance, of what the file says."""
    random = np.random.default_rng(0)
    for _ in range(60):
        turn = np.linalg.qr(random.standard_normal((3, 3)))[0]
        a, b = random.uniform(0.005, 0.02, 2)
        inertia = turn @ np.diag([a, b, a + b]) @ turn.T
        model, _ = loaded(a_result(inertia_com=0.5 * (inertia + inertia.T)))
        found = np.sort(model.body("vehicle").inertia)
        np.testing.assert_allclose(found, np.sort([a, b, a + b]), rtol=1e-6)


def test_it_lands_on_the_floor():
    """Without thrust the vehicle falls 1 m and stays upon the floor."""
    model, data = loaded(a_result())
    mujoco.mj_resetData(model, data)
    data.qpos[2] = 0.5
    for _ in range(round(2.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    assert 0.0 < data.qpos[2] < 0.1
    assert abs(data.qvel[2]) < 0.05


@pytest.mark.parametrize(("integrator", "exact"), [("Euler", True), ("RK4", False)])
def test_filterexact_is_exact_under_euler_alone(integrator, exact):
    """As the comment of the file says; RK4 advances an activation by its own rule."""
    text = text_of(a_result(), "mujoco").replace("<option ", f'<option integrator="{integrator}" ')
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.ctrl[0] = 2.0
    mujoco.mj_step(model, data)
    expected = 2.0 * (1.0 - np.exp(-model.opt.timestep / LAG))
    assert bool(abs(data.act[0] / expected - 1.0) < 1e-9) is exact
