"""Margins of open loops against python-control, filters against SciPy's own responses."""

import control
import numpy as np
import pytest
from scipy import signal

from rotorfit.tools.control_loop.controllers import RateController
from rotorfit.tools.control_loop.margins import margins
from rotorfit.tools.control_loop.measures import (
    bandwidth,
    closed_loop,
    step_harmonics,
    step_response,
)
from rotorfit.tools.control_loop.plant import (
    GyroFilter,
    Plant,
    delays,
    first_order,
    integral,
    smoothing,
)
from rotorfit.tools.control_loop.vehicle import cross_spectra

GRID = np.geomspace(0.05, 90.0, 1500)
S = 2j * np.pi * GRID


def plant_response(*, gain, lag, angle):
    """Rate loop P with an attitude loop around it, and the same as transfer function."""
    s = control.tf("s")
    system = gain / s / (1 + lag * s) * (1 + angle / s)
    return gain / S / (1 + lag * S) * (1 + angle / S), system


@pytest.mark.parametrize(("gain", "lag", "angle"), [(30.0, 0.03, 4.0), (12.0, 0.06, 0.0)])
@pytest.mark.parametrize("delay", [0.004, 0.012])
def test_margins_are_those_of_python_control(gain, lag, angle, delay):
    response, system = plant_response(gain=gain, lag=lag, angle=angle)
    top, bottom = control.pade(delay, 10)
    whole = system * control.tf(top, bottom)
    gm, pm, sm, _, wc, _ = control.stability_margins(whole)
    found = margins(GRID, (response * np.exp(-S * delay))[None, :])
    assert found.crossover[0] == pytest.approx(wc / (2 * np.pi), rel=2e-3)
    assert found.phase[0] == pytest.approx(pm, abs=0.1)
    assert found.gain[0] == pytest.approx(gm, rel=2e-3)
    assert found.delay[0] == pytest.approx(np.radians(pm) / wc, rel=2e-3)
    assert found.sensitivity[0] == pytest.approx(1.0 / sm, rel=2e-2)
    assert found.stable[0]


def test_a_loop_beyond_its_delay_margin_is_unstable():
    response, _ = plant_response(gain=30.0, lag=0.03, angle=0.0)
    left = margins(GRID, response[None, :]).delay[0]
    late = [response * np.exp(-S * factor * left) for factor in (0.9, 1.1)]
    assert margins(GRID, np.array(late)).stable.tolist() == [True, False]


def test_a_loop_at_its_gain_margin_oscillates():
    response, _ = plant_response(gain=20.0, lag=0.05, angle=3.0)
    response = response * np.exp(-S * 0.01)
    gain = margins(GRID, response[None, :]).gain[0]
    near = margins(GRID, np.array([0.95 * gain * response, 1.05 * gain * response]))
    assert near.stable.tolist() == [True, False]


@pytest.mark.parametrize("cutoff", [5.0, 20.0, 60.0])
def test_low_passes_are_those_of_scipy(cutoff):
    period = 1 / 250
    z = delays(GRID, period)
    for order in (1, 2):
        _, expected = signal.freqs(*signal.butter(order, cutoff, analog=True), GRID)
        assert np.allclose(GyroFilter(frequency=cutoff, order=order).response(GRID), expected)
    alpha = smoothing(cutoff, period)
    _, expected = signal.freqz([alpha], [1, alpha - 1], GRID, fs=250)
    assert np.allclose(first_order(z, cutoff, period), expected)


def test_a_notch_leaves_its_floor_and_passes_what_is_far():
    notch = GyroFilter(frequency=80.0, order=0, width=40.0, floor=0.01)
    assert np.abs(notch.response(np.array([1e-3, 80.0, 1e5]))) == pytest.approx(
        [1.0, 0.01, 1.0], abs=1e-3
    )
    b, a = signal.iirnotch(80.0, 80.0 / 40.0, fs=20000)
    deep = GyroFilter(frequency=80.0, order=0, width=40.0)
    _, expected = signal.freqz(b, a, GRID, fs=20000)
    assert np.allclose(deep.response(GRID), expected, atol=0.01)


@pytest.mark.parametrize("late", [False, True])
def test_a_running_sum_is_that_of_scipy(late):
    z = delays(GRID, 0.004)
    b = [0.0, 0.004] if late else [0.004]
    _, expected = signal.freqz(b, [1, -1], GRID, fs=250)
    assert np.allclose(integral(z, 0.004, late=late), expected)


def flown_like(*, slope_of="rate"):
    """A controller of the autopilots' form and a vehicle, with the same loops in python-control."""
    T = 0.004
    controller = RateController(
        P=0.15, I=0.2, D=0.003, FF=0.0, angle=6.0, period=T, set_point_age=1,
        slope_of=slope_of, slope_lowpass=30.0, gyro_filters=(),
    )  # fmt: skip
    one = np.ones(1)
    body = Plant(gain=150.0 * one, damping=0.4 * one, lag=0.03 * one, delay=2 * T * one)
    z = control.tf([1, 0], [1], T)
    alpha = T / (T + 1 / (2 * np.pi * 30.0))
    steep = 0.003 * (1 - 1 / z) / T * alpha / (1 - (1 - alpha) / z)
    total = T / (z - 1) if slope_of == "rate" else T / (1 - 1 / z)
    feedback = 0.15 + 0.2 * total + steep
    forward = 0.15 + 0.2 * total + (0 if slope_of == "rate" else steep)
    s = control.tf("s")
    vehicle = control.c2d(150.0 / (s + 0.4) / (1 + 0.03 * s), T, "zoh") / z**2
    return controller, body, vehicle, feedback, forward


@pytest.mark.parametrize("slope_of", ["rate", "error"])
def test_the_loop_and_its_step_are_python_controls(slope_of):
    controller, body, vehicle, feedback, forward = flown_like(slope_of=slope_of)
    slow = GRID[GRID < 20.0]
    loop = controller.from_rate(slow) * body.response(slow, controller.period)
    expected = control.frequency_response(vehicle * feedback, 2 * np.pi * slow).complex
    assert loop[0] == pytest.approx(expected, rel=0.03)
    gm, pm, *_ = control.stability_margins(vehicle * feedback, method="frd")
    grid = np.geomspace(0.05, 112.0, 2000)
    found = margins(grid, controller.from_rate(grid) * body.response(grid, controller.period))
    assert found.phase[0] == pytest.approx(pm, abs=0.5)
    assert found.gain[0] == pytest.approx(gm, rel=0.03)
    harmonics = step_harmonics(controller.period)
    loops = controller.from_rate(harmonics) * body.response(harmonics, controller.period)
    time = np.arange(0, 150) * controller.period
    answer = step_response(harmonics, closed_loop(controller, loops, harmonics), time)[0]
    closed = control.minreal(vehicle * forward / (1 + vehicle * feedback), verbose=False)
    _, exact = control.step_response(closed, time)
    # A step comes at any time between two runs: half a period later than at a run, in the mean.
    exact = np.interp(time - controller.period / 2, time, np.asarray(exact))
    assert np.abs(answer - exact).max() < 0.01


@pytest.mark.parametrize("damping", [0.3, 0.7, 1.5])
def test_the_bandwidth_is_that_of_python_control(damping):
    s = control.tf("s")
    system = 400.0 / (s * s + 2.0 * damping * 20.0 * s + 400.0)
    response = 400.0 / (S * S + 2.0 * damping * 20.0 * S + 400.0)
    slow = np.full_like(response, 0.1)
    found = bandwidth(GRID, np.stack([response, 1.0 + 0.0 * response, slow]))
    # python-control falls by 3 dB, which is .07079 of 10.
    assert found[0] == pytest.approx(control.bandwidth(system) / (2 * np.pi), rel=3e-3)
    assert np.isnan(found[1:]).all()


def test_the_share_of_d_is_reported_at_a_frequency():
    one = RateController(P=0.2, I=0.0, D=0.002, FF=0.0, angle=0.0, period=1e-4)
    assert one.derivative_share(10.0) == pytest.approx(0.002 * 2 * np.pi * 10.0 / 0.2, rel=1e-3)


@pytest.mark.parametrize(("length", "rows"), [(64, 1000), (63, 1000), (64, 50)])
def test_cross_spectra_are_those_of_scipy(length, rows):
    records = np.random.default_rng(2).standard_normal((3, rows)) + 1.0
    found, spectra = cross_spectra(list(records), 0.004, length)
    for i, one in enumerate(records):
        for j, other in enumerate(records):
            grid, expected = signal.csd(one, other, 250.0, nperseg=min(length, rows))
            assert spectra[i, j] == pytest.approx(expected, rel=1e-9, abs=1e-12)
            assert found == pytest.approx(grid)
