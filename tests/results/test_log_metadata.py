"""What logs say of motors, simulator, filter and velocity, and what it does to a result."""

import dataclasses

import numpy as np
import pytest

import made_fit
from rotorfit.errors import ExperimentError
from rotorfit.findings import sentences
from rotorfit.fit.dataset.load import agreed_motors, completed_motors
from rotorfit.fit.experiment.experiment import MotorsEntry
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.reduction.motor_timing import MotorTiming
from rotorfit.fit.sensors.known_faults import (
    lowpass_term,
    velocity_term,
    vertical_partner,
)
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.logs.flight_log import Channel, FlightLog, LoggedMotors
from rotorfit.logs.motor_law import MotorLaw, SquareRootCurve, VoltageFactor
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.registry import added_signals
from rotorfit.results.assemble import log_metadata

LAW = MotorLaw(
    curve=SquareRootCurve(1.0, 0.65, 0.15, 0.95), voltage=VoltageFactor(12.8, 1.0), stated=True
)
TOLD = LoggedMotors(law=LAW, words="MOT_THST_EXPO", lag_on="thrust")
COMMANDED = MotorsEntry(speed="commanded")
KNOWN = regressor(made_fit.QUAD, added=added_signals(["drag"]))
"""A model with the velocity among its signals."""
OWN = MotorLaw(curve=SquareRootCurve(900.0, 0.3))


def logged(motors=TOLD, **more):
    command = Channel(time=np.arange(3.0), values=np.zeros((3, 4)), source="made")
    [flight] = made_fit.dataset(made_fit.prepared()).configurations[0].flights
    return dataclasses.replace(flight.log, channels={"command": command}, motors=motors, **more)


def made(log: FlightLog, *, motors=COMMANDED, prepared=None, **more):
    flown = made_fit.dataset(made_fit.prepared() if prepared is None else prepared, motors=motors)
    [configured] = flown.configurations
    flights = [dataclasses.replace(f, log=log, motors=motors) for f in configured.flights]
    configured = dataclasses.replace(configured, flights=flights)
    return dataclasses.replace(flown, configurations=(configured,), **more)


def numbers(**values):
    names = tuple(n if n in ("inflow", "kt") else f"{n}@A" for n in values)
    return Numbers(
        names=names,
        values=np.array(list(values.values())),
        terms=made_fit.known_to(np.full(len(names), 0.01)),
        correlation=np.eye(len(names)),
        excitation={},
    )


def test_the_logs_law_fills_what_nobody_gave():
    found = completed_motors(COMMANDED, logged())
    assert (found.law, found.lag_on) == (TOLD.law, "thrust")
    assert found.law_is_relative
    own = COMMANDED.model_copy(update={"law": OWN, "lag_on": "speed"})
    assert completed_motors(own, logged()) == own
    measured = MotorsEntry(speed="measured")
    assert completed_motors(measured, logged()) == measured
    assert completed_motors(COMMANDED, logged(None)) == COMMANDED


def test_flights_whose_logs_show_different_motors_are_refused():
    one, other = (
        made(logged(), motors=completed_motors(COMMANDED, log)).configurations[0].flights[0]
        for log in (logged(), logged(None))
    )
    assert agreed_motors(COMMANDED, [one, one]) == one.motors
    with pytest.raises(ExperimentError, match="give the one that holds for all"):
        agreed_motors(COMMANDED, [one, other])


def test_what_was_taken_from_a_log_is_said(assert_wording):
    completed = completed_motors(COMMANDED, logged())
    flown = made(logged(simulator="ArduPilot SITL", gyro_lowpass=20.0), motors=completed)
    said = sentences(log_metadata(COMMANDED, flown))
    assert any("at 12.8 V)" in w for w in said)
    assert_wording(said)
    # A log too slow to time its motors has no lag that a filter could be part of.
    assert not any("low-passed on board" in w for w in said)
    timing = MotorTiming(response=MotorResponse(lag=0.02), total_std=0.001)
    said = sentences(log_metadata(COMMANDED, dataclasses.replace(flown, motor_timing=timing)))
    assert any("at 20 Hz: 11" in w for w in said)
    assert_wording(said)
    declared = COMMANDED.model_copy(update={"law": OWN})
    assert log_metadata(declared, made(logged(), motors=declared)) == ()


def test_only_settings_may_be_wrong_not_simulated_motors(assert_text):
    exact = dataclasses.replace(TOLD, law=dataclasses.replace(LAW, exact=True, stated=False))
    for motors, replaceable in ((TOLD, True), (exact, False)):
        found = made(logged(motors), motors=completed_motors(COMMANDED, logged(motors)))
        [sentence] = sentences(log_metadata(COMMANDED, found))
        assert ("under [motors] replaces it" in sentence) is replaceable
        assert_text(sentence)


def test_an_estimated_velocity_leaves_drag_open():
    """Errors of .4 m/s in a velocity of variance .25: 64 % of it, and drag 178 % more."""
    time = np.arange(2000) / 100.0
    velocity = np.zeros((2000, 3))
    velocity[:, 0] = np.sqrt(0.5) * np.sin(2.0 * np.pi * time)
    prepared = made_fit.prepared()
    data = dataclasses.replace(prepared.data, velocity=velocity)
    prepared = dataclasses.replace(prepared, data=data)
    given = numbers(drag_x=0.9, drag_y=0.9, Ixx=0.02)
    flown = made(logged(format="ulog"), prepared=prepared, model=KNOWN)
    half = given.with_terms(velocity_term(given, flown)).half_width
    assert half == pytest.approx([0.01 + 0.9 * 0.64 / 0.36, 0.01 + 0.9 * 9.0, 0.01], rel=1e-3)
    table = made(logged(), prepared=prepared, model=KNOWN)
    assert not velocity_term(given, table).half_width.any()


def test_drag_along_z_may_be_inflow_and_the_other_way_round():
    """Four rotors at 500 rad/s that lose 1e-4 N of each per m/s: as drag of .2 N s/m."""
    given = numbers(drag_z=0.3, inflow=1e-4, hover_speed=500.0, drag_x=0.3)
    assert vertical_partner(given, "drag_z@A", rotors=4) == pytest.approx(0.2)
    assert vertical_partner(given, "inflow", rotors=4) == pytest.approx(0.3 / 2000.0)
    assert vertical_partner(given, "drag_x@A", rotors=4) == 0.0
    alone = numbers(drag_z=0.3, hover_speed=500.0)
    assert vertical_partner(alone, "drag_z@A", rotors=4) == 0.0


def test_a_low_pass_taken_for_a_lag_is_in_the_intervals():
    given = numbers(Ixx_com=0.02, com_z=0.001, Ixy_com=0.001, kt=1.0)
    flown = made(logged(gyro_lowpass=20.0)).at(MotorResponse(lag=0.007))
    half = given.with_terms(lowpass_term(given, flown)).half_width
    lost = 1.0 / np.sqrt(1.0 + 0.15**4) - 1.0 / np.sqrt(1.0 + (6.0 * np.pi * 0.007) ** 2)
    assert half == pytest.approx([0.01 + 0.02 * lost, 0.0102, 0.01, 0.01])
    raw = made(logged()).at(MotorResponse(lag=0.007))
    assert not lowpass_term(given, raw).half_width.any()
