"""Frequency sweeps that autopilots fly are found in the rates, and nothing else is one."""

import numpy as np
import pytest

from rotorfit.report.log_report import sweep_messages
from rotorfit.simulation.pilot import Stick, movement
from rotorfit.tools.inspection.spectra import AXES, frequency_sweeps

RATE = 250.0
TIME = np.arange(0.0, 40.0, 1.0 / RATE)


def rates(*moved):
    """Return the rates of the three axes [rad/s], with noise."""
    noise = 0.05 * np.random.default_rng(1).normal(size=(len(TIME), 3))
    for axis, values in enumerate(moved):
        noise[:, axis] += values
    return noise


def swept(low, high, seconds, *, begin=5.0):
    """Return a sine of 0.5 rad/s whose frequency rises exponentially."""
    since = np.clip(TIME - begin, 0.0, seconds)
    growth = np.log(high / low) / seconds
    phase = 2.0 * np.pi * low / growth * np.expm1(growth * since)
    return 0.5 * np.sin(phase) * ((begin < TIME) & (begin + seconds > TIME))


@pytest.mark.parametrize(
    ("low", "high", "seconds"),
    [(0.5, 40.0, 30.0), (0.2, 300.0, 20.0), (1.0, 10.0, 20.0)],
    ids=["ArduPilot", "Betaflight", "slow"],
)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_sweep_is_found(low, high, seconds, axis):
    still = np.zeros_like(TIME)
    moved = [still, still, still]
    moved[axis] = swept(low, high, seconds)
    [found] = frequency_sweeps(TIME + 100.0, rates(*moved))
    assert found.axis == AXES[axis]
    assert found.lowest == pytest.approx(max(low, 1.2), rel=0.3)
    assert found.highest == pytest.approx(min(high, 60.0), rel=0.15)
    assert 104.5 <= found.start < found.end <= 106.0 + seconds


def test_what_is_no_sweep_is_none():
    rng = np.random.default_rng(0)
    for stick in (
        Stick(band=(0.2, 1.3), rms=0.3),
        Stick(band=(1.0, 20.0), rms=0.3),
        Stick(band=(1.0, 2.0), rms=0.3),
        Stick(band=(0.4, 1.2), rms=0.3, shape="doublets"),
    ):
        flown = movement(stick, samples=len(TIME), sample_rate=RATE, rng=rng)
        assert frequency_sweeps(TIME, rates(flown)) == ()
    assert frequency_sweeps(TIME, rates(0.5 * np.sin(20.0 * TIME))) == ()
    assert frequency_sweeps(TIME, rates(swept(40.0, 1.0, 30.0))) == ()  # falls
    assert frequency_sweeps(TIME[:500], rates()[:500]) == ()  # 2 s


def test_the_axes_that_are_missing_are_named(assert_wording):
    found = frequency_sweeps(TIME, rates(swept(1.0, 10.0, 20.0)))
    [words] = sweep_messages(found)
    assert_wording(words)
    assert sweep_messages(()) == []
