"""One realistic fault at a time in a sound flight: refused or said, and its cause named."""

import re
from dataclasses import replace
from io import StringIO
from types import SimpleNamespace

import numpy as np
import pytest

import flown
import made_fit
from rotorfit.checks.motors.changed_thrust import (
    LEAST_UNLIKE,
    PARTS,
    half_change,
    lone_change,
    most_unlike,
    unlike_rotors,
    unlike_sentence,
)
from rotorfit.checks.vehicle_size import AIR, figure_of_merit, largest_radius
from rotorfit.errors import FlightError, FrameError
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.flight.imu_tilt import ImuTilt, levelled, mean_force_tilt
from rotorfit.flight.prepare import prepare
from rotorfit.logs.table import write_table
from rotorfit.simulation import paper_vehicle, to_flight_log
from rotorfit.simulation.experiment_files import flight_table

IMU = [f"{name}_{axis}" for name in ("gyro", "accel") for axis in "xyz"]
ROTORS = [f"rotor_{i}" for i in range(1, 5)]
COMMANDS = [f"command_{i}" for i in range(1, 5)]


@pytest.fixture(scope="module")
def flight():
    return flown.simulated("A", "noisy", seed=3, seconds=25.0, physics_rate=200.0)


@pytest.fixture(scope="module")
def columns(flight):
    return table_of(flight)


def table_of(flight):
    text = flight_table(flight, channels=("gyro", "accel", "rotor_speed", "command"))
    names = text.partition("\n")[0].split(",")
    rows = np.loadtxt(StringIO(text), delimiter=",", skiprows=1)
    return dict(zip(names, rows.T, strict=True))


def turned(columns, rotation):
    """Return the table with gyro and accelerometer as an IMU reads them that is turned."""
    new = dict(columns)
    for first in (0, 3):
        vectors = np.column_stack([columns[name] for name in IMU[first : first + 3]])
        for name, values in zip(IMU[first : first + 3], (vectors @ rotation).T, strict=True):
            new[name] = values
    return new


def identified(folder, flight, columns, *, mass=None, vehicle=None, more=()):
    names = []
    for number, table in enumerate((columns, *more)):
        names.append(f"flight{number}.csv")
        write_table(folder / names[-1], table, force=True)
    path = flown.experiment_file(
        folder / "experiment.toml",
        vehicle or flight.vehicle,
        [(folder / name).relative_to(folder) for name in names],
        mass=flight.truth.mass if mass is None else mass,
    )
    return flown.quietly_identified(path)


@pytest.fixture(scope="module")
def sound(tmp_path_factory, flight, columns):
    """Return the result of the flight as it is."""
    return identified(tmp_path_factory.mktemp("sound"), flight, columns)


def said(result, words):
    return [text for text in result.warnings if words in text]


def test_a_sound_flight_has_no_warnings_and_lists_its_inputs(flight, sound, assert_wording):
    assert not any(
        said(sound, words)
        for words in ("IMU is mounted", "rotor 1 ", "without flight", "density", "come ")
    )
    hanging = sound.settings["used"]["hangs_on"]
    assert f"the mass ({flight.truth.mass:g} kg)" in hanging[0]
    assert "400 mm" in hanging[1]
    assert "back, 400 mm" in hanging[1]
    assert_wording(hanging[1])
    assert "rpm)" in hanging[2]
    assert "clock" in hanging[3]
    assert "IMU (0, 0, 0" in hanging[4]
    assert_wording(hanging[4])


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 10.0), (-8.0, 6.0)])
def test_a_turned_imu_is_found_and_turned_back(tmp_path, flight, columns, sound, roll, pitch):
    tilt = ImuTilt(roll=np.radians(roll), pitch=np.radians(pitch))
    result = identified(tmp_path, flight, turned(columns, tilt.rotation_imu_to_body))
    assert len(said(result, "the IMU is mounted")) == 1
    found = result.settings["airframe"]["imu_tilt_deg"]
    np.testing.assert_allclose(found, [roll, pitch], atol=0.6)
    for name in ("kt", "kd"):
        low, high = result.parameter(name).interval
        apart = result.parameter(name).value - sound.parameter(name).value
        assert abs(apart) < 0.15 * (high - low), name
    for name in ("Ixx_com", "Iyy_com", "Izz_com"):
        low, high = result.derived_value(name).interval
        apart = result.derived_value(name).value - sound.derived_value(name).value
        assert abs(apart) < 0.15 * (high - low), name


def test_levelling_undoes_a_tilt(flight):
    data = prepare(to_flight_log(flight), rotor_count=4, arm=0.2)
    rng = np.random.default_rng(1)
    for _ in range(5):
        tilt = ImuTilt(roll=float(rng.uniform(-0.4, 0.4)), pitch=float(rng.uniform(-0.4, 0.4)))
        R = tilt.rotation_imu_to_body
        mounted = replace(
            data,
            data=replace(
                data.data,
                specific_force=data.data.specific_force @ R,
                angular_velocity=data.data.angular_velocity @ R,
            ),
        )
        back = levelled(mounted, tilt).data
        np.testing.assert_allclose(back.specific_force, data.data.specific_force, atol=1e-12)
        seen, before = mean_force_tilt([mounted.data]), mean_force_tilt([data.data])
        assert abs(before.angle) < np.radians(1.5)
        np.testing.assert_allclose(
            [seen.roll, seen.pitch], [tilt.roll, tilt.pitch], atol=1.6 * before.angle + 1e-3
        )


@pytest.mark.parametrize("degrees", [20.0, -45.0])
def test_an_imu_turned_about_z_is_refused_with_its_angle(tmp_path, flight, columns, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    about_z = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    way = "counter-clockwise" if degrees > 0 else "clockwise"
    with pytest.raises(FrameError, match=rf"turned by {abs(degrees):.0f} degrees {way} about z"):
        identified(tmp_path, flight, turned(columns, about_z))


@pytest.mark.parametrize("factor", [100.0, 1000.0])
def test_a_mass_in_other_units_is_refused(tmp_path, flight, columns, factor):
    with pytest.raises(FrameError, match=r"cannot lift .* kg|denser than stone"):
        identified(tmp_path, flight, columns, mass=factor * flight.truth.mass)


def test_one_rotor_at_another_scale_is_refused_as_inspect_says(tmp_path, flight, columns):
    spoilt = {**columns, "rotor_2": columns["rotor_2"] * 14.0 / 12.0}
    with pytest.raises(FlightError, match=r"rotor 2 turns at 1\.1\d times .*correct its poles"):
        identified(tmp_path, flight, spoilt)
    # A group of its own is a coefficient of its own.
    rotors = tuple(
        replace(r, group=f"rotor {i}") for i, r in enumerate(flight.vehicle.rotors, start=1)
    )
    grouped = replace(flight.vehicle, rotors=rotors)
    assert identified(tmp_path, flight, spoilt, vehicle=grouped).parameter("kt").value


def test_speeds_that_come_late_are_moved_and_said(tmp_path, flight, columns):
    late = dict(columns)
    shift = round(0.03 / float(np.median(np.diff(columns["time"]))))
    for name in (*ROTORS, *COMMANDS):
        late[name] = np.concatenate([np.full(shift, columns[name][0]), columns[name][:-shift]])
    result = identified(tmp_path, flight, late)
    assert len(said(result, "ms after the motion that they make")) == 1
    assert result.parameter("motor_delay").value == pytest.approx(-0.03, abs=0.004)
    low, high = result.parameter("kt").interval
    assert low <= flight.truth.kt <= high


def test_two_vehicles_in_one_configuration_are_reported(tmp_path, flight, columns):
    other = flown.simulated("A", "noisy", seed=9, seconds=25.0, physics_rate=200.0)
    slower = table_of(other)
    for axis in "xyz":
        slower[f"gyro_{axis}"] = slower[f"gyro_{axis}"] * 0.7
    result = identified(tmp_path, flight, columns, more=(slower,))
    assert len(said(result, "standard deviations apart")) == 1
    alike = identified(tmp_path, flight, columns, more=(table_of(other),))
    assert not said(alike, "standard deviations apart")


def test_a_propeller_that_breaks_is_named(tmp_path, flight, columns, assert_wording):
    broken = {name: columns[name] for name in ("time", *IMU, *ROTORS)}
    half = len(broken["time"]) // 2
    weaker = np.where(np.arange(len(broken["time"])) < half, 1.0, 1.15)
    broken["rotor_3"] = broken["rotor_3"] * weaker
    result = identified(tmp_path, flight, broken)
    [words] = said(result, "in the first half of the flight")
    assert "rotor 3 has 24" in words
    assert_wording(words)
    assert "30 % in the second" in words
    doubted = {p.name for p in (*result.parameters, *result.derived) if p.verdict == "doubtful"}
    assert {"kt", "kd", "Izz", "com_x", "kd_over_Izz"} <= doubted


YAWLESS, ALONE = np.array([1.0, -1.0, 1.0, -1.0]), np.array([0.0, 1.0, 0.0, 0.0])


def squares_of_flight(change, *, at=0.5, rms=0.05):
    """Return squared speeds of four rotors that move, with a change from a moment on."""
    rng = np.random.default_rng(8)
    moving = 1.0 + rms * rng.normal(size=(4000, 4)).cumsum(axis=0) / np.sqrt(4000.0)
    moving += 0.05 * rng.normal(size=moving.shape)
    late = np.arange(len(moving)) >= at * len(moving)
    return moving * (1.0 + np.outer(late, change))


@pytest.mark.parametrize(("loss", "at"), [(0.05, 0.5), (0.1, 0.25), (0.2, 0.75)])
def test_a_propeller_that_loses_thrust_is_told_from_motion(loss, at):
    found = lone_change(squares_of_flight(ALONE / (1.0 - loss) - ALONE, at=at, rms=0.0))
    assert found.rotor == 1
    assert found.moment == pytest.approx(at, abs=1.0 / PARTS)
    assert found.after - found.before == pytest.approx(3.0 / 16.0 * loss, rel=0.25)


def test_it_may_change_within_a_part():
    found = lone_change(squares_of_flight(0.1 * ALONE, at=0.54, rms=0.0))
    assert found.moment == 6.5 / PARTS


def test_neither_a_push_nor_motion_is_one_rotor():
    assert lone_change(squares_of_flight(0.0 * ALONE, rms=0.5)) is None
    pushed = squares_of_flight(0.2 * YAWLESS, rms=0.0)
    assert lone_change(pushed) is None
    assert half_change(pushed) is not None


def numbers(**values):
    names = tuple(values)
    return Numbers(
        names=names,
        values=np.array([v for v, _ in values.values()]),
        terms=made_fit.known_to(np.array([h for _, h in values.values()])),
        correlation=np.eye(len(names)),
        excitation={},
    )


def test_the_figure_of_merit_is_ideal_power_over_shaft_power():
    kt, kd, R, speed = 3.0e-6, 5.0e-8, 0.1, 700.0
    thrust, power = kt * speed**2, kd * speed**3
    ideal = thrust**1.5 / np.sqrt(2.0 * AIR * np.pi * R**2)
    exact = numbers(kt=(kt, 0.0), kd=(kd, 0.0))
    assert figure_of_merit(exact, R) == pytest.approx(ideal / power)
    # An interval that reaches the usual says nothing.
    wide = numbers(kt=(kt, 0.0), kd=(kd, 0.6 * kd))
    assert abs(figure_of_merit(wide, R) - 0.3) < abs(ideal / power - 0.3)
    assert figure_of_merit(numbers(kt=(kt, 0.0), kd=(kd, 1.1 * kd)), R) is None


def test_the_largest_rotor_is_half_the_way_to_the_next():
    assert largest_radius(paper_vehicle("A")[1]) == pytest.approx(0.1 * np.sqrt(2.0))


def test_a_rotor_unlike_the_others_is_named(assert_text):
    vehicle = paper_vehicle("A")[1]

    def said(factor, half):
        own = {f"kt_{i}": (3e-6 * (factor if i == 2 else 1.0), half) for i in range(1, 5)}
        rotor, excess = most_unlike(numbers(**own), vehicle)
        assert rotor == 1
        assert excess.value == pytest.approx(factor - 1.0)
        return unlike_sentence(rotor, excess) or ""

    below = {f"kt_{i}": (-1e-8 * i, 1e-6) for i in range(1, 5)}
    assert most_unlike(numbers(**below), vehicle) is None  # nothing to compare a rotor with
    off = 1.0 - 1.2 * LEAST_UNLIKE
    assert_text(said(off, 1e-08))
    assert said(0.94, 1e-8) == ""
    # A throw that tells each rotor only to 15 % says nothing of one that seems 12 % weak.
    assert said(off, 0.15 * 3e-6) == ""


@pytest.mark.parametrize(
    ("pattern", "kind", "said"),
    [
        ((0.88, 1.0, 1.01, 0.99), "rotor-unlike", "11.56 +- 0.38 % less thrust .*: its speed"),
        ((0.88, 1.06, 1.08, 0.92), "rotor-pattern", "the others differ, too, which no single"),
    ],
)
def test_a_pattern_over_all_rotors_is_no_single_rotor(pattern, kind, said):
    leaning = {f"kt_{i}": (3e-6 * k, 1e-8) for i, k in enumerate(pattern, start=1)}
    fit = SimpleNamespace(
        numbers=numbers(kt=(3e-6, 1e-8), **leaning),
        dataset=SimpleNamespace(vehicle=paper_vehicle("A")[1]),
    )
    (found,) = unlike_rotors(fit)
    assert (found.kind, found.severity) == (kind, "doubt")
    # A wrong scale of one speed bends the mean of all, a push does not.
    assert ("kd" in found.numbers) == (kind == "rotor-unlike")
    assert re.search(said.replace("+-", r"\+-"), found.sentence)


def test_an_open_scale_of_a_speed_does_not_hide_the_rotor():
    own = {f"kt_{i}": (3e-6 * k, 1e-8) for i, k in enumerate((0.88, 1.0, 1.01, 0.99), start=1)}
    sharp = numbers(kt=(3e-6, 1e-8), **own)
    name = "rotor speed scale"
    wide = IntervalTerm(name=name, half_width=0.1 * sharp.values, source="a trial")
    vehicle = SimpleNamespace(vehicle=paper_vehicle("A")[1])
    (found,) = unlike_rotors(SimpleNamespace(numbers=sharp.with_terms(wide), dataset=vehicle))
    assert (found.kind, found.severity) == ("rotor-unlike", "doubt")
