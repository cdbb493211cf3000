"""Noise of the rotor speeds in the rows of a band: what is claimed, and what drawn noise makes."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import signal

import made_fit
from rotorfit.fit.reduction.reduce import BandPlan, band_factors, line_rows
from rotorfit.flight.flight_data import Segment
from rotorfit.model.signals import signal_layout, signal_matrix
from rotorfit.model.vehicle import Rotor

EDGES = (1.0, 5.0, 15.0, 30.0, 45.0)
STD, SPEED, RATE = 3.0, 400.0, 100.0


def drawn(differentiation, vehicle, seed):
    """Return a hover of 100 s with noise on the rotor speeds, and the exact one."""
    flight = made_fit.prepared(seconds=100.0, rate=RATE, speed=SPEED).data
    n = len(flight.time)
    segments = (Segment(start=1, stop=n - 1),)
    clean = replace(flight, differentiation=differentiation, segments=segments)
    noise = STD * np.random.default_rng(seed).normal(size=(n, 4))
    slope = np.gradient(noise, 1.0 / RATE, axis=0)
    if differentiation == "exact":  # every line's derivative is its own
        lines = np.fft.rfft(noise, axis=0)
        turn = 2j * np.pi * np.fft.rfftfreq(n, 1.0 / RATE)
        slope = np.fft.irfft(lines * turn[:, None], n=n, axis=0)
    noisy = replace(clean, rotor_speed=SPEED + noise, rotor_acceleration=slope, rotor_speed_std=STD)
    return noisy, clean, vehicle


def shown(noisy, clean, vehicle):
    """Return the mean square a row that noise makes of each signal in each band."""
    rows = noisy.segments[0].start, noisy.segments[0].stop
    error = signal_matrix(noisy, vehicle, *rows) - signal_matrix(clean, vehicle, *rows)
    window = signal.windows.tukey(len(error), 0.1)
    lines = np.fft.rfft(error * (window / np.sqrt(window @ window))[:, None], axis=0)
    at = np.fft.rfftfreq(len(error), 1.0 / RATE)
    return np.array(
        [
            (np.abs(lines[(at >= low) & (at < high)]) ** 2).mean(axis=0) / 2.0
            for low, high in pairwise(EDGES)
        ]
    )


LEANING = replace(
    made_fit.QUAD,
    rotors=tuple(
        Rotor(position=r.position, spin=r.spin, axis=(0.6 * s, 0.0, 0.8))
        for r, s in zip(made_fit.QUAD.rotors, (1.0, -1.0, 1.0, -1.0), strict=True)
    ),
)


@pytest.mark.parametrize("differentiation", ["central", "exact"])
@pytest.mark.parametrize("vehicle", [made_fit.QUAD, LEANING])
def test_the_claimed_variance_is_that_of_drawn_noise(differentiation, vehicle):
    flights = [drawn(differentiation, vehicle, seed) for seed in range(4)]
    plan = BandPlan(edges=EDGES, longest=200.0)
    claimed = band_factors(flights[0][0], vehicle, plan=plan).noise
    found = np.mean([shown(*flight) for flight in flights], axis=0)
    layout = signal_layout(vehicle)
    axes = "xz" if "dHx" in layout else "z"
    for name in (*(f"O2_{i}" for i in (1, 2, 3, 4)), *(f"dH{axis}" for axis in axes)):
        column = layout.index(name)
        np.testing.assert_allclose(claimed[:, column], found[:, column], rtol=0.2, err_msg=name)
    others = [i for i, n in enumerate(layout.names) if not n.startswith(("O2_", "dH"))]
    assert not claimed[:, others].any()


def test_exact_rotor_speeds_have_no_noise():
    _, clean, vehicle = drawn("central", made_fit.QUAD, 0)
    assert band_factors(clean, vehicle, plan=BandPlan(edges=EDGES)).noise is None


def test_all_rows_of_white_noise_have_one_variance_the_mean_too():
    """A line has it in two rows, half in each; the mean is one row, of half of it."""
    white = np.random.default_rng(0).normal(size=(64, 20_000)) / 8.0
    rows = line_rows(np.fft.rfft(white, axis=0), 0, 6)
    assert rows.shape == (11, 20_000)
    np.testing.assert_allclose((rows**2).mean(axis=1), 0.5, rtol=0.06)
    assert line_rows(np.fft.rfft(white, axis=0), 3, 6).shape == (6, 20_000)
