"""Stability and margins of random loops with several crossings, against python-control's poles.

Controller, notches, low-passes and vehicle are rotorfit's own; python-control has the same parts in
continuous time, and Pade approximations for the delay.
"""

import control
import numpy as np
import pytest

from rotorfit.report.loop import limit_words
from rotorfit.tools.control_loop.controllers import RateController
from rotorfit.tools.control_loop.loop import loop_frequencies
from rotorfit.tools.control_loop.margins import fine_grid, last_crossover, margins
from rotorfit.tools.control_loop.measures import measures_of
from rotorfit.tools.control_loop.plant import GyroFilter, Plant

PERIOD = 1e-5
"""So short that the discrete controller is the continuous one [s]."""
HIGHEST = 300.0
BORDER = np.sin(np.radians(1.0))
"""Distance from -1 that one degree makes at gain 1."""
PADE = 5
"""Order of the Pade approximation of each quarter of a delay: right to 1e-3 up to 50 Hz."""


def draw_loop(random):
    """Draw a rate controller with its gyro filters, and a vehicle with lag and delay."""
    crossover = np.exp(random.uniform(np.log(1.5), np.log(25.0)))
    notches = tuple(
        GyroFilter(
            frequency=random.uniform(5.0, 40.0),
            order=0,
            width=np.exp(random.uniform(np.log(0.2), np.log(20.0))),
            floor=random.choice([0.0, 0.05, 0.2, 2.0, 6.0]),
        )
        for _ in range(random.integers(0, 4))
    )
    low_passes = tuple(
        GyroFilter(frequency=random.uniform(20.0, 120.0), order=int(random.integers(1, 3)))
        for _ in range(random.integers(0, 3))
    )
    P = 0.15
    controller = RateController(
        P=P,
        I=P * random.choice([0.0, 0.5, 2.0, 8.0]),
        D=P * random.choice([0.0, 0.005, 0.02, 0.05]),
        FF=0.0,
        angle=random.choice([0.0, 2.0, 6.0, 12.0]),
        period=PERIOD,
        slope_lowpass=random.uniform(15.0, 100.0),
        gyro_filters=low_passes + notches,
    )
    one = np.ones(1)
    body = Plant(
        gain=one * 2.0 * np.pi * crossover / P,
        damping=one * random.choice([0.0, -0.3, 0.5, 2.0]),
        lag=one * random.choice([0.0, 0.015, 0.045, 0.09]),
        delay=one * random.uniform(0.0, 0.03),
    )
    return controller, body


def loop_response(controller, body, frequency):
    """Compute the open loop with the attitude loop by rotorfit's own functions."""
    forward = controller.from_rate(frequency) + controller.from_angle(frequency)
    heard = controller.gyro_response(frequency)
    return forward * heard * body.response(frequency, controller.period)


def rotorfit_margins(controller, body):
    """Judge a loop as `rotorfit loop` does, and find its least distance from -1."""
    grid = loop_frequencies(controller)
    fine = fine_grid(grid[grid < HIGHEST], lambda f: loop_response(controller, body, f))
    return margins(fine, loop_response(controller, body, fine))


def late_by(delay):
    """Approximate a delay; of one second first, because short ones make large coefficients."""
    one = control.ss(control.tf(*control.pade(1.0, PADE)))
    return control.ss(one.A / delay, one.B / delay, one.C, one.D)


def control_loop(controller, body):
    """Build the same open loop in python-control."""
    c, ((gain,), (damping,), (lag,), (delay,)) = (
        controller,
        (body.gain, body.damping, body.lag, body.delay),
    )
    steep = 1.0 / (2.0 * np.pi * c.slope_lowpass)
    # (P + I / s) (1 + K / s) + D s / (1 + steep s), D on the error of both.
    on_error = np.polyadd([c.P, c.I] if c.I else [c.P], [0.0])
    integrators = int(c.I > 0.0) + int(c.angle > 0.0)
    attitude = [1.0, c.angle] if c.angle else [1.0]
    slope = np.polymul([c.D], attitude) if c.D else np.zeros(1)
    low = np.r_[np.ones(1), np.zeros(integrators - int(c.angle > 0.0) + 1)]
    top = np.polyadd(
        np.polymul(np.polymul(on_error, attitude), [steep, 1.0]), np.polymul(slope, low)
    )
    bottom = np.polymul(np.r_[1.0, np.zeros(integrators)], [steep, 1.0])
    parts = [(top, bottom), ([gain], np.polymul([1.0, damping], [lag, 1.0] if lag else [1.0]))]
    for one in c.gyro_filters:
        w = 2.0 * np.pi * one.frequency
        if one.order == 0:
            wide = 2.0 * np.pi * one.width
            parts.append(([1.0, one.floor * wide, w * w], [1.0, wide, w * w]))
        elif one.order == 1:
            parts.append(([w], [1.0, w]))
        else:
            parts.append(([w * w], [1.0, np.sqrt(2.0) * w, w * w]))
    systems = [control.ss(control.tf(*part)) for part in parts]
    return control.series(*systems, *4 * [late_by(0.25 * delay)])


def disagreements(count, seed):
    """Return loops farther than a degree from the border, with what each side calls stable.

    Those whose gain is still above 1 at the highest frequency count as unstable, and are left out.
    """
    random = np.random.default_rng(seed)
    grid = np.geomspace(0.01, HIGHEST, 4000)
    judged = []
    for _ in range(count):
        controller, body = draw_loop(random)
        response = loop_response(controller, body, grid)
        if np.abs(1.0 + response).min() < BORDER:
            continue
        if abs(response[0, -1]) >= 1.0:  # crosses gain 1 above the highest frequency
            continue
        found = rotorfit_margins(controller, body)
        poles = control.feedback(control_loop(controller, body), 1).poles()
        judged.append((found, bool(poles.real.max() < 0.0)))
    return judged


def check_against_poles(count, seed):
    judged = disagreements(count, seed)
    stable = np.array([found.stable[0] for found, _ in judged])
    assert stable.tolist() == [by_poles for _, by_poles in judged]
    assert 0.2 < stable.mean() < 0.8  # both kinds are among them
    for name in ("phase", "delay"):
        values = np.array([getattr(found, name)[0] for found, _ in judged])
        assert (values[stable & np.isfinite(values)] > 0.0).all()
        assert (values[~stable & np.isfinite(values)] < 0.0).all()


def test_stability_of_random_loops_is_that_of_the_poles():
    check_against_poles(250, seed=3)


@pytest.mark.slow
def test_stability_of_many_random_loops_is_that_of_the_poles():
    check_against_poles(5000, seed=11)


def notched_loop(frequency):
    """A loop whose gain crosses 1 three times about a notch, and that oscillates at 5.6 Hz."""
    s = 2j * np.pi * frequency
    notch = GyroFilter(frequency=6.0, order=0, width=0.2 * 6.0, floor=0.18).response(frequency)
    return (98.77 * (1 + s / 60) / (s * (1 + 0.045 * s)) * notch * np.exp(-0.012 * s))[None, :]


def test_a_loop_unstable_at_an_early_crossing_is_not_stable():
    found = margins(*judged_on(notched_loop))
    s = control.tf("s")
    w = 2 * np.pi * 6.0
    notch = (s**2 + 0.18 * 0.2 * w * s + w**2) / (s**2 + 0.2 * w * s + w**2)
    delay = control.tf(*control.pade(0.012, 8))
    system = 98.77 * (1 + s / 60) / (s * (1 + 0.045 * s)) * notch * delay
    poles = control.feedback(control.ss(system), 1).poles()
    worst = poles[np.argmax(poles.real)]
    assert worst.real == pytest.approx(0.14, abs=0.02)
    assert abs(worst.imag) / (2 * np.pi) == pytest.approx(5.6, abs=0.05)
    assert not found.stable[0]
    dense = np.geomspace(4.0, 6.0, 200_000)
    loop = notched_loop(dense)[0]
    at_one = np.abs(np.diff(np.sign(np.abs(loop) - 1.0))) > 0
    left = np.degrees(np.angle(-loop[:-1][at_one]))
    assert found.phase[0] == pytest.approx(-np.abs(left).min(), abs=0.05)
    assert found.delay[0] < 0.0


def judged_on(response):
    """Return a fine grid with the loop on it."""
    grid = fine_grid(np.geomspace(0.05, 200.0, 400), response)
    return grid, response(grid)


def test_a_conditionally_stable_loop_has_a_margin_of_lower_gain():
    def response(frequency):
        s = 2j * np.pi * frequency
        return (600.0 * (s + 2.0) ** 2 / s**3 / (1 + s / 600.0) ** 2 * 0.1)[None, :]

    s = control.tf("s")
    system = 600.0 * (s + 2.0) ** 2 / s**3 / (1 + s / 600.0) ** 2 * 0.1
    found = margins(*judged_on(response))
    assert found.stable[0]
    for factor in (found.lower_gain[0], found.gain[0]):
        inside, outside = (
            control.feedback(factor**share * system, 1).poles().real.max() for share in (0.98, 1.02)
        )
        assert inside < 0.0 < outside


def test_a_resonance_at_a_full_turn_leaves_a_loop_stable():
    """The gain is above 1 again where the phase is near -360 degrees: no crossing is at -180."""

    def response(frequency):
        s = 2j * np.pi * frequency
        w = 2 * np.pi * 15.0
        peak = 1 + 20.0 * (0.02 * w * s) / (s**2 + 0.02 * w * s + w**2)
        return (8.0 / s * peak * np.exp(-s * 0.0445))[None, :]

    found = margins(*judged_on(response))
    assert found.crossover[0] == pytest.approx(15.0, abs=0.5)
    assert found.stable[0]
    assert found.phase[0] > 10.0


def test_a_step_past_the_border_is_halved():
    grid = np.array([1.0, 2.0, 3.0])
    fine = fine_grid(grid, lambda f: (-1.0 + 0.01j + 0.2 * (f - 2.2))[None, :])
    loop = -1.0 + 0.01j + 0.2 * (fine - 2.2)
    steps = np.abs(np.diff(loop)) / np.minimum(np.abs(1 + loop[1:]), np.abs(1 + loop[:-1]))
    assert set(grid) <= set(fine)
    assert steps.max() <= 0.25


def test_the_last_crossover_is_a_falling_one():
    grid = np.geomspace(0.1, 100.0, 4000)
    size = np.interp(np.log(grid), np.log([0.1, 2.0, 5.0, 9.0, 100.0]), [9.0, 0.5, 3.0, 0.9, 0.1])
    expected = np.exp(np.interp(-1.0, [-3.0, -0.9], np.log([5.0, 9.0])))
    assert last_crossover(grid, size * np.exp(-2j)) == pytest.approx(expected, rel=2e-3)


def limits_of(response):
    found = margins(*judged_on(response))
    return limit_words(measures_of(found, np.full(1, np.nan)))


def test_the_limits_of_a_loop_name_its_nearest_gain():
    def loop(frequency, factor):
        s = 2j * np.pi * frequency
        return (factor * 60.0 * (s + 2.0) ** 2 / s**3 / (1 + s / 600.0) ** 2)[None, :]

    higher, lower = (limits_of(lambda f, k=k: loop(f, k)) for k in (6.0, 0.03))
    assert "times higher" in higher
    assert "fell to" not in higher
    assert "fell to 0.5" in lower


def test_a_loop_without_a_gain_margin_names_its_delay_only(assert_wording):
    words = limits_of(lambda f: (20.0 / (2j * np.pi * f))[None, :])
    assert "were 79 ms" in words
    assert_wording(words)
    assert "gain" not in words
