"""What the autopilot does about errors of roll, pitch, yaw and climb, as the likelihood is told."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import made_fit
from rotorfit.estimation.factors import Factors, triangular_factors
from rotorfit.fit.joint.joint_problem import (
    NOISY,
    closed_loop_responses,
    joint_problem,
    lateness,
    nominal_response,
)
from rotorfit.fit.reduction.motor_timing import FreeTiming
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.model.regressor import regressor
from rotorfit.model.signals import signal_matrix

ROLL, PITCH, YAW = (NOISY.index(name) for name in ("dwx", "dwy", "dwz"))
BANDS = [(0.0, 0.3), (1.0, 2.0), (3.0, 4.0)]
TURNS = 2.0 * np.pi * np.array([0.15, 1.5, 3.5])
SPEEDS = np.array([400.0, 500.0, 500.0, 600.0])
AT = MotorResponse(lag=0.03, delay=0.01, lag_down=0.05)


def hovering(vehicle=made_fit.QUAD):
    """Factors of a hover at `SPEEDS` with the bands above."""
    layout = regressor(vehicle).layout
    Z = np.zeros((3, 30, len(layout)))
    Z[0, :, layout.index("one")] = 1.0
    for number, speed in enumerate(SPEEDS, start=1):
        Z[0, :, layout.index(f"O2_{number}")] = speed**2
    return Factors(
        R=triangular_factors(Z),
        rows=np.array([10, 20, 30]),
        segment=np.zeros(3, dtype=np.int64),
        band=np.array(BANDS),
    )


def steered(vehicle=made_fit.QUAD, **more):
    """A body whose roll is flown in the second band alone, pitch nowhere, yaw in both."""
    counted = np.ones((3, 6), dtype=bool)
    with_response = np.zeros((3, 3), dtype=bool)
    with_response[1, 0] = with_response[1:, 2] = True
    counted[2, ROLL] = False
    return made_fit.configuration(
        vehicle=vehicle,
        factors=hovering(vehicle),
        counted=counted,
        with_response=with_response,
        **more,
    )


def test_a_response_is_a_rate_loop_inside_an_attitude_loop():
    """Roll and pitch where they are flown; of yaw nothing is taken for granted over 0.3 Hz."""
    share = closed_loop_responses(steered()).complementary_sensitivity
    loop = 25.0 / (1j * TURNS[1]) * (1.0 + 6.0 / (1j * TURNS[1]))
    assert share[:, 0] == pytest.approx([0.0, loop / (1.0 + loop), 0.0])
    assert (share[:, 1:3] == 0.0).all()
    assert np.angle(share[1, 0]) < 0.0  # later than the error


def test_an_altitude_hold_responds_to_the_climb_in_every_band():
    share = closed_loop_responses(steered()).complementary_sensitivity
    assert share[:, 3] == pytest.approx(4.0 / (4.0 + 1j * TURNS))


def test_every_autopilot_responds_to_slow_yaw():
    answered = np.zeros((3, 3), dtype=bool)
    answered[0, 2] = True
    share = closed_loop_responses(
        replace(steered(), with_response=answered)
    ).complementary_sensitivity
    assert share[0, 2] == pytest.approx(3.0 / (3.0 + 1j * TURNS[0]))
    assert np.count_nonzero(share[:, :3]) == 1


def test_response_is_full_at_low_and_zero_at_high_frequency():
    assert nominal_response(np.array([0.0, 0.01])) == pytest.approx([1.0, 1.0], abs=1e-5)
    assert nominal_response(np.array([1e5])) == pytest.approx(25.0 / 1e5j, rel=1e-3)


def test_all_of_a_response_is_open_on_every_axis_flown_or_not():
    answer, open_share = nominal_response(TURNS), closed_loop_responses(steered()).uncertainty
    np.testing.assert_allclose(open_share[:, :3], np.tile(answer[:, None], (1, 3)))
    np.testing.assert_allclose(open_share[:, 3], 4.0 / (4.0 + 1j * TURNS))


def test_rows_that_count_may_be_responded_to_but_for_trim():
    """The first band has the mean beside nine other rows."""
    rows = closed_loop_responses(steered()).rows.tolist()
    assert rows == [[9, 9, 9, 9], [20, 20, 20, 20], [0, 30, 30, 30]]


def test_nobody_responds_where_that_was_not_looked_at():
    assert joint_problem([replace(steered(), with_response=None)]).feedback is None
    feedback = joint_problem([steered()]).feedback
    layout = regressor(made_fit.QUAD).layout
    assert [NOISY[e] for e in feedback.errors] == ["dwx", "dwy", "dwz", "az"]
    assert [layout.names[i] for i in feedback.inputs] == ["O2_1", "O2_2", "O2_3", "O2_4", "dHz"]


@given(
    turn=st.floats(0.1, 200.0),
    lag=st.floats(1e-3, 0.2),
    delay=st.floats(-0.1, 0.1),
    name=st.sampled_from(["motor_lag", "motor_delay"]),
)
def test_lateness_is_the_derivative_of_the_motors_response(turn, lag, delay, name):
    def logarithm(lag, delay):
        return -1j * turn * delay - np.log(1.0 + 1j * turn * lag)

    h = 1e-5 * lag
    step = {"motor_lag": (h, 0.0), "motor_delay": (0.0, h)}[name]
    slope = logarithm(lag + step[0], delay + step[1]) - logarithm(lag - step[0], delay - step[1])
    found = lateness(name, np.array([turn]), MotorResponse(lag=lag, delay=delay))
    assert found[0] == pytest.approx(slope / (2.0 * h), rel=1e-4)


def test_every_free_time_has_its_lateness_in_its_own_place():
    """Of two lags the mean; a skew delays nothing, and climbs tell no time: pilots hold them."""
    names = ("motor_delay", "motor_skew", "motor_lag")
    late = closed_loop_responses(steered(timing=FreeTiming(at=AT, names=names))).log_effect_slopes
    for turned in np.moveaxis(late, 1, 0)[:3]:
        assert turned[:, 0] == pytest.approx(-1j * TURNS)
        assert (turned[:, 1] == 0.0).all()
        assert turned[:, 2] == pytest.approx(-1j * TURNS / (1.0 + 0.04j * TURNS))
    assert (late[:, 3] == 0.0).all()
    assert closed_loop_responses(steered()).log_effect_slopes.shape == (3, 4, 0)


def moved_signals(vehicle, direction, turn):
    """Return the amplitudes of the signals when squared speeds swing along a direction."""
    time = np.arange(4000) * (2.0 * np.pi / turn / 200.0)
    wave = 1e-3 * SPEEDS.mean() ** 2 * np.exp(1j * turn * time)[:, None] * direction
    speed = np.sqrt(SPEEDS**2 + wave.real)
    prepared = made_fit.prepared(seconds=40.0, rate=100.0)
    data = replace(
        prepared.data,
        time=time,
        rotor_speed=speed,
        rotor_acceleration=(1j * turn * wave).real / (2.0 * speed),
        angular_velocity=np.zeros((4000, 3)),
    )
    Z = signal_matrix(data, vehicle, 0, 4000)
    return 2.0 * np.exp(-1j * turn * time) @ Z / 4000


@pytest.mark.parametrize("error", [0, 1, 2, 3])
@pytest.mark.parametrize("block", [1, 2])
def test_rotors_that_are_moved_move_the_signals_so(error, block):
    """Squared speeds by the mixer, and the spin-up that goes with them, phase and sign."""
    layout = regressor(made_fit.QUAD).layout
    moves = closed_loop_responses(steered()).moves[block, error]
    found = moved_signals(made_fit.QUAD, moves[:4].real, TURNS[block])
    inputs = [layout.index(f"O2_{i}") for i in (1, 2, 3, 4)] + [layout.index("dHz")]
    np.testing.assert_allclose(
        found[inputs] / found[inputs[0]],
        moves / moves[0],
        rtol=2e-3,
        atol=2e-3 * abs(moves[4] / moves[0]) if error == 2 else 1e-3,
    )


@pytest.mark.parametrize(("error", "other"), [(0, 1), (1, 0), (2, 0), (3, 0), (3, 2)])
def test_a_response_moves_its_own_axis_alone(error, other):
    """By torques of the arms and spins, which of a square of arms are orthogonal."""
    moves = closed_loop_responses(steered()).moves[1].real[:, :4]
    assert moves[error] @ moves[other] == pytest.approx(0.0, abs=1e-12)
    assert moves[:3].sum(axis=1) == pytest.approx(0.0, abs=1e-12)
    x, y = made_fit.QUAD.positions[:, :2].T
    np.testing.assert_allclose(moves, [y, -x, made_fit.QUAD.spins, np.ones(4)], atol=1e-12)


def test_rotors_that_lean_take_no_spin_up():
    lean = (0.1, 0.0, float(np.sqrt(0.99)))
    tilted = replace(
        made_fit.QUAD, rotors=tuple(replace(r, axis=lean) for r in made_fit.QUAD.rotors)
    )
    assert (closed_loop_responses(steered(tilted)).moves[:, :, 4] == 0.0).all()
