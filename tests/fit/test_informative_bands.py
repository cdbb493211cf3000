"""Which bands count, and in which the autopilot answers."""

from dataclasses import replace

import numpy as np
import pytest

import flown
import made_fit
from rotorfit.estimation.factors import Factors
from rotorfit.fit.dataset.load import load_dataset
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.fit.joint.informative_bands import (
    error_correlation,
    pushes,
    select_slow_bands,
    with_counted_bands,
)
from rotorfit.fit.joint.joint_fit import joint_fit
from rotorfit.fit.joint.joint_problem import NOISY, TURN_ERRORS
from rotorfit.fit.reduction.frequency_bands import (
    EDGES,
    LEAST_RATIO,
    PILOT_BAND,
    counted_bands,
    excited_bands,
)
from rotorfit.fit.row_fits import turned_flights
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.simulation import Stick, Sticks, write_flight_table

ROLL, PITCH, YAW = (NOISY.index(name) for name in ("dwx", "dwy", "dwz"))


def blocks(*, flights=1, stretches=2):
    """Empty factors with every band of every stretch of some flights."""
    bands = np.column_stack([EDGES[:-1], EDGES[1:]])
    count = flights * stretches * len(bands)
    return Factors(
        R=np.zeros((count, 2, 2)),
        rows=np.full(count, 20),
        segment=np.repeat(np.arange(flights * stretches), len(bands)),
        band=np.tile(bands, (flights * stretches, 1)),
        source=np.repeat(np.arange(flights), stretches * len(bands)),
    )


def test_a_band_is_judged_over_all_stretches_of_its_flight():
    factors = blocks(flights=2)
    residual = np.ones((len(factors), 1))
    signal = np.ones((len(factors), 1))
    second = (factors.source == 0) & (factors.band[:, 0] == 1.0)
    first_stretch = second & (factors.segment == 0)
    signal[first_stretch] = 2.0 * (1.0 + LEAST_RATIO) + 0.1  # the other stretch is calm: twice
    moved = excited_bands(factors, signal, residual)[:, 0]
    np.testing.assert_array_equal(moved, second)
    signal[first_stretch] -= 2.0
    assert not excited_bands(factors, signal, residual).any()
    assert excited_bands(factors, signal, residual, least_ratio=0.4 * LEAST_RATIO).any()


def test_a_first_fit_looks_at_turns_in_the_pilots_band_alone():
    body = made_fit.configuration(factors=blocks(stretches=1))
    counted = select_slow_bands(body).counted
    slow = body.factors.band[:, 0] < PILOT_BAND[1]
    assert (counted[:, [ROLL, PITCH, YAW]] == slow[:, None]).all()
    assert counted[:, [NOISY.index(name) for name in ("ax", "ay", "az")]].all()


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def pushed(rng, share, *, push=1.0, with_response=None):
    """What is tied of the errors of 12 blocks in which yaw has a share of the push along y."""
    size = np.array([push, 2.0 * push, push, 0.1, 0.1, 0.1])
    error = rng.normal(size=(12, 40, 6)) * size
    error[:, :, YAW] += share * error[:, :, 1]
    counted = np.ones((12, 6), dtype=bool)
    with_response = np.ones((12, 3), dtype=bool) if with_response is None else with_response
    factors = made_fit.blocks([(1.0, 2.0)] * 12, rows=40)
    body = made_fit.configuration(factors=factors, counted=counted, with_response=with_response)
    return error_correlation([pushes(body, error)], body.vehicle)


def test_what_comes_with_a_push_is_found(rng):
    found = pushed(rng, -0.3)
    assert found[YAW, 1] == pytest.approx(-0.3, abs=0.01)
    found[YAW, 1] = 0.0
    assert np.abs(found).max() < 0.02


def test_errors_by_themselves_are_hardly_correlated(rng):
    assert np.abs(pushed(rng, 0.0)).max() < 0.02


def test_pushes_too_weak_to_see_correlate_nothing(rng):
    """Chance alone would give shares of some hundred; a vehicle is not pushed from so far off."""
    assert np.abs(pushed(rng, 0.0, push=1e-5)).max() < 0.5


def test_an_axis_that_is_flown_nowhere_stays_as_it_is(rng):
    roll_alone = np.zeros((12, 3), dtype=bool)
    roll_alone[3, 0] = True
    found = pushed(rng, -0.3, with_response=roll_alone)
    assert found[ROLL].any()
    assert not found[[PITCH, YAW]].any()


def test_bands_that_do_not_count_tie_nothing(rng):
    error = rng.normal(size=(12, 40, 6))
    error[:, :, YAW] = error[:, :, 1]
    body = made_fit.configuration(
        factors=made_fit.blocks([(1.0, 2.0)] * 12, rows=40),
        counted=np.zeros((12, 6), dtype=bool),
        with_response=np.ones((12, 3), dtype=bool),
    )
    assert not error_correlation([pushes(body, error)], body.vehicle).any()


def test_what_counts():
    """Bands flown and the mean; of an axis that is nowhere flown, all."""
    factors = blocks()
    moved = np.zeros((len(factors), 2), dtype=bool)
    moved[factors.band[:, 0] == 2.0, 0] = True
    counted = counted_bands(factors, moved)
    assert set(factors.band[counted[:, 0], 0]) == {0.0, 2.0}
    assert counted[:, 1].all()


def left(body, power=1.0):
    """Errors of this power in every block."""
    found = np.zeros((*body.factors.R.shape[:2], 6))
    found[:, 0] = power**0.5
    return found


def test_bands_that_are_flown_have_a_response_and_count():
    """Roll and yaw are flown from 1 to 4 Hz, pitch nowhere."""
    bands = [(0.0, 0.3), (1.0, 1.5), (2.0, 2.9), (3.0, 4.0), (11.0, 15.0)]
    rows = [2, 9, 11, 13, 15]
    body = made_fit.configuration(factors=made_fit.blocks(bands, rows=rows))
    signal = np.ones((5, 6))
    signal[1:4, [ROLL, YAW]] = 1.0 + LEAST_RATIO + 0.1
    steered = with_counted_bands(body, signal, left(body))
    assert TURN_ERRORS == ("dwx", "dwy", "dwz")
    roll = yaw = [False, True, True, True, False]
    assert steered.with_response.T.tolist() == [roll, [False] * 5, yaw]
    assert steered.counted[:, ROLL].tolist() == [True, True, True, True, False]
    assert steered.counted[:, PITCH].all()


def test_means_of_flights_that_do_not_yaw_do_not_count_in_yaw():
    """A steady push there would be taken for k_d; roll's mean holds the centre of mass."""
    factors = made_fit.blocks([(0.0, 0.3), (1.0, 1.5)] * 2, rows=[7, 10] * 2, source=[0, 0, 1, 1])
    body = made_fit.configuration(factors=factors)
    signal = np.ones((4, 6))
    signal[1, [ROLL, YAW]] += LEAST_RATIO + 0.1
    found = with_counted_bands(body, signal, left(body))
    assert found.counted[:, YAW].tolist() == [True, True, False, False]
    assert found.counted[:, ROLL].tolist() == [True, True, True, False]
    calm = with_counted_bands(body, np.ones((4, 6)), left(body))
    assert calm.counted[:, YAW].all()


def climbing(rng, *, followed):
    """Blocks of a body that accelerates upwards as the model says in some bands alone."""
    bands = [(0.0, 0.3), (1.0, 1.5), (3.0, 4.0), (11.0, 15.0)]
    body = made_fit.configuration(factors=made_fit.blocks(bands))
    R = rng.normal(size=body.factors.R.shape)
    errors = rng.normal(size=(*R.shape[:2], 6))
    errors[followed, :, NOISY.index("az")] *= 0.1
    return replace(body, factors=replace(body.factors, R=R)), errors


@pytest.mark.parametrize(
    ("followed", "counted"),
    [
        ([False, True, True, False], [True, True, True, False]),  # the mean always counts
        ([False] * 4, [True, False, False, False]),
    ],
)
def test_thrust_counts_where_the_model_explains_it(rng, followed, counted):
    """And nowhere but in the mean where it explains none, of measured speeds as of commands."""
    body, errors = climbing(rng, followed=followed)
    steered = with_counted_bands(body, np.ones((4, 6)), errors)
    assert steered.counted[:, NOISY.index("az")].tolist() == counted
    assert steered.counted[:, [NOISY.index("ax"), NOISY.index("ay")]].all()


def test_no_band_counts_above_its_sensors_bandwidth(rng):
    """An accelerometer that shows up to 2 Hz, beside a gyro that shows up to 10 Hz."""
    body, errors = climbing(rng, followed=[True] * 4)
    reach = np.tile([2.0, 2.0, 2.0, 10.0, 10.0, 10.0], (4, 1))
    signal = 100.0 * np.ones((4, 6))
    found = with_counted_bands(replace(body, reach=reach), signal, 0.1 * errors)
    assert found.counted[:, :3].all(axis=1).tolist() == [True, True, False, False]
    assert found.counted[:, ROLL].tolist() == [True, True, True, False]
    free = with_counted_bands(body, signal, 0.1 * errors)
    assert free.counted[1:, :].all()


def test_a_band_is_excited_where_rotors_explain_thrice_the_rest():
    factors = made_fit.blocks([(1.0, 1.5)])
    for explained, flown_there in ((2.9, False), (3.1, True)):
        signal = np.full((1, 1), 1.0 + explained)
        assert excited_bands(factors, signal, np.ones((1, 1))).tolist() == [[flown_there]]


def test_a_short_stretch_is_judged_alone():
    """Its ten lines about 5 Hz hold the pilot's motion at 1 Hz; the others' lines there do not."""
    bands = [(4.0, 5.5), (4.0, 5.4), (0.8, 8.2)]
    factors = made_fit.blocks(bands, rows=[20, 20, 20])
    signal, residual = np.array([[1.0], [1.0], [300.0]]), np.ones((3, 1))
    assert excited_bands(factors, signal, residual)[:, 0].tolist() == [False, False, True]
    narrower = made_fit.blocks([*bands[:2], (3.0, 7.0)], rows=[20, 20, 20])
    assert excited_bands(narrower, signal, residual).all()


@pytest.fixture(scope="module")
def rolled(tmp_path_factory):
    """A flight with gusts of which only roll is flown, as it is fitted."""
    folder = tmp_path_factory.mktemp("rolled")
    still = Stick(band=(0.1, 0.5), rms=0.0)
    sticks = Sticks(pitch=still, yaw=still)
    flight = flown.simulated("A", "disturbed", seed=2, seconds=40.0, sticks=sticks)
    write_flight_table(flight, folder / "flight.csv")
    path = flown.experiment_file(
        folder / "experiment.toml", flight.vehicle, ["flight.csv"], mass=flight.truth.mass
    )
    loaded = TimedDataset.of(load_dataset(load_experiment(path), lambda words: None))
    _, (configuration,) = joint_fit(loaded)
    return configuration


def test_bands_that_only_the_autopilot_moves_do_not_count(rolled):
    band = rolled.factors.band
    assert rolled.counted[:, :2].all()  # forces across the thrust always do
    slow = (band[:, 0] > 0.0) & (band[:, 1] < 2.0)
    assert slow.any()
    assert rolled.counted[slow, ROLL].mean() > 0.6
    # Above 4 Hz only where a short phase has a band that reaches down to the pilot's.
    assert rolled.counted[band[:, 0] > 4.0, ROLL].mean() < 0.1
    assert rolled.counted[band[:, 0] == 0.0, ROLL].all()


def test_an_axis_that_is_not_flown_counts_but_has_no_response(rolled):
    """With an answer and no motion, an inertia of zero would be the likeliest."""
    assert rolled.counted[:, PITCH].all()
    assert not rolled.with_response[:, TURN_ERRORS.index("dwy")].any()
    with_response = rolled.with_response[:, TURN_ERRORS.index("dwx")]
    assert with_response.any()
    assert (with_response <= rolled.counted[:, ROLL]).all()


def test_a_first_fit_takes_an_axis_from_flights_that_move_it(tmp_path):
    """Roll of the flight that rolls alone; pitch, which nobody moves, of both."""
    still = Stick(band=(0.1, 0.5), rms=0.0)
    rolls = Sticks(pitch=still, yaw=still)
    flights = [
        flown.simulated("A", "disturbed", seed=seed, seconds=20.0, sticks=sticks)
        for seed, sticks in ((2, rolls), (3, replace(rolls, roll=still)))
    ]
    names = [f"flight{k}.csv" for k in range(len(flights))]
    for name, flight in zip(names, flights, strict=True):
        write_flight_table(flight, tmp_path / name)
    path = flown.experiment_file(
        tmp_path / "experiment.toml", flights[0].vehicle, names, mass=flights[0].truth.mass
    )
    dataset = TimedDataset.of(load_dataset(load_experiment(path), lambda words: None))
    factors = dataset.timed_bands[0]
    turned = turned_flights(factors, dataset.model, mass=flights[0].truth.mass)
    assert turned[:, 0].tolist() == (factors.source == 0).tolist()
    assert not turned[:, 1].any()
    body = made_fit.configuration(factors=factors)
    body = replace(body, model=dataset.model, mass=flights[0].truth.mass)
    counted = select_slow_bands(body).counted
    slow = factors.band[:, 0] < PILOT_BAND[1]
    assert counted[:, ROLL].tolist() == (slow & (factors.source == 0)).tolist()
    assert counted[:, PITCH].tolist() == slow.tolist()
