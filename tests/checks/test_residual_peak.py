"""A peak in what the model leaves: a vibration, or the loop that rings with its rotors."""

import dataclasses

import numpy as np
import pytest

import made_fit
from rotorfit.checks.residual_peaks import highest_peaks, residual_peaks
from rotorfit.fit.experiment.experiment import MotorsEntry
from rotorfit.fit.fit_flights import fit_flights
from rotorfit.flight.flight_data import FlightData

MASS, KT, KD, RATE, SECONDS = 1.4, 2e-6, 3e-8, 100.0, 40.0
INERTIA = np.array([0.010, 0.013, 0.021])
PEAK = 21.2
TIME = np.arange(round(SECONDS * RATE)) / RATE
MIXER = np.array([[-1, -1, 1], [1, 1, 1], [1, -1, -1], [-1, 1, -1]])


def fit_of(*, shaken=0.0, ringing=0.0, felt=0.0):
    """Fit 40 s of rolls and nods; at 21.2 Hz the body is shaken, and its rotors ring in pitch."""
    rng = np.random.default_rng(3)
    waves = [np.cos(2 * np.pi * f * TIME) for f in (0.83, 0.71, 0.29, 1.13)]
    at_peak = np.cos(2 * np.pi * PEAK * TIME)
    pitch = 0.03 * waves[1] + ringing * at_peak
    turns = np.stack([0.03 * waves[0], pitch, 0.3 * waves[2]], axis=1)
    turns += rng.normal(scale=1e-3, size=turns.shape)
    vehicle = made_fit.QUAD
    squares = MASS * 9.80665 / (4 * KT) * (1.0 + 0.1 * waves[3][:, None] + turns @ MIXER.T)
    lever = np.cross(vehicle.positions, vehicle.axes)
    torque = KT * squares @ lever - KD * (squares * vehicle.spins).sum(axis=1)[:, None] * [0, 0, 1]
    rates, turned = np.zeros((2, len(TIME), 3))
    w = np.zeros(3)
    for k, moment in enumerate(torque):
        dw = (moment - np.cross(w, INERTIA * w)) / INERTIA
        dw[1] += shaken * at_peak[k]
        rates[k], turned[k] = w, dw
        w = w + dw / RATE
    turned += rng.normal(scale=0.1, size=turned.shape)
    data = FlightData(
        sample_rate=RATE,
        time=TIME,
        specific_force=np.stack([felt * at_peak, 0 * TIME, KT * squares.sum(axis=1) / MASS], axis=1)
        + rng.normal(scale=0.05, size=(len(TIME), 3)),
        angular_velocity=rates,
        angular_acceleration=turned,
        rotor_speed=np.sqrt(squares),
        rotor_acceleration=np.gradient(np.sqrt(squares), axis=0) * RATE,
        differentiation="exact",
        segments=made_fit.prepared(seconds=SECONDS).data.segments,
    )
    flight = dataclasses.replace(
        made_fit.prepared(seconds=SECONDS), data=data, phases=data.segments,
        motor_channel=data.rotor_speed,
    )  # fmt: skip
    motors = MotorsEntry(speed="measured", delay=0.0)
    return fit_flights(made_fit.dataset(flight, mass=MASS, motors=motors), ())


@pytest.mark.parametrize(
    ("ringing", "words"),
    [(0.0, "look for a loose part"), (0.01, "lower the rate gains")],
    ids=["vibration", "loop"],
)
def test_a_peak_that_rotors_have_too_is_that_of_the_loop(ringing, words):
    fit = fit_of(shaken=0.3, ringing=ringing)
    [peak] = highest_peaks(fit)
    assert (peak.axis, peak.frequency) == ("pitch", pytest.approx(PEAK, abs=0.5))
    assert peak.of_loop is (ringing > 0.0)
    assert peak.coherence > 0.9 or not ringing
    [found] = residual_peaks(fit)
    assert found.severity == "doubt"
    assert words in found.sentence


def test_without_a_shaken_body_there_is_no_peak():
    [found] = residual_peaks(fit_of(ringing=0.01))
    assert (found.severity, found.sentence) == ("passed", "")


def test_a_swing_that_is_felt_as_a_force_is_the_loops(assert_wording):
    """Rotors that ring in pitch, and an IMU that feels it as a forward force."""
    (peak,) = highest_peaks(fit_of(ringing=0.01, felt=0.5))
    assert peak.axis == "forward force"
    assert peak.of_loop
    assert peak.coherence > 0.9
    (found,) = residual_peaks(fit_of(ringing=0.01, felt=0.5))
    assert_wording(found.sentence)
    (alone,) = residual_peaks(fit_of(felt=0.5))
    assert "look for a loose part" in alone.sentence
