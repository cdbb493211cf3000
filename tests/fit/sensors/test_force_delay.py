"""Forces that come later than turns are so by a delay of each flight, with its deviation."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import flown
from rotorfit.errors import EstimationError
from rotorfit.fit.dataset.dataset import with_flights
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.fit.fit import refit
from rotorfit.fit.joint.joint_problem import closed_loop_responses
from rotorfit.fit.sensors import force_delay
from rotorfit.fit.sensors.force_delay import force_delays
from rotorfit.flight.motors.motor_model import shift_time
from rotorfit.identification import identify_flights
from rotorfit.simulation import Scenario, simulate_flight, write_flight_table

MS = 1e-3
SHORT = Scenario(seconds=12.0, gyro_noise_in_loop=True)


@pytest.fixture(scope="module")
def fit(tmp_path_factory):
    """The fit of two flights in gusts with measured speeds, whose sensors are in time."""
    folder = tmp_path_factory.mktemp("forces")
    vehicle = flown.simulated_vehicle("quad-x")
    (truth, body), sensors = flown.variant(vehicle, "disturbed")
    files = [folder / f"{seed}.csv" for seed in (1, 2)]
    for seed, file in enumerate(files, start=1):
        flight = simulate_flight(truth, body, replace(SHORT, sensors=sensors), seed=seed)
        write_flight_table(flight, file, channels=("gyro", "accel", "rotor_speed"))
    path = flown.experiment_file(folder / "experiment.toml", body, files, mass=truth.mass)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return identify_flights(load_experiment(path)).fit


def with_late_forces(fit, *delays):
    """Return the fit of the flights with accelerometers late by so much each [ms]."""
    each = iter(delays)

    def late(flight):
        data = flight.prepared.data
        force = shift_time(data.specific_force, data.sample_rate, next(each) * MS)
        data = replace(data, specific_force=force)
        return replace(flight, prepared=replace(flight.prepared, data=data))

    moved = replace(with_flights(fit.dataset, late), body=None).reduced()
    return refit(fit, moved, begin=fit.estimate.estimate.by_name)


@pytest.mark.parametrize("delays", [(0.0, 0.0), (0.0, 7.0), (5.0, -4.0), (12.0, 12.0)])
def test_the_delay_of_each_flights_forces_is_found(fit, delays):
    flights = force_delays(with_late_forces(fit, *delays)).flights
    assert [flight.entry.file.rpartition("/")[2] for flight, _ in flights] == ["1.csv", "2.csv"]
    for (_, late), true in zip(flights, delays, strict=True):
        assert 1.3 * MS < late.std < 2.0 * MS
        assert late.seconds == pytest.approx(true * MS, abs=2.5 * late.std)


def test_with_a_delay_of_their_own_late_forces_leave_the_numbers(fit):
    """With one delay of the motors for both, unequal rotors would make up for the difference."""
    late = with_late_forces(fit, 12.0, 12.0)
    delayed, names = force_delays(late).numbers, list(fit.numbers.names)
    assert set(delayed) == {*names, "motor_delay", "motor_lag_total"}
    for name in ("kt_4", "Izz@A"):
        own, moved = (one.numbers.values[names.index(name)] for one in (fit, late))
        assert abs(delayed[name] - own) < 0.3 * abs(moved - own)


def test_chance_gusts_and_the_model_leave_a_delay_open(fit, monkeypatch):
    """What the model lacks is on top, however long the flight."""
    deviations = []
    for fault in (0.0, 3.0):
        monkeypatch.setattr(force_delay, "MODEL_FAULT", fault * MS)
        deviations.append([late.std for _, late in force_delays(fit).flights])
    without, withal = np.array(deviations)
    assert withal == pytest.approx(np.hypot(without, 3.0 * MS))
    assert (without > 0.1 * MS).all()


def test_forces_that_nobody_flies_leave_their_delay_unknown(fit):
    """As many deviations of the noise as of the thrust: a delay is open by what it was before."""
    rng = np.random.default_rng(1)

    def noisy(flight):
        data = flight.prepared.data
        noise = 300.0 * rng.standard_normal(data.specific_force.shape)
        data = replace(data, specific_force=data.specific_force + noise)
        return replace(flight, prepared=replace(flight.prepared, data=data))

    drowned = replace(with_flights(fit.dataset, noisy), body=None).reduced()
    flights, _ = force_delays(refit(fit, drowned, begin=fit.estimate.estimate.by_name))
    assert [late.std for _, late in flights] == pytest.approx([30.0 * MS] * 2, rel=0.05)


def test_no_delay_is_told_where_the_fit_does_not_settle(fit, monkeypatch):
    def lost(*_, **__):
        raise EstimationError("no end")

    monkeypatch.setattr(force_delay, "joint_estimate", lost)
    assert force_delays(fit) == ([], {})


@pytest.mark.parametrize("free", [(), ("motor_skew",)])
def test_where_the_motors_times_are_given_the_bands_tell(fit, free):
    """The signals then have no slopes by one: gyro and accelerometer are compared alone."""
    (timing,) = {one.timing.at: one.timing for one in fit.configurations}.values()
    held = replace(timing, names=free) if free else None
    given = [replace(one, timing=held) for one in fit.configurations]
    flights, numbers = force_delays(replace(fit, configurations=tuple(given)))
    assert len(flights) == 2
    assert numbers == {}
    assert all(late.std > 2.0 * MS for _, late in flights)


def test_an_altitude_hold_answers_the_forces_as_they_come(fit):
    """Whatever it makes of a force late by d is late by d: its logarithm falls by i omega d."""
    one = fit.configurations[0]
    apart = replace(one, timing=replace(one.timing, force_std=0.03))
    slopes = closed_loop_responses(apart).log_effect_slopes
    turn = 2.0 * np.pi * one.factors.band.mean(axis=1)
    np.testing.assert_allclose(slopes[:, 3, -1], -1j * turn)
    assert not slopes[:, :3, -1].any()
    np.testing.assert_array_equal(slopes[:, :, :-1], closed_loop_responses(one).log_effect_slopes)


@pytest.fixture(scope="module")
def lagging(tmp_path_factory):
    """The fit of a flight by commands whose delay is given; only the motors' lag is free."""
    folder = tmp_path_factory.mktemp("lagging")
    (truth, body), sensors = flown.variant(flown.simulated_vehicle("quad-x"), "noisy")
    flight = simulate_flight(truth, body, replace(SHORT, sensors=sensors), seed=4)
    write_flight_table(flight, folder / "flight.csv", channels=("gyro", "accel", "command"))
    law = f'speed = "commanded"\ndelay = 0.0\nlaw = {{ linear = [0, {flight.max_speed}] }}\n'
    path = flown.experiment_file(
        folder / "experiment.toml",
        body,
        [folder / "flight.csv"],
        mass=truth.mass,
        extra=f"[motors]\n{law}",
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return identify_flights(load_experiment(path)).fit


def test_beside_a_lag_the_forces_lag(lagging):
    """A lag delays slow motion as a delay does: here one of 9 ms as 6 to 12."""
    assert lagging.configurations[0].timing.names == ("motor_lag",)
    found = []
    for true in (0.0, 9.0):
        ((_, late),) = force_delays(with_late_forces(lagging, true)).flights
        found.append(late)
        assert late.std < 3.5 * MS
        assert late.seconds == pytest.approx(true * MS, abs=2.0 * late.std)
    assert found[1].seconds - found[0].seconds == pytest.approx(9.0 * MS, rel=0.33)
