"""What the errors of a replay mean: how long it is good for, and whether trim is most of it."""

import numpy as np
import pytest

from rotorfit.report.fly import meaning
from rotorfit.validation.fly_outcome import FlyOutcome, horizon, steady_share
from rotorfit.validation.replay import Predicted, Replay

WINDOWS, STEPS, STEP = 40, 51, 0.01


def outcome(error) -> FlyOutcome:
    """Windows of half a second, whose rates have an rms of about 1 and are predicted with an error.

    `error`: of the window and its times, rad/s per axis.
    """
    random = np.random.default_rng(3)
    time = np.arange(STEPS) * STEP + np.arange(WINDOWS)[:, None]
    start = random.choice([-1.0, 1.0], size=(WINDOWS, 1, 3))
    signs = random.permutation(np.tile([-1.0, 1.0], WINDOWS // 2))
    t = np.arange(STEPS) * STEP
    # They move by 0.5 in a window, back or forth: what holding the rate is wrong by.
    rates = start + 0.5 * signs[:, None, None] * (t / t[-1])[:, None] - 0.25
    off = np.stack([error(sign, t) for sign in signs])
    own = Predicted(
        label="identified",
        rates=rates + off,
        rates_std=0.0 * rates,
        force=np.zeros((WINDOWS, 1, 3)),
    )
    replay = Replay(
        flight="a.csv",
        sha256="",
        configuration="A",
        time=time,
        block=0.05,
        rates=rates,
        force=np.zeros((WINDOWS, 1, 3)),
        predicted=(own,),
    )
    return FlyOutcome(
        name="n",
        configuration="A",
        seconds=0.5,
        draws=0,
        labels=("identified",),
        replays=(replay,),
        manoeuvres={},
        notes=(),
    )


def growing(sign, t):
    """Roll: 0.1 per half second; pitch: 1.0, chance; yaw: 0.4, always the same way."""
    return np.stack([0.2 * sign * t, 1.9 * sign * t, 0.78 * t], axis=1)


def test_how_long_the_rates_are_predicted():
    made = outcome(growing)
    rms = np.sqrt((made.replays[0].rates ** 2).mean(axis=(0, 1)))
    seconds = horizon(made, 0.2)
    reached = 0.2 * rms / np.array([0.2, 1.9, 0.78])
    assert seconds == pytest.approx(np.minimum(np.floor(100 * reached) / 100, 0.5), abs=1e-9)
    assert seconds[1] < seconds[2] < seconds[0] == 0.5


def test_a_steady_error_is_told_from_chance():
    assert steady_share(outcome(growing)) == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)


def test_the_sentences_say_what_to_do():
    words = meaning(outcome(growing))
    assert words[0].startswith("open loop (planning, MPC) the rates stay within 20 %")
    assert "roll 0.5 s, pitch 0.1" in words[0]
    assert words[1].startswith("pitch: over 0.5 s the model is worse than holding the rate")
    assert words[2].startswith("yaw: most of the error is steady, which is trim")
    assert len(words) == 3
    small = meaning(outcome(lambda sign, t: 0.1 * growing(sign, t)))
    assert small[-1].startswith("closed loop, for tuning and simulation")
