"""From a result to one checked vehicle: origin, units, ratios, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from export_material import (
    COM,
    IMU,
    INERTIA_COM,
    JR,
    KD,
    KT,
    KT_EACH,
    MASS,
    RATES,
    ROTORS,
    SPEEDS,
    UNKNOWN,
    YAW_LOST,
    a_result,
    body_of,
    changed,
    motion,
    not_identified,
    parameter,
    steiner,
    vehicle,
)
from export_material import text_of as exported_text
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flown import with_findings
from kept_words import lines_with
from rotorfit.checks.verdicts.judge import body_verdict
from rotorfit.errors import OutputError
from rotorfit.export import file_format
from rotorfit.export.result_numbers import number_warnings, numbers_of
from rotorfit.export.targets import TARGETS
from rotorfit.export.vehicle import inertia_at_origin
from rotorfit.export.vehicle_model import vehicle_model
from rotorfit.export.write import export
from rotorfit.findings import doubt, note
from rotorfit.flight.motors.motor_model import thrust_curve
from rotorfit.logs.motor_law import MotorLaw, PolynomialCurve, SquareRootCurve
from rotorfit.model.parameters import INERTIA, effective_unit
from rotorfit.report.parameters import body_entry

EVERY = sorted(TARGETS)
WITH_YAW = [target for target in EVERY if "kd" in TARGETS[target].needs]


def text_of(result, target, **options):
    """Return the file; no interval of what is drawn is looked at here."""
    return exported_text(result, target, draws=3, **options)


def with_numbers(result, *parameters):
    """Return the result with parameters put in place of those of the same name."""
    names = {p.name for p in parameters}
    kept = tuple(p for p in result.parameters if p.name not in names)
    return replace(result, parameters=(*kept, *parameters))


def without_derived(result):
    return replace(result, derived=())


def motors_of(result, **motors):
    return replace(result, settings={**result.settings, "motors": motors})


def scaled(entry, factor, unit):
    """Return changes of a parameter in another unit."""
    low, high = entry.interval
    return {"value": factor * entry.value, "interval": (factor * low, factor * high), "unit": unit}


def test_a_plain_result_is_the_vehicle():
    model = vehicle_model(a_result())
    assert (model.mass, model.kd, model.Jr) == (MASS, KD, JR)
    np.testing.assert_array_equal(model.com, COM)
    np.testing.assert_array_equal(model.inertia_com, INERTIA_COM)
    np.testing.assert_allclose(inertia_at_origin(model), INERTIA_COM + steiner(MASS, COM))
    np.testing.assert_allclose([r.kt for r in model.rotors], KT_EACH)
    np.testing.assert_allclose(model.arms, np.array([p for p, _ in ROTORS]) - COM)
    np.testing.assert_array_equal(model.imu, IMU)
    assert model.max_speed == 1100.0
    assert model.hover_speed == pytest.approx(np.sqrt(MASS * 9.80665 / KT_EACH.sum()))


@pytest.mark.parametrize("target", [target for target in EVERY if target != "px4-sih"])
def test_terms_that_are_left_out_are_named_in_the_file(target, assert_wording):
    term = parameter("wake_moment_x", 1.2e-5)
    lost = replace(parameter("twist", 0.0, "A"), **UNKNOWN, verdict="not-identified")
    text = text_of(with_numbers(a_result(), term, lost), target)
    assert "wake_moment_x = (1.200 +-" in text
    assert "0.012)e-05 N s^2/m" in text
    assert_wording(lines_with(text, "wake_moment_x ="))
    assert "left out here" not in text_of(with_numbers(a_result(), lost), target)


def test_drag_of_the_rotors_damps_yaw_in_sih():
    term = parameter("rotor_drag", 1.2e-5)
    text = text_of(with_numbers(a_result(), term), "px4-sih")
    assert "rotor_drag = " not in text
    model = vehicle_model(with_numbers(a_result(), term))
    damping = 1.2e-5 * model.hover_speed * float((model.arms_from_middle[:, :2] ** 2).sum()) / 3.0
    (line,) = [line for line in text.splitlines() if "SIH_KDW" in line and not line.startswith("#")]
    assert float(line.split()[3]) == pytest.approx(damping, rel=1e-5)


@pytest.mark.parametrize("axes", ["FLU", "FRD"])
def test_settings_in_either_axes_are_the_same_vehicle(axes):
    result = a_result()
    if axes == "FRD":
        frame = dict(result.settings["airframe"])
        frame["axes"] = "FRD"
        frame["imu"] = {"position": [IMU[0], -IMU[1], -IMU[2]], "position_std": 0.0}
        frame["rotors"] = [
            {"position": [x, -y, -z], "spin": s, "axis": [0.0, 0.0, -1.0]}
            for (x, y, z), s in ROTORS
        ]
        result = replace(result, settings={**result.settings, "airframe": frame})
    model = vehicle_model(result)
    np.testing.assert_allclose(model.arms, np.array([p for p, _ in ROTORS]) - COM)
    np.testing.assert_allclose([r.axis for r in model.rotors], [[0, 0, 1]] * 4)


def test_with_the_imu_as_origin_rotors_move_with_their_centre(assert_wording):
    """The torque about the CoM of rotors declared at p is that of rotors at p + rotor_center."""
    center = np.array([0.02, -0.015, 0.0])
    result = with_numbers(
        a_result(imu=None),
        parameter("rotor_center_x", 0.02, "A"),
        parameter("rotor_center_y", -0.015, "A"),
    )
    model = vehicle_model(result)
    np.testing.assert_allclose(model.arms, np.array([p for p, _ in ROTORS]) + center - COM)
    np.testing.assert_array_equal(model.imu, np.zeros(3))
    assert_wording(model.notes)
    body = body_of(shift=center)
    alpha, dw = motion(body, vehicle())
    moved = tuple((tuple(float(v) for v in np.array(p) + center), spin) for p, spin in ROTORS)
    again, same = motion(body_of(), vehicle(moved))
    np.testing.assert_allclose(alpha, again)
    np.testing.assert_allclose(dw, same)
    torque = np.zeros(3)
    for rotor, arm, O in zip(model.rotors, model.arms, SPEEDS, strict=True):
        thrust = rotor.kt * O**2 * rotor.axis
        torque += np.cross(arm, thrust) - rotor.spin * (model.kd * O**2) * rotor.axis
    wheels = sum(r.spin * model.Jr * O for r, O in zip(model.rotors, SPEEDS, strict=True))
    torque -= np.cross(RATES, [0, 0, wheels])
    I = model.inertia_com
    expected = np.linalg.solve(I, torque - np.cross(RATES, I @ RATES))
    np.testing.assert_allclose(dw, expected, rtol=1e-9, atol=1e-9)


def test_an_unknown_rotor_centre_is_refused():
    result = with_numbers(
        a_result(imu=None),
        parameter("rotor_center_x", 0.02, "A"),
        replace(parameter("rotor_center_y", 0.0, "A"), **not_identified()),
    )
    with pytest.raises(OutputError, match="--assume rotor_center_y=VALUE"):
        vehicle_model(result)


def test_without_derived_numbers_they_are_made_of_the_parameters():
    model = vehicle_model(without_derived(a_result()))
    np.testing.assert_allclose(model.com, COM, rtol=1e-12)
    np.testing.assert_allclose(model.inertia_com, INERTIA_COM, rtol=1e-12, atol=1e-15)


def test_unessential_parameters_are_zero_and_marked_but_not_kd():
    """The paper's method takes parameters out of the model: there they are zero."""
    removed = {**UNKNOWN, "verdict": "removed"}
    base = without_derived(a_result())
    result = changed(base, Ixy=removed, Iyz=removed, msz=removed)
    model = vehicle_model(result)
    assert model.com[2] == 0.0
    assert [n.origin for n in model.numbers if n.name == "com_z"] == ["removed"]
    assert "com_z = 0 m [REMOVED: " in text_of(result, "px4")
    with pytest.raises(OutputError, match=r"kd is removed \(the method took it out of the model\)"):
        vehicle_model(changed(base, kd=removed))


def per_kilogram():
    result = a_result()
    changes = {
        p.name: scaled(p, 1 / MASS, f"{p.unit} per kg")
        for p in result.parameters
        if p.unit.startswith(("N ", "kg m"))
    }
    changes |= {
        d.name: scaled(d, 1 / MASS, f"{d.unit} per kg")
        for d in result.derived
        if d.unit == "kg m^2"
    }
    return changed(result, mass={**UNKNOWN, "verdict": "not-identified"}, **changes)


def test_an_unknown_mass_is_refused_and_scales_all_if_assumed(assert_wording):
    with pytest.raises(OutputError) as refused:
        vehicle_model(per_kilogram())
    words = str(refused.value)
    assert "mass is not-identified" in words
    assert_wording(words)
    model = vehicle_model(per_kilogram(), assumed={"mass": 2 * MASS})
    np.testing.assert_allclose(model.inertia_com, 2 * INERTIA_COM)
    np.testing.assert_allclose([r.kt for r in model.rotors], 2 * KT_EACH)
    np.testing.assert_allclose((model.kd, model.Jr), (2 * KD, 2 * JR))
    np.testing.assert_allclose(model.com, COM)
    same = vehicle_model(without_derived(per_kilogram()), assumed={"mass": 2 * MASS})
    np.testing.assert_allclose(same.com, COM)
    np.testing.assert_allclose(same.inertia_com, 2 * INERTIA_COM)
    assert "kg m^2 per kg" not in text_of(per_kilogram(), "casadi", assumed={"mass": MASS})


def in_commands(full=1000.0):
    """The result of commands without a law: speed in parts of `full` rad/s."""
    result = a_result(law=None)
    powers = {"kt": 2, "kd": 2, "Jr": 1, "kd_over_Izz": 2, "Jr_over_Izz": 1}
    powers |= {f"kt_{i}": 2 for i in range(1, 5)}
    changes = {
        p.name: scaled(p, full ** powers[p.name], effective_unit(p.name, p.unit))
        for p in (*result.parameters, *result.derived)
        if p.name in powers
    }
    return motors_of(changed(result, **changes), speed="commanded", lag=0.03)


def test_commands_without_a_law_need_the_full_speed(assert_wording):
    with pytest.raises(OutputError) as refused:
        vehicle_model(in_commands())
    words = str(refused.value)
    assert_wording(words)
    model = vehicle_model(in_commands(), assumed={"max_speed": 1000.0})
    np.testing.assert_allclose([r.kt for r in model.rotors], KT_EACH)
    np.testing.assert_allclose((model.kd, model.Jr), (KD, JR))


def test_an_autopilot_needs_only_the_thrust_at_full_command():
    with pytest.raises(OutputError, match="max_speed"):
        text_of(in_commands(), "paparazzi", assumed={"motor_lag": 0.03})
    text = text_of(in_commands(), "px4")
    lines = [line.split("\t") for line in text.splitlines() if not line.startswith("#")]
    found = {line[2]: float(line[3]) for line in lines}
    assert found["CA_ROTOR0_CT"] == pytest.approx(KT_EACH[0] * 1000.0**2)
    assert found["CA_ROTOR0_KM"] == pytest.approx(KD / KT_EACH[0])
    assert "SIM_GZ_EC_MAX1" not in found
    sih = text_of(in_commands(), "px4-sih", assumed={"motor_lag": 0.03})
    assert f"SIH_T_MAX\t{file_format.text(KT_EACH.mean() * 1e6)}\t" in sih


def test_half_of_a_ratio_gives_the_other(assert_text):
    lost = changed(a_result(), **YAW_LOST)
    model = vehicle_model(lost, assumed={"Izz_com": 0.0288 * 1.1})
    assert model.kd == pytest.approx(1.1 * KD)
    assert model.inertia_com[2, 2] == pytest.approx(0.0288 * 1.1)
    other = vehicle_model(lost, assumed={"kd": 0.9 * KD})
    assert other.inertia_com[2, 2] == pytest.approx(0.9 * 0.0288)
    text = text_of(lost, "mujoco", assumed={"Izz_com": 0.0288 * 1.1})
    assert_text(lines_with(text, "kd ="))


def test_an_inertia_at_the_origin_may_be_assumed():
    lost = changed(a_result(), **YAW_LOST)
    at_origin = float((INERTIA_COM + steiner(MASS, COM))[2, 2])
    model = vehicle_model(lost, assumed={"Izz": at_origin})
    assert model.inertia_com[2, 2] == pytest.approx(INERTIA_COM[2, 2])
    assert model.kd == pytest.approx(KD)


@pytest.mark.parametrize("target", WITH_YAW)
def test_every_target_refuses_a_lost_yaw_with_the_cure(target, assert_wording, assert_text):
    with pytest.raises(OutputError) as refused:
        text_of(changed(a_result(), **YAW_LOST), target)
    words = str(refused.value)
    assert_wording(words)
    assert "--assume kd=VALUE" in words
    assert "kd in N m s^2/rad^2" in words
    text = text_of(changed(a_result(), **YAW_LOST), target, assumed={"kd": KD})
    assert "kd = 5.11e-08 N" in text
    assert "m s^2/rad^2 [ASSUMED]" in text
    assert_text(lines_with(text, "kd ="))


@pytest.mark.parametrize("target", [t for t in WITH_YAW if "Izz_com" in TARGETS[t].needs])
def test_every_target_refuses_an_izz_that_is_not_identified(target, assert_text, assert_wording):
    lost = changed(
        a_result(), Izz=not_identified(), Izz_com=UNKNOWN, kd_over_Izz=UNKNOWN, Jr_over_Izz=UNKNOWN
    )
    with pytest.raises(OutputError) as refused:
        text_of(lost, target)
    words = str(refused.value)
    assert_wording(words)
    assert "--assume Izz_com=VALUE" in words
    assert_text(lines_with(text_of(lost, target, assumed={"Izz_com": 0.03}), "Izz_com ="))


@pytest.mark.parametrize("target", EVERY)
def test_every_target_marks_what_is_weak(target, assert_text):
    weak = {"verdict": "weak", "reason": "known only to +-30 %"}
    text = text_of(changed(a_result(), kd=weak, msx=weak), target)
    assert "kd = 5.11e-08 (5.0588e-08" in text
    assert "to 5.1612e-08) N" in text
    assert "m s^2/rad^2 [WEAK]" in text
    assert_text(lines_with(text, "kd ="))
    comx = next(line for line in text.splitlines() if "com_x = " in line)
    assert "WEAK" in comx


def test_a_wide_interval_about_the_com_alone_is_marked(assert_text):
    wide = changed(a_result(), Ixx_com={"interval": (0.01, 0.03)})
    assert_text(lines_with(text_of(wide, "px4"), "Ixx_com ="))


@pytest.mark.parametrize("target", EVERY)
def test_every_target_says_where_its_numbers_are_from(target, assert_text):
    text = text_of(a_result(), target)
    assert "on 2026-11-21" in text
    assert "sha256 0123456789ab" in text
    assert "/home/someone" not in text
    assert "long.csv" in text
    assert "kd = 5.11e-08 (5.0588e-08" in text
    assert "to 5.1612e-08) N" in text
    assert "m s^2/rad^2 [identified]" in text
    assert_text(lines_with(text, "kd ="))


def test_the_doubts_of_the_result_stand_in_the_file(assert_wording):
    doubtful = replace(a_result(), findings=(doubt("made", "gyro bias not removed"),))
    assert_wording(lines_with(text_of(doubtful, "px4"), "gyro bias"))


ANGLES = np.radians([90, -90, -30, 150, 30, -150])  # clockwise from the front: ArduPilot's hexa X
HEXA = tuple(
    ((float(0.3 * np.cos(a)), float(-0.3 * np.sin(a)), 0.0), s)
    for a, s in zip(ANGLES, ("cw", "ccw", "cw", "ccw", "ccw", "cw"), strict=True)
)


@pytest.mark.parametrize(
    ("target", "marks"),
    [
        ("gazebo", ("<motorNumber>5</motorNumber>", "rotor_5_joint")),
        ("px4", ("CA_ROTOR_COUNT\t6\t6", "CA_ROTOR5_KM")),
        ("px4-gazebo", ("SIM_GZ_EC_FUNC6\t106",)),
        ("mujoco", ('<general name="rotor_6"',)),
        ("urdf", ("prop5_joint",)),
        ("casadi", ("SPINS = [-1, 1, -1, 1, 1, -1]",)),
        ("ardupilot-sitl", ("--model hexax:THIS_FILE.json", "motor6_position")),
    ],
)
def test_six_rotors_are_written_where_the_target_has_them(target, marks):
    text = text_of(a_result(rotors=HEXA), target)
    assert all(mark in text for mark in marks), text


def test_rotors_without_a_coefficient_of_their_own_have_the_mean(assert_wording):
    model = vehicle_model(changed(a_result(), kt_2=not_identified()))
    assert [r.kt for r in model.rotors] == pytest.approx([KT_EACH[0], KT, *KT_EACH[2:]])
    assert any("known: 2" in n for n in model.notes)
    assert_wording(model.notes)


def test_an_assumed_coefficient_is_that_of_every_rotor():
    model = vehicle_model(a_result(), assumed={"kt": 4e-6, "kt_2": 5e-6})
    assert [r.kt for r in model.rotors] == [4e-6, 5e-6, 4e-6, 4e-6]


def test_several_configurations_must_differ_in_name():
    one, two = a_result(), a_result(configuration="B", com=np.array([0.01, 0.0, 0.0]))
    both = replace(
        one,
        parameters=(*one.parameters, *(p for p in two.parameters if p.configuration == "B")),
        derived=(*one.derived, *two.derived),
    )
    with pytest.raises(OutputError, match="has the configurations A, B; say which is meant"):
        vehicle_model(both)
    with pytest.raises(OutputError, match="--configuration NAME"):
        vehicle_model(both, configuration="C")
    assert vehicle_model(both, configuration="B").com[0] == 0.01


def test_another_mass_than_the_results_is_refused():
    with pytest.raises(OutputError, match=r"mass=2 was assumed, .* made with 1.285 kg"):
        vehicle_model(a_result(), assumed={"mass": 2.0})


def test_inertia_that_no_body_has_is_refused(assert_wording):
    flat_disc_and_more = np.diag([0.01, 0.01, 0.0201])
    with pytest.raises(OutputError, match="no body has this inertia about its CoM") as refused:
        vehicle_model(a_result(inertia_com=flat_disc_and_more))
    assert "0.01, 0.01, 0.0201 kg" in str(refused.value)
    assert "m^2 break" in str(refused.value)
    assert_wording(str(refused.value))
    assert vehicle_model(a_result(inertia_com=np.diag([0.01, 0.01, 0.02]))).mass == MASS


def test_inertia_impossible_by_its_products_is_refused():
    tensor = np.diag([0.01, 0.01, 0.015])
    tensor[0, 2] = tensor[2, 0] = 0.008
    with pytest.raises(OutputError, match="no body has this inertia"):
        vehicle_model(a_result(inertia_com=tensor))


def impossible():
    """A flat body whose Izz came out 4 % too large, with a covariance of its nine moments."""
    result = a_result(inertia_com=np.diag([0.0182, 0.0196, 0.0393]))
    names = ("msx", "msy", "msz", *INERTIA)
    std = np.array([1e-4] * 3 + [2e-4, 2e-4, 1.5e-3, 1e-4, 1e-4, 1e-4])
    return replace(
        result, covariance_names=tuple(f"{n}@A" for n in names), covariance=np.diag(std**2)
    )


def test_impossible_inertia_is_projected_with_its_distance(assert_wording):
    pytest.importorskip("clarabel", reason="clarabel is not installed")
    with pytest.raises(OutputError, match="--project"):
        vehicle_model(impossible())
    model = vehicle_model(impossible(), project=True)
    moments = np.linalg.eigvalsh(model.inertia_com)
    assert 0.0 <= moments[0] + moments[1] - moments[2] < 1e-6
    # Nearest by the covariance: the one that is known least moves most, and all but alone.
    Ixx, Iyy, Izz = np.diag(model.inertia_com)
    excess = 0.0393 - 0.0182 - 0.0196
    assert 0.0393 - Izz == pytest.approx(excess * 1.5**2 / (1.5**2 + 2 * 0.2**2), rel=0.01)
    assert Ixx - 0.0182 == pytest.approx(Iyy - 0.0196, rel=0.02)
    distance = excess / np.sqrt(1.5e-3**2 + 2 * 2e-4**2)
    note = next(n for n in model.notes if "PROJECTED" in n)
    assert f"{distance:.2g} standard" in note
    assert_wording(note)
    text = text_of(impossible(), "urdf", project=True)
    assert "kg m^2 [WEAK:" in text
    assert "from 0.0393]" in text
    assert_wording(lines_with(text, "rojected"))


def test_a_possible_inertia_is_left_alone_by_the_projection():
    np.testing.assert_array_equal(vehicle_model(a_result(), project=True).inertia_com, INERTIA_COM)


def test_what_was_assumed_is_not_projected():
    with pytest.raises(OutputError, match="but Izz_com is not from them"):
        vehicle_model(impossible(), assumed={"Izz_com": 0.05}, project=True)


def test_lags_of_rising_and_falling_speed_are_each_written():
    result = with_numbers(
        a_result(), parameter("motor_lag_up", 0.03), parameter("motor_lag_down", 0.06)
    )
    model = vehicle_model(result)
    assert (model.lag_up, model.lag_down) == (0.03, 0.06)
    only = changed(result, motor_lag=None)
    assert "<timeConstantDown>0.06</timeConstantDown>" in text_of(only, "gazebo-motors")
    lost = changed(only, motor_lag_down=not_identified())
    with pytest.raises(OutputError, match="--assume motor_lag_down=VALUE"):
        text_of(lost, "gazebo-motors")
    one = vehicle_model(result, assumed={"motor_lag": 0.04})
    assert (one.lag_up, one.lag_down) == (0.04, 0.04)


@pytest.mark.parametrize("name", ["kt", "kd", "kt_3", "Jr"])
def test_a_coefficient_below_zero_is_refused(name):
    own = {} if name == "kt_3" else {f"kt_{i}": None for i in range(1, 5)}
    lost = {name: {"value": -1e-9, "interval": (-2e-9, -1e-10)}}
    negative = changed(a_result(), **(own | lost))
    with pytest.raises(OutputError, match=f"{name} is -1e-09 .*, which cannot be below 0"):
        vehicle_model(negative)


def test_a_rotor_inertia_not_distinct_from_zero_is_left_out(assert_wording):
    none = changed(a_result(), Jr={"value": -1e-9, "interval": (-2e-9, 1e-9)})
    model = vehicle_model(none)
    assert model.Jr is None
    assert_wording(model.notes)
    with pytest.raises(OutputError, match=r"Jr is -1e-09 .*, which cannot be below 0"):
        vehicle_model(none, assumed={"Jr": -1e-9})


def test_a_result_without_its_vehicle_is_refused():
    with pytest.raises(OutputError, match="settings do not describe its vehicle"):
        vehicle_model(replace(a_result(), settings={"name": "lost"}))


def test_a_missing_lag_says_why_it_is_missing(assert_wording):
    with pytest.raises(OutputError) as refused:
        text_of(a_result(law=None), "gazebo")
    words = str(refused.value)
    assert_wording(words)
    assert "needed: supply them with " in words
    assert "fly" not in words
    assert "--assume motor_lag=VALUE --assume max_speed=VALUE" in words


def test_a_lag_is_not_blamed_on_speeds_that_no_log_has():
    made = a_result(law=None)
    motors = {**made.settings["motors"], "speed": "commanded"}
    with pytest.raises(OutputError, match=r"motor_lag is not in the result \(the flights do not"):
        text_of(replace(made, settings={**made.settings, "motors": motors}), "gazebo")


def test_the_mass_alone_does_not_help_what_the_log_cannot_show():
    step = note("log-too-slow", "", numbers=("Ixx",), next_step="set it", useless_because="slow")
    lost = changed(a_result(), mass=UNKNOWN, Ixx=not_identified(), Ixx_com=UNKNOWN)
    with pytest.raises(OutputError, match=r"set it, then identify with the weighed mass \(--mass"):
        vehicle_model(with_findings(lost, step))


def test_numbers_weak_for_one_reason_are_one_line():
    reason = "these flights hardly show how a rotor differs from the average one"
    weak = {"verdict": "weak", "reason": reason}
    found = numbers_of(changed(a_result(), kd=weak, kt=weak), "A", assumed={}, full_speed=None)
    [line] = number_warnings([found["kt"], found["kd"]])
    assert line.startswith("kt = ") and ", kd = " in line
    assert line.endswith(f"are weak: {reason}")


def test_what_is_not_known_is_never_written():
    with pytest.raises(ValueError, match="not known was to be written"):
        file_format.text(float("nan"))


@given(st.floats(-1e9, 1e9, allow_nan=False))
def test_numbers_are_read_back(value):
    assert float(file_format.text(value)) == pytest.approx(value, rel=1e-11, abs=0.0)


@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda v: np.linalg.norm(v) > 0.1))
def test_rotations_take_z_to_the_axis(direction):
    axis = np.array(direction) / np.linalg.norm(direction)
    w, x, y, z = file_format.quaternion_wxyz(axis)
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).apply([0, 0, 1]), axis, atol=1e-6)
    turned = Rotation.from_euler("xyz", file_format.roll_pitch_yaw(axis)).apply([0, 0, 1])
    np.testing.assert_allclose(turned, axis, atol=1e-7)


def test_an_inertia_in_frd_is_the_turned_one():
    turn = Rotation.from_euler("x", np.pi).as_matrix()
    found = file_format.inertia_frd(INERTIA_COM)
    np.testing.assert_allclose(found, turn @ INERTIA_COM @ turn.T, atol=1e-15)
    assert file_format.elements(found)[3] == -file_format.elements(INERTIA_COM)[3]


@pytest.mark.parametrize("f", [0.0, 0.35, 1.0])
def test_the_factor_of_the_thrust_curve_is_found(f):
    curve = thrust_curve(MotorLaw(curve=SquareRootCurve(900.0, f)))
    assert curve.factor == pytest.approx(f, abs=1e-9)
    assert curve.error == pytest.approx(0.0, abs=1e-9)
    assert f * curve.command(0.4) ** 2 + (1 - f) * curve.command(0.4) == pytest.approx(0.4)


def test_the_misfit_of_a_thrust_curve_is_reported():
    curve = thrust_curve(MotorLaw(curve=PolynomialCurve((300.0, 700.0))))
    u = np.linspace(0, 1, 501)
    relative = (0.3 + 0.7 * u) ** 2
    miss = np.abs(curve.factor * u**2 + (1 - curve.factor) * u - relative).max()
    assert curve.error == pytest.approx(miss)
    assert miss > 0.05
    for other in (curve.factor - 0.01, curve.factor + 0.01):
        here, there = (
            ((f * u**2 + (1 - f) * u - relative) ** 2).sum() for f in (curve.factor, other)
        )
        assert here <= there or not 0 <= other <= 1


def half_width(value, half):
    return {"value": value, "interval": (value - half, value + half)}


WEAK_AT_THE_ORIGIN = {"verdict": "weak", "reason": "known only to +-50 %"}


@pytest.mark.parametrize(
    ("name", "interval", "twin", "origin"),
    [
        ("Ixz_com", half_width(6e-4, 1e-4), WEAK_AT_THE_ORIGIN, "identified"),
        ("Ixz_com", half_width(6e-4, 4e-4), {}, "weak"),
        ("Ixy_com", half_width(1e-6, 1e-4), {}, "identified"),  # sqrt(Ixx Iyy)/20 is 9e-4
        ("Ixx_com", half_width(0.018, 0.002), WEAK_AT_THE_ORIGIN, "identified"),
        ("Ixx_com", half_width(0.018, 0.006), {}, "weak"),
        ("com_x", half_width(0.004, 0.004), {}, "identified"),
        ("com_x", half_width(0.004, 0.001), WEAK_AT_THE_ORIGIN, "weak"),
    ],
)
def test_what_is_about_the_com_is_weak_where_the_report_says_so(name, interval, twin, origin):
    at_origin = name.removesuffix("_com").replace("com_", "ms")
    result = changed(a_result(), **{name: interval, at_origin: twin})
    number = next(n for n in vehicle_model(result).numbers if n.name == name)
    assert number.origin == origin
    kin = {d.name: d for d in result.derived}
    assert body_verdict(kin[name], result.parameter(at_origin), kin) == origin
    if name == "Ixx_com" and origin == "weak":
        assert number.remark is None  # the interval says so


SMALL = "near zero, and known 1.4 times less well than wanted"


def test_a_number_about_the_com_is_explained_by_its_own_width():
    """The product at the origin has the CoM's place in it, and is known less well."""
    wide = half_width(6e-4, 4e-4)
    result = changed(a_result(), Ixz_com=wide, Ixz=WEAK_AT_THE_ORIGIN)
    own = next(d for d in result.derived if d.name == "Ixz_com")
    kin = {d.name: d for d in result.derived}
    assert body_entry(own, result.parameter("Ixz"), kin).reason == SMALL
    little = {"verdict": "weak", "reason": "the motors explain too little of the motion in roll"}
    twin = changed(a_result(), Ixz=little).parameter("Ixz")
    assert body_entry(own, twin, kin).reason == little["reason"]


@pytest.mark.parametrize(
    ("half", "twin", "origin"),
    [
        (1e-4, WEAK_AT_THE_ORIGIN, "identified"),
        (4e-4, WEAK_AT_THE_ORIGIN, "weak"),
        (4e-4, {}, "identified"),  # the estimate knew the moment, and found it sharp
        (4e-4, not_identified(), "weak"),
    ],
)
def test_a_product_with_a_lost_moment_is_weak_as_in_the_report(half, twin, origin):
    result = changed(a_result(), Izz_com=UNKNOWN, Ixz_com=half_width(6e-4, half), Ixz=twin)
    found = numbers_of(result, "A", assumed={}, full_speed=None)["Ixz_com"]
    assert found.origin == origin
    kin = {d.name: d for d in result.derived}
    assert body_verdict(kin["Ixz_com"], result.parameter("Ixz"), kin) == origin


@pytest.mark.parametrize(
    ("target", "held"),
    [
        ("mujoco", {"com_x", "Ixx_com", "kd"}),
        ("px4-sih", {"com_x", "Ixx_com", "kd"}),
        ("px4", {"com_x", "kd"}),
        ("ardupilot", set()),
        ("px4-gazebo", set()),
    ],
)
def test_only_numbers_that_the_file_holds_are_warned_of(target, held):
    weak = {"verdict": "weak", "reason": "known only to +-40 %"}
    wide = {"interval": (0.012, 0.024)}
    made = export(changed(a_result(), com_x=weak, msx=weak, Ixx_com=wide, kd=weak), target)
    assert {n.name for n in made.unsure} == held
    words = " ".join(number_warnings(made.unsure))
    assert ("kd = (5.110 +- 0.051)e-08 N m s^2/rad^2 " in words) is ("kd" in held)
    assert "%" not in words
