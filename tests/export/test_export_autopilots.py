"""PX4, its SIH, ArduPilot and Crazyflow: their own formulas with the file's numbers."""

import importlib.util
import json
import math
import subprocess
import sys
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from export_material import (
    COM,
    INERTIA_COM,
    JR,
    KD,
    KT,
    KT_EACH,
    LAG,
    MASS,
    RATES,
    ROTORS,
    SPEEDS,
    UNKNOWN,
    a_result,
    body_of,
    changed,
    com_acceleration,
    flat,
    motion,
    text_of,
    vehicle,
)

from kept_words import lines_with
from rotorfit.errors import OutputError

FULL = 1100.0
TURN = np.diag([1.0, -1.0, -1.0])
"""Between FLU and FRD."""
CENTERED = tuple(
    ((x, y, 0.0), s)
    for (x, y), s in zip(
        ((0.15, -0.16), (-0.15, 0.16), (0.15, 0.16), (-0.15, -0.16)),
        ("ccw", "ccw", "cw", "cw"),
        strict=True,
    )
)
SQRT_LAW = {"sqrt": {"full_speed": FULL, "thr_mdl_fac": 0.3}}


def params(text):
    """Return name to value, as QGroundControl reads them: five columns, tabs between."""
    found = {}
    for line in text.splitlines():
        if line.startswith("#"):
            continue
        vehicle_id, component, name, value, kind = line.split("\t")
        assert (vehicle_id, component) == ("1", "1")
        assert len(name) <= 16
        assert kind in ("6", "9")
        found[name] = int(value) if kind == "6" else float(value)
    return found


def com_torque(body, rotors, speeds):
    """Return the torque of the rotors about the CoM, FLU."""
    alpha, dw = motion(body, rotors, rates=np.zeros(3), speeds=speeds)
    return body.inertia_com @ dw, body.mass * com_acceleration(body, alpha, dw, np.zeros(3))


def test_px4_allocates_the_wrench_of_the_vehicle():
    """ActuatorEffectivenessRotors: moment = ct pos x axis - ct km axis, thrust = ct axis."""
    p = params(text_of(a_result(), "px4"))
    assert (p["CA_AIRFRAME"], p["CA_ROTOR_COUNT"]) == (0, 4)
    u = SPEEDS / FULL
    moment, thrust = np.zeros(3), np.zeros(3)
    for i in range(4):
        place, axis = (np.array([p[f"CA_ROTOR{i}_{k}{a}"] for a in "XYZ"]) for k in "PA")
        ct = p[f"CA_ROTOR{i}_CT"] * u[i] ** 2
        moment += ct * np.cross(place, axis) - ct * p[f"CA_ROTOR{i}_KM"] * axis
        thrust += ct * axis
    torque, force = com_torque(body_of(Jr=0.0), vehicle(), SPEEDS)
    np.testing.assert_allclose(moment, TURN @ torque, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(thrust, TURN @ force, rtol=1e-9, atol=1e-9)
    # ccw turns the nose right, positive about FRD's z, and is positive in KM.
    assert [math.copysign(1, p[f"CA_ROTOR{i}_KM"]) for i in range(4)] == [1, 1, -1, -1]


def test_px4_takes_its_own_law_back():
    p = params(text_of(a_result(law=SQRT_LAW), "px4"))
    assert p["THR_MDL_FAC"] == pytest.approx(0.3, abs=1e-9)
    assert p["MPC_THR_HOVER"] == pytest.approx(MASS * 9.80665 / (4 * KT * FULL**2), rel=1e-9)


def test_px4_fits_the_law_of_a_proportional_speed():
    p = params(text_of(a_result(law={"linear": [0.0, FULL]}), "px4"))
    assert p["THR_MDL_FAC"] == pytest.approx(1.0, abs=1e-9)
    assert not [name for name in p if name.startswith("SIM_")]


def test_px4_without_a_law_says_what_is_missing(assert_wording):
    text = text_of(a_result(law=None), "px4")
    assert not {"THR_MDL_FAC", "MPC_THR_HOVER"} & params(text).keys()
    assert_wording(lines_with(text, "MPC_THR_HOVER"))
    assert "THR_MDL_FAC" not in params(
        text_of(a_result(law=None), "px4", assumed={"max_speed": 1000.0})
    )


def test_px4_in_gazebo_has_a_file_of_its_own():
    """There the speed is linear in the output, whatever the vehicle's ESCs make of theirs."""
    text = text_of(a_result(law=SQRT_LAW), "px4-gazebo")
    p = params(text)
    assert len(p) == 13
    assert (p["SIM_GZ_EC_FUNC4"], p["SIM_GZ_EC_MIN4"], p["SIM_GZ_EC_MAX4"]) == (104, 0, 1100)
    assert p["THR_MDL_FAC"] == pytest.approx(1.0, abs=1e-9)
    assert params(text_of(a_result(law=SQRT_LAW), "px4"))["THR_MDL_FAC"] == pytest.approx(0.3)
    assert "over the 1000" in text
    slow = text_of(a_result(law={"linear": [0.0, 900.0]}), "px4-gazebo")
    assert "over the 1000" not in slow
    assumed = text_of(a_result(law=None), "px4-gazebo", assumed={"max_speed": 1000.0})
    assert params(assumed)["SIM_GZ_EC_MAX1"] == 1000
    many = [((float(np.cos(a)), float(np.sin(a)), 0.0), "ccw") for a in range(9)]
    with pytest.raises(OutputError, match="9 rotors, but PX4 has 8 outputs to Gazebo"):
        text_of(a_result(rotors=many), "px4-gazebo")


@pytest.mark.parametrize(
    ("target", "lost"),
    [
        ("px4", ("Izz_com", "Ixx_com", "com_z")),
        ("px4-sih", ("com_x", "com_z")),
        ("ardupilot", ("kd", "Izz_com", "com_z")),
        ("ardupilot-sitl", ("Ixy_com", "Iyz_com")),
        ("gazebo-motors", ("Izz_com",)),
    ],
)
def test_no_file_is_refused_for_what_is_not_in_it(target, lost):
    unknown = {name: {**UNKNOWN, "verdict": "not-identified"} for name in lost if "_" not in name}
    result = changed(a_result(law=SQRT_LAW), **unknown)
    gone = tuple(replace(d, **UNKNOWN) if d.name in lost else d for d in result.derived)
    text = text_of(replace(result, derived=gone), target)
    assert "nan" not in text.lower().replace("dominan", "")


def test_px4_asks_for_the_height_of_tilted_rotors():
    axes = [(0.1, 0.0, math.sqrt(0.99))] * 4
    result = a_result(axes=axes)
    gone = tuple(replace(d, **UNKNOWN) if d.name == "com_z" else d for d in result.derived)
    with pytest.raises(OutputError, match="com_z"):
        text_of(replace(result, derived=gone), "px4")


def test_px4_leaves_ct_out_for_all_or_none(assert_wording):
    """PX4 compares rotors by CT: one left at PX4's 6.5 beside 99 would be no rotor at all."""
    # kt_1 is 2 % over the mean, and alone above 100 N.
    speed = math.sqrt(100.0 / (1.01 * KT))
    text = text_of(a_result(law={"linear": [0.0, speed]}), "px4")
    assert not [name for name in params(text) if name.endswith("_CT")]
    assert "as PX4 has" in text
    assert "over 100" in text
    assert_wording(lines_with(text, "CT is left out"))
    assert "CT is left out" in text_of(a_result(law=None), "px4")


def test_px4_refuses_hover_beyond_its_range_and_too_many_rotors():
    strong = text_of(a_result(law={"linear": [0.0, 4000.0]}), "px4")
    assert "MPC_THR_HOVER" not in params(strong)
    assert "MPC_THR_HOVER would be 0.0542" in strong
    many = [((float(np.cos(a)), float(np.sin(a)), 0.0), "ccw") for a in range(13)]
    with pytest.raises(OutputError, match="13 rotors, but PX4 allocates at most 12"):
        text_of(a_result(rotors=many), "px4")


def test_sih_moves_as_the_vehicle():
    """sih.cpp, Quadcopter: u is the thrust of each motor as a fraction of its largest."""
    result = flat(rotors=CENTERED, com=np.zeros(3), imu=np.zeros(3))
    p = params(text_of(result, "px4-sih"))
    u = SPEEDS**2 / FULL**2
    torque = np.array(
        [
            p["SIH_L_ROLL"] * p["SIH_T_MAX"] * (-u[0] + u[1] + u[2] - u[3]),
            p["SIH_L_PITCH"] * p["SIH_T_MAX"] * (u[0] - u[1] + u[2] - u[3]),
            p["SIH_Q_MAX"] * (u[0] + u[1] - u[2] - u[3]),
        ]
    )
    names = ("IXX", "IXY", "IXZ", "IXY", "IYY", "IYZ", "IXZ", "IYZ", "IZZ")
    I = np.array([p[f"SIH_{name}"] for name in names]).reshape(3, 3)
    w = TURN @ RATES
    dw = np.linalg.solve(I, torque - np.cross(w, I @ w))
    body = body_of(kt=np.full(4, KT), Jr=0.0, com=np.zeros(3))
    alpha, expected = motion(body, vehicle(CENTERED))
    np.testing.assert_allclose(dw, TURN @ expected, rtol=1e-9, atol=1e-8)
    thrust = p["SIH_T_MAX"] * u.sum()
    assert thrust == pytest.approx(MASS * alpha[2], rel=1e-9)
    assert p["SIH_T_MAX"] * 4 * p["MPC_THR_HOVER"] == pytest.approx(MASS * 9.80665, rel=1e-9)
    assert (p["SIH_MASS"], p["SIH_T_TAU"]) == pytest.approx((MASS, LAG))


HEXA = tuple(
    ((0.3 * math.cos(math.radians(a)), -0.3 * math.sin(math.radians(a)), 0.0), s)
    for a, s in zip((30, 90, 150, 210, 270, 330), ("ccw", "cw") * 3, strict=True)
)
"""Clockwise from the front right, as in sih.cpp."""


def test_sih_turns_a_hexarotor_as_the_vehicle():
    """sih.cpp, Hexacopter: the arms of roll are L_ROLL, those of pitch sqrt(3)/2 L_PITCH."""
    p = params(text_of(flat(rotors=HEXA, com=np.zeros(3), imu=np.zeros(3)), "px4-sih"))
    u = np.array([0.5, 0.6, 0.55, 0.4, 0.45, 0.7])
    roll = p["SIH_L_ROLL"] * (u @ [-0.5, -1, -0.5, 0.5, 1, 0.5])
    pitch = p["SIH_L_PITCH"] * math.sqrt(3) / 2 * (u @ [1, 0, -1, -1, 0, 1])
    yaw = p["SIH_Q_MAX"] * (u @ [1, -1, 1, -1, 1, -1])
    places = np.array([place for place, _ in HEXA])
    spins = np.array([1.0 if s == "ccw" else -1.0 for _, s in HEXA])
    full = KT * FULL**2
    torque = (full * u[:, None] * np.cross(places, [0, 0, 1.0])).sum(axis=0)
    torque[2] = -KD * FULL**2 * (u @ spins)
    found = [p["SIH_T_MAX"] * roll, p["SIH_T_MAX"] * pitch, yaw]
    np.testing.assert_allclose(found, TURN @ torque, rtol=1e-9)
    assert p["SIH_VEHICLE_TYPE"] == 4
    turned = tuple((place, "cw" if s == "ccw" else "ccw") for place, s in HEXA)
    with pytest.raises(OutputError, match="a hexarotor in X with front right"):
        text_of(a_result(rotors=turned), "px4-sih")
    plus = tuple(((-y, x, z), s) for (x, y, z), s in HEXA)
    with pytest.raises(OutputError, match="these rotors are others"):
        text_of(a_result(rotors=plus), "px4-sih")


def test_sih_says_what_it_leaves_out_and_refuses_other_layouts(assert_wording):
    text = text_of(a_result(), "px4-sih")
    assert "is 1 mm" in text
    assert "and 3 mm" in text
    assert_wording(lines_with(text, "middle is"))
    reversed_spins = [(p, "cw" if s == "ccw" else "ccw") for p, s in ROTORS]
    with pytest.raises(OutputError, match="SIH simulates a quadrotor in X"):
        text_of(a_result(rotors=reversed_spins), "px4-sih")


def ardupilot(text):
    """Return the JSON without its lines of comments."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return json.loads("\n".join(lines))


def test_ardupilot_hovers_and_turns_as_the_vehicle():
    """SIM_Motor: torque about z = 0.05 diagonal yaw command thrust; SIM_Frame: position in FRD."""
    found = ardupilot(text_of(a_result(law=SQRT_LAW), "ardupilot-sitl"))
    assert found["mass"] == MASS
    assert found["moment_inertia"] == pytest.approx(np.diag(INERTIA_COM))
    assert found["propExpo"] == pytest.approx(0.3)
    hover = found["hoverThrOut"]
    f, b = 0.3, 0.7
    command = (-b + math.sqrt(b * b + 4 * f * hover)) / (2 * f)
    moment = np.zeros(3)
    for i in range(4):
        thrust = KT_EACH[i] * SPEEDS[i] ** 2
        place = np.array(found[f"motor{i + 1}_position"])
        moment += np.cross(place, [0, 0, -thrust])
        moment[2] += 0.05 * found["diagonal_size"] * found[f"motor{i + 1}_yaw"] * command * thrust
    torque, _ = com_torque(body_of(Jr=0.0), vehicle(), SPEEDS)
    np.testing.assert_allclose(moment, TURN @ torque, rtol=1e-9, atol=1e-9)
    assert hover == pytest.approx(MASS * 9.80665 / (4 * KT * FULL**2), rel=1e-9)


def sitl_thrust(found, output):
    """SIM_Motor::pwm_to_command and calc_thrust: the share of full thrust at an output 0 to 1."""
    low, high, e = found["spin_min"], found["spin_max"], found["propExpo"]
    u = np.clip((output - low) / (high - low), 0.0, 1.0)
    return (1 - e) * u + e * u**2


@pytest.mark.parametrize("stands", [0.0, 0.12])
def test_ardupilot_s_motor_gives_the_thrust_of_the_law(stands):
    """Its spin range is not the default, 0.15 to 0.95, in which the law would be another."""
    law = {"linear": [-stands * FULL / (1 - stands), FULL / (1 - stands)]}
    found = ardupilot(text_of(a_result(law=law), "ardupilot-sitl"))
    u = np.linspace(0.0, 1.0, 51)
    speed = np.maximum(u - stands, 0.0) / (1 - stands)
    np.testing.assert_allclose(sitl_thrust(found, u), speed**2, atol=0.005)
    assert found["spin_min"] == pytest.approx(stands, abs=0.002)


def test_ardupilot_s_reader_finds_no_brace_before_the_first():
    """SIM_Frame.cpp: the JSON begins at the first brace, of a comment or not."""
    named = replace(a_result(), name="quad {v2}")
    text = text_of(named, "ardupilot-sitl")
    assert "quad (v2)" in text
    assert json.loads(text[text.index("{") :])["num_motors"] == 4


def test_ardupilot_needs_no_speed_of_commands_without_a_law():
    per_command = {"unit": "N per squared command", "value": 4.2}
    kt_each = {f"kt_{i}": None for i in range(1, 5)}
    torque = {"unit": "N m per squared command", "value": 0.05}
    result = changed(a_result(law=None), kt=per_command, kd=torque, Jr=None, **kt_each)
    motors = {**result.settings, "motors": {"speed": "commanded"}}
    found = ardupilot(text_of(replace(result, settings=motors), "ardupilot-sitl"))
    assert found["mass"] == MASS
    assert "propExpo" not in found


def test_ardupilot_frames_are_found_by_their_rotors(assert_wording):
    assert "--model x:THIS_FILE.json" in text_of(a_result(), "ardupilot-sitl")
    betaflight = tuple(ROTORS[i] for i in (3, 0, 1, 2))
    assert "--model bfx:THIS_FILE.json" in text_of(a_result(rotors=betaflight), "ardupilot-sitl")
    other = tuple(ROTORS[i] for i in (1, 0, 3, 2))
    with pytest.raises(OutputError, match="has no frame with these rotors in this order"):
        text_of(a_result(rotors=other), "ardupilot-sitl")
    copter_text = text_of(a_result(rotors=other, law=SQRT_LAW), "ardupilot")
    assert_wording(lines_with(copter_text, "FRAME_CLASS"))
    without = text_of(a_result(law=None), "ardupilot-sitl")
    assert "motor1_yaw" not in ardupilot(without)
    assert_wording(lines_with(without, "hoverThrOut"))


def crazyflow_motion(p):
    """Return accelerations by the formulas of crazyflow's first_principles/dynamics.py."""
    rpm = SPEEDS / (2 * np.pi / 60)
    assert np.shape(p["rpm2thrust"]) == (3,)  # sim.py takes one curve from the file
    forces = np.array([np.array(p["rpm2thrust"]) @ [1, n, n**2] for n in rpm])
    torques = np.array([np.array(p["rpm2torque"]) @ [1, n, n**2] for n in rpm])
    mixing = np.array(p["mixing_matrix"])
    torque = mixing @ (forces * p["L"]) * [1, 1, 0] + mixing @ torques * [0, 0, 1]
    momentum = float(mixing[2] @ SPEEDS) * p["prop_inertia"]
    torque += [RATES[1] * momentum, -RATES[0] * momentum, 0.0]
    J = np.array(p["J"])
    return forces.sum() / p["mass"], np.linalg.solve(J, torque - np.cross(RATES, J @ RATES))


@pytest.mark.parametrize("equal", [True, False])
def test_crazyflow_moves_as_the_vehicle(equal):
    result = changed(a_result(), **{f"kt_{i}": None for i in range(1, 5)}) if equal else a_result()
    p = tomllib.loads(text_of(result, "crazyflow"))["export_me"]
    force, dw = crazyflow_motion(p)
    body = body_of(kt=np.full(4, KT) if equal else KT_EACH)
    alpha, expected = motion(body, vehicle())
    np.testing.assert_allclose(dw, expected, rtol=1e-8, atol=1e-8)
    lift = float(body.kt.mean() * (SPEEDS**2).sum())  # equal rotors: the very thrust
    assert force == pytest.approx(lift / MASS, rel=1e-9)
    real = com_acceleration(body, alpha, expected)[2]
    assert force == pytest.approx(real, rel=1e-9 if equal else 0.02)
    assert p["thrust_max"] == pytest.approx(KT * FULL**2)
    assert p["prop_inertia"] == pytest.approx(JR)
    assert p["rotor_dyn_coef"] == pytest.approx([1 / LAG, 0, 1 / LAG, 0])
    assert p["rpm2torque"][2] == pytest.approx(KD * (2 * np.pi / 60) ** 2, rel=1e-9)
    assert isinstance(p["drag_matrix"][0][0], float)


def test_crazyflow_gets_no_integers():
    """An integer of TOML would be an array of integers there."""
    p = tomllib.loads(text_of(a_result(mass=1.0), "crazyflow"))["export_me"]
    assert p["mass"] == 1.0
    assert all(isinstance(p[name], float) for name in ("mass", "L", "thrust_max", "prop_inertia"))


CRAZYFLOW = """
import json, sys, tomllib
import numpy as np
from crazyflow.dynamics.first_principles import dynamics

given = json.load(sys.stdin)
p = {name: np.array(v) for name, v in tomllib.loads(given["file"])["export_me"].items()}
p = {name: v for name, v in p.items() if not name.startswith("thrust_")}

import crazyflow.dynamics.core as core
from crazyflow.dynamics import Dynamics
from crazyflow.drones import Drone
from crazyflow.sim.sim import rotor_vel_limits

class ours:
    # The section pasted in the place of a drone that there is.
    def load(file):
        found = tomllib.load(file)
        if "first_principles" in file.name:
            found["hb_x500"] = tomllib.loads(given["file"])["export_me"]
        return found

core.tomllib = ours
loaded = core.load_params(Dynamics.first_principles, Drone.hb_x500)
assert float(loaded["mass"]) == float(p["mass"])
limits = [float(v) for v in rotor_vel_limits(Dynamics.first_principles, Drone.hb_x500)]

rpm, rates = np.array(given["rpm"]), np.array(given["rates"])
level, still = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3)
p |= {"gravity_vec": np.array([0.0, 0.0, -9.80665]), "J_inv": np.linalg.inv(p["J"])}
found = dynamics(still, level, still, rates, rpm, rotor_vel=rpm, **p)
print(json.dumps([np.asarray(v).tolist() for v in (*found[2:4], limits)]))
"""


def test_crazyflow_itself_takes_the_section():
    if importlib.util.find_spec("crazyflow") is None:
        pytest.skip("crazyflow is not installed (pip install crazyflow)")
    given = {"file": text_of(a_result(), "crazyflow"), "rates": RATES.tolist()}
    given["rpm"] = (SPEEDS / (2 * np.pi / 60)).tolist()
    ended = subprocess.run(  # apart: it wants to be imported before scipy
        [sys.executable, "-c", CRAZYFLOW],
        input=json.dumps(given),
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert ended.returncode == 0, ended.stderr
    acceleration, angular, limits = json.loads(ended.stdout.splitlines()[-1])
    assert limits == pytest.approx([0.0, FULL / (2 * np.pi / 60)], rel=1e-6)
    body = body_of()
    alpha, dw = motion(body, vehicle())
    expected = com_acceleration(body, alpha, dw) - [0, 0, 9.80665]
    np.testing.assert_allclose(acceleration[:2], expected[:2], atol=1e-8)
    lift = KT * (SPEEDS**2).sum() / MASS - 9.80665
    assert acceleration[2] == pytest.approx(lift, rel=1e-8)
    np.testing.assert_allclose(angular, dw, rtol=1e-8, atol=1e-8)


def test_the_com_is_taken_off_every_position():
    p = params(text_of(a_result(), "px4"))
    for i, (place, _) in enumerate(ROTORS):
        found = [p[f"CA_ROTOR{i}_P{axis}"] for axis in "XYZ"]
        np.testing.assert_allclose(found, TURN @ (np.array(place) - COM), atol=1e-12)


def test_a_law_with_its_range_comes_back_as_arducopter_has_it():
    law = {"sqrt": {"full_speed": 1.0, "thr_mdl_fac": 0.65, "start": 0.15, "end": 0.95}}
    found = ardupilot(text_of(a_result(law=law), "ardupilot-sitl"))
    assert (found["propExpo"], found["spin_min"], found["spin_max"]) == pytest.approx(
        (0.65, 0.15, 0.95)
    )


def copter(text):
    return {n: float(v) for n, v in (x.split(",") for x in text.splitlines() if x[0] != "#")}


@pytest.mark.parametrize(
    ("motors", "expected"),
    [(ROTORS, (1, 1)), (tuple(ROTORS[i] for i in (3, 0, 1, 2)), (1, 12))],
)
def test_the_copter_gets_frame_spin_range_and_curve_together(motors, expected):
    law = {"sqrt": {"full_speed": FULL, "thr_mdl_fac": 0.65, "start": 0.15, "end": 0.95}}
    found = copter(text_of(a_result(rotors=motors, law=law), "ardupilot"))
    assert (found["FRAME_CLASS"], found["FRAME_TYPE"]) == expected
    assert (found["MOT_SPIN_MIN"], found["MOT_SPIN_MAX"]) == pytest.approx((0.15, 0.95))
    assert found["MOT_SPIN_ARM"] == 0.1
    assert found["MOT_THST_EXPO"] == pytest.approx(0.65)


def test_the_copter_arms(assert_wording):
    """AP_MotorsMulticopter: not with MOT_SPIN_ARM over MOT_SPIN_MIN, nor with that over 0.3."""
    at_once = copter(text_of(a_result(law=SQRT_LAW), "ardupilot"))
    assert (at_once["MOT_SPIN_ARM"], at_once["MOT_SPIN_MIN"], at_once["MOT_SPIN_MAX"]) == (0, 0, 1)
    late = {"sqrt": {"full_speed": FULL, "thr_mdl_fac": 0.65, "start": 0.4, "end": 1.0}}
    text = text_of(a_result(law=late), "ardupilot")
    assert not [name for name in copter(text) if name.startswith("MOT_SPIN")]
    assert "be 0.4, with" in text
    assert_wording(lines_with(text, "MOT_SPIN_MIN would"))


@pytest.mark.parametrize(
    "target", ["gazebo", "gazebo-motors", "mujoco", "rotorpy", "crazyflow", "casadi", "urdf"]
)
def test_thrust_at_full_command_is_enough_for_a_simulator(target, assert_wording, assert_text):
    """kt per squared command is that thrust [N]: a nominal speed, which the file declares."""
    each = {f"kt_{i}": None for i in range(1, 5)}
    kt = {"unit": "N per squared command", "value": 4.2, "interval": (4.1, 4.3)}
    kd = {"unit": "N m per squared command", "value": 0.063, "interval": (0.06, 0.066)}
    result = changed(a_result(law=None), kt=kt, kd=kd, Jr=None, **each)
    result = replace(result, settings={**result.settings, "motors": {"speed": "commanded"}})
    text = text_of(result, target, assumed={"motor_lag": 0.03})
    if target == "mujoco":
        assert 'ctrlrange="0 4.2"' in text and "-0.015" in text
        return
    assert "max_speed = 1000 rad/s" in text
    assert_wording(lines_with(text, "max_speed ="))
    if target.startswith("gazebo"):
        value = {n: float(text.split(f"<{n}>")[1].split("<")[0]) for n in (
            "motorConstant", "maxRotVelocity", "momentConstant")}  # fmt: skip
        assert value["motorConstant"] * value["maxRotVelocity"] ** 2 == pytest.approx(4.2)
        assert value["momentConstant"] == pytest.approx(0.015)
    if target == "crazyflow":
        assert tomllib.loads(text)["export_me"]["thrust_max"] == pytest.approx(4.2)
    real = text_of(result, target, assumed={"motor_lag": 0.03, "max_speed": 800.0})
    assert "nominal" not in real
    assert "max_speed = 800 rad/s" in real
    assert_text(lines_with(real, "max_speed ="))
