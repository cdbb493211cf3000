"""URDF: check_urdf, Pinocchio and PyBullet load it; masses, inertia and motion are right."""

import shutil
import subprocess
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from export_material import (
    COM,
    INERTIA_COM,
    KD,
    KT,
    MASS,
    RATES,
    ROTORS,
    SPEEDS,
    a_result,
    body_of,
    elements,
    flat,
    motion,
    saved,
    text_of,
    vehicle,
)

from kept_words import lines_with
from rotorfit.errors import OutputError

RPM = 2 * np.pi / 60
UP = np.array([0.0, 0.0, 9.80665])


GYM = "gym-pybullet-drones"


def properties(result, **options):
    root = ET.fromstring(text_of(result, GYM, **options))
    found = root.find("properties")
    return None if found is None else {k: float(v) for k, v in found.attrib.items()}


def test_check_urdf_takes_it(tmp_path):
    tool = shutil.which("check_urdf")
    if tool is None:
        pytest.skip("check_urdf is not installed (Debian: liburdfdom-tools)")
    path = saved(tmp_path, a_result(), "urdf", "vehicle.urdf")
    ended = subprocess.run([tool, path], capture_output=True, text=True, timeout=600)
    assert ended.returncode == 0, ended.stderr
    assert "Successfully Parsed XML" in ended.stdout
    assert "base_link has 5 child(ren)" in ended.stdout


def test_coefficients_are_per_squared_rpm():
    found = properties(flat())
    speed_rpm = 9000.0
    thrust = KT * (speed_rpm * RPM) ** 2
    assert found["kf"] * speed_rpm**2 == pytest.approx(thrust, rel=1e-9)
    assert found["km"] / found["kf"] == pytest.approx(KD / KT, rel=1e-9)
    assert found["thrust2weight"] == pytest.approx(4 * KT * 1100.0**2 / (MASS * 9.80665), rel=1e-9)


def test_rotors_are_numbered_as_gym_pybullet_drones_has_them():
    """Front right, rear right, rear left, front left; spins such that -t0 + t1 - t2 + t3 is yaw."""
    root = ET.fromstring(text_of(a_result(), GYM))
    places = {
        joint.attrib["name"]: [float(v) for v in joint.find("origin").attrib["xyz"].split()]
        for joint in root.iter("joint")
    }
    for i, number in enumerate((0, 3, 1, 2)):  # of ROTORS
        place, spin = ROTORS[number]
        assert places[f"prop{i}_joint"] == pytest.approx(place)
        assert (spin == "ccw") == (i in (0, 2))
    assert places["center_of_mass_joint"] == pytest.approx(COM)
    order = [child.tag for child in root][:2]
    assert order == ["properties", "link"]
    assert [child.tag for child in root[1]] == ["inertial", "visual", "collision"]
    assert [child.tag for child in root[1][0]] == ["origin", "mass", "inertia"]


def test_other_rotors_are_refused_by_name():
    reversed_spins = [(p, "cw" if s == "ccw" else "ccw") for p, s in ROTORS]
    with pytest.raises(OutputError, match="front right and rear left ccw"):
        text_of(a_result(rotors=reversed_spins), GYM)
    assert "<properties" not in text_of(a_result(rotors=reversed_spins), "urdf")
    assert properties(a_result(law=None), assumed={"max_speed": 1000.0}) is not None


def test_products_are_left_out_of_gym_pybullet_drones(assert_wording):
    def tensor(target):
        inertia = ET.fromstring(text_of(a_result(), target)).find("link/inertial/inertia")
        return [float(inertia.attrib[name]) for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")]

    assert tensor("urdf") == pytest.approx(list(elements(INERTIA_COM).values()))
    assert tensor(GYM) == pytest.approx([*np.diag(INERTIA_COM), 0.0, 0.0, 0.0])
    text = text_of(a_result(), GYM)
    assert "(Ixy = 0.00035, Ixz" in text
    assert "= 0.0009, Iyz" in text
    assert "= -0.0004 kg m^2)" in text
    assert_wording(lines_with(text, "Ixy = "))


@pytest.mark.parametrize(("target", "tilt"), [(GYM, 0.0), ("urdf", 5.26)])
@pytest.mark.filterwarnings("ignore")  # the module's own, at import
def test_a_level_vehicle_reads_level_in_pybullet(tmp_path, target, tilt):
    """PyBullet 3.2.7 returns the attitude of the principal axes, as the comment of `urdf` says.

    The tilt is that of the z axis of gym-pybullet-drones' own state: of the thrust, if the package
    holds that state level.
    """
    p = pytest.importorskip("pybullet", reason="pybullet is not installed")
    path = saved(tmp_path, a_result(), target, "vehicle.urdf")
    client = p.connect(p.DIRECT)
    try:
        flags = p.URDF_USE_INERTIA_FROM_FILE
        drone = p.loadURDF(str(path), flags=flags, physicsClientId=client)
        _, attitude = p.getBasePositionAndOrientation(drone, physicsClientId=client)
        upright = np.array(p.getMatrixFromQuaternion(attitude)).reshape(3, 3)[2, 2]
        assert np.degrees(np.arccos(min(upright, 1.0))) == pytest.approx(tilt, abs=0.01)
        turn = p.getDynamicsInfo(drone, -1, physicsClientId=client)[4]
        _, back = p.invertTransform([0, 0, 0], turn)
        _, link = p.multiplyTransforms([0, 0, 0], attitude, [0, 0, 0], back)
        assert abs(link[3]) == pytest.approx(1.0, abs=1e-9)
    finally:
        p.disconnect(client)


@pytest.mark.filterwarnings("ignore")  # the module's own, at import
def test_it_hovers_level_by_pybullets_own_state(tmp_path):
    """Rotors that hold the attitude which PyBullet returns at zero carry the vehicle straight up.

    Forces at the links prop0 to prop3, as BaseAviary applies them; the attitude's controller is a
    plain PD on the Euler angles of getBasePositionAndOrientation.
    """
    p = pytest.importorskip("pybullet", reason="pybullet is not installed")
    path = saved(tmp_path, flat(), GYM, "vehicle.urdf")
    client = p.connect(p.DIRECT)
    try:
        p.setGravity(0, 0, -9.8, physicsClientId=client)
        p.setTimeStep(1 / 240, physicsClientId=client)
        drone = p.loadURDF(
            str(path), [0, 0, 5], flags=p.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client
        )
        places = np.array([place for place, _ in ROTORS])[[0, 3, 1, 2]] - COM
        mixer = np.array([np.ones(4), places[:, 1], -places[:, 0]])
        for _ in range(480):
            _, attitude = p.getBasePositionAndOrientation(drone, physicsClientId=client)
            rpy = np.array(p.getEulerFromQuaternion(attitude))
            _, rates = p.getBaseVelocity(drone, physicsClientId=client)
            roll, pitch = (-0.02 * (100 * rpy + 20 * np.array(rates)))[:2]
            for i, thrust in enumerate(np.linalg.pinv(mixer) @ [MASS * 9.8, roll, pitch]):
                force = [0, 0, float(thrust)]
                p.applyExternalForce(drone, i, force, [0, 0, 0], p.LINK_FRAME, client)
            p.stepSimulation(physicsClientId=client)
        velocity, _ = p.getBaseVelocity(drone, physicsClientId=client)
        assert np.hypot(*velocity[:2]) < 0.02  # 5 degrees of tilt would give 1.7 m/s
    finally:
        p.disconnect(client)


def test_pinocchio_reads_back_and_moves(tmp_path):
    pin = pytest.importorskip("pinocchio", reason="pinocchio (pip install pin) is not installed")
    path = saved(tmp_path, flat(), "urdf", "vehicle.urdf")
    model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    data = model.createData()
    inertia = model.inertias[1]
    assert inertia.mass == pytest.approx(MASS, rel=1e-9)
    assert inertia.lever == pytest.approx(COM, abs=1e-9)
    np.testing.assert_allclose(inertia.inertia, INERTIA_COM, rtol=0, atol=1e-9 * INERTIA_COM.max())
    wrench = np.zeros(6)
    kf, km = (properties(flat())[name] for name in ("kf", "km"))
    signs = (-1.0, -1.0, 1.0, 1.0)  # of yaw torque, rotors in the order of the log
    for i, number in enumerate(range(4)):
        place = model.frames[model.getFrameId(f"prop{i}_link")].placement
        rpm = SPEEDS[number] / RPM
        thrust = place.rotation @ np.array([0, 0, kf * rpm**2])
        wrench[:3] += thrust
        wrench[3:] += np.cross(place.translation, thrust)
        wrench[5] += signs[i] * km * rpm**2
    v = np.concatenate([np.zeros(3), RATES])
    model.gravity.linear = np.array([0.0, 0.0, -9.80665])
    acceleration = pin.aba(model, data, pin.neutral(model), v, wrench)
    alpha, dw = motion(body_of(kt=np.full(4, KT), Jr=0.0), vehicle())
    np.testing.assert_allclose(acceleration[:3] + UP, alpha, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(acceleration[3:], dw, rtol=1e-9, atol=1e-8)


# PyBullet turns the tensor to its principal axes by itself, and stops before the last digits.
@pytest.mark.parametrize(
    ("inertia", "digits"),
    [(np.diag(np.diag(INERTIA_COM)), 1e-9), (INERTIA_COM, 1e-6)],
    ids=["diagonal", "full"],
)
@pytest.mark.filterwarnings("ignore")  # the module's own, at import
def test_pybullet_reads_back_and_moves(tmp_path, inertia, digits):
    p = pytest.importorskip("pybullet", reason="pybullet is not installed")
    path = saved(tmp_path, flat(inertia_com=inertia), "urdf", "vehicle.urdf")
    client = p.connect(p.DIRECT)
    try:
        flags = p.URDF_USE_INERTIA_FROM_FILE
        drone = p.loadURDF(str(path), flags=flags, physicsClientId=client)
        found = p.getDynamicsInfo(drone, -1, physicsClientId=client)
        turn = np.array(p.getMatrixFromQuaternion(found[4])).reshape(3, 3)
        assert found[0] == pytest.approx(MASS, rel=1e-9)
        assert found[3] == pytest.approx(COM, abs=1e-9)
        tensor = turn @ np.diag(found[2]) @ turn.T
        np.testing.assert_allclose(tensor, inertia, rtol=0, atol=digits * inertia.max())
        one_step(p, client, drone, inertia)
    finally:
        p.disconnect(client)


def one_step(p, client, drone, inertia):
    """Fly one short step with gym-pybullet-drones' own forces, and compare with Newton-Euler."""
    dt = 1e-5
    p.setGravity(0, 0, -9.80665, physicsClientId=client)
    p.setTimeStep(dt, physicsClientId=client)
    p.changeDynamics(drone, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    kf, km = (properties(flat())[name] for name in ("kf", "km"))
    rpm = SPEEDS / RPM
    for i in range(4):
        force = [0, 0, float(kf * rpm[i] ** 2)]
        p.applyExternalForce(drone, i, force, [0, 0, 0], p.LINK_FRAME, physicsClientId=client)
    torque = km * (-(rpm[0] ** 2) - rpm[1] ** 2 + rpm[2] ** 2 + rpm[3] ** 2)
    p.applyExternalTorque(drone, 4, [0, 0, float(torque)], p.LINK_FRAME, physicsClientId=client)
    p.stepSimulation(physicsClientId=client)
    linear, angular = p.getBaseVelocity(drone, physicsClientId=client)
    body = body_of(kt=np.full(4, KT), Jr=0.0, inertia_com=inertia)
    alpha, dw = motion(body, vehicle(), rates=np.zeros(3))
    of_com = alpha + np.cross(dw, body.com)
    np.testing.assert_allclose(np.array(linear) / dt, of_com - UP, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(np.array(angular) / dt, dw, rtol=1e-6, atol=1e-6)
