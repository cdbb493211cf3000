"""Lever arms of another ratio, sensors apart in time, mass and lean out of the usual: in words."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

import flown
import made_fit
from rotorfit.checks.lever_arms import judge_sides
from rotorfit.checks.sensors.clocks import accelerometer_delay, late_speeds
from rotorfit.checks.vehicle_size import unusual_loading
from rotorfit.errors import FrameError
from rotorfit.fit.experiment.experiment import MotorsEntry
from rotorfit.fit.frame_sides import FrameSides
from rotorfit.fit.imu_tilt import lean_sentence
from rotorfit.fit.reduction.motor_timing import MotorTiming
from rotorfit.fit.sensors.late_accelerometer import ForceDelays
from rotorfit.fit.sensors.lateness import (
    BandDelay,
    Lateness,
    accelerometer_lateness,
    of_one_vehicle,
    weigh_bands,
)
from rotorfit.fit.sensors.sensor_response import deviation_by_chance
from rotorfit.flight.motors.motor_model import MotorResponse

RATE, SECONDS = 200.0, 30.0


@pytest.fixture(scope="module")
def flight():
    return flown.simulated("A", "noisy", seed=3, seconds=25.0, physics_rate=200.0)


def stretched(vehicle, ratio):
    """Return the vehicle with its rotors further apart along x, over y, by a ratio."""
    factor = ratio**0.5
    rotors = [
        replace(r, position=(factor * r.position[0], r.position[1] / factor, r.position[2]))
        for r in vehicle.rotors
    ]
    return replace(vehicle, rotors=tuple(rotors))


def sides_of(result):
    (found,) = (one for one in result.findings if one.kind == "lever-arms")
    return found


def test_arms_of_another_ratio_are_refused_with_the_likely_one(tmp_path, flight):
    found = sides_of(flown.identified(tmp_path, [flight]))
    (ratio,) = found.evidence
    assert found.severity == "passed"
    assert ratio.value == pytest.approx(1.0, abs=0.05)
    assert ratio.interval[0] < 1.0 < ratio.interval[1]
    wrong = stretched(flight.vehicle, 2.0)
    with pytest.raises(FrameError, match=r"are 2\.00 as declared, .* shows (0\.9|1\.0)") as refused:
        flown.identified(tmp_path, [flight], vehicle=wrong)
    assert refused.value.finding.evidence[0].limit == pytest.approx(2.0)


def test_doubtful_arms_widen_inertia_to_what_the_flight_shows(tmp_path, flight):
    result = flown.identified(tmp_path, [flight], vehicle=stretched(flight.vehicle, 1.12))
    found = sides_of(result)
    assert found.severity == "doubt"
    assert "but the flight shows " in found.sentence
    assert {"Ixx_com@A", "com_x@A"} <= {*found.numbers}
    for name, true in zip(
        ("Ixx_com", "Iyy_com"), np.diagonal(flight.truth.com_inertia), strict=False
    ):
        (number,) = (d for d in result.derived if d.name == name)
        assert number.interval[1] - number.interval[0] > 0.15 * number.value
        assert number.interval[0] < true < number.interval[1]


def _sides_known_to(value, std):
    one = np.ones(1)
    return FrameSides(
        declared=1.0, ruler=0.01, value=value, std=std, blocks=20.0, slopes=one, by_mistake=one
    )


def test_an_arm_next_to_nothing_is_no_declared_frame():
    fit = made_fit.fit(made_fit.dataset(made_fit.prepared()))
    said = {s: judge_sides(fit, _sides_known_to(s, 0.02)).severity for s in (0.0, 0.3, 0.9)}
    assert said == {0.0: "passed", 0.3: "doubt", 0.9: "passed"}


def rotors_that_respond(*, accel_late=0.0, gyro_late=0.0, noise=0.0, turned=0.0):
    """Return what flew: random speeds, to which thrust and roll answer, each so much later [s].

    `noise` of the force [m/s^2]; `turned`: power of other turns over that of those answers.
    """
    rng = np.random.default_rng(5)
    n = round(RATE * SECONDS)
    sos = signal.butter(2, (0.8, 12.0), "bandpass", fs=RATE, output="sos")
    moves = signal.sosfiltfilt(sos, rng.standard_normal((n, 4)), axis=0)
    squares = 500.0**2 * (1.0 + 0.2 * moves)
    flat = made_fit.prepared(seconds=SECONDS, rate=RATE)
    body = made_fit.BODY
    thrust = body["kt"] / 1.4 * squares.sum(axis=1)
    roll = body["kt"] / body["Ixx"] * squares @ made_fit.QUAD.positions[:, 1]

    def late(values, seconds):
        return np.roll(values, round(seconds * RATE))

    force = np.zeros((n, 3))
    force[:, 2] = late(thrust, accel_late) + noise * rng.standard_normal(n)
    turn = np.zeros((n, 3))
    turn[:, 0] = late(roll, gyro_late)
    other = signal.sosfiltfilt(sos, rng.standard_normal(n))
    turn[:, 0] += other * np.sqrt(turned * (turn[:, 0] ** 2).mean() / (other**2).mean())
    data = replace(
        flat.data, specific_force=force, angular_acceleration=turn, rotor_speed=np.sqrt(squares)
    )
    return made_fit.dataset(replace(flat, data=data, motor_channel=data.rotor_speed))


def judged(fit):
    left = tuple(accelerometer_lateness(fit))
    return accelerometer_delay(fit.with_record(ForceDelays(left=left, shifts={})))


def test_a_late_accelerometer_asks_for_its_low_pass(assert_wording):
    """Betaflight logs the accelerometer behind acc_lpf_hz; `inspect` says so of the same log."""
    made = made_fit.fit(rotors_that_respond(accel_late=0.03))
    [configuration] = made.dataset.configurations
    [flight] = configuration.flights
    log = replace(
        flight.log,
        format="blackbox",
        metadata={"Firmware revision": "Betaflight 4.5.0", "acc_lpf_hz": "1000"},
    )
    flights = [replace(flight, log=log)]
    dataset = replace(made.dataset, configurations=(replace(configuration, flights=flights),))
    [found] = judged(replace(made, dataset=dataset))
    assert "acc_lpf_hz = 100 (as" in found.next_step
    assert_wording(found.next_step)
    assert "acc_lpf_hz = 100" in found.sentence
    assert_wording(found.sentence)


def late_sensor(**flight):
    made = made_fit.fit(rotors_that_respond(**flight))
    [found] = judged(made)
    [evidence] = found.evidence
    assert (found.severity == "doubt") is bool(found.sentence)
    return found.sentence, evidence


def band(seconds, omega, unexplained):
    """A band in which rotors and motion go together but for a time: nothing else is left."""
    common = (0.5 * unexplained / np.sin(0.5 * omega * seconds)) ** 2
    return BandDelay(seconds=seconds, std=0.013, omega=omega, left=0.0, common=common)


OMEGAS = (13.6, 21.0, 33.0, 51.0)


def test_the_answer_to_gusts_is_a_phase_and_no_lateness():
    """1.1 rad in every band, of a rotor's answer that explains as much as it leaves."""
    answer = weigh_bands([[band(1.1 / omega, omega, 1.1) for omega in OMEGAS]])
    assert abs(answer.seconds) < 2.0 * answer.std
    late = weigh_bands([[band(0.03, omega, 0.03 * omega) for omega in OMEGAS]])
    assert late.seconds == pytest.approx(0.03, abs=0.003)
    assert late.seconds > 3.0 * late.std


def test_bands_share_drag_and_phase_in_their_covariance():
    """The same as errors of all bands together: C = s^2 + drags + phases, 1 / (1' C^-1 1)."""
    bands = [band(1.1 / omega, omega, 1.1) for omega in OMEGAS]
    found = weigh_bands([bands])
    omega, times = np.array(OMEGAS), np.array([one.seconds for one in bands])
    left = np.mean([one.unexplained(found.seconds) for one in bands])
    phases = 0.6**2 * left * np.outer(1.0 / omega, 1.0 / omega)
    drags = np.outer(omega**-2.0, omega**-2.0)
    weight = np.linalg.inv(0.013**2 * np.eye(4) + phases + drags)
    expected = float(weight.sum(axis=0) @ times / weight.sum())
    assert found.seconds == pytest.approx(expected, abs=1e-4)
    assert found.std == pytest.approx(weight.sum() ** -0.5, rel=0.02)


def drawn(*times):
    return of_one_vehicle([Lateness(seconds=value, std=std) for value, std in times])


def test_other_flights_refute_a_late_sensor_of_a_calm_one():
    """51 +- 12.7 ms beside two of 0 and 1 +- 1 ms has the time of these."""
    calm, *others = drawn((0.051, 0.0127), (0.0, 0.001), (0.001, 0.001))
    assert calm.seconds < 0.01
    assert calm.std < 0.005
    assert [one.seconds for one in others] == pytest.approx([0.0, 0.001], abs=3e-4)
    assert drawn((0.051, 0.0127)) == [Lateness(seconds=0.051, std=0.0127)]


def test_a_sensor_that_is_late_in_one_flight_alone_is_found():
    """20 +- 3 ms beside 0 +- 3 ms: they differ, and keep their own."""
    late, early = drawn((0.02, 0.003), (0.0, 0.003))
    assert [late.seconds, early.seconds] == pytest.approx([0.0195, 0.0005], abs=3e-4)
    assert late.std == pytest.approx(0.003, rel=0.03)


@pytest.mark.parametrize(
    ("accel", "gyro", "words"),
    [
        (0.03, 0.0, "the accelerometer follows the rotors "),
        (0.0, 0.045, "the gyro follows the rotors "),
        (0.02, 0.02, ""),  # together: the motors' own delay
        (0.02, 0.0, "the accelerometer follows the rotors "),
        (0.0, 0.02, "the gyro follows the rotors "),
        (0.005, 0.0, ""),
    ],
)
def test_sensors_that_differ_in_time_are_named(accel, gyro, words):
    said, evidence = late_sensor(accel_late=accel, gyro_late=gyro)
    assert words in said
    assert bool(words) is bool(said)
    low, high = evidence.interval
    assert low < accel - gyro < high
    assert evidence.value == pytest.approx(accel - gyro, abs=0.004)


def test_what_the_rotors_do_not_explain_widens_the_lateness():
    """Each has a time that is as sure as its rest is small; feedback may answer all of it."""
    sure, less = (late_sensor(accel_late=0.02, turned=share)[1] for share in (0.0, 0.3))
    noisy, evidence = late_sensor(accel_late=0.02, noise=20.0)
    width = [high - low for low, high in (sure.interval, less.interval, evidence.interval)]
    assert width[0] < 0.6 * width[1]
    assert width[1] < 0.3 * width[2]
    assert not noisy


@pytest.mark.parametrize(("mass", "said"), [(1.4, False), (14.0, True)])
def test_a_mass_too_large_for_the_rotors_is_said(mass, said, assert_text):
    """Four rotors of 177 mm in radius at most: 14 kg make 349 N/m^2."""
    words = unusual_loading(made_fit.dataset(made_fit.prepared(), mass=mass))
    assert (words is not None) is said
    assert words is None or "(mass 14 kg)" in words
    assert_text(words or "")


@pytest.mark.parametrize(("degrees", "said"), [(4.0, False), (10.0, True)])
def test_thrust_that_leans_is_said(degrees, said):
    flat = made_fit.prepared()
    lean = np.radians(degrees)
    force = np.tile([9.81 * np.sin(lean), 0.0, 9.81 * np.cos(lean)], (len(flat.data.time), 1))
    flown_so = made_fit.dataset(replace(flat, data=replace(flat.data, specific_force=force)))
    words = lean_sentence(flown_so)
    assert bool(words) is said
    assert not words or "10.0 degrees nose up" in words


def timed(delay, std, speed="measured"):
    """Return a fit whose motor data lead the motion by a delay, known to a deviation [s]."""
    timing = MotorTiming(response=MotorResponse(delay=delay), total_std=std, delay_std=std)
    data = made_fit.dataset(made_fit.prepared(), motors=MotorsEntry(speed=speed))
    return made_fit.fit(replace(data, motor_timing=timing))


@pytest.mark.parametrize(
    ("delay", "std", "said"),
    [
        (-0.030, 0.002, "come 30.0 +- 3.9 ms after the motion that they make"),
        (0.030, 0.002, "the gyro is stamped late, filtered or softly mounted"),
        (0.030, 0.010, None),
        (0.010, 0.001, None),
    ],
)
def test_late_speeds_are_said_where_the_whole_interval_is_late(delay, std, said):
    (found,) = late_speeds(timed(delay, std))
    assert found.severity == ("passed" if said is None else "doubt")
    assert (found.doubtful_because is None) is (said is None)
    assert found.is_about("motor_delay")
    assert (said or "") in found.sentence
    (seen,) = found.evidence
    assert seen.interval == pytest.approx((delay - 1.96 * std, delay + 1.96 * std))


@pytest.mark.parametrize(("delay", "doubted"), [(-0.030, True), (0.018, False), (-0.010, False)])
def test_late_speeds_doubt_the_times_of_the_commands(delay, doubted):
    """Speeds behind a low-pass: motor_lag includes it, and was identified."""
    (found,) = late_speeds(timed(delay, 0.002))
    assert (found.severity == "doubt" and found.is_about("motor_lag")) is doubted
    assert (found.severity == "doubt" and found.is_about("command_delay")) is doubted


@pytest.mark.parametrize(("delay", "doubted"), [(0.041, True), (0.018, False), (-0.041, False)])
def test_speeds_as_early_as_motors_lag_doubt_inertia(delay, doubted):
    """Speeds asked for, of motors with a lag of 40 ms: Ixx was 3.5 half-widths off, identified."""
    (found,) = late_speeds(timed(delay, 0.0003))
    assert found.is_about("Ixx@A") is doubted
    assert ("asked for" in found.sentence) is doubted


def test_a_delay_that_was_given_is_no_doubt():
    given = MotorTiming(response=MotorResponse(delay=0.05), total_std=0.0)
    fit = made_fit.fit(replace(made_fit.dataset(made_fit.prepared()), motor_timing=given))
    assert list(late_speeds(fit)) == []


def test_huge_and_tiny_windows_have_a_deviation():
    for size in (1e-200, 1.0, 1e200):
        score, information = size * np.array([1.0, -2.0, 1.0]), size * np.ones(3)
        assert deviation_by_chance(score, information) == pytest.approx(1.79, abs=0.01)
