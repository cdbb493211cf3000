"""What is known of parameters before the flight, in figures: it is part of their intervals."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.estimation.factors import Factors, triangular_factors
from rotorfit.fit import row_fits
from rotorfit.fit.experiment.payload import PointMass
from rotorfit.fit.joint.joint_problem import joint_prior, joint_problem, rotor_speeds
from rotorfit.fit.reduction.motor_timing import FreeTiming
from rotorfit.fit.row_fits import fit_rows
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.model.regressor import regressor

MASS, G = 1.4, 9.80665
SPEEDS = np.array([400.0, 500.0, 500.0, 600.0])


def hovering(vehicle=made_fit.QUAD):
    """Factors of a hover at `SPEEDS`, in two stretches, with the mean in a band of its own."""
    layout = regressor(vehicle).layout
    Z = np.zeros((4, 30, len(layout)))
    Z[:2, :, layout.index("one")] = [[1.0], [2.0]]
    for number, speed in enumerate(SPEEDS, start=1):
        Z[:2, :, layout.index(f"O2_{number}")] = [[speed**2], [2.0 * speed**2]]
        Z[2:, :, layout.index(f"O2_{number}")] = 1e7
    return Factors(
        R=triangular_factors(Z),
        rows=np.full(4, 30),
        segment=np.array([0, 1, 0, 1]),
        band=np.array([[0.0, 0.3], [0.0, 0.3], [1.0, 2.0], [1.0, 2.0]]),
    )


def prior(vehicle=made_fit.QUAD, **more):
    return joint_prior(
        [made_fit.configuration(mass=MASS, vehicle=vehicle, factors=hovering(), **more)]
    )


def test_rotors_turn_as_fast_as_their_mean_square_says():
    body = made_fit.configuration(mass=MASS, factors=hovering())
    assert rotor_speeds(body) == pytest.approx(SPEEDS)


@pytest.mark.parametrize(
    ("name", "std"),
    [
        ("spread_2", 0.04),
        ("rotor_drag", 0.3 * MASS / 2000.0),
        ("accel_bias_x@A", 0.5),
        ("accel_bias_y@A", 0.5),
        ("accel_bias_z@A", 0.2),
        ("twist@A", np.radians(2.0) * 0.25),
        ("Ixx@A", 10.0 * MASS * 0.25**2),
        ("Iyz@A", 10.0 * MASS * 0.25**2),
        ("torque_offset_x@A", 0.05 * MASS * G * 0.25),
        ("drag_moment_yz@A", 0.3 * MASS * 0.25),
        ("turn_damping_x@A", 0.3 * MASS * 0.25**2),
        ("inflow", 0.4 * MASS / 2000.0),
        ("translational_lift", 0.05 * MASS),
    ],
)
def test_deviations_before_the_flight_are_those_of_the_method(name, std):
    assert prior()[name] == pytest.approx(std, rel=1e-9)


def test_groups_of_rotors_may_differ_by_a_tenth():
    groups = ("upper", "upper", None, None)
    rotors = [replace(r, group=g) for r, g in zip(made_fit.QUAD.rotors, groups, strict=True)]
    found = prior(replace(made_fit.QUAD, rotors=tuple(rotors)))
    assert [found[f"spread_{i}"] for i in (1, 2, 3, 4)] == [0.1, 0.1, 0.04, 0.04]


def test_a_payload_is_known_to_its_tolerances():
    item = PointMass(mass=0.1, position=(0.2, 0.0, 0.0), mass_std=5e-4, position_std=2e-3)
    found = prior(payload=(item,))
    assert found["payload_1_mass@A"] == 5e-4
    assert {found[f"payload_1_{axis}@A"] for axis in "xyz"} == {2e-3}


def test_a_known_thrust_coefficient_keeps_its_deviation():
    body = made_fit.configuration(mass=MASS, factors=hovering())
    problem = joint_problem([body], known={"kt": (2e-6, 3e-8)})
    means = {"kt": 2e-6, "inflow": pytest.approx(0.65 * MASS / 2000.0)}
    assert (problem.prior_mean, problem.prior_std["kt"]) == (means, 3e-8)
    assert "kt" not in joint_problem([body]).prior_std


def test_times_are_known_from_where_their_signals_were_made():
    """A lag of 35 give or take 30 ms, seen from 50; of a delay nothing is known."""
    timing = FreeTiming(at=MotorResponse(lag=0.05), names=("motor_lag", "motor_delay"))
    body = made_fit.configuration(mass=MASS, factors=hovering(), timing=timing)
    problem = joint_problem([body], known={"kt": (2e-6, 3e-8)})
    means = {"kt": 2e-6, "motor_lag": -0.015, "inflow": 0.65 * MASS / 2000.0}
    assert problem.prior_mean == pytest.approx(means)
    assert problem.prior_std["motor_lag"] == 0.03
    assert "motor_delay" not in problem.prior_std
    assert problem.moving == ("motor_lag", "motor_delay")
    assert set(problem.moving) <= set(problem.map.names)


def test_the_rows_take_small_terms_for_as_small_as_they_are(monkeypatch):
    """Forces: the bias times the mass. Roll and pitch: in shares of their inertia; then rotors."""
    seen = []
    reweighted = row_fits.reweighted

    def noting(problem, *, prior_std):
        fit = reweighted(problem, prior_std=prior_std)
        seen.append((prior_std, fit.estimate))
        return fit

    monkeypatch.setattr(row_fits, "reweighted", noting)
    R = triangular_factors(np.random.default_rng(0).normal(size=(8, 60, 24)))
    factors = replace(hovering(), R=R, rows=np.full(8, 60), segment=np.zeros(8, dtype=int),
                      band=np.tile([1.0, 2.0], (8, 1)))  # fmt: skip
    fit_rows(factors, regressor(made_fit.QUAD), mass=MASS)
    first_roll, first_pitch, first_yaw, force, roll, pitch, yaw = seen
    assert force[0] == pytest.approx({"Fx_0": 0.5 * MASS, "Fy_0": 0.5 * MASS, "Fz_0": 0.2 * MASS})
    small = {"difference": 1.0, "Ixy": 0.2, "Ixz": 0.2, "Iyz": 0.2, "Jr": 0.003}
    assert first_roll[0] == first_pitch[0] == small
    assert first_yaw[0] == yaw[0] == {}
    for (first, again), row in zip(((first_roll, roll), (first_pitch, pitch)), "xy", strict=True):
        spread = 0.015 * abs(first[1].value("kt"))
        own = {f"kt_{i}": spread for i in (1, 2, 3, 4)}
        assert again[0] == pytest.approx({**small, **own}), row
