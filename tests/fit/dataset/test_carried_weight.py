"""The thrust coefficient that carries the weight: throws, climbs and gusts written out by hand."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.estimation.measured import Measured
from rotorfit.fit.dataset.carried_weight import (
    VerticalMotion,
    carrying_stretches,
    climb_drag,
    height_force_of,
    variance_of_sum,
    vertical_acceleration,
    vertical_motions,
    weighed,
)
from rotorfit.fit.dataset.weight_balance import turning
from rotorfit.flight.flight_data import Segment

G = 9.80665
MASS = 1.4
KT = MASS * G / (4 * 500.0**2)
"""Of four rotors at 500 rad/s."""
CERTAIN, UNKNOWN = Measured(value=0.0, std=1e-6), Measured(value=0.0, std=1e6)


def flown(acceleration, *, drag=0.0, velocity=None, factor=1.0):
    """Return a flight of a vertical acceleration at 100 Hz, its thrust as that takes with drag."""
    v = np.cumsum(acceleration) / 100.0
    force = np.zeros((len(v), 3))
    force[:, 2] = G + acceleration
    thrust = (force[:, 2] + drag * v) * factor
    data = made_fit.prepared(seconds=len(v) / 100.0, force=force).data
    speed = np.repeat(500.0 * np.sqrt(thrust / G)[:, None], 4, axis=1)
    logged = None if velocity is None else np.outer(v, [0.0, 0.0, 1.0]) + velocity
    return replace(data, rotor_speed=speed, velocity=logged)


def kts(data, *, bias=CERTAIN, velocity_std=0.3):
    return list(
        carrying_stretches(
            data, turning(data), made_fit.QUAD, mass=MASS, bias=bias, velocity_std=velocity_std
        )
    )


def thrown(seconds=12.0, brake=5.0):
    """A throw that is braked within a second."""
    acceleration = np.zeros(round(100 * seconds))
    acceleration[:100] = brake
    return acceleration


def test_hover_carries_the_weight():
    (held,) = kts(flown(np.zeros(800)))
    assert held.ratio == pytest.approx(KT, rel=1e-9)
    assert held.seconds == pytest.approx(8.0)


@pytest.mark.parametrize(("seconds", "own"), [(4.0, 1.0), (16.0, 4.0 / 3.0)])
def test_an_unknown_velocity_is_what_a_hover_leaves_open(seconds, own):
    """Two velocities of 1.5 m/s are taken as seen, one in 2 s is still; 12 / T^2 of T / 2."""
    (held,) = kts(flown(np.zeros(round(100 * seconds))), bias=UNKNOWN)
    velocity = 1.5 * np.sqrt(2.0 / (2.0 + seconds / 2.0))
    slope = np.sqrt(12.0 * 2.0 / seconds) / seconds
    assert held.std / held.ratio == pytest.approx(velocity * slope / G, rel=1e-6)


def test_a_throw_counts_with_its_momentum():
    """5 m/s of a throw braked in the first of 12 s: 4.2 % of the weight on average."""
    (known,) = kts(flown(thrown()))
    assert known.ratio == pytest.approx(KT, rel=1e-6)
    (open_bias,) = kts(flown(thrown()), bias=UNKNOWN)
    # Weighed by 6 t (T - t) / T^3, the first second counts a fiftieth.
    assert open_bias.ratio / KT == pytest.approx(1.0 - 5.0 * (3 / 144 - 2 / 1728) / G, abs=1e-3)
    assert abs(open_bias.ratio - KT) < 1.96 * open_bias.std


def test_a_logged_velocity_shows_the_momentum():
    logged = flown(thrown(), velocity=0.0)
    (held,) = kts(logged, bias=UNKNOWN, velocity_std=1e-3)
    assert held.ratio == pytest.approx(KT, rel=2e-3)
    by_positions = replace(logged, velocity=None, carried=logged.velocity)
    assert kts(by_positions, bias=UNKNOWN, velocity_std=1e-3) == [held]
    gap = by_positions.carried.copy()
    gap[300] = np.nan  # far from any position
    (blind,) = kts(replace(by_positions, carried=gap), bias=UNKNOWN)
    assert [blind] == kts(flown(thrown()), bias=UNKNOWN)


@pytest.mark.parametrize(("read", "std"), [(0.05, 0.05 / np.sqrt(2.0)), (0.2, 0.1)])
def test_a_bias_is_weighed_against_the_velocity(read, std):
    """Where each leaves as much open, half of what is read is acceleration; or all is open."""
    step = 0.01
    motion = VerticalMotion(
        step=step, read=np.full(1000, G + read), push=np.full(1000, 1.0), velocity=np.zeros(1000)
    )
    slope = np.sqrt(12.0 * 2.0 / 10.0) / 10.0
    found = vertical_acceleration(motion, Measured(value=0.0, std=0.05), 0.05 / slope)
    assert found.value == pytest.approx(0.5 * read)
    assert found.std == pytest.approx(std)


def test_the_bias_at_rest_is_no_acceleration():
    motion = VerticalMotion(
        step=0.01, read=np.full(1000, G + 0.2), push=np.full(1000, 1.0), velocity=None
    )
    found = vertical_acceleration(motion, Measured(value=0.2, std=0.05), 0.3)
    assert found.value == pytest.approx(0.0, abs=1e-12)


def test_drag_that_goes_with_the_velocity_is_no_scatter():
    velocity = np.sin(np.arange(2000) / 300.0)
    push = 1.0 + 0.1 * np.sin(np.arange(2000) / 170.0)
    read = G * push - 0.3 * velocity
    _, std = climb_drag(VerticalMotion(step=0.01, read=read, push=push, velocity=velocity))
    scatter = np.std([part.mean() for part in np.array_split(0.3 * velocity, 10)]) / np.sqrt(10.0)
    assert std < 0.2 * scatter


def leaning(seconds=20.0, lean=0.05):
    """Speed up for half of the time, leaning forward, and brake for the other; height is held."""
    t = np.arange(round(100 * seconds)) / 100.0
    angle = lean * np.clip(10.0 * np.sin(2.0 * np.pi * t / seconds), -1.0, 1.0)
    force = np.zeros((len(t), 3))
    force[:, 2] = G / np.cos(angle)
    forward = np.cumsum(G * np.tan(angle)) / 100.0
    data = made_fit.prepared(seconds=seconds, force=force).data
    rates = np.zeros_like(force)
    rates[:, 1] = np.diff(angle, append=0.0) * 100.0
    speed = np.repeat(500.0 * np.sqrt(force[:, 2:] / G), 4, axis=1)
    logged = np.column_stack([forward * np.cos(angle), 0.0 * t, forward * np.sin(angle)])
    return replace(data, angular_velocity=rates, rotor_speed=speed, velocity=logged)


def test_gaining_speed_sideways_carries_nothing():
    """Leaning by .05 rad takes .13 % more thrust than the weight, but none of it is upwards."""
    (held,) = kts(leaning(), bias=UNKNOWN)
    assert held.ratio == pytest.approx(KT, rel=1e-4)


def test_axes_that_a_biased_gyro_turns():
    """A bias of .028 rad/s turns them by .28 rad in ten seconds, .33 % of a mean force."""
    data = flown(np.zeros(4000))
    rates = data.angular_velocity + np.array([0.02, -0.02, 0.0])
    (held,) = kts(replace(data, angular_velocity=rates), bias=UNKNOWN)
    assert held.ratio == pytest.approx(KT, rel=1e-4)


def climbing():
    """Climb for a while, sink longer; the mean velocity is not zero where it counts most."""
    t = np.arange(6000) / 100.0
    return 0.8 * np.sin(2 * np.pi * t / 17.0) * np.exp(-((t - 25.0) ** 2) / 300.0)


def test_drag_of_a_climb_is_no_thrust():
    """With drag of 0.5 /s the climb takes half a percent of thrust more, and scatters."""
    with_drag = flown(climbing(), drag=0.5, velocity=0.0)
    (held,) = kts(with_drag)
    assert abs(held.ratio - KT) < 1.96 * held.std
    (blind,) = kts(replace(with_drag, velocity=None))
    assert abs(held.ratio - KT) < abs(blind.ratio - KT)
    motion = next(vertical_motions(turning(with_drag), with_drag, with_drag.rotor_speed[:, :3]))
    assert motion.velocity is not None


def test_half_a_flight_in_ground_effect_is_open():
    """A tenth more of thrust at one rotor speed, in the first half."""
    factor = np.where(np.arange(4000) < 2000, 1.0 / 1.1, 1.0)
    (held,) = kts(flown(np.zeros(4000), factor=factor))
    assert 0.9 * KT < KT < held.ratio + 1.96 * held.std
    assert 0.01 < held.std / held.ratio < 0.035


def test_batches_scatter_as_their_mean_does(rng=None):
    """Ten batches of what no thrust explains: their mean as sure as it is over many flights."""
    rng = np.random.default_rng(5)
    found = []
    for _ in range(300):
        read = G + np.repeat(rng.normal(0.0, 0.3, 100), 20)
        motion = VerticalMotion(step=0.01, read=read, push=np.full(2000, 1.0), velocity=None)
        mean = float(motion.weights @ read) - G
        found.append((mean, climb_drag(motion)[1]))
    means, stds = np.array(found).T
    # t of nine degrees over 1.96: 1.15; the felt velocity takes a little off.
    assert 1.0 < np.median(stds) / means.std() < 1.3


def test_separate_stretches_are_weighed_alone():
    data = flown(np.zeros(2000))
    data = replace(data, segments=(Segment(start=0, stop=800), Segment(start=1000, stop=2000)))
    assert [round(one.seconds) for one in kts(data)] == [8, 10]
    assert kts(replace(data, segments=(Segment(start=0, stop=190),))) == []


def torn(data, *, whole=1.9, every=2.3):
    """Return a flight of which gaps leave pieces that are too short to weigh alone."""
    steps = round(len(data.time) / (100.0 * every))
    begins = np.round(100.0 * every * np.arange(steps)).astype(int)
    parts = tuple(Segment(start=int(a), stop=int(a) + round(100 * whole)) for a in begins)
    return replace(data, segments=parts)


def test_pieces_of_a_torn_flight_are_weighed_together():
    """The velocity at the ends of each shows the weight; the bias is the same in all."""
    data = flown(climbing(), drag=0.1, velocity=0.0)
    (held,) = kts(torn(data), bias=UNKNOWN, velocity_std=0.1)
    assert abs(held.ratio - KT) < 1.96 * held.std
    assert held.std < 0.01 * KT
    assert held.seconds == pytest.approx(1.9 * 26)
    unseen = replace(data, velocity=None)
    (blind,) = kts(torn(unseen), bias=Measured(value=0.0, std=0.2))
    assert abs(blind.ratio - KT) < 1.96 * blind.std
    assert blind.std / blind.ratio == pytest.approx(0.2 / G, rel=0.05)


def hanging(pull, *, noise, seed=3):
    """Thirty seconds of climbs about a height at which a tether takes part of the thrust."""
    rng = np.random.default_rng(seed)
    t = 0.05 * np.arange(600)
    climb = sum(0.3 * np.sin(2 * np.pi * f * t + p) for f, p in ((0.07, 0), (0.13, 1), (0.29, 2)))
    height = np.cumsum(climb) * 0.05
    read = G + np.gradient(climb, 0.05)
    push = (read + pull * height + noise * rng.normal(size=len(t))) / KT
    return VerticalMotion(step=0.05, read=read, push=push, velocity=None)


def test_a_tether_is_found_and_leaves_the_mean_force_open():
    found = height_force_of(hanging(0.25, noise=0.05))
    assert found.value == pytest.approx(0.25, abs=3.0 * found.std)
    assert found.std < 0.03
    assert found.probability > 0.999
    deviation = climb_drag(hanging(0.25, noise=0.05))[1]
    assert 0.25 * 3.0 / 1.96 < deviation < 0.35 * 3.0 / 1.96


def test_without_a_tether_nothing_grows_with_height():
    found = [height_force_of(hanging(0.0, noise=0.1, seed=seed)) for seed in range(40)]
    assert max(one.probability for one in found) < 0.5
    assert np.median([one.half_width for one in found]) == 0.0
    assert np.mean([abs(one.value) < 1.96 * one.std for one in found]) > 0.9


def test_a_doubtful_tether_is_open_by_its_likelihood():
    """Two deviations of a force that one flight in thirty has: likely none, but not surely."""
    assert weighed(0.1, 0.05, degrees=9).half_width < 0.1
    assert 0.1 < weighed(0.2, 0.06, degrees=9).half_width < 0.3
    assert weighed(0.0, 0.2, degrees=9).half_width == 0.0


def test_a_short_stretch_shows_no_tether():
    short = hanging(0.25, noise=0.0)
    short = replace(short, read=short.read[:140], push=short.push[:140])
    assert height_force_of(short) is None


def test_a_push_that_lasts_makes_batches_go_together() -> None:
    """A wall in the middle third of a flight: what it makes of the sum is within its deviation."""
    independent = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    together = np.array([-3.0, -3.0, -3.0, 7.0, 7.0, 7.0, -3.0, -3.0, -3.0, -3.0])
    assert variance_of_sum(independent) == pytest.approx(10.0)
    assert variance_of_sum(together) == pytest.approx(210.0 + 2.0 * 101.0)
