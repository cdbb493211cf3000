"""A row of the fleet is what `rotorfit identify` says of the log alone."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from rotorfit.errors import FlightWarning
from rotorfit.fit.experiment.experiment import named_flight
from rotorfit.identification import identify_flights
from rotorfit.tools.fleet.joined import joined
from rotorfit.tools.fleet.one_flight import experiment_of, fitted_factors, refusal_of
from rotorfit.tools.fleet.records import KT_WEIGHT, TRIM, read_entry


def quietly(experiment):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FlightWarning)
        return identify_flights(experiment)


@pytest.fixture(scope="module")
def alone(small_fleet):
    return quietly(experiment_of(small_fleet.logs[0].task)).result


def test_every_number_is_that_of_identify(small_fleet, alone):
    record = small_fleet.fleet.records[0]
    for number in (*alone.parameters, *alone.derived):
        value, std = (np.nan if v is None else v for v in (number.value, number.std))
        np.testing.assert_equal(record.value(number.name), value)
        np.testing.assert_equal(record.deviation(number.name), std)
    assert record.verdict("kt") == alone.parameter("kt").verdict
    assert record.warnings == (*alone.warnings, *alone.flights[0].warnings)
    assert record.seconds_used == alone.flights[0].seconds_used


def test_the_covariance_is_that_of_the_result(small_fleet, alone):
    record = small_fleet.fleet.records[0]
    names = [name for name in ("kt", "kd") if name in record.compared]  # kd: if flown
    at = [record.compared.index(name) for name in names]
    theirs = [alone.covariance_names.index(name) for name in names]
    np.testing.assert_allclose(
        record.covariance[np.ix_(at, at)], alone.covariance[np.ix_(theirs, theirs)], rtol=1e-6
    )
    std = np.sqrt(np.diagonal(record.covariance))
    np.testing.assert_allclose(std, [record.deviation(name) for name in record.compared])
    kt, hover = (record.compared.index(name) for name in ("kt", "hover_speed"))
    assert record.covariance[kt, hover] / (std[kt] * std[hover]) == pytest.approx(-1.0, abs=1e-6)


def test_motors_alone_show_the_centre_of_mass_in_calm_flight(small_fleet):
    for record in small_fleet.fleet.records:
        if "com_x" in record.compared:  # where the flight determines it
            assert abs(record.value("thrust_center_x") - record.value("com_x")) < 2e-3
        assert record.value("hover_motor") == pytest.approx(record.value("hover_speed"), rel=0.05)
        assert record.deviation(KT_WEIGHT) < 0.02 * record.value(KT_WEIGHT)
        assert set(TRIM[:2]) <= set(record.compared)
    assert sum("com_x" in record.compared for record in small_fleet.fleet.records) >= 3


@pytest.fixture(scope="module")
def two(small_fleet):
    """Return the flights of a vehicle identified together, and what loads each by itself."""
    own = [i for i, r in enumerate(small_fleet.fleet.records) if r.vehicle == "one"]
    cached = [small_fleet.fleet.cached[i] for i in own]
    experiment = experiment_of(cached[0].task)
    flights = tuple(named_flight(Path(one.task.file)) for one in cached)
    configuration = experiment.configuration[0].model_copy(update={"flights": flights})
    whole = quietly(experiment.model_copy(update={"configuration": (configuration,)}))

    def loads(key):
        return lambda: fitted_factors(
            read_entry(small_fleet.cache, key, factors=True).factors, experiment
        )

    return whole, [loads(one.key) for one in cached]


JOINED = ("kt", "kd", "Ixx_com", "Iyy_com", "com_x", "com_y", "hover_speed")


def steps(together, whole):
    """Return how far joined numbers are from those of one fit, and their deviations: in its own."""
    assert together.flights == 2
    found = []
    for name in JOINED:
        shared = name in ("kt", "kd")
        number = whole.result.parameter(name) if shared else whole.result.derived_value(name)
        value, std = together.number(name)
        found.append(((value - number.value) / number.std, std / number.std))
    return np.array(found).T


def test_joined_flights_are_those_identified_together(two):
    """Timing, what counts, and the terms are settled flight by flight: that is the difference."""
    whole, loads = two
    away, std = steps(joined(loads), whole)
    assert np.abs(away).max() < 0.3
    assert std.max() < 1.2
    # What is open of the weight shifts every flight alike, which joined deviations do not have.
    own = [name not in ("kt", "hover_speed") for name in JOINED]
    assert std[own].min() > 0.25


@pytest.mark.parametrize(
    ("message", "reason", "advice"),
    [
        (
            "it has no gyro (0 samples); log the raw IMU",
            "it has no gyro (0 samples)",
            "log the raw IMU",
        ),
        ("unknown format: copy it again", "unknown format", "copy it again"),
        ("nothing", "nothing", ""),
    ],
)
def test_a_refusal_says_what_was_met_and_what_to_do(message, reason, advice):
    found = refusal_of(message)
    assert (found.sentence, found.next_step) == (reason, advice)
