"""Optional terms of the model: drag and twist that are there are found, others stay out."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flown
import made_fit
from rotorfit.errors import ExperimentError
from rotorfit.export.vehicle_model import terms_left_out
from rotorfit.fit.joint.term_choice import LEAST_GAIN
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.registry import BY_LIKELIHOOD
from rotorfit.model.terms.rotors import imu_mounting, rotor_inertia, rotor_thrust, rotor_torque
from rotorfit.report.text import result_text
from rotorfit.results.validation.validate import validate_file
from rotorfit.simulation import Scenario, simulate_flight, variant, write_flight_table
from rotorfit.simulation.experiment_files import IMU_AND_SPEED
from rotorfit.simulation.pilot import Stick, Sticks

LOGGED = (*IMU_AND_SPEED, "velocity")
SHORT = {"seconds": 30.0, "ground_seconds": 2.0, "physics_rate": 200.0}
DELAY = "[motors]\ndelay = 0.0\n"


def flight_of(drag, *, kind="noisy", seed=1, rotor_drag=0.0, at=(0.0, 0.0, 0.0)):
    (truth, vehicle), sensors = variant(flown.simulated_vehicle("A"), kind)
    scenario = Scenario(sensors=sensors, **SHORT)
    truth = replace(truth, drag=drag, drag_position=at, rotor_drag=rotor_drag)
    return simulate_flight(truth, vehicle, scenario, seed=seed)


def of_many_speeds(share):
    """Return a flight of wide thrust and yaw whose drag torque in hover is linear by a share."""
    (truth, vehicle), sensors = variant(flown.simulated_vehicle("A"), "noisy")
    hover = np.sqrt(truth.mass * 9.80665 / (4.0 * truth.kt))
    truth = replace(truth, kd=truth.kd * (1.0 - share), kd_linear=share * truth.kd * hover)
    sticks = Sticks(climb=Stick(band=(0.3, 1.5), rms=3.5), yaw=Stick(band=(0.1, 1.0), rms=1.2))
    return simulate_flight(
        truth, vehicle, Scenario(sensors=sensors, sticks=sticks, **SHORT), seed=6
    )


def identified(folder, flight, *, terms=None, channels=LOGGED):
    """Identify a flight from a table in `folder`, which may be there already."""
    table = folder / "flight.csv"
    table.unlink(missing_ok=True)
    write_flight_table(flight, table, channels=channels)
    asked = "" if terms is None else f"[identification]\nterms = {list(terms)!r}\n"
    path = flown.experiment_file(
        folder / "experiment.toml",
        flight.vehicle,
        [table],
        mass=flight.truth.mass,
        extra=DELAY + asked,
    )
    return flown.quietly_identified(path)


@pytest.fixture(scope="module")
def draggy():
    """Return a flight with strong drag, that of a big frame sideways and less along z.

    It acts where it does in real vehicles: neither at the origin nor at the centre of mass.
    """
    return flight_of((0.6, 0.5, 0.3), at=(0.02, -0.015, 0.03))


def inside(parameter, true):
    low, high = parameter.interval
    return low < true < high


@pytest.fixture(scope="module")
def once(draggy, tmp_path_factory):
    """Return what is identified of it."""
    return identified(tmp_path_factory.mktemp("once"), draggy)


def test_drag_enters_by_itself_where_the_velocity_is_known(once, draggy, assert_wording):
    result = once
    used = result.settings["used"]
    assert used["terms"][-1] == "drag"
    assert used["terms_gain"]["drag"] > used["terms_least_gain"] == LEAST_GAIN
    (words,) = [w for w in result.warnings if "air drag of the frame" in w]
    assert_wording(words)
    assert "(drag)" in words
    for axis, true in zip("xyz", draggy.truth.drag, strict=True):
        found = result.parameter(f"drag_{axis}", "A")
        assert inside(found, true)
        assert found.unit == "N s/m"
    assert result.parameter("drag_x", "A").value == pytest.approx(0.6, rel=0.1)
    assert inside(result.parameter("kt"), draggy.truth.kt)


@pytest.mark.parametrize(
    ("name", "true"),
    [
        ("drag_moment_xy", 0.03 * 0.5),
        ("drag_moment_xz", 0.015 * 0.3),
        ("drag_moment_yx", -0.03 * 0.6),
        ("drag_moment_yz", 0.02 * 0.3),
        ("drag_moment_zx", -0.015 * 0.6),
        ("drag_moment_zy", -0.02 * 0.5),
    ],
)
def test_torques_of_drag_about_the_origin_are_found(once, name, true):
    found = once.parameter(name, "A")
    assert found.unit == "N s"
    assert found.value == pytest.approx(true, abs=0.002)


def test_torques_of_drag_are_in_the_file_and_not_in_the_text(once):
    text = result_text(once)
    assert "drag_z" in text
    assert "drag_moment" not in text
    left_out = [words for words in terms_left_out(once, "A") if words.startswith("drag_moment_")]
    assert left_out[0].startswith("drag_moment_xy = 0.01")


@pytest.mark.parametrize("name", ["com_x", "com_z", "Ixx_com", "kd_over_kt"])
def test_drag_off_the_origin_does_not_bend_the_body(once, draggy, name):
    true = draggy.truth.parameters()
    true |= dict(zip(("com_x", "com_y", "com_z"), draggy.truth.center_of_mass, strict=True))
    true["kd_over_kt"] = true["kd"] / true["kt"]
    assert inside(once.derived_value(name, None if name == "kd_over_kt" else "A"), true[name])


def test_drag_does_not_depend_on_where_the_origin_is(once, draggy, tmp_path):
    up = np.array([0.0, 0.0, 0.03])
    rotors = tuple(
        replace(r, position=tuple((r.position - up).tolist())) for r in draggy.vehicle.rotors
    )
    moved = replace(draggy.vehicle, rotors=rotors, imu_position=(0.0, 0.0, -0.03))
    attitude = Rotation.from_quat(draggy.attitude_wxyz, scalar_first=True)
    there = draggy.velocity + attitude.apply(np.cross(draggy.angular_velocity, up))
    result = identified(tmp_path, replace(draggy, vehicle=moved, velocity=there))
    # Of the frame and of the rotors, which one hover speed hardly tells apart; what is known of
    # their moments before the flight is about the origin.
    speeds = 4.0 * once.derived_value("hover_speed").value
    shares = {"x": ("rotor_drag", 1.0), "y": ("rotor_drag", 1.0), "z": ("inflow", 0.5)}
    for axis, (name, share) in shares.items():
        found, same = (
            r.parameter(f"drag_{axis}", "A").value
            + share * speeds * (r.parameter(name).value or 0.0)
            for r in (result, once)
        )
        assert found == pytest.approx(same, rel=0.04)


def test_drag_is_in_the_predicted_wrench_of_other_flights(once, draggy, tmp_path):
    other = tmp_path / "other.csv"
    flight = flight_of(draggy.truth.drag, seed=2, at=draggy.truth.drag_position)
    write_flight_table(flight, other, channels=LOGGED)
    without = identified(tmp_path, draggy, terms=["rotor_inertia", "accel_bias", "twist"])
    alone = tuple(p for p in once.parameters if not p.name.startswith("drag_moment_"))
    after, before, bent = (
        validate_file(result, other) for result in (once, without, replace(once, parameters=alone))
    )
    assert after.relative_error["My"] < 0.8 * bent.relative_error["My"]  # its torque, too
    leaves = [
        np.linalg.norm((c.body_wrench - c.rotor_wrench)[:, :2]) for c in (after, before)
    ]  # sideways forces, where nothing else acts
    assert leaves[0] < 0.5 * leaves[1]


def test_terms_of_the_file_are_the_model_and_others_are_absent(draggy, tmp_path):
    result = identified(tmp_path, draggy, terms=["torque_offset"])
    names = {p.name for p in result.parameters}
    absent = {"Jr", "kt_1", "accel_bias_x", "twist", "rotor_drag", "drag_x"}
    assert not names & absent
    assert {"kt", "kd", "Izz", "torque_offset_z"} <= names
    assert result.settings["used"]["terms"] == ["torque_offset"]
    assert result.settings["used"]["terms_chosen"] == "by the experiment file"
    assert identified(tmp_path, draggy, terms=[]).settings["used"]["terms"] == []


def test_rotors_that_a_turn_drags_do_not_bend_the_drag_torque(tmp_path):
    c = 0.3 * 1.285 / 3730.0  # 0.3 of the mass per second, four rotors in hover
    flight = flight_of((0.0, 0.0, 0.0), rotor_drag=c, seed=3)
    result, true = identified(tmp_path, flight), flight.truth.parameters()
    for name in ("kd", "rotor_drag"):
        assert inside(result.parameter(name), true[name]), name
        assert result.parameter(name).verdict == "identified"
    assert result.parameter("rotor_drag").unit == "N s^2/(m rad)"
    assert result.parameter("rotor_drag").value == pytest.approx(c, rel=0.1)
    terms = ["rotor_inertia", "rotor_spread", "accel_bias", "twist"]
    without = identified(tmp_path, flight, terms=terms)
    ratio = true["kd"] / true["Izz_com"]
    found, bent = (r.derived_value("kd_over_Izz", "A") for r in (result, without))
    assert inside(found, ratio)
    assert found.value == pytest.approx(ratio, rel=0.015)
    low, high = found.interval
    assert ratio - bent.value > 2.0 * (high - low)  # its own interval grows with the misfit
    assert 0.03 < 1.0 - bent.value / ratio < 0.06
    assert without.parameter("kd").value < 0.99 * true["kd"]


USUAL = ("rotor_inertia", "rotor_spread", "accel_bias", "twist", "rotor_drag")
FELT = (*USUAL, "climb_drag", "imu_mounting")


def test_axial_drag_does_not_bias_kt_without_a_velocity(once, draggy, tmp_path):
    found = identified(tmp_path, draggy, channels=IMU_AND_SPEED)
    without = identified(tmp_path, draggy, channels=IMU_AND_SPEED, terms=(*USUAL, "imu_mounting"))
    assert found.settings["used"]["terms"] == list(FELT)
    assert found.parameter("kt").value == pytest.approx(once.parameter("kt").value, rel=1e-3)
    # Without the term changes of thrust look too small, and only the weight holds kt.
    changes, bent = (r.diagnostics["thrust_over_weight"] for r in (found, without))
    assert bent < 0.997 * changes
    assert inside(found.parameter("kt"), draggy.truth.kt)


WITH_LINEAR = (*FELT, "linear_drag_torque")


@pytest.fixture(scope="module", params=[0.0, 0.3], ids=["without", "with it"])
def linear(request, tmp_path_factory):
    """Return what is true of such a flight, and what is identified with the term and without."""
    folder, flight = tmp_path_factory.mktemp("linear"), of_many_speeds(request.param)
    asked, usual = (
        identified(folder, flight, channels=IMU_AND_SPEED, terms=terms)
        for terms in (WITH_LINEAR, None)
    )
    return flight.truth, asked, usual


def test_a_torque_linear_in_speed_is_found_next_to_kd(linear):
    truth, asked, usual = linear
    found = asked.parameter("kd_linear")
    assert found.unit == "N m s/rad"
    assert inside(asked.parameter("kd"), truth.kd)
    assert "kd_linear" not in {p.name for p in usual.parameters}
    if truth.kd_linear:
        assert inside(found, truth.kd_linear)
        assert found.verdict == "identified"
        assert found.value == pytest.approx(truth.kd_linear, rel=0.05)
    else:
        assert found.value is None or inside(found, 0.0)


def test_a_torque_linear_in_speed_gains_only_where_it_is(linear):
    truth, asked, usual = linear
    gain = asked.diagnostics["log_likelihood"] - usual.diagnostics["log_likelihood"]
    assert (gain > LEAST_GAIN) is bool(truth.kd_linear)
    found = asked.parameter("kd_linear")
    surely = found.value is not None and found.value > 4.0 * found.std
    assert surely is bool(truth.kd_linear)


def test_air_that_drives_a_climb_is_not_believed(tmp_path):
    driven = flight_of((0.0, 0.0, -0.3), seed=5)
    result = identified(tmp_path, driven, channels=IMU_AND_SPEED)
    assert result.settings["used"]["terms"] == [*USUAL, "imu_mounting"]


def test_drag_without_velocity_is_refused_with_what_to_log(draggy, tmp_path):
    with pytest.raises(ExperimentError, match=r"flight.csv has no velocity .* vel_x, vel_y, vel_z"):
        identified(tmp_path, draggy, terms=["drag"], channels=IMU_AND_SPEED)


@pytest.mark.parametrize("kind", ["clean", "disturbed"])
def test_terms_that_are_not_there_stay_out(tmp_path, kind):
    result = identified(tmp_path, flight_of((0.0, 0.0, 0.0), kind=kind, seed=4))
    assert result.settings["used"]["terms"] == [*USUAL, "inflow", "imu_mounting", "yaw_damping"]
    assert set(result.settings["used"]["terms_gain"]) == {t.name for t in BY_LIKELIHOOD}
    assert not any("which the flights show" in words for words in result.warnings)


def about(place):
    """Return the matrix from a wrench about the origin to that about a place."""
    return np.block([[np.eye(3), np.zeros((3, 3))], [-np.cross(place, np.eye(3)).T, np.eye(3)]])


def test_a_turned_imu_sees_thrust_and_torque_turned():
    """Against the rotors' wrench about the IMU turned as a whole, about each axis."""
    imu = np.array([0.02, -0.03, 0.05])
    vehicle = replace(made_fit.QUAD, imu_position=tuple(imu.tolist()))
    layout = regressor(vehicle).layout
    found = imu_mounting(vehicle, layout)
    wrenches = {
        "kt": rotor_thrust(vehicle, layout)["kt"],
        **rotor_torque(vehicle, layout),
        **rotor_inertia(vehicle, layout),
    }
    for axis, direction in zip("xyz", np.eye(3), strict=True):
        turn = np.kron(np.eye(2), Rotation.from_rotvec(1e-6 * direction).as_matrix())
        turn = about(-imu) @ turn @ about(imu)
        for name, plain in wrenches.items():
            change = 1e6 * (turn @ plain - plain)
            assert found[f"{name}_mounting_{axis}"] == pytest.approx(change, abs=1e-5)


def test_an_imu_a_degree_off_leaves_no_wrong_product_of_inertia(tmp_path):
    flight = flown.simulated("A", "noisy", seed=7, **SHORT)
    table = tmp_path / "flight.csv"
    write_flight_table(flight, table, channels=LOGGED)
    header, values = table.read_text().splitlines()[0], np.loadtxt(table, delimiter=",", skiprows=1)
    turn = Rotation.from_rotvec(np.radians([0.8, -1.0, 0.7]))
    for names in (("gyro_x", "gyro_y", "gyro_z"), ("accel_x", "accel_y", "accel_z")):
        at = [header.split(",").index(name) for name in names]
        values[:, at] = turn.inv().apply(values[:, at])
    np.savetxt(table, values, delimiter=",", header=header, comments="")
    path = flown.experiment_file(
        tmp_path / "experiment.toml", flight.vehicle, [table], mass=flight.truth.mass
    )
    result = flown.quietly_identified(path)
    found = [result.diagnostics[f"mounting_{axis}"] for axis in "xyz"]
    assert found == pytest.approx((-turn.as_rotvec()).tolist(), abs=np.radians(0.2))
    tensor = flight.truth.com_inertia
    for name, true in (("Ixz_com", tensor[0, 2]), ("Iyz_com", tensor[1, 2])):
        assert inside(result.derived_value(name), true)
