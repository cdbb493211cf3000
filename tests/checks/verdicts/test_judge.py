"""The verdict of a number by its interval."""

import pytest

from rotorfit.checks.verdicts.judge import judge


@pytest.mark.parametrize("half_width", [0.0, 0.1])
def test_a_number_that_is_zero_is_judged_without_a_scale(half_width):
    """A motor's law that jumps at a lost command gives a hover throttle of zero."""
    judged = judge(0.0, half_width, scale=0.0, axis="force")
    assert judged.verdict == "not-identified"
