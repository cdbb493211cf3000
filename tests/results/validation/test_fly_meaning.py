"""What the errors of a replay mean: how long it is good for, and whether trim is most of it."""

import re
from dataclasses import replace

import numpy as np
import pytest

from rotorfit.report.fly import meaning
from rotorfit.results.validation.fly_outcome import FlyOutcome, steady_share
from rotorfit.results.validation.judgement import (
    error_sentences,
    horizon,
    judgement,
    moment_sentences,
    moment_splits,
)
from rotorfit.results.validation.replay import Predicted, Replay
from rotorfit.results.validation.wrench_comparison import WrenchComparison

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
    seconds = horizon(made.replays, 0.2)
    reached = 0.2 * rms / np.array([0.2, 1.9, 0.78])
    assert seconds == pytest.approx(np.minimum(np.floor(100 * reached) / 100, 0.5), abs=1e-9)
    assert seconds[1] < seconds[2] < seconds[0] == 0.5


def test_a_steady_error_is_distinguished_from_chance():
    assert steady_share(outcome(growing)) == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)


def test_the_sentences_say_what_to_do(assert_wording):
    words = meaning(outcome(growing))
    assert "within 20 %" in words[0]
    assert_wording(words[0])
    assert "roll 0.5 s, pitch 0.1" in words[0]
    assert "after 0.5 s" in words[1]
    assert_wording(words[1])
    assert_wording(words[2])
    assert words[3].startswith("closed loop")  # what judges good
    assert_wording(words[3])
    assert len(words) == 4
    small = meaning(outcome(lambda sign, t: 0.1 * growing(sign, t)))
    assert_wording(small[-1])


def compared(**errors):
    """Wrenches of which so much is left, by component."""
    return WrenchComparison(
        configuration="A", flight="a.csv", sha256="", used_in_fit=False, time=np.zeros(1),
        body_wrench=np.zeros((1, 6)), rotor_wrench=np.zeros((1, 6)), relative_error=errors,
        whiteness={},
    )  # fmt: skip


def test_wrench_and_replay_make_one_judgement(assert_text):
    """Roll good in both, pitch worse than constant rates, yaw with half of its moment left."""
    made = replace(
        outcome(growing).replays[0], comparison=compared(Fz=0.02, Mx=0.1, My=0.2, Mz=0.5)
    )
    found = judgement([made], doubtful=("kd",))
    assert [one.level for one in found.axes] == ["good", "good", "with-feedback", "rough"]
    assert_text(found.sentence)
    right = replace(made, comparison=compared(Fz=0.02, Mx=0.1, My=0.2, Mz=0.2))
    assert_text(judgement([right]).sentence)


@pytest.mark.parametrize(
    ("errors", "level"),
    [
        ({"Fz": 0.05, "Mx": 0.3, "My": 0.3, "Mz": 0.3}, "good"),
        ({"Fz": 0.051, "Mx": 0.3, "My": 0.3, "Mz": 0.3}, "rough"),
        ({"Fz": 0.05, "Mx": 0.3, "My": 0.3}, "unknown"),
        ({"Fz": 0.05, "Mx": 1.0, "My": 0.3}, "nothing"),
    ],
)
def test_the_worst_axis_decides(errors, level):
    assert judgement((), comparisons=[compared(**errors)]).level == level


def test_a_replay_that_beats_rates_held_is_not_nothing():
    """A moment as small as its gusts, and rates that are right: yaw of calm flights."""
    made = replace(outcome(growing).replays[0], comparison=compared(Fz=0.02, Mx=1.2, My=1.2))
    assert [one.level for one in judgement([made]).axes[1:]] == ["rough", "nothing", "good"]


def test_what_is_left_of_a_moment_is_laid_to_its_cause(assert_wording):
    """Yaw: rotors of 1 and unrelated gusts of .8; roll 2 times as much; pitch offset; all good."""
    random = np.random.default_rng(3)
    rotors, gusts = random.standard_normal((2, 4000, 6))
    body = rotors * [1, 1, 1, 2, 1, 1] + [0, 0, 0, 0, 3, 0] + gusts * [0, 0, 0, 0, 0, 0.8]
    errors = {"Fz": 0.5, "Mx": 1.0, "My": 3.0, "Mz": 0.8}
    one = replace(compared(**errors), body_wrench=body, rotor_wrench=rotors)
    roll, pitch, yaw = moment_sentences([one])
    assert "explain 75 %" in roll
    assert "100 %" in roll
    assert_wording(roll)
    assert_wording(pitch)
    assert yaw.startswith("yaw: the rotors explain ")
    assert re.search("(59|60|61|62) %", yaw)
    assert "100 %" in yaw
    assert_wording(yaw)
    good = replace(one, relative_error=dict.fromkeys(errors, 0.2))
    assert moment_sentences([good]) == []
    plain = [split.to_plain() for split in moment_splits([good])]
    assert [split["axis"] for split in plain] == ["roll", "pitch", "yaw"]
    assert [split["by_rotors"] for split in plain] == pytest.approx([0.75, 0.1, 0.61], abs=0.02)
    shares = [[split[part] for part in ("steady", "with_motion", "neither")] for split in plain]
    assert shares == pytest.approx(np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]]), abs=0.01)
    assert yaw in meaning(replace_comparison(outcome(growing), one))


def replace_comparison(made, comparison):
    return replace(made, replays=[replace(made.replays[0], comparison=comparison)])


def test_a_large_error_has_no_exponent():
    yaw = judgement((), comparisons=[compared(Mz=1.04)]).axes[3]
    assert yaw.deciding == "error 104 %"


def with_band(made, half):
    """Return a replay whose parameters have a 95 % band of so many rad/s."""
    (own,) = made.replays[0].predicted
    band = replace(own, rates_std=np.full_like(own.rates, half / 1.96))
    return [replace(made.replays[0], predicted=(band,))]


def test_an_error_beyond_the_band_is_laid_to_band_or_model(assert_wording):
    """Roll's goes with the predicted change, pitch's is chance, yaw's is steady."""
    random = np.random.default_rng(5)

    def error(sign, t):
        chance = random.choice([-1.0, 1.0])
        return np.stack([0.5 * sign * t, 0.8 * chance * t, 0.78 * t], axis=1)

    words = error_sentences(with_band(outcome(error), 0.02))
    assert [one.split(":")[0] for one in words] == ["roll", "pitch", "yaw"]
    assert_wording(words[0])
    assert_wording(words[1])
    assert_wording(words[2])
    assert error_sentences(with_band(outcome(error), 0.2)) == []
