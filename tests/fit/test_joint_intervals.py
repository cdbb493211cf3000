"""Every term of an interval of the joint estimate, by hand: none may be halved or doubled."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.experiment.payload import PointMass
from rotorfit.fit.joint_numbers import (
    Numbers,
    _with_systematic,
    excitation,
    hanging_on_roll_and_pitch,
    joint_numbers,
    number_scale,
)

FREE = 12
"""Parameters of `made_fit.fit_of` with one configuration: two blocks' worth, at six signals."""
EVEN = np.tile([1.0, -1.0], 6)
T_10, T_3, T_2 = 2.228, 3.182, 4.303
"""Two-sided 95 % of Student's t, from the printed tables."""


def half_width(fit, configurations, name="kt", mass_std=0.0):
    numbers = joint_numbers(fit, configurations, {c.name: mass_std for c in configurations})
    return float(numbers.half_width[numbers.index(name)])


def test_without_scatter_an_interval_is_that_of_the_covariance():
    body = made_fit.configuration()
    fit = made_fit.fit_of([body], std={"kt": 1e-8})
    assert len(fit.estimate.names) == FREE
    assert half_width(fit, [body]) == pytest.approx(1.96e-8, rel=1e-6)
    assert half_width(fit, [body], "com_x@A") == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("offset", [0.0, 5e-9])
def test_scatter_of_blocks_is_a_jackknife_with_the_t_of_what_is_left(offset):
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


def test_the_wider_of_covariance_and_scatter_counts_alone():
    body = made_fit.configuration()
    fit = made_fit.fit_of([body], std={"kt": 4e-8}, influence={"kt": 1e-8 * EVEN})
    assert half_width(fit, [body]) == pytest.approx(8.83e-8, rel=1e-3)
    fit = made_fit.fit_of([body], std={"kt": 5e-8}, influence={"kt": 1e-8 * EVEN})
    assert half_width(fit, [body]) == pytest.approx(9.8e-8, rel=1e-3)


def of_flights(name, flights):
    """Return a configuration with four blocks a flight."""
    source = np.repeat(np.arange(flights), 4)
    return made_fit.configuration(
        name, factors=made_fit.blocks([(1.0, 2.0)] * len(source), source=source)
    )


@pytest.mark.parametrize("offset", [0.0, 7e-8])
def test_three_flights_that_differ_widen_an_interval(offset):
    """Pulls of -d, 0 and d: their variance times three is 3 d^2, with two degrees of freedom."""
    body = of_flights("A", 3)
    pulls = np.repeat([-4e-8, 0.0, 4e-8], 4) + offset
    fit = made_fit.fit_of([body], std={}, influence={"kt": pulls / 4})
    assert half_width(fit, [body]) == pytest.approx(T_2 * np.sqrt(3.0) * 4e-8, rel=1e-3)


def test_two_flights_tell_nothing_of_how_flights_differ():
    body = of_flights("A", 2)
    pulls = np.repeat([-4e-8, 4e-8], 4)
    fit = made_fit.fit_of([body], std={}, influence={"kt": pulls / 4})
    blocks_alone = 2.447 * np.sqrt(8 * 8 / 7 * 8 / 6) * 1e-8  # t of 6
    assert half_width(fit, [body]) == pytest.approx(blocks_alone, rel=1e-3)


@pytest.mark.parametrize("order", [(3, 4), (4, 3)])
def test_flights_of_two_configurations_add_and_the_fewest_set_the_degrees(order):
    bodies = [of_flights(name, count) for name, count in zip("AB", order, strict=True)]
    parts = {3: [-4e-8, 0.0, 4e-8], 4: [-3e-8, 3e-8, -3e-8, 3e-8]}
    pulls = np.repeat([*parts[order[0]], *parts[order[1]]], 4)
    fit = made_fit.fit_of(bodies, std={}, influence={"kt": pulls / 4})
    variance = 3 / 2 * 2 * 4e-8**2 + 4 / 3 * 4 * 3e-8**2
    assert half_width(fit, bodies) == pytest.approx(T_2 * np.sqrt(variance), rel=1e-3)


def test_four_flights_have_three_degrees_of_freedom():
    body = of_flights("A", 4)
    pulls = np.repeat([-3e-8, 3e-8, -3e-8, 3e-8], 4)
    fit = made_fit.fit_of([body], std={}, influence={"kt": pulls / 4})
    assert half_width(fit, [body]) == pytest.approx(T_3 * np.sqrt(16 / 3) * 3e-8, rel=1e-3)


def test_excitation_is_what_the_rotors_explain_over_the_rest_in_the_pilots_band():
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
    # roll: (12 + 40) / 2 in 10 shares of the first flight, 12 / 2 in 30 of the second.
    expected = {"roll@A": (26.0 * 10 + 6.0 * 30) / 40, "pitch@A": 8.0, "yaw@A": 0.0}
    assert found == pytest.approx(expected)


RHO = {"roll@A": 13.5, "pitch@A": 28.5, "yaw@A": 12.0}


def numbers_of(entries, rho=RHO):
    """Return numbers (name: value, half-width)."""
    values, half = np.array(list(entries.values()), dtype=float).T
    return Numbers(
        names=tuple(entries),
        values=values,
        half_width=half,
        correlation=np.eye(len(values)),
        excitation=rho,
    )


DIAGONAL = {"Ixx_com@A": (2.0, 0.3), "Iyy_com@A": (8.0, 0.0), "Izz_com@A": (10.0, 0.0)}


def widened(entries, *, mass_std=0.0, rho=RHO, bodies=None):
    numbers = numbers_of({**DIAGONAL, **entries}, rho)
    bodies = bodies or [made_fit.configuration()]
    stds = {c.name: mass_std for c in bodies} if isinstance(mass_std, float) else mass_std
    found = _with_systematic(numbers, bodies, stds)
    return dict(zip(found.names, found.half_width.tolist(), strict=True))


def test_chance_pull_and_mass_add_as_squares():
    """Ixx = 2 at a rho of 13.5: a tenth of it is the pull; 1 % of the mass is 1.96 % of it."""
    half = widened({}, mass_std=0.014)
    assert half["Ixx_com@A"] == pytest.approx(np.sqrt(0.3**2 + 0.2**2 + 0.0392**2), rel=1e-9)
    assert half["Iyy_com@A"] == pytest.approx(np.sqrt(0.4**2 + 0.1568**2), rel=1e-9)
    assert half["Izz_com@A"] == pytest.approx(np.sqrt(2.0**2 + 0.196**2), rel=1e-9)


def test_what_is_free_of_the_mass_is_free_of_its_deviation():
    half = widened({"com_x@A": (0.01, 1e-3), "Ixx_over_kt@A": (5.0, 0.0)}, mass_std=0.014)
    assert half["com_x@A"] == pytest.approx(1e-3, rel=1e-12)
    assert half["Ixx_over_kt@A"] == pytest.approx(0.5, rel=1e-9)


def test_a_shared_number_hangs_on_the_least_known_mass():
    bodies = [made_fit.configuration("A", mass=1.0), made_fit.configuration("B", mass=2.0)]
    half = widened({"kt": (1.0, 0.0)}, mass_std={"A": 0.01, "B": 0.06}, bodies=bodies)
    assert half["kt"] == pytest.approx(1.96 * 0.03)


def test_a_shared_number_goes_by_the_configuration_that_yaws_most():
    rho = {**RHO, "yaw@B": 27.0}
    half = widened({"kd": (1.0, 0.0), "kd_over_Izz@A": (1.0, 0.0)}, rho=rho)
    assert half["kd"] == pytest.approx(0.1)  # 3 / (27 + 3)
    assert half["kd_over_Izz@A"] == pytest.approx(1.5 / 10.5)


def test_a_number_near_zero_is_pulled_as_one_that_matters():
    """Jr: 1/1000 of Izz = 10; its pull at a rho of 12 is a fifth. Ixy: sqrt(16) / 20, a tenth."""
    half = widened({"Jr": (0.0, 0.0), "Ixy_com@A": (0.0, 0.0)})
    assert half["Jr"] == pytest.approx(0.2 * 0.01)
    assert half["Ixy_com@A"] == pytest.approx(0.1 * 0.2)
    assert widened({"Jr": (0.5, 0.0)})["Jr"] == pytest.approx(0.1)


def test_products_of_yaw_are_allowed_what_their_equation_leaves_open():
    """Ixz = 3 is pulled with roll by a tenth, and with yaw by 3 / (12 + 3)."""
    half = widened({"Ixz_com@A": (3.0, 0.4)})
    assert half["Ixz_com@A"] == pytest.approx(np.sqrt(0.4**2 + 0.3**2 + 0.6**2))


def test_the_rotors_drag_is_allowed_what_the_autopilot_damps():
    """At a rho of 15 the half-width doubles; the pull is a sixth of 0.3 of the mass a second."""
    rho = {**RHO, "yaw@A": 15.0}
    half = widened({"rotor_drag": (0.0, 1e-4), "hover_speed@A": (500.0, 0.0)}, rho=rho)
    pull = 0.3 * 1.4 / (4 * 500.0) / 6.0
    assert half["rotor_drag"] == pytest.approx(np.hypot(2e-4, pull))


@pytest.mark.parametrize(
    ("name", "size"),
    [
        *((name, 1.4 * 0.25 / 50) for name in ("msx@A", "msy@A", "msz@A")),
        *((name, 0.25 / 50) for name in ("com_x@A", "com_z@A", "rotor_center_x@A", "twist@A")),
        ("drag_moment_xy@A", 0.3 * 1.4 * 0.25 / 5),
        ("drag_x@A", 0.3 * 1.4),
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


TWO = {"roll@A": 27.0, "pitch@A": 2.0, "roll@B": 3.0, "pitch@B": 12.0, "yaw@A": 50.0, "yaw@B": 50.0}
HANGING = {
    "kt": (1.0, 0.1), "kd": (1.0, 0.2), "Izz_com@A": (4.0, 0.0), "Izz_com@B": (5.0, 0.0),
    "com_z@A": (0.0, 0.003), "com_z@B": (0.0, 0.003), "msz@B": (0.0, 0.004),
}  # fmt: skip


def hanging(payload=False):
    more = {"payload": (PointMass(mass=0.1, position=(0.1, 0.0, 0.0)),), "payload_of": "A"}
    bodies = [
        made_fit.configuration("A", mass=1.0),
        made_fit.configuration("B", mass=2.0, **(more if payload else {})),
    ]
    found = hanging_on_roll_and_pitch(numbers_of(HANGING, TWO), bodies)
    return dict(zip(found.names, found.half_width.tolist(), strict=True))


def test_the_scale_of_yaw_hangs_on_the_best_flown_of_all_turns():
    """A rho of 27: a tenth, beside 0.2 of kd; then as long as the interval of the inverse."""
    half = hanging()
    kd = np.hypot(0.2, 0.1)
    assert half["kd"] == pytest.approx(kd / (1.0 - kd**2))
    assert half["Izz_com@A"] == pytest.approx(0.4 / (1.0 - 0.1**2))
    assert half["kt"] == 0.1


def test_heights_hang_on_the_turns_of_their_own_configuration():
    """Half an arm of 0.25 m over 27 (A) and over 12 (B)."""
    half = hanging()
    assert half["com_z@A"] == pytest.approx(np.hypot(0.003, 0.125 / 27))
    assert half["com_z@B"] == pytest.approx(np.hypot(0.003, 0.125 / 12))
    assert half["msz@B"] == pytest.approx(np.hypot(0.004, 2.0 * 0.125 / 12))


def test_a_known_payload_gives_the_scale_and_shares_the_height():
    half = hanging(payload=True)
    assert half["kd"] == pytest.approx(0.2 / (1.0 - 0.2**2))
    assert half["com_z@B"] == pytest.approx(np.hypot(0.003, 0.125 / 27))


def test_all_terms_stand_together_in_the_interval_of_a_flight():
    """Ixx of one body, its CoM in the origin: chance, pull and mass, as squares."""
    body = made_fit.configuration()
    fit = made_fit.fit_of([body], std={"Ixx@A": 1e-4, "msx@A": 1e-12})
    origin = replace(fit.estimate, values=at_origin(fit))
    numbers = joint_numbers(replace(fit, estimate=origin), [body], {"A": 0.014})
    half = numbers.half_width[numbers.index("Ixx_com@A")]
    parts = (1.96e-4, 0.01 * 1.5 / 101.5, 0.01 * 0.0196)  # a rho of 100
    assert half == pytest.approx(np.linalg.norm(parts), rel=1e-4)


def at_origin(fit):
    keep = [not name.startswith("ms") for name in fit.estimate.names]
    return fit.estimate.values * keep
