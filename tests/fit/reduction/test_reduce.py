"""From a flight to its factors: chunks, low-pass, bands, and what survives all of them."""

import tracemalloc
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

import newton_euler as ne
from rotorfit.errors import EstimationError, FlightError
from rotorfit.fit.reduction import reduce
from rotorfit.fit.reduction.reduce import (
    BandPlan,
    LowPass,
    band_factors,
    banded_lines,
    merged_bands,
    split_segment,
    time_factors,
)
from rotorfit.flight.flight_data import Segment
from rotorfit.model.regressor import regressor
from rotorfit.model.signals import signal_matrix

VEHICLE = ne.paper_vehicle()
EDGES = (0.0, 0.3, 0.6, 0.9, 1.2, 1.6, 2.0, 2.5, 3.0, 3.7, 4.5, 5.5, 6.5, 8.0, 10.0, 12.5)


def flight(n, *, seed=0, noise=1.0):
    return ne.flown(ne.paper_body(), VEHICLE, n, seed=seed, noise=noise)


def dense(data, start=0, stop=None):
    return signal_matrix(data, VEHICLE, start, len(data.time) if stop is None else stop)


def assert_same_gram(R, Z, tolerance=1e-12):
    size = np.linalg.norm(Z, axis=0)
    assert np.abs((R.T @ R - Z.T @ Z) / np.outer(size, size)).max() < tolerance


def assert_no_residual(factors, *, tolerance):
    """Check that exact equations hold for every factor, against the size of their terms."""
    A = regressor(VEHICLE)
    theta = ne.theta_of(ne.paper_body())
    values = np.array([theta.get(name, 0.0) for name in A.names])
    B = np.einsum("p,pjz->jz", values, A.tensor)
    terms = np.linalg.norm(factors.R, axis=1) @ np.abs(B).T
    residual = np.linalg.norm(factors.R @ B.T, axis=1)
    # Forces among forces, torques among torques: a row without terms of its own has none.
    for rows in (slice(0, 3), slice(3, 6)):
        assert (residual[:, rows] <= tolerance * terms[:, rows].max(axis=1, keepdims=True)).all()


@pytest.fixture
def long_flight(monkeypatch):
    """A flight of several chunks, here an eighth of the usual ones, the last of them not full."""
    rows = reduce.CHUNK_ROWS // 8
    monkeypatch.setattr(reduce, "CHUNK_ROWS", rows)
    return flight(2 * rows + 630)


@pytest.mark.parametrize("block_rows", [200, 450, 2_000, 2_500])
def test_chunks_of_a_long_flight_are_factored_as_a_whole(long_flight, block_rows):
    """Of blocks that fill a chunk or not, and of one that is longer than a chunk."""
    Z = dense(long_flight)
    F = time_factors(long_flight, VEHICLE, block_seconds=block_rows / long_flight.sample_rate)
    starts = range(0, len(Z), block_rows)
    assert F.rows.tolist() == [min(block_rows, len(Z) - start) for start in starts]
    for R, start in zip(F.R, starts, strict=True):
        assert_same_gram(R, Z[start : start + block_rows])
    assert_same_gram(F.total, Z)


def test_segments_are_kept_separate_and_gaps_are_left_out():
    parts = (
        Segment(start=3, stop=503),
        Segment(start=700, stop=1100),
        Segment(start=1100, stop=1101),
    )
    data = replace(flight(1200), segments=parts)
    F = time_factors(data, VEHICLE)
    assert F.segment.tolist() == [0, 0, 0, 1, 1, 2]
    assert F.rows.tolist() == [200, 200, 100, 200, 200, 1]
    assert F.rows.sum() == data.samples_used
    for number, part in enumerate(parts):
        assert_same_gram(F.select(F.segment == number).total, dense(data, part.start, part.stop))


def test_a_flight_without_a_segment_is_refused():
    with pytest.raises(FlightError, match="too short to use"):
        time_factors(replace(flight(300), segments=()), VEHICLE)


def filtered_rows(data, lowpass):
    """Return the rows of Z that are factored: a block of one row is the row, but for its sign."""
    step = lowpass.step(data.sample_rate)
    F = time_factors(data, VEHICLE, lowpass=lowpass, block_seconds=step / data.sample_rate)
    assert (F.rows == 1).all()
    rows = F.R[:, 0]
    return rows * np.sign(rows[:, -1:])  # The last signal is 1, before the filter and after.


@pytest.mark.parametrize(
    "lowpass",
    [
        LowPass(cutoff=3.0),
        LowPass(cutoff=3.0, samples_per_period=8.0),
        LowPass(cutoff=20.0, order=2),
    ],
)
def test_filtering_in_chunks_is_filtering_the_whole_flight(long_flight, lowpass):
    Z = dense(long_flight)
    sos = lowpass.sos(200.0)
    whole = signal.sosfiltfilt(sos, Z, axis=0)[:: lowpass.step(200.0)]
    got = filtered_rows(long_flight, lowpass)
    assert got.shape == whole.shape
    assert (np.abs(got - whole).max(axis=0) < 1e-10 * np.abs(Z).max(axis=0)).all()


def test_a_segment_is_filtered_without_its_surroundings():
    data = flight(1500)
    data = replace(data, segments=(Segment(start=400, stop=1300),))
    lowpass = LowPass(cutoff=5.0)
    whole = signal.sosfiltfilt(lowpass.sos(200.0), dense(data, 400, 1300), axis=0)
    got = filtered_rows(data, lowpass)
    assert (np.abs(got - whole).max(axis=0) < 1e-10 * np.abs(whole).max(axis=0)).all()


@pytest.mark.parametrize("order", [2, 4])
def test_both_passes_together_lose_3_db_at_the_cutoff(order):
    lowpass = LowPass(cutoff=3.0, order=order)
    _, gain = signal.sosfreqz(lowpass.sos(200.0), worN=[3.0], fs=200.0)
    assert np.abs(gain[0]) ** 2 == pytest.approx(2**-0.5, rel=1e-3)
    assert lowpass.step(200.0) == 1
    assert LowPass(cutoff=3.0, samples_per_period=8.0).step(200.0) == 8


def test_a_log_too_slow_for_the_cutoff_is_refused():
    with pytest.raises(FlightError, match="a cut-off of 90 Hz needs a log faster than"):
        time_factors(flight(300), VEHICLE, lowpass=LowPass(cutoff=90.0))


@pytest.mark.parametrize("n", [1, 2, 20, 60])
def test_a_short_stretch_can_be_filtered(n):
    data = replace(flight(100), segments=(Segment(start=10, stop=10 + n),))
    F = time_factors(data, VEHICLE, lowpass=LowPass(cutoff=3.0))
    assert F.rows.tolist() == [n]
    assert F.R[0, 0, 0] > 0


@pytest.mark.parametrize("lowpass", [None, LowPass(cutoff=3.0, samples_per_period=8.0)])
def test_exact_equations_survive_the_low_pass(lowpass):
    F = time_factors(flight(3000, noise=0.0), VEHICLE, lowpass=lowpass)
    assert_no_residual(F, tolerance=1e-12)
    assert_no_residual(F.merged(), tolerance=1e-12)


def test_exact_equations_survive_the_bands():
    data = flight(9000, noise=0.0)
    assert_no_residual(band_factors(data, VEHICLE, plan=BandPlan(edges=EDGES)), tolerance=1e-12)


def peak_bytes(n, block_seconds, lowpass):
    rng = np.random.default_rng(0)
    motion = ne.random_motion(rng, n, 4)
    data = ne.flight_of(*motion)
    tracemalloc.start()
    try:
        F = time_factors(data, VEHICLE, lowpass=lowpass, block_seconds=block_seconds)
        return tracemalloc.get_traced_memory()[1], F.R.nbytes
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("lowpass", [None, LowPass(cutoff=5.0)])
def test_memory_does_not_grow_with_the_flight(lowpass):
    """With as many blocks in four times the flight: the peak is that of one chunk."""
    short, _ = peak_bytes(60_000, 5.0, lowpass)
    long, kept = peak_bytes(240_000, 20.0, lowpass)
    Z = 240_000 * 20 * 8
    assert long < 1.1 * short
    assert long < Z / 2
    assert kept < Z / 100


def windowed(data, part):
    Z = dense(data, part.start, part.stop)
    window = signal.windows.tukey(len(Z), 0.1)
    return Z * (window / np.linalg.norm(window))[:, None]


@pytest.mark.parametrize("n", [800, 801])
def test_all_lines_together_obey_parseval(n):
    data = flight(n)
    plan = BandPlan(edges=(0.0, 1.0, 5.0, 20.0, 101.0))
    F = band_factors(data, VEHICLE, plan=plan)
    Z = windowed(data, Segment(start=0, stop=n))
    # One side of the spectrum: an even n has Nyquist there with all its power; the mean, which has
    # one row where another line has two, counts half, as every line does.
    expected = n * Z.T @ Z / 2
    if n % 2 == 0:
        nyquist = (-1.0) ** np.arange(n) @ Z
        expected += np.outer(nyquist, nyquist) / 2
    size = np.sqrt(np.diagonal(expected))
    got = F.total.T @ F.total
    assert np.abs((got - expected) / np.outer(size, size)).max() < 1e-12
    assert F.rows.sum() == 2 * (n // 2 + 1) - 1


def test_lines_of_any_columns_are_those_of_the_blocks():
    """A log cut in two: the lines of every block, real and imaginary, have its Gram matrix."""
    whole = flight(1700)
    parts = (Segment(start=0, stop=900), Segment(start=900, stop=1700))
    data, plan = replace(whole, segments=parts), BandPlan(edges=(0.0, 1.0, 4.0, 8.0))
    F = band_factors(data, VEHICLE, plan=plan)
    found = banded_lines(data, lambda start, stop: dense(data, start, stop), plan=plan)
    blocks = [
        (lines[a:b], frequency[[a, b - 1]]) for lines, bands, frequency in found for a, b in bands
    ]
    assert len(blocks) == len(F) == 6
    for R, band, (lines, ends) in zip(F.R, F.band, blocks, strict=True):
        np.testing.assert_allclose(ends, band, rtol=1e-12)
        if band[0] > 0.0:
            assert_same_gram(R, np.concatenate([lines.real, lines.imag]))


def test_a_band_holds_its_lines_and_no_others():
    data = flight(4000)
    F = band_factors(data, VEHICLE, plan=BandPlan(edges=(1.0, 2.0, 4.0)))
    lines = np.fft.rfft(windowed(data, Segment(start=0, stop=4000)), axis=0)
    f = np.fft.rfftfreq(4000, 0.005)
    for i, (low, high) in enumerate(((1.0, 2.0), (2.0, 4.0))):
        inside = lines[(f >= low) & (f < high)]
        assert_same_gram(F.R[i], np.concatenate([inside.real, inside.imag]))
        assert F.rows[i] == 2 * len(inside)
        assert F.band[i] == pytest.approx([low, high - 0.05])


def test_lower_bands_alone_are_those_of_all():
    data, plan = flight(9000), BandPlan(edges=EDGES, longest=20.0)
    every = band_factors(data, VEHICLE, plan=plan)
    low = band_factors(data, VEHICLE, plan=plan, top=3.0)
    own = every.select(every.band[:, 0] < 3.0)
    assert 0 < len(own) < len(every)
    np.testing.assert_array_equal(low.R, own.R)
    np.testing.assert_array_equal(low.band, own.band)


def test_a_stretch_too_short_for_a_band_is_left_out():
    parts = (Segment(start=0, stop=3), Segment(start=10, stop=2010), Segment(start=2010, stop=2012))
    data = replace(flight(2100), segments=parts)
    F = band_factors(data, VEHICLE, plan=BandPlan(edges=(0.3, 4.0, 8.0)))
    assert F.segment.tolist() == [0, 0]
    alone = replace(data, segments=parts[1:2])
    np.testing.assert_array_equal(
        F.R, band_factors(alone, VEHICLE, plan=BandPlan(edges=(0.3, 4.0, 8.0))).R
    )
    with pytest.raises(FlightError, match="too short to use"):
        band_factors(replace(data, segments=parts[2:]), VEHICLE, plan=BandPlan(edges=EDGES))


def test_long_stretches_are_cut_and_numbered():
    F = band_factors(flight(9000), VEHICLE, plan=BandPlan(edges=(0.3, 4.0, 8.0), longest=20.0))
    assert F.segment.tolist() == [0, 0, 1, 1, 2, 2]


@settings(max_examples=100, deadline=None)
@given(
    n=st.integers(1, 5000),
    edges=st.lists(st.floats(0, 120), min_size=2, max_size=16, unique=True),
    fewest=st.integers(1, 30),
)
def test_merged_bands_share_the_lines_out(n, edges, fewest):
    edges = tuple(sorted(edges))
    f = np.fft.rfftfreq(n, 0.005)
    bands = merged_bands(f, BandPlan(edges=edges, fewest_lines=fewest))
    mean = edges[0] == 0.0  # A first band from 0 Hz stands alone, however few its lines.
    inside = np.flatnonzero((f >= edges[mean]) & (f < edges[-1]))
    if len(inside) < fewest:
        assert bands == []
        return
    if mean:
        assert bands.pop(0) == (0, inside[0])
    assert [i for a, b in bands for i in range(a, b)] == inside.tolist()
    assert all(b - a >= fewest for a, b in bands)
    cuts = set(np.searchsorted(f, edges).tolist())
    assert all(a in cuts and b in cuts for a, b in bands)


def test_a_band_with_few_lines_is_merged_upwards():
    f = np.fft.rfftfreq(2000, 0.005)  # 0.1 Hz apart
    plan = BandPlan(edges=(0.0, 0.5, 1.5, 3.0, 3.5), fewest_lines=10)
    assert merged_bands(f, plan) == [(0, 5), (5, 15), (15, 35)]
    assert merged_bands(f, replace(plan, edges=(0.1, *plan.edges[1:]))) == [(1, 15), (15, 35)]


@settings(max_examples=60, deadline=None)
@given(start=st.integers(0, 10_000), rows=st.integers(1, 30_000), longest=st.integers(1, 6000))
def test_split_segment_cuts_into_the_fewest_equal_parts(start, rows, longest):
    parts = split_segment(Segment(start=start, stop=start + rows), float(longest))
    assert parts[0].start == start
    assert parts[-1].stop == start + rows
    assert all(a.stop == b.start for a, b in pairwise(parts))
    lengths = [len(part) for part in parts]
    assert max(lengths) - min(lengths) <= 1
    assert max(lengths) <= longest
    assert len(parts) == -(-rows // longest)


def test_nan_in_a_flight_is_refused():
    data = flight(500)
    data.specific_force[321, 1] = np.nan
    with pytest.raises(EstimationError, match="NaN or infinite"):
        time_factors(data, VEHICLE)
