"""From half-widths to what a result says: intervals, deviations, covariance, in figures."""

import dataclasses

import numpy as np
import pytest

import made_fit
from rotorfit.checks.verdicts.parameters import given_parameter, with_timing_total
from rotorfit.checks.weak_directions import little_excitation
from rotorfit.estimation.estimate import Estimate, LinearProblem
from rotorfit.estimation.least_squares import EssentialEstimate
from rotorfit.estimation.parameter_map import parameter_map
from rotorfit.estimation.reweighted import BandedFit
from rotorfit.findings import sentences
from rotorfit.fit.experiment.experiment import ConfigurationEntry, MotorsEntry
from rotorfit.fit.experiment.flight_entries import FlightEntry
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.paper_fit import PaperSettings
from rotorfit.fit.reduction.motor_timing import MotorTiming
from rotorfit.fit.row_fits import ROWS, RowFits
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.results.joint_tables import joint_tables
from rotorfit.results.row_tables import paper_tables, row_tables

ENTRY = ConfigurationEntry(name="A", mass=1.4, mass_std=0.01, flights=(FlightEntry(file="A.csv"),))
STILL = MotorsEntry(lag=0.0, delay=0.0)
EXPERIMENT = made_fit.experiment(ENTRY, STILL)
CORRELATION = np.array([[1.0, 0.5, 0.2], [0.5, 1.0, 0.0], [0.2, 0.0, 1.0]])
VALUES, HALF = np.array([2e-6, 0.01, 1.5e-6]), np.array([1.96e-8, 1.96e-3, 1.96e-7])
STD = np.array([1e-8, 1e-3, 1e-7])


def number(tables, name):
    return next(n for n in (*tables.parameters, *tables.derived) if n.name == name)


def stated(number):
    """Return value, interval and deviation of a number."""
    return [number.value, *number.interval, number.std]


def interval_of_95(value, half):
    return pytest.approx([value, value - half, value + half, half / 1.96], rel=1e-12)


def joint(excitation=None):
    body = made_fit.configuration()
    numbers = Numbers(
        names=("kt", "Ixx@A", "kd_over_Izz@A"),
        values=VALUES,
        terms=made_fit.known_to(HALF),
        correlation=CORRELATION,
        excitation=excitation or {"roll@A": 50.0, "pitch@A": 50.0, "yaw@A": 50.0},
    )
    return tabulated(body, numbers)


def flights():
    made = made_fit.dataset(made_fit.prepared(), motors=STILL)
    [configured] = made.configurations
    configured = dataclasses.replace(configured, entry=ENTRY)
    return dataclasses.replace(made, configurations=(configured,))


def tabulated(body, numbers):
    fit = made_fit.fit(flights(), numbers, bodies=[body])
    return joint_tables(fit).found(*little_excitation(fit))


RHOS = [(4.9, False), (5.0, True), (9.9, True), (10.1, False)]


@pytest.mark.parametrize(("rho", "warned"), RHOS)
def test_between_a_rho_of_5_and_10_it_is_said(rho, warned):
    words = sentences(joint({"roll@A": rho, "pitch@A": 50.0, "yaw@A": 50.0}).findings)
    assert any(w.startswith("roll: signal-to-noise only") for w in words) is warned


def by_rows(rho=50.0):
    empty = Estimate(
        names=(),
        values=np.zeros(0),
        covariance=np.zeros((0, 0)),
        condition_number=1.0,
    )
    fit = BandedFit(
        estimate=empty,
        influence=np.zeros((2, 0)),
        variance=np.ones(2),
        known_power=np.ones(2),
        residual_power=np.ones(2),
        log_likelihood=0.0,
        information=np.zeros((2, 0, 0)),
    )
    fits = RowFits(
        fits=dict.fromkeys(ROWS, fit),
        excitation={"roll": rho, "pitch": 50.0, "yaw": 50.0},
        covariance=np.zeros((0, 0)),
        formal=np.zeros((0, 0)),
        segment=np.zeros(2, dtype=int),
    )
    numbers = Numbers(
        names=("kt", "Ixx", "kd_over_Izz", "Jr_over_Izz"),
        values=np.array([*VALUES, 1e-3]),
        terms=made_fit.known_to(np.array([*HALF, 1e-4])),
        correlation=np.pad(CORRELATION, (0, 1)) + np.diag([0.0, 0.0, 0.0, 1.0]),
        excitation=fits.excitation,
    )
    return row_tables(numbers, fits, EXPERIMENT, flights())


@pytest.mark.parametrize("made", [joint, by_rows])
def test_a_result_states_half_widths_and_their_1_96th_part(made):
    tables = made()
    assert stated(number(tables, "kt")) == interval_of_95(2e-6, 1.96e-8)
    assert stated(number(tables, "Ixx")) == interval_of_95(0.01, 1.96e-3)
    assert stated(number(tables, "kd_over_Izz")) == interval_of_95(1.5e-6, 1.96e-7)
    assert tables.covariance_names == ("kt", "Ixx@A")
    expected = CORRELATION[:2, :2] * np.outer(STD[:2], STD[:2])
    np.testing.assert_allclose(tables.covariance, expected, rtol=1e-9)


@pytest.mark.parametrize(("rho", "warned"), RHOS)
def test_by_rows_it_is_said_as_well(rho, warned):
    words = sentences(by_rows(rho).findings)
    assert any(w.startswith("roll: signal-to-noise only") for w in words) is warned


def test_a_mass_has_the_interval_of_its_scale():
    mass = given_parameter("mass", 1.4, 0.01, ENTRY)
    assert mass.interval == pytest.approx((1.4 - 0.0196, 1.4 + 0.0196))
    assert (mass.std, mass.verdict) == (0.01, "given")
    assert given_parameter("mass", 1.4, 0.0, ENTRY).interval is None


def test_lag_plus_delay_has_the_interval_of_the_sum():
    timing = MotorTiming(
        response=MotorResponse(lag=0.04, delay=0.01), total_std=0.002, lag_std=0.02, delay_std=0.02
    )
    (total,) = with_timing_total((), timing)
    assert stated(total) == interval_of_95(0.05, 0.00392)


def paper(relative):
    """Return the paper's tables of a k_t with this relative deviation, all else removed."""
    estimate = Estimate(
        names=("kt",),
        values=np.array([2e-6]),
        covariance=np.array([[(relative * 2e-6) ** 2]]),
        condition_number=1.0,
    )
    problem = LinearProblem(
        factors=(), tensors=(), map=parameter_map(("kt",), {}, {}), weights=np.zeros((0, 6))
    )
    essential = EssentialEstimate(estimate=estimate, removed=(), problem=problem)
    return number(paper_tables(essential, PaperSettings(), EXPERIMENT, flights()), "kt")


def test_the_papers_sigma_makes_an_interval_of_1_96():
    kt = paper(0.01)
    assert stated(kt) == interval_of_95(2e-6, 1.96 * 2e-8)
    assert kt.verdict == "identified"


@pytest.mark.parametrize(
    ("relative", "verdict"),
    [
        (0.1275, "identified"),  # 1.96 times it is a quarter
        (0.1276, "weak"),
        (0.510, "weak"),
        (0.511, "not-identified"),
    ],
)
def test_the_papers_numbers_are_judged_by_1_96_sigma(relative, verdict):
    assert paper(relative).verdict == verdict


def test_a_body_of_two_configurations_keeps_its_own_scale():
    """A mass of 1.4 kg on arms of 0.25 m: 7 g m matter of a first moment, 5 mm of a place."""
    body = made_fit.configuration()
    numbers = Numbers(
        names=("kt", "msx@A", "com_x@A"),
        values=np.array([2e-6, 0.0, 0.0]),
        terms=made_fit.known_to(np.array([1e-8, 0.25 * 0.007 * 1.01, 0.25 * 0.005 * 0.99])),
        correlation=np.eye(3),
        excitation={"roll@A": 50.0, "pitch@A": 50.0, "yaw@A": 50.0},
    )
    tables = tabulated(body, numbers)
    assert number(tables, "msx").verdict == "weak"
    assert number(tables, "com_x").value == 0.0
