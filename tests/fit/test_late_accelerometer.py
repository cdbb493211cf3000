"""The lateness of an accelerometer's low-pass is taken off, whether seen or felt in its time."""

import warnings
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.fast_worlds import draw_world, experiment_text

import flown
import made_fit
from rotorfit.errors import UnsettledError
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.fit.reduction.bandwidth import Bandwidth
from rotorfit.fit.reduction.motor_timing import MotorTiming
from rotorfit.fit.sensors import late_accelerometer
from rotorfit.fit.sensors.force_delay import DelayedForces
from rotorfit.fit.sensors.late_accelerometer import (
    ForceDelays,
    allow_for_force_delays,
    fit_with_force_in_time,
    log_odds_of_delay,
)
from rotorfit.fit.sensors.lateness import Lateness
from rotorfit.fit.timing.sensor_bandwidth import (
    measure_bandwidths,
    take_off_lateness,
    with_force_in_time,
)
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.identification import identify_flights
from rotorfit.simulation import Scenario, simulate_flight, variant, write_flight_table
from rotorfit.simulation.experiment_files import true_parameters
from rotorfit.simulation.sensors import Sensors

CUTOFF = 4.8
MS = 1e-3


@pytest.fixture(scope="module")
def filtered(tmp_path_factory):
    """A fast flight behind a low-pass that makes forces 47 ms late; what is found, and its J_r."""
    folder, world = tmp_path_factory.mktemp("late"), draw_world(90431, 35, seconds=25.0)
    assert world.scenario.sensors.accel_cutoff == pytest.approx(CUTOFF, abs=0.01)
    flight = simulate_flight(world.truth, world.vehicle, world.scenario, seed=world.index)
    channels = ("gyro", "accel", "rotor_speed", "velocity")
    write_flight_table(flight, folder / "flight.csv", channels=channels)
    (folder / "world.toml").write_text(experiment_text(world), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = identify_flights(load_experiment(folder / "world.toml"))
    return found, true_parameters(world.truth, rotors=4)["Jr_over_Izz"]


def test_a_late_accelerometer_does_not_time_the_motors(filtered):
    """Of nine such worlds the delay is within 3 ms; it was 9 to 50 ms, as late as the force."""
    found, _ = filtered
    timing = found.dataset.motor_timing
    assert timing is not None
    assert abs(timing.response.delay) < 0.004


def test_the_rotors_inertia_does_not_make_up_for_it(filtered):
    found, truth = filtered
    (ratio,) = (n for n in found.result.derived if n.name == "Jr_over_Izz")
    assert ratio.interval[0] < truth < ratio.interval[1]
    assert ratio.verdict == "identified"


def test_a_low_pass_that_was_taken_off_is_named(filtered, assert_wording):
    """A Butterworth delays slow motion by the root of 2 over 2 pi times its cut-off: 47 ms."""
    found, _ = filtered
    (said,) = (one for one in found.result.findings if one.kind == "accelerometer-filtered")
    assert said.severity == "note"
    assert said.flights == ("flight.csv",)
    assert said.evidence[0].value == pytest.approx(CUTOFF, rel=0.1)
    assert "47 ms" in said.sentence
    assert_wording(said.sentence)


def test_a_low_pass_that_was_taken_off_is_not_measured_again(filtered):
    found, _ = filtered
    (flight,) = found.dataset.configurations[0].flights
    low_pass = flight.bandwidths["accel"]
    assert low_pass.taken_off
    assert low_pass.cutoff == pytest.approx(CUTOFF, rel=0.1)
    again = measure_bandwidths(found.dataset)
    assert again.configurations[0].flights[0].bandwidths["accel"] is low_pass
    assert take_off_lateness(again) is again


@pytest.mark.parametrize(
    ("shape", "source", "is_moved"),
    [
        ("first order", "imu", True),
        ("second order", "imu", True),
        ("smoothed", "imu", False),
        ("second order", "mocap", False),
    ],
)
def test_only_an_imu_behind_a_filter_on_board_is_late(shape, source, is_moved):
    low_pass = Bandwidth(shape=shape, cutoff=5.0, interval=(4.0, 6.0), delay=0.0, gain=100.0)
    dataset = TimedDataset.of(made_fit.dataset(made_fit.prepared()))
    (configuration,) = dataset.configurations
    flights = [replace(one, bandwidths={"accel": low_pass}) for one in configuration.flights]
    dataset = replace(
        dataset, source=source, configurations=(replace(configuration, flights=flights),)
    )
    moved = take_off_lateness(dataset)
    before, after = (
        one.configurations[0].flights[0].prepared.data.specific_force for one in (dataset, moved)
    )
    assert np.array_equal(before, after) is not is_moved
    assert (moved is dataset) is not is_moved


# What neither noise nor motion shows, forces and turns may: they respond to the rotors at once.


COARSE = Sensors(gyro_std=0.005, gyro_resolution=0.004, accel_std=0.02, accel_resolution=0.05)
"""Of whose accelerometer the steps hide the noise, and with it what its low-pass takes off that."""


@pytest.fixture(scope="module")
def felt(tmp_path_factory):
    """What is found in a flight by commands behind a low-pass at 9 Hz: 25 ms."""
    folder = tmp_path_factory.mktemp("felt")
    vehicle = flown.simulated_vehicle("quad-x")
    scenario = Scenario(sensors=replace(COARSE, accel_cutoff=9.0), seconds=25.0)
    flight = simulate_flight(*variant(vehicle, "clean")[0], scenario, seed=3)
    write_flight_table(flight, folder / "flight.csv", channels=("gyro", "accel", "command"))
    commanded = f'[motors]\nspeed = "commanded"\nlaw = {{ linear = [0, {flight.max_speed}] }}\n'
    path = flown.experiment_file(
        folder / "experiment.toml",
        flight.vehicle,
        [folder / "flight.csv"],
        mass=flight.truth.mass,
        extra=commanded,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return identify_flights(load_experiment(path))


def test_a_low_pass_that_only_its_delay_shows_is_taken_off(felt, assert_wording):
    (said,) = (one for one in felt.result.findings if one.kind == "accelerometer-filtered")
    assert said.evidence[0].value == pytest.approx(9.0, rel=0.05)
    assert "25 ms" in said.sentence
    assert_wording(said.sentence)
    (clocks,) = (one for one in felt.result.findings if one.kind == "imu-clocks")
    assert clocks.severity == "passed"


def test_what_such_a_delay_leaves_open_is_in_the_intervals(felt):
    (com,) = (n for n in felt.result.derived if n.name == "com_x")
    terms = {one.name: one.half_width for one in com.interval_terms}
    assert terms["late accelerometer"] > 0.0
    (delay,) = (n for n in felt.result.parameters if n.name == "motor_delay")
    assert delay.interval[0] < 0.0 < delay.interval[1]


@pytest.mark.parametrize(
    ("late", "std", "likely"),
    [
        (2.6, 1.0, False),
        (2.9, 1.0, True),
        (-2.9, 1.0, True),
        (7.0, 3.0, False),
        (8.0, 3.0, True),
        (60.0, 20.0, False),  # no autopilot filters so much
        (60.0, 6.0, True),
    ],
)
def test_a_delay_is_as_likely_as_chance_and_usual_filters_say(late, std, likely):
    """One in ten is behind a low-pass, whose delay is 10 ms on the average; the others are not."""
    odds = log_odds_of_delay(Lateness(seconds=late * MS, std=std * MS))
    delays, step = np.linspace(0.0, 0.2, 20_001), 1e-5
    by_delay = np.exp(-0.5 * ((abs(late) * MS - delays) / (std * MS)) ** 2 - delays / 0.01) / 0.01
    none = np.exp(-0.5 * (late / std) ** 2)
    assert odds == pytest.approx(np.log(by_delay.sum() * step / none / 9.0), abs=0.1)
    assert (odds > 0.0) is likely


class Felt:
    """Fits whose lateness shrinks by a share of what is taken off, and number by its delay.

    `numbers`: of a fit with a delay of the forces.
    """

    numbers: Mapping[str, float] = {}

    def __init__(
        self, monkeypatch, *, true, share=0.45, std=2.0, before=0.0, fails_at=9, error=None
    ):
        self.fails_with = error
        self.true, self.share, self.std, self.fails_at = true, share, std, fails_at
        self.delays = []
        monkeypatch.setattr(late_accelerometer, "force_delays", self.delayed)
        flights = TimedDataset.of(made_fit.dataset(made_fit.prepared()))
        if before:
            flights = with_force_in_time(flights, {0: low_pass_of(before)})
        self.begun = self.fit(flights)

    def delayed(self, fit):
        return DelayedForces(list(self.lateness(fit)), self.numbers)

    def lateness(self, fit):
        (flight,) = fit.dataset.configurations[0].flights
        left = self.share * (self.true - 1e3 * self.off(flight))
        yield flight, Lateness(seconds=left * MS, std=self.std * MS)

    def off(self, flight):
        low_pass = flight.bandwidths.get("accel")
        return 0.0 if low_pass is None else low_pass.slow_delay

    def fit(self, flights):
        (flight,) = flights.configurations[0].flights
        self.delays.append(1e3 * self.off(flight))
        if len(self.delays) > self.fails_at:
            raise self.fails_with
        numbers = made_fit.no_numbers("Jr", values=[3.0 - 0.1 * self.delays[-1]], half_width=[1.0])
        return made_fit.fit(flights, numbers)

    def found(self):
        return fit_with_force_in_time(self.begun, self.fit)


def low_pass_of(delay):
    cutoff = 1e3 / (2.0**0.5 * np.pi * delay)
    return Bandwidth(
        shape="second order", cutoff=cutoff, interval=(cutoff, cutoff), delay=0.0, gain=30.0
    )


@pytest.mark.parametrize(("share", "rounds"), [(1.0, 2), (0.45, 3)])
def test_a_delay_is_taken_off_until_forces_and_turns_agree(monkeypatch, share, rounds):
    """A fit has followed the late force, and shows a share of the lateness only."""
    felt = Felt(monkeypatch, true=18.0, share=share)
    found = felt.found()
    assert len(felt.delays) == rounds
    assert felt.delays[-1] == pytest.approx(18.0, rel=1e-3)
    assert found.numbers.values[0] == pytest.approx(3.0 - 1.8, rel=1e-3)


def test_a_delay_that_was_taken_off_too_much_is_given_back(monkeypatch):
    felt = Felt(monkeypatch, true=8.0, share=0.8, before=20.0)
    felt.found()
    assert felt.delays[0] == pytest.approx(20.0, rel=1e-3)
    assert felt.delays[-1] == pytest.approx(8.0, rel=1e-3)


@pytest.mark.parametrize(
    ("before", "left", "after"), [(0.0, 4.8, 0.0), (20.0, 4.8, 24.8), (20.0, 3.6, 20.0)]
)
def test_a_low_pass_that_was_found_is_doubted_sooner(monkeypatch, before, left, after):
    """By 2.4 deviations: noise and motion tell its cut-off less surely than that there is one."""
    felt = Felt(monkeypatch, true=before + left, share=1.0, before=before)
    felt.found()
    assert felt.delays[-1] == pytest.approx(after, rel=1e-3)


def test_a_delay_that_nothing_shows_stays_as_it_was_found(monkeypatch):
    """Once such a one went from 13 to 99 ms, by a lateness of 18 +- 43."""
    felt = Felt(monkeypatch, true=31.0, share=1.0, before=13.0, std=43.0)
    felt.found()
    assert felt.delays == pytest.approx([13.0], rel=1e-3)


def test_most_of_a_delays_deviation_widens_the_numbers(monkeypatch):
    """2 ms that are .45 of the delay's: J_r moves by .1 a millisecond."""
    found = allow_for_force_delays(Felt(monkeypatch, true=18.0).found())
    late = found.numbers.terms[-1]
    assert late.name == "late accelerometer"
    assert late.half_width[0] == pytest.approx(1.96 * 0.75 * 0.1 * 2.0 / 0.45, rel=1e-3)


class FeltInTwo(Felt):
    """Two flights, 18 and 40 ms late: one fit shows all of the first, and .45 of the second."""

    def __init__(self, monkeypatch):
        monkeypatch.setattr(late_accelerometer, "of_one_vehicle", list)
        self.late = ((18.0, 1.0), (40.0, 0.45))
        super().__init__(monkeypatch, true=0.0)

    def lateness(self, fit):
        flights = fit.dataset.configurations[0].flights
        for flight, (true, share) in zip(flights, self.late, strict=True):
            yield flight, Lateness(seconds=share * (true - 1e3 * self.off(flight)) * MS, std=2 * MS)

    def fit(self, flights):
        both = made_fit.dataset(made_fit.prepared(), made_fit.prepared())
        flights = flights if self.delays else TimedDataset.of(both)
        self.delays.append(sum(1e3 * self.off(one) for one in flights.configurations[0].flights))
        numbers = made_fit.no_numbers("Jr", values=[3.0 - 0.1 * self.delays[-1]], half_width=[1.0])
        return made_fit.fit(flights, numbers)


def test_a_flight_in_time_at_once_does_not_widen_the_numbers(monkeypatch):
    """The numbers moved by 2.2 with the 22 ms of the other flight."""
    felt = FeltInTwo(monkeypatch)
    found = allow_for_force_delays(felt.found())
    assert felt.delays == pytest.approx([0.0, 36.0, 58.0], rel=1e-3)
    open_delays = np.hypot(2.0, 2.0 / 0.45)
    assert found.numbers.terms[-1].half_width[0] == pytest.approx(
        1.96 * 0.75 * 0.1 * open_delays, rel=1e-3
    )


def test_a_delay_beyond_those_taken_off_leaves_its_interval(monkeypatch):
    """Once the numbers were known exactly, as the same delay was taken off again."""
    felt = Felt(monkeypatch, true=150.0, share=0.8)
    found = allow_for_force_delays(felt.found())
    assert felt.delays == pytest.approx([0.0, 99.0], rel=1e-3)
    assert found.numbers.terms[-1].half_width[0] > 0.1


def test_delays_of_the_forces_leave_the_motors_times_open(monkeypatch):
    """By their shifts beside what was known, the sum of lag and delay by its own."""
    felt = Felt(monkeypatch, true=0.0)
    timing = MotorTiming(
        response=MotorResponse(lag=0.03, delay=0.002), lag_std=3e-3, delay_std=1e-3, total_std=1e-3
    )
    timed = replace(felt.begun, dataset=replace(felt.begun.dataset, motor_timing=timing))
    shifts = {"Jr": 0.1, "motor_lag": 4e-3, "motor_delay": 2e-3, "motor_lag_total": 1e-3}
    found = allow_for_force_delays(timed.with_record(ForceDelays(left=(), shifts=shifts)))
    wider = found.dataset.motor_timing
    assert wider.response == timing.response
    assert wider.lag_std == pytest.approx(5e-3)
    assert wider.delay_std == pytest.approx(5**0.5 * 1e-3)
    assert wider.total_std == pytest.approx(2**0.5 * 1e-3)
    given = replace(timing, lag_std=None, delay_std=None)
    timed = replace(felt.begun, dataset=replace(felt.begun.dataset, motor_timing=given))
    found = allow_for_force_delays(timed.with_record(ForceDelays(left=(), shifts=shifts)))
    assert found.dataset.motor_timing.lag_std is None
    assert found.dataset.motor_timing.delay_std is None


@pytest.mark.parametrize("true", [4.0, -18.0])
def test_forces_that_may_be_in_time_stay_as_they_are(monkeypatch, true):
    felt = Felt(monkeypatch, true=true)
    found = felt.found()
    assert felt.delays == [0.0]
    assert found.dataset is felt.begun.dataset
    assert allow_for_force_delays(found) is found
    ((_, left),) = found.record_of(ForceDelays).left
    assert left.seconds == pytest.approx(0.45 * true * MS)


@pytest.mark.parametrize(("true", "wider"), [(10.0, True), (2.0, True), (-10.0, False)])
def test_a_delay_that_may_be_there_widens_the_numbers(monkeypatch, true, wider):
    """Of 2.25, .45 and -2.25 deviations: by its chance, and by how far J_r moves with it."""
    felt = Felt(monkeypatch, true=true)
    felt.numbers = {"Jr": 3.0 - 0.1 * true}
    found = allow_for_force_delays(felt.found())
    assert felt.delays == [0.0]
    odds = log_odds_of_delay(Lateness(seconds=0.45 * true * MS, std=2.0 * MS))
    chance = np.exp(odds) / (1.0 + np.exp(odds))
    expected = 1.96 * np.sqrt(chance) * 0.1 * true if wider else 0.0
    late = [one.half_width[0] for one in found.numbers.terms if one.name == "late accelerometer"]
    assert sum(late) == pytest.approx(expected)


def test_a_number_that_a_delay_would_not_leave_stays_as_it_was(monkeypatch):
    """A fit that runs away leaves some that are none."""
    felt = Felt(monkeypatch, true=10.0)
    felt.numbers = {"Jr": np.nan}
    begun = felt.found()
    assert allow_for_force_delays(begun) is begun


@pytest.mark.parametrize("error", [UnsettledError("no end"), np.linalg.LinAlgError("singular")])
def test_where_the_flights_do_not_settle_the_last_fit_stays(monkeypatch, error):
    felt = Felt(monkeypatch, true=18.0, fails_at=2, error=error)
    assert felt.found().numbers.values[0] == pytest.approx(3.0 - 0.81, rel=1e-3)
    assert len(felt.delays) == 3


def test_a_flight_that_seemed_in_time_beside_a_later_one_follows(monkeypatch):
    """18 and 8 ms late; a fit that followed the first shows .8 ms of the second."""

    def off(flight):
        return 1e3 * flight.bandwidths["accel"].slow_delay if flight.bandwidths else 0.0

    def lateness(fit):
        one, other = fit.dataset.configurations[0].flights
        left = 18.0 - off(one)
        yield one, Lateness(seconds=0.9 * left * MS, std=MS)
        yield other, Lateness(seconds=(8.0 - off(other) - 0.4 * left) * MS, std=MS)

    monkeypatch.setattr(
        late_accelerometer, "force_delays", lambda fit: DelayedForces(list(lateness(fit)), {})
    )
    monkeypatch.setattr(late_accelerometer, "of_one_vehicle", lambda found: found)
    flights = TimedDataset.of(made_fit.dataset(made_fit.prepared(), made_fit.prepared()))
    found = fit_with_force_in_time(made_fit.fit(flights), made_fit.fit)
    delays = [off(flight) for flight in found.dataset.configurations[0].flights]
    assert delays == pytest.approx([18.0, 8.0], abs=0.3)


def test_motion_capture_has_no_accelerometer_to_be_late(monkeypatch):
    felt = Felt(monkeypatch, true=18.0)
    tracked = replace(felt.begun, dataset=replace(felt.begun.dataset, source="mocap"))
    assert fit_with_force_in_time(tracked, felt.fit) is tracked
