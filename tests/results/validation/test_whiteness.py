"""How much of the motion is left in a residual, and the band of the parameters: by hand."""

import numpy as np
import pytest

from rotorfit.results.validation.replay import Predicted, Replay, band_growth
from rotorfit.results.validation.validate import CUTOFF, relative_error, whiteness


def pair(lag, sign=1.0):
    """Return two spikes so many samples apart in 4000 of nothing."""
    x = np.zeros(4000)
    x[100], x[100 + lag] = 1.0, sign
    return x


@pytest.mark.parametrize("lag", [1, 3, 9, 10])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_two_equal_spikes_are_half_alike_up_to_ten_samples_away(lag, sign):
    """Product 1 over squares of 2; the sign of it does not matter."""
    assert whiteness(pair(lag, sign)) == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("lag", [11, 20])
def test_further_off_they_are_not_looked_at(lag):
    assert whiteness(pair(lag)) == pytest.approx(0.0, abs=1e-3)


def test_an_offset_is_no_colour():
    assert whiteness(pair(15) + 50.0) == pytest.approx(0.0, abs=1e-3)
    assert whiteness(np.full(50, 3.0)) == 0.0


def test_a_whole_wave_is_as_alike_as_its_cosine():
    """A period of 40 samples: one sample later it is cos 9 degrees of itself."""
    wave = np.sin(2.0 * np.pi * np.arange(40_000) / 40.0)
    assert whiteness(wave) == pytest.approx(np.cos(2.0 * np.pi / 40.0), abs=1e-3)


def test_too_few_samples_say_nothing():
    assert whiteness(pair(1)[95:105]) == 0.0
    assert whiteness(pair(1)[95:106]) > 0.3


def test_an_error_is_relative_to_what_the_rotors_give():
    body, rotors = np.zeros((5, 6)), np.zeros((5, 6))
    body[:, 2], rotors[:, 2] = 3.0, 4.0
    body[:, 3], rotors[:, 3] = 1.0, -1.0
    assert relative_error(body, rotors, "Fz") == pytest.approx(0.25)
    assert relative_error(body, rotors, "Mx") == pytest.approx(2.0)


def test_both_sides_are_seen_through_the_papers_low_pass():
    assert CUTOFF == 3.0


def test_the_parameters_band_is_1_96_rms_deviations():
    std = np.array([0.1, 0.2, 0.2])[:, None, None] * np.ones((3, 2, 3))
    made = Predicted(
        label="own", rates=np.zeros((3, 2, 3)), rates_std=std, force=np.zeros((3, 1, 3))
    )
    replay = Replay(
        flight="made",
        sha256="",
        configuration="A",
        time=np.zeros((3, 2)),
        block=0.05,
        rates=np.zeros((3, 2, 3)),
        force=np.zeros((3, 1, 3)),
        predicted=(made,),
    )
    expected = 1.96 * np.sqrt((0.01 + 0.04 + 0.04) / 3)
    assert band_growth([replay], "own") == pytest.approx(np.full((2, 3), expected))
