"""The quick fit of a form: against least squares on all speeds, by SciPy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from rotorfit.fit.motor_law import form_fit
from rotorfit.fit.motor_law.block_jackknife import blocks_of
from rotorfit.fit.motor_law.command_response import (
    Recording,
    Timing,
    merged_commands,
    respond_to_commands,
)
from rotorfit.fit.motor_law.fit_law import fit_law
from rotorfit.fit.motor_law.form_fit import (
    OUTLYING,
    SETTLED,
    FormFit,
    finish_form,
    prepare_recording,
    search_first,
    search_form,
)
from rotorfit.fit.motor_law.law_model import FORMS, Layout, predicted

CURVES = {"linear": (0.06,), "power": (0.7,), "sqrt": (0.5,), "offset power": (0.05, 0.75)}


def smoothed(rng, count, length):
    """Noise of deviation one, averaged over some samples."""
    kernel = np.ones(length) / np.sqrt(length)
    return np.convolve(rng.normal(size=count + length - 1), kernel, "valid")


def made_recording(seed, form, *, seconds=20.0, step=0.002, rotors=2, glitches=0.003):
    """One flight of a law, lag and delay drawn at random; speeds off by air, noise and glitches."""
    rng = np.random.default_rng(seed)
    n = int(seconds / step)
    stride = max(round(0.008 / step), 1)
    time = np.arange(n) * step
    commands = [
        np.clip(0.4 + 0.1 * smoothed(rng, n, 60) + 0.01 * rng.normal(size=n), 0.02, 1.0)
        for _ in range(rotors)
    ]
    at = [time[250::stride] + 1e4 * i for i in range(rotors)]
    count = len(at[0])
    recording = Recording(
        command_time=np.concatenate([time + 1e4 * i for i in range(rotors)]),
        command=np.concatenate(commands),
        voltage=None,
        nominal_voltage=None,
        rotor=np.repeat(np.arange(rotors), n),
        rotors=tuple(range(rotors)),
        flight=np.zeros(n * rotors, dtype=int),
        since=np.tile(time - time.mean(), rotors),
        begins=np.arange(n * rotors) % n == 0,
        time=np.concatenate(at),
        speed=np.ones(count * rotors),
        speed_rotor=np.repeat(np.arange(rotors), count),
        speed_flight=np.zeros(count * rotors, dtype=int),
        flight_time=np.tile(time[250::stride], rotors),
    )
    lag, delay = np.exp(rng.uniform(np.log(0.008), np.log(0.08))), rng.uniform(0.0, 0.02)
    settled = 2000.0 * np.exp(FORMS[form].logarithm(recording.command, np.array(CURVES[form]))[0])
    timing = Timing(log_lag=float(np.log(lag)), log_ratio=0.0, delay=float(delay))
    speed = respond_to_commands(recording, settled, timing)
    air = rng.choice([0.0, 0.01]) * smoothed(rng, len(speed), 40)
    speed = speed * (1.0 + air) + rng.choice([0.5, 5.0]) * rng.normal(size=len(speed))
    return replace(recording, speed=np.where(rng.random(len(speed)) < glitches, 3.0, 1.0) * speed)


def fit_by_scipy(recording, layout, begin, scale):
    """Fit to all speeds and commands until nothing moves."""
    bounds = form_fit.parameter_bounds(layout)
    return least_squares(
        lambda x: predicted(recording, layout, x)[0] - recording.speed,
        np.clip(begin, bounds[0] + 1e-6, bounds[1] - 1e-6),
        jac=lambda x: predicted(recording, layout, x)[1].T.copy(),
        bounds=bounds,
        x_scale="jac",
        loss="huber",
        f_scale=OUTLYING * scale,
        xtol=1e-9,
        ftol=1e-11,
        gtol=1e-12,
    ).x


def law_fit_at(prepared, recording, fit, x, scale):
    """Return the same fit at other values."""
    speed, slopes = predicted(recording, fit.layout, x)
    residuals = recording.speed - speed
    limit = OUTLYING * scale
    root = np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(residuals), 1e-12)))
    sums = form_fit._sum_all_blocks(prepared, prepared.block, slopes * root, residuals * root)
    return replace(fit, values=x, sums=sums)


@pytest.mark.parametrize("form", list(FORMS))
@pytest.mark.parametrize("seed", range(4))
def test_it_gives_what_all_speeds_and_commands_give(form, seed):
    recording = made_recording(seed, form, step=float(np.array([0.0005, 0.001, 0.002, 0.01])[seed]))
    prepared = prepare_recording(recording)
    general = Layout(form="offset power", voltage=False, two_way=False, rotors=2, flights=1)
    rough = finish_form(prepared, search_first(prepared, general))
    scale = 1.4826 * float(np.median(np.abs(rough.residuals)))
    layout = replace(general, form=form, two_way=bool(seed % 2))
    quick = finish_form(prepared, search_form(prepared, layout, rough, scale), scale, close=SETTLED)
    whole = law_fit_at(
        prepared, recording, quick, fit_by_scipy(recording, layout, quick.values, scale), scale
    )
    for i in range(layout.size):
        half = whole.half_width(lambda x, i=i: float(x[i]))
        assert abs(quick.values[i] - whole.values[i]) < 0.1 * half / 1.96, i
        assert quick.half_width(lambda x, i=i: float(x[i])) == pytest.approx(half, rel=0.05), i
    assert quick.error == pytest.approx(whole.error, rel=1e-3)


def test_a_law_looks_at_all_speeds_few_times(monkeypatch):
    """Predictions of all speeds cost most. Here every form is a rival: some 14 fits."""
    counts: dict[int, int] = {}

    def counted(one, layout, x):
        counts[len(one.speed)] = counts.get(len(one.speed), 0) + 1
        return predicted(one, layout, x)

    monkeypatch.setattr(form_fit, "predicted", counted)
    for seed in range(3):
        recording = made_recording(seed, "offset power", seconds=40.0, rotors=4)
        fit_law(recording)
    assert 30 < counts[len(recording.speed)] <= 30 * 3
    assert sum(counts.values()) <= 60 * 3


def test_merged_commands_keep_their_mean_and_their_stretches():
    recording = made_recording(3, "linear", seconds=6.0, step=0.00025)
    merged = merged_commands(recording, 0.001)
    assert len(merged.command) == len(recording.command) // 4
    assert merged.command == pytest.approx(recording.command.reshape(-1, 4).mean(axis=1))
    assert merged.command_time[merged.begins] == pytest.approx([0.0, 1e4])
    assert merged_commands(recording, 0.0004) is recording


def test_a_form_without_enough_blocks_has_no_interval():
    recording = made_recording(5, "power", seconds=3.0)
    prepared = prepare_recording(recording)
    layout = Layout(form="power", voltage=False, two_way=False, rotors=2, flights=1)
    fit: FormFit = search_first(prepared, layout)
    assert prepared.joined == ()
    assert fit.error == np.inf
    assert fit.half_width(lambda x: float(x[0])) == np.inf


def test_sums_over_longer_blocks_are_those_of_shorter_ones():
    recording = made_recording(6, "sqrt")
    prepared = prepare_recording(recording)
    layout = Layout(form="sqrt", voltage=False, two_way=False, rotors=2, flights=1)
    fit = finish_form(prepared, search_first(prepared, layout))
    for seconds, sums in zip(form_fit.BLOCKS, fit.sums, strict=False):
        block = blocks_of(recording.speed_flight, recording.flight_time, seconds)
        for b in range(int(block.max()) + 1):
            J, e = fit.slopes[:, block == b], fit.residuals[block == b]
            assert sums.information[b] == pytest.approx(J @ J.T, rel=1e-9)
            assert sums.score[b] == pytest.approx(J @ e, rel=1e-6, abs=1e-6 * np.abs(J).max())
            assert sums.squares[b] == pytest.approx(e @ e)
