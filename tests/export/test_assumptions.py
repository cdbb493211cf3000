"""What may be assumed, and how it is refused."""

import pytest

from rotorfit.export.result_numbers import parse_assumptions


def test_assumptions_are_numbers_by_name():
    found = parse_assumptions(["kd=3.7e-9", "Izz_com = 0.01", "com_z=-0.002"])
    assert found == {"kd": 3.7e-9, "Izz_com": 0.01, "com_z": -0.002}


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("kd", "'kd' is no assumption; write NAME=VALUE, such as kd=3.7e-9"),
        ("kd_=1", "nothing named 'kd_' can be assumed; did you mean kd"),
        ("windspeed=1", "nothing named 'windspeed' can be assumed; known: mass, kt"),
        ("kt=abc", r"kt=abc: 'abc' is no number \[N s\^2/rad\^2\]"),
        ("kt=nan", r"kt=nan is not finite"),
        ("kt=-1e-6", r"kt=-1e-6 cannot be: it is above 0 \[N s\^2/rad\^2\]"),
        ("Izz_com=0", r"Izz_com=0 cannot be: it is above 0 \[kg m\^2\]"),
        ("motor_lag=-0.1", r"motor_lag=-0.1 cannot be: it is 0 or more \[s\]"),
        ("max_speed=0", r"max_speed=0 cannot be: it is above 0 \[rad/s\]"),
    ],
)
def test_what_cannot_be_is_refused(word, message):
    with pytest.raises(ValueError, match=message):
        parse_assumptions([word])


def test_nothing_is_assumed_twice():
    with pytest.raises(ValueError, match="kd is assumed twice"):
        parse_assumptions(["kd=1e-8", "kd=2e-8"])


def test_a_product_may_be_negative_and_a_lag_zero():
    assert parse_assumptions(["Ixz_com=-1e-4", "motor_lag=0"]) == {"Ixz_com": -1e-4, "motor_lag": 0}
