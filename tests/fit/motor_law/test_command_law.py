"""Lag, delay and law between commands and measured speeds: what motors of known ones give."""

from dataclasses import replace

import numpy as np
import pytest
from motor_responses import (
    DELAY,
    EXPONENT,
    FACTORS,
    FULL,
    LAG,
    NOMINAL,
    OFFSET,
    VOLTAGE_EXPONENT,
    motor_responses,
)
from scipy import signal

from rotorfit.errors import EstimationError
from rotorfit.fit.motor_law.command_response import recording_of
from rotorfit.fit.motor_law.fit_law import fit_law
from rotorfit.fit.motor_law.law_model import scales_of
from rotorfit.flight.motors.command_response import MeasuredResponse
from rotorfit.results.command_law import USUAL_EXPONENT
from rotorfit.results.law_tables import charge_std, law_tables, voltage_exponent


def fitted(answers):
    return fit_law(recording_of([answers]))


def numbers(answers, count=4):
    law, parameters = law_tables(fitted(answers), count)
    return law, {p.name: p for p in parameters}


def test_motors_without_noise_give_their_law():
    found = fitted(motor_responses(1, air=0.0, noise=0.0))
    best = found.best
    assert best.layout.form == "offset power"
    assert best.layout.voltage
    at = found.law
    full = at.full_speed * (NOMINAL / at.voltage.nominal) ** at.voltage.exponent
    assert full == pytest.approx(FULL, rel=2e-3)
    assert (at.curve.offset, at.curve.exponent) == pytest.approx((OFFSET, EXPONENT), abs=2e-3)
    assert at.voltage.exponent == pytest.approx(VOLTAGE_EXPONENT, abs=0.01)
    assert np.exp(best.timing.log_lag) == pytest.approx(LAG, rel=0.01)
    assert best.timing.delay == pytest.approx(DELAY, abs=2e-4)
    assert scales_of(best.layout, best.values)[0] == pytest.approx(FACTORS, abs=1e-3)


def test_rising_and_falling_are_distinguished_where_they_differ():
    law, apart = numbers(motor_responses(2, up=0.03, down=0.02))
    assert apart["motor_lag_up"].value == pytest.approx(0.03, rel=0.06)
    assert apart["motor_lag_down"].value == pytest.approx(0.02, rel=0.06)
    assert apart["motor_lag"].value == pytest.approx(0.025, rel=0.06)
    assert law.motors["lag"] == pytest.approx(0.025, rel=0.06)
    _, alike = numbers(motor_responses(2))
    assert "motor_lag_up" not in alike


@pytest.mark.parametrize("latency", [0.02, 0.09])
def test_late_telemetry_is_delay_and_no_lag(latency):
    _, found = numbers(motor_responses(3, latency=latency, seconds=12.0))
    assert found["motor_lag"].value == pytest.approx(LAG, rel=0.06)
    assert found["command_delay"].value == pytest.approx(DELAY + latency, abs=5e-4)


def test_slow_telemetry_gives_the_law_without_lag():
    _, fast = numbers(motor_responses(4))
    _, slow = numbers(motor_responses(4, speed_rate=12.0))
    assert slow["max_speed"].interval[0] < fast["max_speed"].value < slow["max_speed"].interval[1]
    assert fast["motor_lag"].interval[0] < LAG < fast["motor_lag"].interval[1]
    assert slow["motor_lag"].value is None  # telemetry that slow shows no lag


def test_without_voltage_the_law_is_of_the_charge_that_was_flown():
    answers = [replace(a, voltage=None) for a in motor_responses(5, voltage=False)]
    law, found = numbers(answers)
    assert law.nominal_voltage is None
    assert "voltage" not in law.motors["law"]
    assert law.motors["law"]["speed_std"] == pytest.approx(charge_std(np.zeros(1)), rel=0.1)
    assert found["max_speed"].value == pytest.approx(FULL, rel=0.02)


def test_a_constant_voltage_has_no_exponent():
    answers = [replace(a, voltage=np.full(len(a.command), 16.0)) for a in motor_responses(6)]
    law = numbers(answers)[0]
    assert law.nominal_voltage is None
    assert "voltage" not in law.motors["law"]  # a sensor that stands still measures none


def test_a_voltage_that_hardly_changes_has_a_usual_exponent():
    rng = np.random.default_rng(0)
    answers = [
        replace(a, voltage=16.0 + 0.02 * rng.standard_normal(len(a.command)))
        for a in motor_responses(6, voltage=False)
    ]
    law = numbers(answers)[0]
    assert law.nominal_voltage is None
    entry = law.motors["law"]
    assert entry["voltage"] == {
        "nominal": pytest.approx(16.0, abs=0.01),
        "exponent": 0.8,
        "exponent_std": 0.2,
        "missing_std": pytest.approx(2**0.5 * 0.8 * 0.034, rel=1e-4),
    }
    assert entry["speed_std"] < 0.01


def test_a_voltage_that_sags_gives_its_exponent():
    entry = numbers(motor_responses(5))[0].motors["law"]["voltage"]
    off = abs(entry["exponent"] - VOLTAGE_EXPONENT)
    assert off < 1.96 * entry["exponent_std"]
    assert entry["exponent_std"] < 0.1


def test_an_exponent_far_from_the_usual_one_is_less_sure():
    assert voltage_exponent(None) == USUAL_EXPONENT
    own = voltage_exponent((0.82, 0.05))
    assert own.value == pytest.approx(0.82, abs=1e-3)
    assert own.std == pytest.approx(0.05 / 1.96, rel=0.02)
    compensated = voltage_exponent((0.0, 0.1))
    assert compensated.value == pytest.approx(0.05, abs=0.01)
    assert compensated.std == pytest.approx(0.05 * 0.8 / 0.206, rel=0.05)


def test_flights_tell_how_far_another_one_may_be():
    alone = charge_std(np.zeros(1))
    assert alone == pytest.approx(2**0.5 * 0.8 * 0.034)
    alike, unlike = charge_std(np.zeros(6)), charge_std(0.08 * np.array([-1, 1, -1, 1, -1, 1]))
    assert alike < 0.5 * alone
    assert unlike == pytest.approx(((2 * 0.0272**2 + 6 * 0.08**2) / 7 * 7 / 6) ** 0.5)


def test_a_hover_does_not_show_the_speed_at_full_command():
    """What the law is continued to must be as wide as the forms that fit are apart."""
    _, calm = numbers(motor_responses(7, lively=0.02, pulses=False, seconds=10.0))
    _, lively = numbers(motor_responses(7, seconds=10.0))
    if calm["max_speed"].value is not None:
        wide = calm["max_speed"].std / calm["max_speed"].value
        assert wide > 3.0 * lively["max_speed"].std / lively["max_speed"].value
        low, high = calm["max_speed"].interval
        assert low < FULL * (16.1 / NOMINAL) ** VOLTAGE_EXPONENT < high


def test_glitches_and_stopped_rotors_do_not_move_the_law():
    answers = motor_responses(8)
    sound = fitted(answers).best
    rng = np.random.default_rng(0)

    def spoilt(a):
        speed = a.speed.copy()
        speed[rng.random(len(speed)) < 0.005] = 9000.0
        speed[-400:] = 0.0
        return replace(a, speed=speed)

    best = fitted([spoilt(a) for a in answers]).best
    assert best.values[0] == pytest.approx(sound.values[0], abs=0.015)
    assert best.timing.log_lag == pytest.approx(sound.timing.log_lag, abs=0.03)


@pytest.mark.parametrize("seed", range(3))
def test_glitches_do_not_make_held_commands_look_smooth(seed):
    """Smooth ones between them would be half a step early: 5 ms of delay that is none."""
    answers = motor_responses(20 + seed, seconds=12.0, rate=100.0, voltage=False)
    rng = np.random.default_rng(seed)

    def spoilt(a):
        speed = np.where(rng.random(len(a.speed)) < 0.005, 3.0 * a.speed, a.speed)
        return replace(a, speed=speed, voltage=None)

    found = fitted([spoilt(a) for a in answers])
    assert found.best.timing.delay == pytest.approx(DELAY, abs=1e-3)
    assert len(found.recording.command) == sum(len(a.command) for a in answers)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda a: replace(a, command=np.full(len(a.command), 0.3)), "the commands hardly change"),
        (lambda a: replace(a, speed=np.full(len(a.speed), 1500.0)), "the commands hardly change"),
        (
            lambda a: replace(a, speed_time=a.speed_time[:900], speed=a.speed[:900]),
            r"only 1\.3 s of measured speeds",
        ),
    ],
    ids=["command stuck", "speed stuck", "short"],
)
def test_what_shows_no_law_is_refused(change, words):
    with pytest.raises(EstimationError, match=words):
        fitted([change(a) for a in motor_responses(9, seconds=6.0)])


@pytest.mark.parametrize("seed", range(3))
def test_speeds_that_never_fall_show_no_law(seed):
    """A lower end of the telemetry: the exponent came out as 236, the lag as 0, with overflows."""
    rng = np.random.default_rng(seed)

    def ended(a):
        noise = 0.03 * rng.normal(size=len(a.command))
        least = np.percentile(a.speed, 95)
        return replace(
            a, speed=np.maximum(a.speed, least), command=np.clip(a.command + noise, 0.0, 1.0)
        )

    answers = motor_responses(seed, rate=200.0, pulses=False, lively=0.05)
    with pytest.raises(EstimationError, match="along one curve"):
        fitted([ended(a) for a in answers])


def test_three_rotors_of_four_are_enough():
    law, _ = numbers([a for a in motor_responses(10) if a.rotor != 2])
    assert law.rotor_factors[2] is None
    assert law.rotor_factors[1] < law.rotor_factors[0]


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say():
    """Coverage and sharpness of 60 flights with coloured disturbances of every rotor."""
    truth = {"full": np.log(FULL), "lag": np.log(LAG), "offset": OFFSET, "exponent": EXPONENT}
    inside: dict[str, list[bool]] = {name: [] for name in truth}
    sharp: dict[str, list[tuple[float, float]]] = {name: [] for name in truth}
    for seed in range(60):
        found = fitted(motor_responses(100 + seed))
        layout, nominal = found.best.layout, found.recording.nominal_voltage

        def full(fit, x, nominal=nominal):
            shift = x[fit.layout.exponent] * np.log(NOMINAL / nominal) if fit.layout.voltage else 0
            return float(x[0] + shift)

        said = {"full": found.number(full), "lag": found.own(layout.size - 2)}
        if layout.form == "offset power":
            said |= {"offset": found.own(1), "exponent": found.own(2)}
        for name, (value, half) in said.items():
            inside[name].append(abs(value - truth[name]) < half)
            sharp[name].append((value - truth[name], half))
    for name, held in inside.items():
        errors, halves = np.array(sharp[name]).T
        assert len(held) > 40, name
        assert np.mean(held) > 0.88, name
        assert np.median(halves) < 3.5 * np.sqrt(np.mean(errors**2)), name


def numbers_of_loop(*, every, up=LAG, down=LAG, noise=0.0, exponent=0.5, square=1.0):
    """Fit the law of a loop of 1 kHz of which the log keeps every so manieth sample."""
    rng, n = np.random.default_rng(11), 30_000
    slow = signal.lfilter([0.0016], [1.0, -1.92, 0.9216], rng.normal(size=(n, 4)), axis=0)
    command = np.clip(0.4 + 0.8 * slow + noise * rng.normal(size=(n, 4)), 0.0, 1.0)
    settled = (1000.0 * command**exponent) ** square
    speed, now = np.empty((n, 4)), settled[0]
    for k, wanted in enumerate(settled):
        speed[k] = now
        now = wanted + np.exp(-1e-3 / np.where(wanted > now, up, down)) * (now - wanted)
    speed = speed ** (1.0 / square) + 0.5 * rng.normal(size=(n, 4))
    time = 1e-3 * np.arange(n)[::every]
    answers = [
        MeasuredResponse(
            rotor=i,
            command_time=time,
            command=command[::every, i],
            voltage=None,
            speed_time=time,
            speed=speed[::every, i],
        )
        for i in range(4)
    ]
    return numbers(answers)


def test_the_lag_of_a_loop_that_the_log_keeps_parts_of():
    _, found = numbers_of_loop(every=10)
    assert found["motor_lag"].value == pytest.approx(LAG, rel=0.01)
    assert found["command_delay"].std < 5e-4
    low, high = found["motor_lag"].interval
    assert low < LAG < high


def test_noise_that_a_log_folds_down_leaves_the_lag_open():
    _, found = numbers_of_loop(every=10, noise=0.03)
    low, high = found["motor_lag"].interval
    assert low < LAG < high
    _, quiet = numbers_of_loop(every=10)
    assert found["motor_lag"].std > 3.0 * quiet["motor_lag"].std


def test_lags_that_differ_are_not_taken_for_a_curve():
    law, found = numbers_of_loop(every=4, up=0.04, down=0.075)
    assert found["motor_lag_up"].value == pytest.approx(0.04, rel=0.02)
    assert found["motor_lag_down"].value == pytest.approx(0.075, rel=0.02)
    assert found["max_speed"].value == pytest.approx(1000.0, rel=0.003)
    assert law.form != "linear"


def test_a_lag_that_acts_on_thrust_is_found():
    law, found = numbers_of_loop(every=1, square=2.0)
    assert law.motors["lag_on"] == "thrust"
    assert found["motor_lag"].value == pytest.approx(LAG, rel=0.01)
