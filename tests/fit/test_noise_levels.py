"""Noise that changes within a phase: its level is found, and rows count by it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

import made_fit
from flown import airframe_table
from rotorfit.fit.dataset.load import load_dataset
from rotorfit.fit.experiment.experiment import single_flight_experiment
from rotorfit.fit.fit_flights import fit_flights
from rotorfit.fit.noise_levels import (
    LEAST_SPREAD,
    allow_for_noise_levels,
    fit_by_noise,
    noise_levels,
)
from rotorfit.fit.reduction.reduce import BandPlan, band_factors, stretch_window
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.fit.timing.timing_fit import time_motors
from rotorfit.flight.flight_data import Segment
from rotorfit.model.parameters import inertia_about
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight, variant
from rotorfit.simulation.experiment_files import IMU_AND_SPEED, write_flight_table

RATE = 250.0


def test_a_step_of_the_noise_is_found_to_a_seventh():
    errors = np.random.default_rng(1).normal(size=(1500, 4)) * [1.0, 20.0, 3.0, 5.0]
    errors[750:] *= 4.0
    level = noise_levels(errors, RATE)
    ratio = np.exp(np.log(level[850:]).mean() - np.log(level[:650]).mean())
    assert ratio == pytest.approx(4.0, rel=1 / 7)
    assert np.log(level).mean() == pytest.approx(0.0, abs=1e-9)


def test_a_slow_gust_of_one_size_makes_no_level():
    drawn = np.random.default_rng(2).normal(size=(5000, 4))
    gust = np.zeros_like(drawn)
    for i in range(1, len(gust)):
        gust[i] = (1.0 - 1.0 / (0.4 * RATE)) * gust[i - 1] + drawn[i]
    plain = np.sqrt((gust**2).mean(axis=1))[500:]
    assert np.log(plain).std() > 1.5 * LEAST_SPREAD
    assert np.log(noise_levels(gust, RATE)).std() < LEAST_SPREAD


def test_a_short_stretch_or_one_without_errors_is_left_alone():
    assert (noise_levels(np.ones((60, 4)), RATE) == 1.0).all()
    assert (noise_levels(np.zeros((600, 4)), RATE) == 1.0).all()


def levelled(level):
    """Return a hover of 20 s whose rows are so noisy."""
    data = made_fit.prepared(seconds=20.0).data
    segments = (Segment(start=1, stop=len(data.time) - 1),)
    return replace(data, segments=segments, noise_level=level, rotor_speed_std=1.0)


def test_rows_of_one_level_count_as_without_any():
    plan = BandPlan(edges=(0.0, 1.0, 5.0, 15.0))
    plain, even = levelled(None), levelled(np.full(2000, 3.0))
    one, other = (band_factors(data, made_fit.QUAD, plan=plan) for data in (plain, even))
    assert one.noise is not None and other.noise is not None
    np.testing.assert_allclose(other.R, one.R, rtol=1e-9, atol=1e-9 * np.abs(one.R).max())
    np.testing.assert_allclose(other.noise, one.noise, rtol=1e-9)


def test_rows_twice_as_noisy_count_a_quarter():
    level = np.where(np.arange(2000) < 1000, 1.0, 2.0)
    data = levelled(level)
    window = stretch_window(data, data.segments[0], BandPlan(edges=(0.0, 1.0), taper=0.0))
    assert window @ window == pytest.approx(1.0)
    assert (window[0] / window[-1]) ** 2 == pytest.approx(4.0)


@pytest.fixture(scope="module")
def bumpy(tmp_path_factory):
    """A flight that is shaken for some 0.4 s of every 2 s, fitted; with its truth."""
    folder = tmp_path_factory.mktemp("bumpy")
    (truth, vehicle), sensors = variant(paper_vehicle("A"), "noisy")
    scenario = Scenario(seconds=20.0, sensors=sensors)
    flight = simulate_flight(truth, vehicle, scenario, seed=3)
    bump = np.clip(np.sin(np.pi * flight.time), 0.0, None)[:, None] ** 8
    drawn = np.random.default_rng(4).normal(size=(len(bump), 3))
    shaken = signal.sosfilt(signal.butter(2, (1.0, 12.0), "band", fs=200.0, output="sos"), drawn, 0)
    flight = replace(flight, gyro=flight.gyro + 0.3 * bump * shaken)
    airframe = f'{airframe_table(vehicle)}[motors]\nspeed = "measured"\n'
    (folder / "airframe.toml").write_text(airframe, encoding="utf-8")
    write_flight_table(flight, folder / "flight.csv", channels=IMU_AND_SPEED)
    experiment = single_flight_experiment(
        folder / "flight.csv", mass=truth.mass, airframe=folder / "airframe.toml"
    )
    dataset = TimedDataset.of(load_dataset(experiment, lambda words: None))
    dataset = time_motors(dataset, lag=True, report=lambda words: None)
    return truth, fit_flights(dataset, None)


@pytest.mark.filterwarnings("ignore:.*gyro bias not removed")
def test_a_flight_with_bumps_shows_more_by_its_quiet_rows(bumpy):
    truth, fit = bumpy
    again = fit_by_noise(fit, None)
    com = np.array(truth.first_moments) / truth.mass
    about_com = inertia_about(np.array(truth.inertia), -truth.mass, com)
    for i, name in enumerate(("Ixx", "Iyy")):
        at = fit.estimate.estimate.names.index(f"{name}@A")
        assert again.estimate.estimate.std[at] < 0.8 * fit.estimate.estimate.std[at]
        value, half = again.numbers.number(f"{name}_com@A")
        assert abs(value - about_com[i]) < half


@pytest.mark.filterwarnings("ignore:.*gyro bias not removed")
def test_what_weights_move_beyond_chance_is_in_the_interval(bumpy):
    _, fit = bumpy
    assert allow_for_noise_levels(fit) is fit  # rows of even noise
    again = fit_by_noise(fit, None)
    wider = allow_for_noise_levels(again).numbers
    moved = np.abs(again.numbers.values - fit.numbers.values)
    least = moved - np.sqrt(
        np.maximum(fit.numbers.half_width**2 - again.numbers.half_width**2, 0.0)
    )
    at = [again.numbers.index(name) for name in ("kt", "kd", "Ixx@A", "Iyy@A", "Izz@A")]
    assert (wider.half_width >= again.numbers.half_width).all()
    assert (wider.half_width[at] >= 0.9 * least[at]).all()
    assert (wider.half_width[at] < 1.3 * fit.numbers.half_width[at]).all()
