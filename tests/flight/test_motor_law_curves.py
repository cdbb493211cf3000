import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorfit.errors import LogError
from rotorfit.findings import sentences
from rotorfit.logs.motor_law import (
    MotorLaw,
    PolynomialCurve,
    PowerCurve,
    SquareRootCurve,
    TableCurve,
    VoltageFactor,
    law_doubts,
    speed_from_command,
)

COMMANDS = np.linspace(0, 1, 41)[:, None] * np.ones(4)
TABLE = TableCurve((0.1, 0.4, 0.9), (100.0, 500.0, 800.0))

# Plain numbers, made laws in the test: the checks of their types draw random numbers.
curves = st.one_of(
    st.tuples(st.just("line"), st.tuples(st.floats(-500, 500), st.floats(1, 4e3))),
    st.tuples(st.just("root"), st.tuples(st.floats(1, 5e3), st.floats(0, 1))),
    st.tuples(
        st.just("table"),
        st.lists(st.tuples(st.floats(0.001, 1), st.floats(0.1, 900)), min_size=2, max_size=6),
    ),
)


def law_of(kind, numbers) -> MotorLaw:
    if kind == "line":
        return MotorLaw(curve=PolynomialCurve(numbers))
    if kind == "root":
        return MotorLaw(curve=SquareRootCurve(*numbers))
    commands, speeds = np.cumsum(numbers, axis=0).T.tolist()
    return MotorLaw(curve=TableCurve(tuple(c / commands[-1] for c in commands), tuple(speeds)))


def doubts_of(law, command):
    return sentences(law_doubts(law, command))


def test_a_polynomial():
    speed = speed_from_command(COMMANDS, MotorLaw(curve=PolynomialCurve((50.0, 900.0, -100.0))))
    assert speed == pytest.approx(50 + 900 * COMMANDS - 100 * COMMANDS**2)
    line = MotorLaw(curve=PolynomialCurve((0.0, 1.0)))
    assert speed_from_command(COMMANDS, line) == pytest.approx(COMMANDS)


def test_below_its_dead_zone_a_rotor_stands():
    speed = speed_from_command(COMMANDS, MotorLaw(curve=PolynomialCurve((-100.0, 1000.0))))
    assert speed == pytest.approx(np.maximum(1000 * COMMANDS - 100, 0))
    assert (speed >= 0).all()


def test_a_table_is_linear_between_its_rows_and_level_beyond():
    u = np.array([[0.0, 0.1, 0.25, 0.4, 0.65, 0.9, 1.0]])
    speed = speed_from_command(u, MotorLaw(curve=TABLE))
    assert speed[0] == pytest.approx([100, 100, 300, 500, 650, 800, 800])


@given(full=st.floats(1, 5000), f=st.floats(0, 1), u=st.floats(0, 1))
def test_the_square_of_a_square_root_law_is_the_thrust(full, f, u):
    speed = speed_from_command(np.array([[u]]), MotorLaw(curve=SquareRootCurve(full, f)))[0, 0]
    assert (speed / full) ** 2 == pytest.approx(f * u * u + (1 - f) * u, rel=1e-12, abs=1e-300)


def test_a_square_root_law_begins_and_ends_at_its_commands():
    """ArduPilot: u = (command - MOT_SPIN_MIN) / (MOT_SPIN_MAX - MOT_SPIN_MIN)."""
    law = MotorLaw(curve=SquareRootCurve(10.0, 0.65, 0.15, 0.95))
    speed = speed_from_command(np.array([[0.1, 0.15, 0.55, 0.95, 1.0]]), law)[0]
    middle = 10.0 * np.sqrt(0.65 * 0.25 + 0.35 * 0.5)
    assert speed == pytest.approx([0.0, 0.0, middle, 10.0, 10.0])


def test_square_root_law_ends_are_square_root_and_line():
    assert speed_from_command(
        COMMANDS, MotorLaw(curve=SquareRootCurve(900.0, 1.0))
    ) == pytest.approx(900 * COMMANDS)
    assert speed_from_command(
        COMMANDS, MotorLaw(curve=SquareRootCurve(900.0, 0.0))
    ) == pytest.approx(900 * np.sqrt(COMMANDS))
    below = speed_from_command(np.array([[-0.1]]), MotorLaw(curve=SquareRootCurve(900.0, 0.3)))
    assert below[0, 0] == 0


@given(curve=curves, command=st.lists(st.floats(0, 1), min_size=2, max_size=30))
def test_more_command_is_never_less_speed(curve, command):
    u = np.sort(command)[:, None]
    speed = speed_from_command(u, law_of(*curve))[:, 0]
    assert (speed >= 0).all()
    assert (np.diff(speed) >= -1e-9 * speed.max()).all()


@given(curve=curves, voltage=st.floats(2.5, 30), exponent=st.floats(0.1, 2))
def test_the_speed_goes_with_a_power_of_the_voltage(curve, voltage, exponent):
    plain = law_of(*curve)
    law = dataclasses.replace(plain, voltage=VoltageFactor(4.2, exponent))
    battery = np.full((len(COMMANDS), 1), voltage)
    expected = speed_from_command(COMMANDS, plain) * (voltage / 4.2) ** exponent
    assert speed_from_command(COMMANDS, law, battery=battery) == pytest.approx(expected)


def test_the_voltage_is_that_of_each_instant():
    law = MotorLaw(curve=PolynomialCurve((0.0, 100.0)), voltage=VoltageFactor(4.0, 1.0))
    speed = speed_from_command(np.ones((3, 2)), law, battery=np.array([[4.0], [3.0], [-1.0]]))
    assert speed.tolist() == [[100, 100], [75, 75], [0, 0]]


def test_a_voltage_factor_without_voltage_is_refused():
    law = MotorLaw(curve=TABLE, voltage=VoltageFactor(4.2, 1.0))
    with pytest.raises(LogError, match="voltage factor, but there is no battery voltage"):
        speed_from_command(COMMANDS, law)


def test_an_optional_voltage_factor_is_one_without_voltage():
    plain = MotorLaw(curve=TABLE)
    law = dataclasses.replace(plain, voltage=VoltageFactor(4.2, 1.0, missing_std=0.04))
    assert (speed_from_command(COMMANDS, law) == speed_from_command(COMMANDS, plain)).all()
    half = speed_from_command(COMMANDS, law, battery=np.full((len(COMMANDS), 1), 2.1))
    assert half == pytest.approx(0.5 * speed_from_command(COMMANDS, plain))


def test_commands_beyond_a_table_are_doubted(assert_wording):
    (doubt,) = doubts_of(MotorLaw(curve=TABLE), COMMANDS)
    assert doubt.startswith("19.5 %")
    assert "commands (0 to 1)" in doubt
    assert_wording(doubt)
    assert "(0.1 to 0.9)" in doubt
    assert doubts_of(MotorLaw(curve=TABLE), COMMANDS[4:37]) == ()
    assert len(doubts_of(MotorLaw(curve=TABLE), COMMANDS[3:37])) == 1


def test_a_law_that_falls_where_it_is_used_is_doubted(assert_text):
    law = MotorLaw(curve=PolynomialCurve((0.0, 1000.0, -1000.0)))  # falls from 0.5
    assert doubts_of(law, COMMANDS[:21]) == ()
    assert_text(doubts_of(law, COMMANDS)[0])
    assert doubts_of(MotorLaw(curve=SquareRootCurve(900.0, 0.3)), COMMANDS) == ()


@given(full=st.floats(100, 5000), b=st.floats(-0.3, 0.5), p=st.floats(0.3, 1.5))
def test_a_power_law_has_its_ends_and_its_dead_zone(full, b, p):
    speed = speed_from_command(COMMANDS, MotorLaw(curve=PowerCurve(full, b, p)))
    assert speed[-1, 0] == pytest.approx(full)
    assert speed[0, 0] == pytest.approx(full * max(b, 0.0) ** p)
    assert (np.diff(speed[:, 0]) >= 0.0).all()
    assert doubts_of(MotorLaw(curve=PowerCurve(full, b, p)), COMMANDS) == ()
