"""Coherence and ratio of wrenches with a planted noise."""

import numpy as np
import pytest

from rotorfit.results.validation.wrench_comparison import SHOWN, WrenchComparison, wrench_spectra


def compared(*, noise, seconds=240.0, rate=100.0, cut=0.0, components=SHOWN):
    """Return rotors that are white, and a body wrench with so much white noise in it."""
    rng = np.random.default_rng(8)
    time = np.arange(round(seconds * rate)) / rate
    time[len(time) // 2 :] += cut
    rotor = rng.normal(size=(len(time), 6))
    return WrenchComparison(
        configuration="A",
        flight="A1.csv",
        sha256="0" * 64,
        used_in_fit=True,
        time=time,
        body_wrench=rotor + noise * rng.normal(size=rotor.shape),
        rotor_wrench=rotor,
        relative_error=dict.fromkeys(components, noise),
        whiteness={},
    )


@pytest.mark.parametrize("cut", [0.0, 30.0])
def test_coherence_and_ratio_are_those_of_the_noise(cut):
    found = wrench_spectra([compared(noise=0.5, cut=cut)])
    assert found is not None
    assert found.seconds == pytest.approx(240.0)
    assert (found.frequency[0], found.frequency[-1]) == (0.25, 8.0)
    for name in SHOWN:
        assert found.coherence[name].mean() == pytest.approx(1.0 / 1.25, abs=0.03)
        assert found.ratio[name].mean() == pytest.approx(2.0, rel=0.05)


def test_95_percent_of_unrelated_signals_are_below_random_level():
    found = wrench_spectra([compared(noise=1e6)])
    assert found is not None
    all_of_them = np.concatenate([found.coherence[name] for name in SHOWN])
    assert 0.88 <= (all_of_them < found.random_level).mean() <= 0.99


def test_flights_count_together_and_short_ones_not_at_all():
    short = compared(noise=0.5, seconds=9.0)
    assert wrench_spectra([short]) is None
    assert wrench_spectra([compared(noise=0.5, seconds=3.0)] * 9) is None
    assert wrench_spectra([]) is None
    together = wrench_spectra([short, short, compared(noise=0.5, seconds=3.0)])
    assert together is not None
    assert together.seconds == pytest.approx(18.0)


def test_a_component_that_is_not_predicted_is_left_out():
    found = wrench_spectra([compared(noise=0.5, components=("Fz", "Mx"))])
    assert found is not None
    assert list(found.coherence) == list(found.ratio) == ["Fz", "Mx"]
