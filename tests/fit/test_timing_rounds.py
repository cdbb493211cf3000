"""Secant steps of the timing search."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rotorfit.fit.timing.timing_rounds import TimingRound, accelerated_move

NAMES = ("motor_delay", "motor_lag")
END = np.array([0.006, 0.03])
STD = np.array([4e-5, 6e-5])
LONGEST = 0.02


def round_at(x, share):
    """A round whose fit goes from x by (1 - share) of the way to the end."""
    return TimingRound(names=NAMES, at=x, move=(1.0 - share) * (END - x), std=STD)


@given(st.floats(-0.9, 0.6), st.floats(-0.005, 0.005), st.floats(-0.005, 0.005))
def test_two_rounds_on_one_line_lead_to_the_end(share, delay, lag):
    first = round_at(END + np.array([delay, lag]), share)
    second = round_at(first.at + first.move, share)
    if np.abs(second.move).max() < 1e-7:
        return
    move = accelerated_move(second, first, longest=LONGEST)
    reached = second.at + np.array([move[name] for name in NAMES])
    np.testing.assert_allclose(reached, END, atol=1e-9)


def test_the_first_round_goes_where_its_fit_goes():
    own = round_at(END + 0.002, -0.5)
    assert accelerated_move(own, None, longest=LONGEST) == dict(zip(NAMES, own.move, strict=True))


def test_rounds_far_off_or_of_other_times_suggest_nothing():
    own = round_at(END + 0.002, -0.5)
    far = round_at(END + 0.03, -0.5)
    other = TimingRound(names=NAMES[:1], at=own.at[:1], move=own.move[:1], std=STD[:1])
    plain = dict(zip(NAMES, own.move, strict=True))
    assert accelerated_move(own, far, longest=LONGEST) == plain
    assert accelerated_move(own, other, longest=LONGEST) == plain


def test_a_leap_far_beyond_the_plain_step_is_not_taken():
    first = round_at(END + 0.002, 0.98)
    second = round_at(first.at + first.move, 0.98)
    move = accelerated_move(second, first, longest=LONGEST)
    assert move == dict(zip(NAMES, second.move, strict=True))
