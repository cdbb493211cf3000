"""Every term of an interval of the joint estimate, by hand: none may be halved or doubled."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

import made_fit
from rotorfit.estimation.banded import (
    BandedProblem,
    banded,
    covariance_with_noise_uncertainty,
    response_sensitivity,
)
from rotorfit.estimation.dispersion import Dispersion
from rotorfit.estimation.estimate import numerical_jacobian
from rotorfit.estimation.factors import Factors, triangular_factors
from rotorfit.estimation.parameter_map import parameter_map
from rotorfit.fit.experiment.payload import PointMass, added_moments
from rotorfit.fit.intervals import joint_numbers as module
from rotorfit.fit.intervals.allowances import (
    SENSOR_SIZE,
    coupling_uncertainty,
    number_scale,
    systematic_uncertainty,
)
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.intervals.joint_numbers import (
    Numbers,
    excitation,
    half_width_between_phases,
    joint_numbers,
    timing_shifts,
    turned_moments,
    weighed_excitation,
)
from rotorfit.fit.joint.joint_problem import joint_problem
from rotorfit.fit.reduction.motor_timing import FreeTiming
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.model.terms.registry import TERMS

FREE = 12
"""Parameters of `made_fit.fit_of` with one configuration: two blocks' worth, at six signals."""
EVEN = np.tile([1.0, -1.0], 6)
T_10, T_4 = 2.228, 2.776
"""Two-sided 95 % of Student's t, from the printed tables."""
LEFT = np.sqrt(12 / 10)
"""Of 12 blocks, 10 are left."""


@pytest.fixture(autouse=True)
def _without_dispersion(monkeypatch):
    """Leave each number its own scatter: made fits have no scores that go with it."""
    none = Dispersion(ratio=1.0, degrees=0.0)
    monkeypatch.setattr(module, "dispersions", lambda fit, parts, groups: [none] * len(groups))


def half_width(fit, configurations, name="kt", mass_std=0.0):
    numbers = joint_numbers(fit, configurations, {c.name: mass_std for c in configurations})
    return float(numbers.half_width[numbers.index(name)])


def test_without_scatter_an_interval_is_that_of_the_covariance():
    """With the t of the 10 blocks whose variances are left, which come out too small by them."""
    body = made_fit.configuration()
    fit = made_fit.fit_of([body], std={"kt": 1e-8})
    assert len(fit.estimate.names) == FREE
    assert half_width(fit, [body]) == pytest.approx(T_10 * LEFT * 1e-8, rel=1e-3)
    found = joint_numbers(fit, [body], {"A": 0.0})
    across = np.hypot(found.number("com_z@A")[0], found.number("kd_over_kt")[0])
    lean = 1.96 * np.radians(0.25) * across  # of the rotors, and of their drag torque
    known = np.hypot(lean, SENSOR_SIZE)
    assert half_width(fit, [body], "com_x@A") == pytest.approx(known, rel=1e-6)


@pytest.mark.parametrize("offset", [0.0, 5e-9])
def test_block_scatter_is_a_jackknife_with_t_of_remaining_blocks(offset):
    """12 blocks of 6 equations, 12 parameters: 10 blocks are left, and t of 10 is 2.228."""
    body = made_fit.configuration()
    q = 1e-8 * EVEN + offset
    # Leave one out: the mean of 12 pulls times 12, and its jackknife variance 11/12 sum (..)^2.
    leave_out = np.array([np.delete(q, i).mean() for i in range(12)]) * 12
    variance = 11 / 12 * ((leave_out - leave_out.mean()) ** 2).sum()
    fit = made_fit.fit_of([body], std={}, influence={"kt": q})
    expected = T_10 * np.sqrt(variance * 12 / 10)
    assert half_width(fit, [body]) == pytest.approx(expected, rel=1e-3)
    assert expected == pytest.approx(8.83e-8, rel=1e-3)  # 2.228 sqrt(12 * 12/11 * 12/10)


def test_scatter_of_a_few_informative_blocks_has_their_t():
    """Of twelve blocks two are a hundred times as lively: t of hardly more than 2 is 4.3."""
    factors = made_fit.blocks([(1.0, 2.0)] * 12)
    size = np.ones(12)
    size[[3, 8]] = 100.0
    body = made_fit.configuration(factors=replace(factors, R=factors.R * size[:, None, None]))
    fit = made_fit.fit_of([body], std={"kt": 1e-12}, influence={"kt": 1e-8 * EVEN})
    assert half_width(fit, [body]) == pytest.approx(8.83e-8 * 4.303 / T_10, rel=0.01)


@pytest.mark.parametrize(("phases", "parts"), [(1, 12), (2, 12), (3, 3), (4, 4)])
def test_the_scatter_of_all_numbers_is_pooled_with_its_own(monkeypatch, phases, parts):
    """By phases from three on, else by blocks: (10 own + 30 times 4 stated) / 40, t of 40."""
    moving_as_they_pull(monkeypatch)
    found = []
    pooled = [Dispersion(ratio=4.0, degrees=30.0)]
    monkeypatch.setattr(module, "dispersions", lambda fit, own, _: found.append(own) or pooled)
    factors = made_fit.blocks([(1.0, 2.0)] * 12)
    segment = np.repeat(np.arange(phases), 12 // phases)
    body = made_fit.configuration(factors=replace(factors, segment=segment))
    fit = made_fit.fit_of([body], std={"kt": 3e-8})
    pulls = fit.influence.copy()
    pulls[:, fit.estimate.names.index("kt")] = 1e-8 * EVEN
    jacobian = np.eye(FREE)[[fit.estimate.names.index("kt")]]
    half = module.random_half_width(
        replace(fit, influence=pulls), jacobian, np.array([[(3e-8) ** 2]])
    )
    own = 12 * 12 / 11 * 12 / 10 * 1e-16
    variance = (10 * own + 30 * 4 * 9e-16) / 40
    assert half[0] == pytest.approx(2.021 * np.sqrt(variance), rel=1e-3)
    assert {len(own) for own in found} == {parts}
    assert all(np.sum(own, axis=0).tolist() == [1] * 12 for own in found)


def test_what_was_known_before_scatters_in_no_flight(monkeypatch):
    """Half of the variance by a prior: the flights' half grows by their scatter, that does not."""
    pooled = [Dispersion(ratio=9.0, degrees=1e9)]
    monkeypatch.setattr(module, "dispersions", lambda fit, own, flights: pooled)
    body = made_fit.configuration()
    fit = made_fit.fit_of([body], std={"kt": 3e-8})
    prior = replace(fit.problem, prior_std={"kt": np.sqrt(2.0) * 3e-8})
    jacobian = np.eye(FREE)[[fit.estimate.names.index("kt")]]
    formal = np.array([[(3e-8) ** 2]])
    alone = module.random_half_width(fit, jacobian, formal)
    known = module.random_half_width(replace(fit, problem=prior), jacobian, formal)
    assert alone[0] == pytest.approx(1.96 * 3.0 * 3e-8, rel=1e-3)
    assert known[0] == pytest.approx(1.96 * np.sqrt(0.5 * 9.0 + 0.5) * 3e-8, rel=1e-3)


def test_the_wider_of_covariance_and_scatter_counts_alone():
    """The scatter's deviation is sqrt(12 * 12/11) e-8, 3.62e-8."""
    body = made_fit.configuration()
    fit = made_fit.fit_of([body], std={"kt": 3.6e-8}, influence={"kt": 1e-8 * EVEN})
    assert half_width(fit, [body]) == pytest.approx(8.83e-8, rel=1e-3)
    fit = made_fit.fit_of([body], std={"kt": 5e-8}, influence={"kt": 1e-8 * EVEN})
    assert half_width(fit, [body]) == pytest.approx(T_10 * LEFT * 5e-8, rel=1e-3)


def of_flights(name, flights):
    """Return a configuration with four blocks a flight."""
    source = np.repeat(np.arange(flights), 4)
    return made_fit.configuration(
        name, factors=made_fit.blocks([(1.0, 2.0)] * len(source), source=source)
    )


@pytest.mark.parametrize("offset", [0.0, 7e-8])
def test_three_flights_that_differ_widen_an_interval(offset):
    """Pulls of -d, 0 and d: their variance times three is 3 d^2; how large, three cannot tell."""
    body = of_flights("A", 3)
    pulls = np.repeat([-4e-8, 0.0, 4e-8], 4) + offset
    fit = made_fit.fit_of([body], std={}, influence={"kt": pulls / 4})
    assert half_width(fit, [body]) == pytest.approx(1.96 * np.sqrt(3.0) * 4e-8, rel=1e-3)


def test_two_flights_show_nothing_of_how_flights_differ():
    body = of_flights("A", 2)
    pulls = np.repeat([-4e-8, 4e-8], 4)
    fit = made_fit.fit_of([body], std={}, influence={"kt": pulls / 4})
    # Each has a trim along x and y, and its air: three blocks' worth of parameters in all.
    blocks_alone = 2.571 * np.sqrt(8 * 8 / 7 * 8 / 5) * 1e-8  # t of 5
    assert half_width(fit, [body]) == pytest.approx(blocks_alone, rel=1e-3)


PULLS = {
    3: [-4e-8, 0.0, 4e-8],
    4: [-3e-8, 3e-8, -3e-8, 3e-8],
    5: [-4e-8, -4e-8, 0.0, 4e-8, 4e-8],
    6: [-3e-8, 3e-8] * 3,
}


def jackknife(pulls):
    m = len(pulls)
    return m / (m - 1) * np.sum(np.square(pulls))


def moving_without(monkeypatch, moves):
    """Let kt move without some blocks by `moves` of these parts."""

    def steps(fit, parts):
        place = fit.estimate.names.index("kt")
        return np.outer(moves(parts), np.eye(len(fit.estimate.names))[place])

    monkeypatch.setattr(module, "steps_without", steps)


def moving_as_they_pull(monkeypatch):
    """Let no phase have more of the information than the others."""
    moving_without(monkeypatch, lambda parts: np.zeros(len(parts)))


@pytest.mark.parametrize(
    ("counts", "t"),
    [
        ((4,), 1.96),
        ((5,), T_4),
        ((6,), 2.571),
        ((3, 4), 1.96),
        ((4, 3), 1.96),
        ((3, 5), T_4),
        ((6, 5), T_4),
        ((5, 6), T_4),
    ],
)
def test_scatter_of_five_flights_sets_the_degrees_of_freedom(monkeypatch, counts, t):
    """Configurations add, and the fewest flights of those with five or more set the degrees."""
    moving_as_they_pull(monkeypatch)
    bodies = [of_flights(name, count) for name, count in zip("AB", counts, strict=False)]
    pulls = np.repeat(np.concatenate([PULLS[count] for count in counts]), 4)
    fit = made_fit.fit_of(bodies, std={}, influence={"kt": pulls / 4})
    expected = t * np.sqrt(sum(jackknife(PULLS[count]) for count in counts))
    assert half_width(fit, bodies) == pytest.approx(expected, rel=1e-3)


def test_flights_are_taken_whole_whatever_their_blocks_do(monkeypatch):
    """Blocks of a flight that pull against each other are no difference between flights."""
    moving_as_they_pull(monkeypatch)
    body = of_flights("A", 5)
    fit = made_fit.fit_of([body], std={}, influence={"kt": 1e-8 * np.tile([1.0, -1.0], 10)})
    free = 20 - (FREE + 3 * 5) / 6  # each has a trim along x and y, and its air
    alone = stats.t.ppf(0.975, free) * np.sqrt(20 * 20 / 19 * 20 / free) * 1e-8
    common = 0.005 * made_fit.BODY["kt"]  # what the model lacks in all of them
    assert half_width(fit, [body]) == pytest.approx(np.hypot(alone, common), rel=1e-4)


@pytest.mark.parametrize("phases", [2, 3, 4])
def test_phase_influence_averages_jackknife_and_sandwich(monkeypatch, phases):
    """Of three and more: pull p of each, its bands together, times the move d without it."""
    factors = made_fit.blocks([(1.0, 2.0), (2.0, 3.0)] * phases)
    body = made_fit.configuration(factors=replace(factors, segment=np.repeat(np.arange(phases), 2)))
    p = 1e-8 * np.array([1.0, -2.0, 3.0, 5.0])[:phases]
    d = 1e-8 * np.array([-3.0, 2.0, -5.0, 7.0])[:phases]
    inside = np.array([1e-7, -1e-7] * phases)  # within the phases, and no matter
    fit = made_fit.fit_of([body], std={}, influence={"kt": np.repeat(p / 2, 2) + inside})
    place = fit.estimate.names.index("kt")

    segment = body.factors.segment
    moving_without(
        monkeypatch, lambda parts: d[[int(*np.unique(segment[blocks])) for blocks in parts]]
    )
    found = half_width_between_phases(fit, np.eye(FREE))
    expected = 1.96 * np.sqrt(np.sum(np.abs(p * d))) if phases > 2 else 0.0
    assert found[place] == pytest.approx(expected)
    assert np.delete(found, place) == pytest.approx(0.0)


@pytest.mark.parametrize(("ratio", "counted"), [(0.5, 1.0), (3.9, 3.9), (10.0, 4.0)])
def test_an_indispensable_phase_counts_four_times_at_most(monkeypatch, ratio, counted):
    """And one that pulls nowhere does not count, wherever the others go without it."""
    factors = made_fit.blocks([(1.0, 2.0)] * 4)
    body = made_fit.configuration(factors=replace(factors, segment=np.arange(4)))
    pulls = 1e-8 * np.array([3.0, -2.0, 1.0, 0.0])
    fit = made_fit.fit_of([body], std={}, influence={"kt": pulls})
    place = fit.estimate.names.index("kt")
    moves = np.array([ratio, 1.0, 1.0, 1.0]) * np.where(pulls == 0.0, 1e-6, -pulls)
    moving_without(monkeypatch, lambda parts: parts @ moves)
    expected = 1.96e-8 * np.sqrt(counted * 9.0 + 4.0 + 1.0)
    assert half_width_between_phases(fit, np.eye(FREE))[place] == pytest.approx(expected)


def test_phases_that_differ_widen_an_interval(monkeypatch):
    """Blocks alone make 8.83e-8; four phases, each pulling by 3e-8 and moving by 12e-8, more."""
    factors = made_fit.blocks([(1.0, 2.0)] * 12)
    body = made_fit.configuration(factors=replace(factors, segment=np.repeat(np.arange(4), 3)))
    pulls = np.repeat([1e-8, -1e-8, 1e-8, -1e-8], 3)
    fit = made_fit.fit_of([body], std={}, influence={"kt": pulls})
    moving_without(monkeypatch, lambda parts: -4.0 * (parts @ pulls))
    assert half_width(fit, [body]) == pytest.approx(1.96 * np.sqrt(4 * 4 * 9) * 1e-8, rel=1e-3)


def test_phases_of_unequal_information_have_the_variance_of_hc2():
    """y = slope x: sum of s^2 / (1 - h), by MacKinnon and White, s the pull and h the leverage."""
    rng = np.random.default_rng(4)
    size = np.array([4.0, 1.0, 1.0, 1.0, 2.0])
    x = size[:, None, None] * rng.normal(size=(5, 3, 60))
    y = 2.0 * x + rng.normal(size=x.shape) + 0.2 * x * rng.normal(size=(5, 1, 1))
    Z = np.stack([y, x], axis=3).reshape(15, 60, 2)
    factors = Factors(
        R=triangular_factors(Z),
        rows=np.full(15, 60),
        segment=np.repeat(np.arange(5), 3),
        band=np.tile([0.0, 1.0], (15, 1)),
    )
    tensor = np.zeros((2, 1, 2))
    tensor[0, 0, 0], tensor[1, 0, 1] = 1.0, -1.0
    mapped = parameter_map(("y", "x"), {"slope": {(0, "x"): 1.0}}, {(0, "y"): 1.0})
    problem = BandedProblem(
        factors=(factors,), tensors=(tensor,), map=mapped, noisy=(0,), prior_mean={}, prior_std={}
    )
    fit = banded(problem, np.array([1.0]))
    (slope,) = fit.estimate.values
    v = fit.variance[:, 0].reshape(5, 3, 1)
    scores = ((y - slope * x) * x / v).sum(axis=(1, 2))
    information = (x**2 / v).sum(axis=(1, 2))
    leverage = information / information.sum()
    assert leverage.max() > 0.4
    hc2 = np.sum(scores**2 / (1.0 - leverage)) / information.sum() ** 2
    found = half_width_between_phases(fit, np.eye(1))
    assert found[0] == pytest.approx(1.96 * np.sqrt(hc2), rel=1e-3)


def with_covariance(fit, entries):
    """Return the fit with covariances between parameters besides their variances."""
    covariance = fit.estimate.covariance.copy()
    for (one, other), value in entries.items():
        i, j = (fit.estimate.names.index(name) for name in (one, other))
        covariance[i, j] = covariance[j, i] = value
    return replace(fit, estimate=replace(fit.estimate, covariance=covariance))


TIMES = FreeTiming(at=MotorResponse(lag=0.04, delay=0.01), names=("motor_lag", "motor_delay"))


def timed_fit(names=TIMES.names):
    """Lag and delay known to 1 and .5 ms, correlated, and a kt that goes with them."""
    body = made_fit.configuration(timing=replace(TIMES, names=names))
    more = {name: std for name, std in zip(TIMES.names, (1e-3, 5e-4), strict=True) if name in names}
    fit = made_fit.fit_of([body], std={"kt": 2e-8, **more})
    pairs = {
        ("kt", "motor_lag"): 8e-12,
        ("kt", "motor_delay"): -2e-12,
        ("motor_lag", "motor_delay"): -3e-7,
    }
    known = {pair: v for pair, v in pairs.items() if set(pair) <= {"kt", *names}}
    return body, with_covariance(fit, known)


def test_a_fault_of_the_times_moves_what_goes_with_them():
    """Where lag and delay are held off by their faults, the rest follows by regression."""
    body, fit = timed_fit()
    K = np.linalg.inv([[1e-6, -3e-7], [-3e-7, 2.5e-7]])
    slopes = np.array([8e-12, -2e-12]) @ K
    split, total = timing_shifts(fit, body.timing)
    at = {name: fit.estimate.names.index(name) for name in ("kt", *TIMES.names)}
    assert split[at["kt"]] == pytest.approx(slopes @ [3e-4, -3e-4])
    assert total[at["kt"]] == pytest.approx(slopes @ [0.0, 1e-4])
    assert [split[at[n]] for n in TIMES.names] == pytest.approx([3e-4, -3e-4])
    assert [total[at[n]] for n in TIMES.names] == pytest.approx([0.0, 1e-4])
    assert timing_shifts(fit, None) == []


@pytest.mark.parametrize(("name", "slope"), [("motor_lag", 8e-6), ("motor_delay", -8e-6)])
def test_a_lone_time_has_the_fault_of_the_sum(name, slope):
    body, fit = timed_fit((name,))
    (shift,) = timing_shifts(fit, body.timing)
    assert shift[fit.estimate.names.index("kt")] == pytest.approx(slope * 1e-4)


def test_responses_and_faults_of_the_times_are_in_the_interval():
    """Of the answers the sum over roll, pitch and yaw; of the faults 1.96 of each; as squares."""
    body, fit = timed_fit()
    place = fit.estimate.names.index("kt")
    shifts = np.zeros((3, len(fit.estimate.names)))
    shifts[:, place] = [4e-8, -3e-8, 1e-8]
    fit = made_fit.moved_by_responses(made_fit.with_known_variances(fit), shifts)
    left = 12 / (12 - len(fit.estimate.names) / 6)
    chance = stats.t.ppf(0.975, 12 / left) * np.sqrt(left) * 2e-8
    slopes = np.array([8e-12, -2e-12]) @ np.linalg.inv([[1e-6, -3e-7], [-3e-7, 2.5e-7]])
    parts = [chance, 8e-8, 1.96 * slopes @ [3e-4, -3e-4], 1.96 * slopes @ [0.0, 1e-4]]
    assert half_width(fit, [body]) == pytest.approx(np.linalg.norm(parts), rel=1e-4)


def test_what_estimated_variances_leave_open_is_in_the_interval():
    """Rows whose errors are so small that the variance of kt is four times what the fit states."""
    body = made_fit.configuration()
    fit = made_fit.fit_of([body], std={"kt": 2e-8})
    place = fit.estimate.names.index("kt")
    stated = fit.estimate.covariance[place, place]

    def added(fit):
        return covariance_with_noise_uncertainty(fit)[place, place] - stated

    wide = replace(fit, variance=fit.variance * added(fit) / (3.0 * stated))
    assert added(wide) == pytest.approx(3.0 * stated)
    known = half_width(made_fit.with_known_variances(fit), [body])
    assert half_width(wide, [body]) == pytest.approx(2.0 * known, rel=1e-3)


def test_what_shifts_two_numbers_at_once_makes_them_go_together():
    """Apart by chance; a shift of three of its deviations each makes 1 / (1 + (1.96 / 3)^2)."""
    body = made_fit.configuration()
    fit = made_fit.fit_of([body], std={"kt": 1e-8, "Ixx@A": 1e-4})
    places = [fit.estimate.names.index(name) for name in ("kt", "Ixx@A")]
    shifts = np.zeros((1, FREE))
    shifts[0, places] = [3e-8, -3e-4]
    fit = made_fit.moved_by_responses(made_fit.with_known_variances(fit), shifts)
    numbers = joint_numbers(fit, [body], {"A": 0.0})
    own = numbers.index("kt"), numbers.index("Ixx@A")
    assert numbers.correlation[own] == pytest.approx(-1.0 / (1.0 + (1.96 / 3.0) ** 2), rel=1e-6)


def test_what_no_autopilot_is_looked_for_depends_on_none():
    body = made_fit.configuration()
    fit = made_fit.fit_of([body], std={})
    assert joint_problem([body]).feedback is None
    assert response_sensitivity(fit).shape == (0, FREE)


def test_excitation_is_rotor_power_over_residual_in_pilots_band():
    """0.3 to 3 Hz; two flights, the second three times as long as the first."""
    bands = [(0.0, 0.25), (0.35, 0.5), (2.0, 2.9), (3.1, 4.0)]
    source = np.repeat([0, 1], 4)
    rows = np.repeat([10, 30], 4)
    factors = made_fit.blocks(bands * 2, rows=rows, source=source)
    residual = np.ones((8, 6))
    signal = np.ones((8, 6))
    signal[1::4, 3:] += [4.0, 8.0, 0.0]
    signal[2::4, 3:] += [8.0, 8.0, 0.0]
    signal[[1, 2], 3] += 20.0
    signal[0::4, 3:] += 1000.0
    signal[3::4, 3:] += 3000.0
    body = made_fit.configuration(factors=factors)
    fit = made_fit.fit_of([body], std={}, powers=(signal, residual))
    found = excitation(fit, [body])
    # roll: (12 + 40) / 2 of the first flight, 12 / 2 of the second; 10 rows at 25 and 29 times
    # what is left, 30 at 5 and 9 times: 1 / 27 and 1 / 7 count in proportion.
    roll = (540.0 + 420.0) / (540.0 / 27.0 + 420.0 / 7.0) - 1.0
    expected = {"roll@A": roll, "pitch@A": 8.0, "yaw@A": 0.0}
    assert found == pytest.approx(expected)


RHO = {"roll@A": 13.5, "pitch@A": 28.5, "yaw@A": 12.0}


def numbers_of(entries, rho=RHO):
    """Return numbers (name: value, half-width)."""
    values, half = np.array(list(entries.values()), dtype=float).T
    return Numbers(
        names=tuple(entries),
        values=values,
        terms=made_fit.known_to(half),
        correlation=np.eye(len(values)),
        excitation=rho,
    )


DIAGONAL = {"Ixx_com@A": (2.0, 0.3), "Iyy_com@A": (8.0, 0.0), "Izz_com@A": (10.0, 0.0)}


def widened(entries, *, mass_std=0.0, rho=RHO, bodies=None, shifts=None):
    numbers = numbers_of({**DIAGONAL, **entries}, rho)
    bodies = bodies or [made_fit.configuration()]
    stds = {c.name: mass_std for c in bodies} if isinstance(mass_std, float) else mass_std
    moved = np.array([(shifts or {}).get(name, 0.0) for name in numbers.names])
    response = IntervalTerm(name="autopilot response", half_width=moved, source="made up")
    found = systematic_uncertainty(numbers.with_terms(response), bodies, stds)
    return dict(zip(found.names, found.half_width.tolist(), strict=True))


def test_chance_response_and_mass_add_as_squares():
    """Ixx = 2 hangs by 0.2 on the answer; 1 % of the mass is 1.96 % of it."""
    half = widened({}, mass_std=0.014, shifts={"Ixx_com@A": -0.2})
    assert half["Ixx_com@A"] == pytest.approx(np.sqrt(0.3**2 + 0.2**2 + 0.0392**2), rel=1e-9)
    assert half["Iyy_com@A"] == pytest.approx(0.1568, rel=1e-9)


def test_what_is_free_of_the_mass_is_free_of_its_deviation():
    at = {"com_x@A": (0.01, 1e-3), "com_y@A": (0.0, 0.1), "com_z@A": (0.0, 0.1)}
    entries = {**at, "kd_over_kt": (0.0, 0.1), "Ixx_over_kt@A": (5.0, 0.5)}
    half = widened(entries, mass_std=0.014)
    assert half["com_x@A"] == pytest.approx(np.hypot(1e-3, SENSOR_SIZE), rel=1e-12)
    assert half["Ixx_over_kt@A"] == pytest.approx(0.5, rel=1e-9)


def test_motors_that_lean_move_the_centre_of_mass():
    """By a quarter of a degree: 10 mm below the IMU, and drag torque with a lever of 5 mm."""
    at = {"com_x@A": (0.003, 0.0), "com_y@A": (0.004, 0.0), "com_z@A": (-0.01, 0.0)}
    half = widened({**at, "msx@A": (0.003, 0.0), "kd_over_kt": (0.005, 0.0)})
    lean = 1.96 * np.radians(0.25)
    across = lean * np.hypot(0.01, 0.005)
    assert half["com_x@A"] == pytest.approx(np.hypot(across, SENSOR_SIZE))
    assert half["com_y@A"] == half["com_x@A"]
    assert half["com_z@A"] == pytest.approx(np.hypot(lean * 0.005, SENSOR_SIZE))
    assert half["msx@A"] == pytest.approx(made_fit.configuration().mass * half["com_x@A"])


def test_motors_that_lean_as_one_twist_beside_the_centre_of_mass():
    """By a quarter of a degree: the centre of mass 5 mm beside the rotors' centre."""
    at = {"com_x@A": (0.003, 0.0), "com_y@A": (0.004, 0.0), "com_z@A": (0.0, 0.0)}
    half = widened({**at, "kd_over_kt": (0.0, 0.0), "twist@A": (1e-4, 1e-5)})
    assert half["twist@A"] == pytest.approx(np.hypot(1e-5, 1.96 * np.radians(0.25) * 0.005))
    half = widened({"twist@A": (1e-4, 1e-5)})
    assert half["twist@A"] == pytest.approx(1e-5)


def test_a_shared_number_depends_on_the_least_known_mass():
    bodies = [made_fit.configuration("A", mass=1.0), made_fit.configuration("B", mass=2.0)]
    half = widened({"kt": (1.0, 0.0)}, mass_std={"A": 0.01, "B": 0.06}, bodies=bodies)
    assert half["kt"] == pytest.approx(1.96 * 0.03)


@pytest.mark.parametrize(
    ("yaw", "kd", "ratio"),
    [
        (5.01, 0.0, 0.0),
        (4.99, 1.5 / 3.49, 1.5 / 3.49),  # the larger of 3 / (rho + 3) and 1.5 / (rho - 1.5)
        (1.49, np.inf, np.inf),
    ],
)
def test_from_a_rho_of_5_down_the_fixed_allowances_are_added(yaw, kd, ratio):
    """For what is the axis' own; roll and what needs no motion are as they were."""
    entries = {"kt": (1.0, 0.1), "kd": (1.0, 0.1), "kd_over_Izz@A": (1.0, 0.1)}
    half = widened(entries, rho={**RHO, "yaw@A": yaw})
    assert half["kd"] == pytest.approx(np.hypot(0.1, kd))
    assert half["kd_over_Izz@A"] == pytest.approx(np.hypot(0.1, ratio))
    assert half["kt"] == 0.1
    assert half["Ixx_com@A"] == 0.3


def test_a_number_near_zero_is_biased_as_one_that_matters():
    """At a rho of 4.5: of 1/1000 of Izz = 10 a half; of sqrt(16) / 20 2.5 / (4.5 + 2.5)."""
    rho = {"roll@A": 4.5, "pitch@A": 4.5, "yaw@A": 4.5}
    half = widened({"Jr": (0.0, 0.0), "Ixy_com@A": (0.0, 0.0)}, rho=rho)
    assert half["Jr"] == pytest.approx(0.5 * 0.01)
    assert half["Ixy_com@A"] == pytest.approx(2.5 / 7.0 * 0.2)
    assert widened({"Jr": (0.5, 0.0)}, rho=rho)["Jr"] == pytest.approx(0.25)


def test_a_body_about_a_turned_imu_is_the_same_body():
    """Against the point masses that it is made of, payload and all."""
    rng = np.random.default_rng(5)
    imu, R = rng.normal(size=3), Rotation.from_rotvec([0.02, -0.01, 0.03]).as_matrix()
    body = [
        PointMass(mass=m, position=tuple(p))
        for m, p in zip((1.0, 2.0, 0.5), rng.normal(size=(3, 3)), strict=True)
    ]
    payload = (PointMass(mass=0.3, position=(0.1, 0.2, -0.3)),)
    seen = [
        replace(p, position=tuple((imu + R @ (np.array(p.position) - imu)).tolist())) for p in body
    ]
    loaded = replace(
        made_fit.configuration("B", mass=3.8),
        vehicle=replace(made_fit.QUAD, imu_position=tuple(imu.tolist())),
        payload=payload,
        payload_of="A",
    )
    moments = {n: np.array([v + added_moments(payload)[n]]) for n, v in added_moments(seen).items()}
    turned = {name: float(v[0]) for name, v in turned_moments(moments, R[None], loaded).items()}
    assert turned == pytest.approx(added_moments([*body, *payload]))


def test_a_shared_number_uses_the_configuration_that_yaws_most():
    entries = {"kd": (1.0, 0.1), "kd_over_Izz@A": (1.0, 0.1)}
    half = widened(entries, rho={**RHO, "yaw@A": 1.0, "yaw@B": 27.0})
    assert half["kd"] == 0.1
    assert half["kd_over_Izz@A"] == np.inf


def test_yaw_products_widen_by_the_uncertainty_of_their_equation():
    """Ixz = 3 hangs on the answer by 0.3, on yaw by 3 / (12 + 3), and on the rotors' lean."""
    half = widened({"Ixz_com@A": (3.0, 0.4)}, shifts={"Ixz_com@A": 0.3})
    lean = 1.96 * np.radians(0.25) * 8.0  # Izz - Ixx
    assert half["Ixz_com@A"] == pytest.approx(np.sqrt(0.4**2 + 0.3**2 + 0.6**2 + lean**2))
    assert widened({"Ixy_com@A": (3.0, 0.4)})["Ixy_com@A"] == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("name", "size"),
    [
        *((name, 1.4 * 0.25 / 50) for name in ("msx@A", "msy@A", "msz@A")),
        *((name, 0.25 / 50) for name in ("com_x@A", "com_z@A", "rotor_center_x@A", "twist@A")),
        ("drag_moment_xy@A", 0.3 * 1.4 * 0.25 / 5),
        ("drag_x@A", 0.3 * 1.4),
        ("turn_damping_y@A", 0.3 * 1.4 * 0.25**2),
        ("translational_lift", 0.1 * 1.4),
        ("inflow", 0.3 * 1.4 / 2000.0),
        ("torque_offset_z@A", 1.4 * 9.80665 * 0.25 / 50),
        ("accel_bias_x@A", 0.2),
        ("rotor_drag", 0.3 * 1.4 / 2000.0),
        ("Jr", 0.01),
        ("Jr_over_Izz@A", 1e-3),
        ("Ixy@A", 4.0 / 20),
        ("Ixz_com@A", np.sqrt(20.0) / 20),
        ("Iyz_com@A", np.sqrt(80.0) / 20),
        ("kt", 0.0),
        ("Ixx_com@A", 0.0),
    ],
)
def test_sizes_that_matter_are_those_of_the_method(name, size):
    """Mass 1.4 kg, arm 0.25 m, four rotors at 500 rad/s in hover, inertia 2, 8, 10."""
    numbers = numbers_of({**DIAGONAL, "hover_speed@A": (500.0, 0.0)})
    found = number_scale(numbers, name, mass=1.4, vehicle=made_fit.QUAD)
    assert found == pytest.approx(size, rel=1e-9)


HANGING = {
    "kt": (1.0, 0.1), "kd": (1.0, 0.2), "Izz_com@A": (4.0, 0.4), "Izz_com@B": (5.0, 0.5),
    "com_z@A": (0.02, 0.003), "com_z@B": (0.02, 0.003), "msz@B": (0.04, 0.004),
}  # fmt: skip
YAWED = {"yaw@A": 50.0, "yaw@B": 50.0}
A_ALONE = {"roll@A": 5.01, "pitch@A": 0.1, "roll@B": 4.99, "pitch@B": 0.1, **YAWED}
LITTLE = {**A_ALONE, "roll@A": 4.98}
NEITHER = {**A_ALONE, "roll@A": 1.49, "roll@B": 1.48}


def hanging(rho, payload=False):
    more = {"payload": (PointMass(mass=0.1, position=(0.1, 0.0, 0.0)),), "payload_of": "A"}
    bodies = [
        made_fit.configuration("A", mass=1.0),
        made_fit.configuration("B", mass=2.0, **(more if payload else {})),
    ]
    found = coupling_uncertainty(numbers_of(HANGING, rho), bodies)
    return dict(zip(found.names, found.half_width.tolist(), strict=True))


def test_the_scale_of_yaw_depends_on_the_best_flown_of_all_turns():
    """A rho above 5 anywhere is enough; then it is as long as the interval of the inverse."""
    half = hanging(A_ALONE)
    assert half["kd"] == pytest.approx(0.2 / (1.0 - 0.2**2))
    assert half["Izz_com@B"] == pytest.approx(0.5 / (1.0 - 0.1**2))
    half = hanging(LITTLE)
    kd = np.hypot(0.2, 3.0 / 7.99)
    assert half["kd"] == pytest.approx(kd / (1.0 - kd**2))
    half = hanging(NEITHER)
    assert half["kd"] == half["Izz_com@A"] == half["Izz_com@B"] == np.inf
    assert half["kt"] == 0.1


def of_yaw(relative):
    """Return what hangs on the scale of yaw, known to a share, of a body with I_zz at a tenth."""
    moments = {"Ixx_com@A": (20.0, 0.0), "Iyy_com@A": (20.0, 0.0), "Izz_com@A": (4.0, 4 * relative)}
    scaled = {"kd": (1.0, relative), "Jr": (0.01, 0.03)}
    shares = {"twist@A": (0.001, 0.002), "Ixz_com@A": (0.1, 0.2)}
    rho = {**A_ALONE, "pitch@A": 50.0}
    numbers = numbers_of({**moments, **scaled, **shares}, rho)
    found = coupling_uncertainty(numbers, [made_fit.configuration()])
    return dict(zip(found.names, found.half_width.tolist(), strict=True))


def test_twist_and_products_are_on_the_scale_of_yaw():
    half = of_yaw(0.6)
    for name, own in {"Jr": 0.03, "twist@A": 0.002, "Ixz_com@A": 0.2}.items():
        assert half[name] == pytest.approx(own / (1.0 - 0.6**2))


def test_where_the_scale_of_yaw_is_lost_only_izz_has_a_bound():
    """From a relative half-width of .62 on, that of the inverse reaches zero; I_zz is below 40."""
    half = of_yaw(0.63)
    assert half["kd"] == half["Izz_com@A"] == half["Jr"] == np.inf
    assert half["twist@A"] == pytest.approx(0.002 * 40.0 / 4.0)
    assert half["Ixz_com@A"] == pytest.approx(0.2 * 40.0 / 4.0)


def test_heights_depend_on_the_turns_of_their_own_configuration():
    half = hanging(A_ALONE)
    assert half["com_z@A"] == 0.003
    assert half["com_z@B"] == pytest.approx(np.hypot(0.003, 0.02 * 3.0 / 7.99))
    assert half["msz@B"] == pytest.approx(np.hypot(0.004, 0.04 * 3.0 / 7.99))
    half = hanging(NEITHER)
    assert half["com_z@A"] == half["com_z@B"] == half["msz@B"] == np.inf


def test_a_known_payload_gives_the_scale_and_shares_the_height():
    half = hanging(A_ALONE, payload=True)
    assert (half["com_z@A"], half["com_z@B"], half["msz@B"]) == (0.003, 0.003, 0.004)
    half = hanging(NEITHER, payload=True)
    assert half["kd"] == pytest.approx(0.2 / (1.0 - 0.2**2))
    assert half["com_z@A"] == half["com_z@B"] == np.inf


def test_flights_that_do_not_count_for_an_axis_leave_it_alone():
    """Roll of the second flight counts in its mean alone: rho is that of the first one."""
    bands = [(0.0, 0.3), (1.0, 2.0)] * 2
    factors = made_fit.blocks(bands, rows=[7, 10] * 2, source=[0, 0, 1, 1])
    counted = np.ones((4, 6), dtype=bool)
    counted[3, 3] = False
    body = made_fit.configuration(factors=factors, counted=counted)
    signal = np.array([1.0, 61.0, 1.0, 1.0])[:, None] * np.ones((4, 6))
    fit = made_fit.fit_of([body], std={}, powers=(signal, np.ones((4, 6))))
    found = weighed_excitation(fit, [body])
    assert found == pytest.approx({"roll@A": 60.0, "pitch@A": 30.0, "yaw@A": 30.0})


def test_a_short_lively_phase_of_a_calm_flight_is_what_counts():
    """Of 40 rows 10 at a rho of 60, the rest at none: 15 by block, 2.4 as a whole."""
    factors = made_fit.blocks([(1.0, 2.0)] * 2, rows=[10, 30])
    body = made_fit.configuration(factors=factors)
    residual = np.array([[1.0], [24.0]]) * np.ones((2, 6))
    fit = made_fit.fit_of([body], std={}, powers=([[61.0], [24.0]] * np.ones((2, 6)), residual))
    assert weighed_excitation(fit, [body]) == pytest.approx(dict.fromkeys(RHO, 15.0))
    assert excitation(fit, [body]) == pytest.approx(dict.fromkeys(RHO, 60.0 / 25.0))
    found = joint_numbers(fit, [body], {"A": 0.0})
    assert found.excitation == pytest.approx(dict.fromkeys(RHO, 2.4))
    assert found.judged.excitation == pytest.approx(dict.fromkeys(RHO, 15.0))
    assert half_of(found, "kd_over_Izz@A") < 1e-6  # no allowance, as by 15
    lively = [[19.0], [24.0]] * np.ones((2, 6))
    little = made_fit.fit_of([body], std={}, powers=(lively, residual))  # 4.5 by block: not enough
    calm = joint_numbers(little, [body], {"A": 0.0})
    assert half_of(calm, "kd_over_Izz@A") == np.inf  # as by the whole flight, 0.72
    assert calm.judged.excitation == calm.excitation


def half_of(numbers, name):
    return numbers.number(name)[1]


def test_all_terms_stand_together_in_the_interval_of_a_flight():
    """Ixx of one body, its CoM in the origin: chance, answer and mass, as squares."""
    body = made_fit.configuration()
    fit = made_fit.fit_of([body], std={"Ixx@A": 1e-4, "msx@A": 1e-12})
    shifts = 2e-4 * np.eye(FREE)[[fit.estimate.names.index("Ixx@A")]]
    fit = made_fit.moved_by_responses(fit, shifts)
    origin = replace(fit.estimate, values=at_origin(fit))
    numbers = joint_numbers(replace(fit, estimate=origin), [body], {"A": 0.014})
    half = numbers.half_width[numbers.index("Ixx_com@A")]
    parts = (T_10 * LEFT * 1e-4, 2e-4, 0.01 * 0.0196)
    assert half == pytest.approx(np.linalg.norm(parts), rel=1e-3)


def at_origin(fit):
    keep = [not name.startswith("ms") for name in fit.estimate.names]
    return fit.estimate.values * keep


GROUPED = replace(
    made_fit.QUAD,
    rotors=tuple(
        replace(rotor, group="front" if number % 2 else "back")
        for number, rotor in enumerate(made_fit.QUAD.rotors)
    ),
)
EVERY_TERM = tuple(term.name for term in TERMS if term.dropped is not None)


@pytest.mark.parametrize("flights", [1, 3])
@pytest.mark.parametrize("vehicle", [made_fit.QUAD, GROUPED])
def test_slopes_of_numbers_are_those_of_every_parameter(vehicle, flights):
    """Parameters that are numbers themselves are not moved: nothing else may depend on them."""
    source = np.repeat(np.arange(flights), 12 // flights)
    factors = made_fit.blocks([(1.0, 2.0)] * 12, source=source)
    load = PointMass(mass=0.2, position=(0.0, 0.0, -0.1), mass_std=1e-3, position_std=1e-3)
    bodies = [
        made_fit.configuration(vehicle=vehicle, factors=factors),
        made_fit.configuration("B", vehicle=vehicle, mass=1.6, payload=(load,), payload_of="A"),
    ]
    fit = made_fit.fit_of(bodies, std={}, terms=EVERY_TERM)
    mapped, rng = fit.problem.map, np.random.default_rng(flights)
    off = fit.estimate.values + 1e-3 * rng.normal(size=len(mapped.names)) * fit.estimate.values
    off = np.where(off == 0.0, 1e-3 * rng.normal(size=len(off)), off)
    estimate = replace(fit.estimate, values=off)
    names = tuple(module.physical(off, mapped, bodies))
    expected = numerical_jacobian(
        lambda phi: np.array(list(module.physical(phi, mapped, bodies).values())),
        off,
        estimate.std,
    )
    found = module.slopes_of_numbers(names, off, estimate.std, mapped, bodies)
    size = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(found, expected, atol=1e-6 * size.max(), rtol=1e-5)
    assert (found != 0.0).sum() > len(mapped.names) - 6 * flights * len(bodies)
