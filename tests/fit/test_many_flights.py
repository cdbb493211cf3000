"""What flights tell together: trim and air of each; from five on how far the autopilot answers."""

from dataclasses import replace

import numpy as np
import pytest

import flown
import made_fit
from rotorfit.estimation.estimate import Estimate
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.fit.experiment.payload import PointMass
from rotorfit.fit.joint.closed_loop import LEAST_OPEN, response_from_scores
from rotorfit.fit.joint.joint_problem import joint_problem, theta_of
from rotorfit.fit.joint.trims import Scatter, scatters
from rotorfit.identification import identify_flights
from rotorfit.model.parameters import INERTIA, inertia_about
from rotorfit.simulation import Scenario, layout_vehicle, simulate_flight, variant
from rotorfit.simulation.experiment_files import write_flight_table

TRIMS = ("msx", "msy", "air")
PLACES = np.array([[2e-3, 0.0], [-2e-3, 1e-3], [0.0, -2e-3], [1e-3, 2e-3], [-1e-3, -1e-3]])
"""Of each flight's centre of mass about that of all [m]."""
AIR = (0.01, -0.01, 0.005, -0.02, 0.015)
"""How much denser than usual it is in each."""


def of_flights(flights):
    source = np.repeat(np.arange(flights), 2)
    blocks = made_fit.blocks([(1.0, 2.0)] * len(source), source=source)
    return made_fit.configuration("A", factors=blocks)


def test_a_flight_alone_has_no_trim():
    problem = joint_problem([of_flights(1)])
    assert len(problem.every_part) == len(problem.map.constant) == 1
    assert not any(name.startswith("trim") for name in problem.map.names)


def at_body(problem):
    """Return the free parameters of the problem as of the made-up body."""
    return np.array([made_fit.BODY.get(name.partition("@")[0], 0.0) for name in problem.map.names])


def test_flights_have_separate_trims_and_share_all_else():
    body, other = of_flights(5), replace(of_flights(2), name="B")
    problem = joint_problem([body, other])
    assert problem.parts == ((2, 2, 2, 2, 2), (2, 2))
    names = problem.map.names
    trims = [f"trim_{own}@{k}" for k in range(7) for own in TRIMS]
    assert [name for name in names if name.startswith("trim")] == trims
    std = 0.01 * body.mass * body.vehicle.arm
    for name in trims:
        assert problem.prior_std[name] == pytest.approx(0.01 if "air" in name else std)
    wide = joint_problem([body, replace(other, scatter=Scatter(moved=0.03, air=0.02))]).prior_std
    assert wide["trim_msx@0"] == wide["trim_msx@5"] / 3.0 == pytest.approx(std)
    assert wide["trim_air@6"] == 2.0 * wide["trim_air@4"]


@pytest.mark.parametrize(("trim", "size"), [("msx", 1e-5), ("msy", -2e-5)])
def test_a_moved_battery_shifts_the_com_but_keeps_com_inertia(trim, size):
    body, other = of_flights(5), replace(of_flights(2), name="B")
    problem = joint_problem([body, other])
    entry = body.model.names.index
    moved = at_body(problem)
    before = problem.map.theta(moved)
    moved[problem.map.names.index(f"trim_{trim}@3")] = size
    theta = problem.map.theta(moved)
    assert set(np.argwhere(theta != before)[:, 0]) == {3}
    assert theta[3, entry(trim)] == pytest.approx(before[3, entry(trim)] + size)
    com, was = (
        inertia_about(
            row[[entry(name) for name in INERTIA]],
            -body.mass,
            row[[entry(name) for name in ("msx", "msy", "msz")]] / body.mass,
        )
        for row in (theta[3], before[3])
    )
    np.testing.assert_allclose(com, was, atol=2.0 * size**2 / body.mass)
    assert np.abs(theta[3] - before[3])[[entry(n) for n in INERTIA]].max() > 2e-8
    np.testing.assert_array_equal(theta_of(problem.map, moved, [body, other]), before[[0, 5]])


def test_a_payload_that_is_known_moves_with_the_body():
    """The first moments of the second configuration are those of the first and the payload's."""
    payload = (PointMass(mass=0.2, position=(0.03, -0.02, 0.05)),)
    body = of_flights(1)
    loaded = replace(of_flights(2), name="B", mass=1.6, payload=payload, payload_of="A")
    problem = joint_problem([body, loaded])
    entry = body.model.names.index
    moved = at_body(problem)
    moved[problem.map.names.index("trim_msx@1")] = 1e-5
    theta = problem.map.theta(moved)
    com = [
        inertia_about(
            row[[entry(name) for name in INERTIA]],
            -loaded.mass,
            row[[entry(name) for name in ("msx", "msy", "msz")]] / loaded.mass,
        )
        for row in theta[1:]
    ]
    np.testing.assert_allclose(com[0], com[1], atol=2e-10)


def test_warmer_air_takes_as_much_of_thrust_as_of_drag_torque():
    body = of_flights(2)
    problem = joint_problem([body])
    moved = at_body(problem)
    before = problem.map.theta(moved)
    moved[problem.map.names.index("trim_air@1")] = -0.02
    changed = problem.map.theta(moved) / np.where(before == 0.0, 1.0, before)
    places = [body.model.names.index(name) for name in ("kt", "kd")]
    np.testing.assert_allclose(changed[1, places], 0.98)
    changed[1, places] = 1.0
    np.testing.assert_array_equal(changed[before != 0.0], 1.0)


def asked_apart(answer, *, rho, scatter=0.0):
    """Return what flights ask for at their joint fit, an answer pulling: s = H D - G answer + n."""
    f = 4
    H = np.array([r * np.eye(f) for r in rho])
    G = np.repeat(np.eye(f)[None] * 20.0, len(rho), axis=0)
    noise = np.random.default_rng(1).standard_normal((len(rho), f)) * np.sqrt(rho)[:, None]
    pulled = scatter * noise - G @ answer
    shift = np.linalg.solve(H.sum(axis=0), -pulled.sum(axis=0))
    return H, H @ shift + pulled, G, np.zeros((f, f))


RHO = np.array([10.0, 20.0, 40.0, 100.0, 300.0, 1000.0, 2000.0, 5000.0])


def test_flights_of_different_rho_reveal_the_autopilot_response():
    true = np.array([0.4, -0.3, 0.0, 0.2])
    found = response_from_scores(*asked_apart(true, rho=RHO))
    np.testing.assert_allclose(found.beyond, true, atol=0.05)
    assert found.open == pytest.approx(tuple(LEAST_OPEN))


def test_flights_of_one_rho_show_nothing_of_it():
    found = response_from_scores(
        *asked_apart(np.array([0.4, -0.3, 0.0, 0.2]), rho=np.full(8, 100.0))
    )
    np.testing.assert_allclose(found.beyond, 0.0, atol=1e-3)
    assert found.open == pytest.approx((1.0,) * 4, abs=1e-3)


def test_flights_that_scatter_leave_it_open():
    assert min(response_from_scores(*asked_apart(np.zeros(4), rho=RHO, scatter=20.0)).open) > 0.7


@pytest.fixture(scope="module")
def five(tmp_path_factory):
    """Return what five flights give, each with its own battery place and air, and the truth."""
    folder = tmp_path_factory.mktemp("five")
    (truth, vehicle), sensors = variant(layout_vehicle("quad-x"), "noisy")
    scenario = Scenario(seconds=10.0, ground_seconds=1.0, sensors=sensors, physics_rate=200.0)
    names = []
    for k, (x, y) in enumerate(PLACES):
        msx, msy, msz = truth.first_moments
        moments = (msx + truth.mass * x, msy + truth.mass * y, msz)
        own = replace(
            truth,
            first_moments=moments,
            kt=truth.kt * (1.0 + AIR[k]),
            kd=truth.kd * (1.0 + AIR[k]),
        )
        flight = simulate_flight(own, vehicle, scenario, seed=k)
        names.append(folder / f"{k}.csv")
        write_flight_table(flight, names[-1])
    path = flown.experiment_file(folder / "e.toml", vehicle, names, mass=truth.mass)
    return identify_flights(load_experiment(path)), truth


@pytest.mark.slow
def test_the_trim_of_each_flight_is_found(five):
    identified, truth = five
    values = identified.fit.estimate.estimate.by_name
    found = [[values[f"trim_{m}@{k}"] for m in ("msx", "msy")] for k in range(5)]
    np.testing.assert_allclose(np.array(found) / truth.mass, PLACES, atol=4e-4)


def test_the_air_of_each_flight_is_found(five):
    values = five[0].fit.estimate.estimate.by_name
    found = np.array([values[f"trim_air@{k}"] for k in range(5)])
    # The weight tells the level of all flights together to half a percent.
    thrust = values["kt"] / five[1].kt * (1.0 + found)
    np.testing.assert_allclose(thrust, 1.0 + np.array(AIR), atol=3e-3)
    np.testing.assert_allclose(found - found.mean(), np.array(AIR) - np.mean(AIR), atol=1e-3)


def test_flights_are_assumed_to_differ_as_they_do(five):
    (body,) = five[0].fit.configurations
    moved = np.sqrt(PLACES.var(axis=0, ddof=1).mean()) / body.vehicle.arm
    assert body.scatter.moved == pytest.approx(moved, rel=0.1)
    known = np.sqrt((0.01**2 + 4.0 * np.var(AIR, ddof=1)) / 5.0)
    assert body.scatter.air == pytest.approx(known, rel=0.15)


def test_flight_scatter_counts_individual_not_common_uncertainty():
    names = [f"trim_{own}@{k}" for k in range(1, 6) for own in TRIMS]
    common = np.kron(np.ones((5, 5)), np.eye(3))
    open_still = np.diag(np.tile([4e-8, 4e-8, 9e-6], 5))
    estimate = Estimate(
        names=tuple(names),
        values=np.full(15, 3e-3),
        covariance=open_still + 1e-4 * common,
        condition_number=1.0,
    )
    owners, moments = [0, 1, 1, 1, 1, 1], [0.2] * 6
    found = scatters(estimate, owners, moments)
    assert list(found) == [1]
    known = np.sqrt((0.01**2 + 4.0 * 3e-3**2) / 5.0)
    assert (found[1].moved, found[1].air) == (pytest.approx(1e-3), pytest.approx(known))
    alike = scatters(replace(estimate, covariance=1e-4 * common), owners, moments)[1]
    assert alike.moved == 5e-4  # and no less
    assert alike.air == pytest.approx(0.01 / 5**0.5)


def test_two_flights_of_one_day_barely_constrain_air_of_another():
    estimate = Estimate(
        names=tuple(f"trim_{own}@{k}" for k in range(2) for own in TRIMS),
        values=np.zeros(6),
        covariance=np.zeros((6, 6)),
        condition_number=1.0,
    )
    assert scatters(estimate, [0, 0], [0.2] * 2)[0].air == pytest.approx(0.01 / 2**0.5)


def test_intervals_of_differently_trimmed_flights_hold_narrowly(five):
    identified, truth = five
    for name, true in zip(
        ("Ixx_com", "Iyy_com", "Izz_com"), np.diagonal(truth.com_inertia), strict=True
    ):
        low, high = identified.result.derived_value(name).interval
        assert low < true < high
        assert high - low < 0.15 * true


def test_what_all_flights_share_is_said(five, assert_wording):
    used = five[0].result.settings["used"]
    assert "5 flights" in used["hangs_on"][-1]
    assert_wording(used["hangs_on"][-1])
    assert all(0.5 <= half <= 1.0 for half in used["autopilot_answer"]["half_width"])
