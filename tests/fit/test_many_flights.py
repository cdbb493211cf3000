"""What five flights or more tell together: a trim of each, and how far their autopilot answers."""

from dataclasses import replace

import numpy as np
import pytest

import flown
import made_fit
from rotorfit.estimation.estimate import Estimate
from rotorfit.experiment.experiment import load_experiment
from rotorfit.fit.joint_equations import joint_problem, theta_of
from rotorfit.identification.identify import identify_flights
from rotorfit.many_flights.autopilot import LEAST_OPEN, heard
from rotorfit.many_flights.trims import trim_shares
from rotorfit.simulation import Scenario, layout_vehicle, simulate_flight, variant
from rotorfit.simulation.tables import write_flight_table

PLACES = np.array([[2e-3, 0.0], [-2e-3, 1e-3], [0.0, -2e-3], [1e-3, 2e-3], [-1e-3, -1e-3]])
"""Of each flight's centre of mass about that of all [m]."""


def of_flights(flights):
    source = np.repeat(np.arange(flights), 2)
    blocks = made_fit.blocks([(1.0, 2.0)] * len(source), source=source)
    return made_fit.configuration("A", factors=blocks)


@pytest.mark.parametrize("flights", [1, 4])
def test_few_flights_are_one(flights):
    problem = joint_problem([of_flights(flights)])
    assert len(problem.every_part) == len(problem.map.constant) == 1
    assert not any(name.startswith("trim") for name in problem.map.names)


def test_each_of_five_flights_has_its_own_first_moments_and_all_else_in_common():
    body, other = of_flights(5), replace(of_flights(2), name="B")
    problem = joint_problem([body, other])
    assert problem.parts == ((2, 2, 2, 2, 2), (4,))
    names = problem.map.names
    trims = [f"trim_{moment}@{k}" for k in range(5) for moment in ("msx", "msy")]
    assert [name for name in names if name.startswith("trim")] == trims
    std = 0.01 * body.mass * body.vehicle.arm
    assert all(problem.prior_std[name] == pytest.approx(std) for name in trims)

    values = np.array([made_fit.BODY.get(name.partition("@")[0], 0.0) for name in names])
    moved = values.copy()
    moved[names.index("trim_msy@3")] = 1e-3
    apart = problem.map.theta(moved) - problem.map.theta(values)
    assert np.argwhere(apart).tolist() == [[3, body.model.names.index("msy")]]
    np.testing.assert_array_equal(
        theta_of(problem.map, moved, [body, other]), problem.map.theta(values)[[0, 5]]
    )


def asked_apart(answer, *, rho, scatter=0.0):
    """Return what flights ask for at their joint fit, an answer pulling: s = H D - G answer + n."""
    f = 4
    H = np.array([r * np.eye(f) for r in rho])
    G = np.repeat(np.eye(f)[:, :3][None] * 20.0, len(rho), axis=0)
    noise = np.random.default_rng(1).standard_normal((len(rho), f)) * np.sqrt(rho)[:, None]
    pulled = scatter * noise - G @ answer
    shift = np.linalg.solve(H.sum(axis=0), -pulled.sum(axis=0))
    return H, H @ shift + pulled, G, np.zeros((f, f))


RHO = np.array([10.0, 20.0, 40.0, 100.0, 300.0, 1000.0, 2000.0, 5000.0])


def test_flights_of_different_rho_show_how_far_the_autopilot_answers():
    true = np.array([0.4, -0.3, 0.0])
    found = heard(*asked_apart(true, rho=RHO))
    np.testing.assert_allclose(found.beyond, true, atol=0.05)
    assert found.open == pytest.approx(tuple(LEAST_OPEN))


def test_flights_of_one_rho_show_nothing_of_it():
    found = heard(*asked_apart(np.array([0.4, -0.3, 0.0]), rho=np.full(8, 100.0)))
    np.testing.assert_allclose(found.beyond, 0.0, atol=1e-3)
    assert found.open == pytest.approx((1.0, 1.0, 1.0), abs=1e-3)


def test_flights_that_scatter_leave_it_open():
    assert min(heard(*asked_apart(np.zeros(3), rho=RHO, scatter=20.0)).open) > 0.7


@pytest.fixture(scope="module")
def five(tmp_path_factory):
    """Return what five flights give whose battery sat elsewhere in each, and the truth of all."""
    folder = tmp_path_factory.mktemp("five")
    (truth, vehicle), sensors = variant(layout_vehicle("quad-x"), "noisy")
    scenario = Scenario(seconds=10.0, ground_seconds=1.0, sensors=sensors, physics_rate=200.0)
    names = []
    for k, (x, y) in enumerate(PLACES):
        msx, msy, msz = truth.first_moments
        moments = (msx + truth.mass * x, msy + truth.mass * y, msz)
        flight = simulate_flight(replace(truth, first_moments=moments), vehicle, scenario, seed=k)
        names.append(folder / f"{k}.csv")
        write_flight_table(flight, names[-1])
    path = flown.experiment_file(folder / "e.toml", vehicle, names, mass=truth.mass)
    return identify_flights(load_experiment(path)), truth


def test_the_trim_of_each_flight_is_found(five):
    identified, truth = five
    values = identified.factors.values
    found = [[values[f"trim_{m}@{k}"] for m in ("msx", "msy")] for k in range(5)]
    np.testing.assert_allclose(np.array(found) / truth.mass, PLACES, atol=4e-4)


def test_trims_are_assumed_to_scatter_as_they_do(five):
    identified, _ = five
    (body,) = identified.factors.configurations
    scatter = np.sqrt(PLACES.var(axis=0, ddof=1).mean()) / body.vehicle.arm
    assert body.trim_share == pytest.approx(scatter, rel=0.1)


def test_the_scatter_of_trims_counts_what_is_open_of_each_not_of_all():
    names = [f"trim_{m}@{k}" for k in range(1, 6) for m in ("msx", "msy")]
    common = np.kron(np.ones((5, 5)), np.eye(2))
    estimate = Estimate(
        names=tuple(names),
        values=np.full(10, 3e-3),
        covariance=4e-8 * np.eye(10) + 1e-4 * common,
        condition_number=1.0,
        weak_directions=np.eye(10),
        weak_strengths=np.ones(10),
    )
    owners, moments = [0, 1, 1, 1, 1, 1], [0.2] * 6
    assert trim_shares(estimate, owners, moments) == {1: pytest.approx(1e-3)}
    alike = replace(estimate, covariance=1e-4 * common)
    assert trim_shares(alike, owners, moments) == {1: 5e-4}  # and no less


def test_intervals_of_flights_of_different_trim_hold_and_are_narrow(five):
    identified, truth = five
    for name, true in zip(
        ("Ixx_com", "Iyy_com", "Izz_com"), np.diagonal(truth.com_inertia), strict=True
    ):
        low, high = identified.result.derived_value(name).interval
        assert low < true < high
        assert high - low < 0.15 * true


def test_what_all_flights_share_is_said(five):
    used = five[0].result.settings["used"]
    assert "averages out over 5 flights; what all share does not" in used["hangs_on"][-1]
    assert all(0.5 <= half <= 1.0 for half in used["autopilot_answer"]["half_width"])
