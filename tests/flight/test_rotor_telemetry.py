"""Measured rotor speeds beside commands: order, dead and stuck channels, ratios; else silence."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rotorfit.flight.motors.rotor_telemetry import telemetry
from rotorfit.flight.motors.telemetry_pair import pair_channels
from rotorfit.logs import read_log
from rotorfit.logs.flight_log import Channel, FlightLog
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight, to_flight_log, variant


@pytest.fixture(scope="module")
def log() -> FlightLog:
    """A flight whose motors lag and whose sensors are noisy, with commands and speeds."""
    flown, sensors = variant(paper_vehicle("A"), "real")
    scenario = Scenario(seconds=14.0, ground_seconds=2.0, sensors=sensors)
    return to_flight_log(simulate_flight(*flown, scenario, seed=3))


def with_channel(log: FlightLog, name: str, values: np.ndarray, time=None) -> FlightLog:
    old = log.channels[name]
    new = replace(old, values=values, time=old.time if time is None else time)
    return replace(log, channels={**log.channels, name: new})


def speeds(log: FlightLog) -> np.ndarray:
    return log.channels["rotor_speed"].values.copy()


def states(found) -> list[str]:
    return [rotor.state for rotor in found.rotors]


def test_silence_on_a_sound_log(log):
    found = telemetry(log)
    assert found.doubts == ()
    assert states(found) == ["follows"] * 4
    assert [rotor.speed_channel for rotor in found.rotors] == [1, 2, 3, 4]
    assert all(rotor.correlation > 0.9 for rotor in found.rotors)
    assert [rotor.ratio for rotor in found.rotors] == pytest.approx([1.0] * 4, abs=0.02)
    assert 0.0 < found.lateness < 0.1
    assert 18.0 < found.seconds < 25.0


@pytest.mark.parametrize("missing", ["command", "rotor_speed"])
def test_nothing_where_either_is_absent(log, missing):
    channels = {name: c for name, c in log.channels.items() if name != missing}
    assert telemetry(replace(log, channels=channels)) is None


@pytest.mark.parametrize("order", [(1, 0, 2, 3), (1, 2, 0, 3), (3, 2, 1, 0)])
def test_a_permutation_is_named(log, order):
    found = telemetry(with_channel(log, "rotor_speed", speeds(log)[:, order]))
    moved = [i for i in range(4) if order[i] != i]
    said = ", ".join(f"command {i + 1} moves speed {order.index(i) + 1}" for i in moved)
    [words] = found.doubts
    assert said in words
    assert [i for i, state in enumerate(states(found)) if state == "swapped"] == moved


@pytest.mark.parametrize(("step", "state"), [(400.0, "coarse"), (40.0, "dead")])
def test_a_step_wider_than_the_motion_is_no_dead_telemetry(log, step, state):
    time = log.channels["rotor_speed"].time
    flown = np.minimum(np.maximum(time - time[0], 0.0), 2.0)  # the motors start in two seconds
    level = 2000.0 * flown[:, None] / 2.0 + 0.0 * speeds(log)
    found = telemetry(with_channel(log, "rotor_speed", step * np.round(level / step)))
    assert states(found) == [state] * 4


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0.0, "the measured speed of rotor 3 is 0 rad/s throughout"),
        (412.0, "the measured speed of rotor 3 is 412 rad/s throughout"),
        (np.nan, "the measured speed of rotor 3 has no values"),
    ],
)
def test_a_dead_speed_is_named(log, value, words):
    values = speeds(log)
    values[:, 2] = value
    found = telemetry(with_channel(log, "rotor_speed", values))
    assert states(found) == ["follows", "follows", "dead", "follows"]
    [said] = found.doubts
    assert said.startswith(words)


def test_dead_telemetry_is_said_once(log, assert_wording):
    found = telemetry(with_channel(log, "rotor_speed", 0.0 * speeds(log)))
    assert states(found) == ["dead"] * 4
    [said] = found.doubts
    assert_wording(said)


def test_a_dead_command_is_named(log, assert_wording):
    values = log.channels["command"].values.copy()
    values[:, 0] = 0.25
    [said] = telemetry(with_channel(log, "command", values)).doubts
    assert "rotor 1 is 0.25" in said
    assert_wording(said)


def test_a_command_that_never_changes_is_still_not_dead(log):
    values = log.channels["command"].values.copy()
    values[:, 0] = 0.7772488  # whose means differ by rounding
    found = telemetry(with_channel(log, "command", values))
    assert states(found) == ["still", "follows", "follows", "follows"]


def usual_deviation(log: FlightLog) -> float:
    """Return by how much the speeds of turning motors vary [rad/s]."""
    pair = pair_channels(log.channels["command"], log.channels["rotor_speed"])
    return float(np.median(pair.speed[pair.used].std(axis=0)))


@pytest.mark.parametrize("steps", [1.0, 1.5])
def test_speeds_in_steps_of_their_deviation_are_sound(log, steps):
    values, step = speeds(log), steps * usual_deviation(log)
    found = telemetry(with_channel(log, "rotor_speed", step * np.round(values / step)))
    assert "stuck" not in states(found)
    assert found.doubts == ()


def test_speeds_in_steps_beyond_their_motion_are_coarse(log):
    values, step = speeds(log), 4.0 * usual_deviation(log)
    found = telemetry(with_channel(log, "rotor_speed", step * np.round(values / step)))
    assert states(found) == ["coarse"] * 4
    assert len(found.doubts) == 1


@pytest.mark.parametrize("share", [0.01, 0.02, 0.05])
def test_commands_lost_for_single_samples_are_mended(log, share):
    values = log.channels["command"].values.copy()
    values[np.random.default_rng(4).random(len(values)) < share, 1] = 0.0
    sound = telemetry(log)
    found = telemetry(with_channel(log, "command", values))
    assert states(found) == ["follows"] * 4
    assert found.rotors[1].correlation == pytest.approx(sound.rotors[1].correlation, abs=0.05)
    [said] = found.doubts
    assert "rotor 2 is far off" in said


@pytest.mark.parametrize("lost", [False, True], ids=["held", "lost"])
def test_a_speed_that_stops_on_the_way_is_named(log, lost, assert_wording):
    values = speeds(log)
    values[len(values) // 2 :, 1] = np.nan if lost else values[len(values) // 2, 1]
    found = telemetry(with_channel(log, "rotor_speed", values))
    assert states(found) == ["follows", "stuck", "follows", "follows"]
    assert found.rotors[1].stuck == pytest.approx(0.5, abs=0.1)
    [said] = found.doubts
    assert "rotor 2 is" in said
    assert_wording(said)


@pytest.mark.parametrize("factor", [0.8, 7 / 6])
def test_a_speed_of_another_ratio_is_named(log, factor):
    found = telemetry(with_channel(log, "rotor_speed", speeds(log) * [1, 1, 1, factor]))
    assert states(found) == ["follows"] * 3 + ["unlike"]
    assert found.rotors[3].ratio == pytest.approx(factor, rel=0.03)
    [said] = found.doubts
    assert said.startswith(f"rotor 4 turns at {found.rotors[3].ratio:.2f} times the speed")


@pytest.mark.parametrize("factor", [0.95, 1.05])
def test_rotors_that_differ_a_little_are_no_fault(log, factor):
    found = telemetry(with_channel(log, "rotor_speed", speeds(log) * [1, factor, 1, 1]))
    assert found.doubts == ()
    assert found.rotors[1].ratio == pytest.approx(factor, abs=0.02)


def test_a_speed_that_follows_nothing_is_named(log, assert_wording):
    values, rng = speeds(log), np.random.default_rng(1)
    values[:, 0] = 400.0 + 20.0 * rng.normal(size=len(values))
    found = telemetry(with_channel(log, "rotor_speed", values))
    assert states(found)[0] == "apart"
    [said] = found.doubts
    assert "rotor 1 does" in said
    assert_wording(said)


def test_speeds_of_another_flight_are_named(log, assert_wording):
    values, rng = speeds(log), np.random.default_rng(1)
    found = telemetry(
        with_channel(log, "rotor_speed", 400.0 + 20.0 * rng.normal(size=values.shape))
    )
    [said] = found.doubts
    assert_wording(said)
    assert found.lateness is None


def test_other_numbers_of_commands_and_speeds_are_said(log, assert_wording):
    found = telemetry(with_channel(log, "rotor_speed", speeds(log)[:, :3]))
    assert found.rotors == ()
    [said] = found.doubts
    assert "has 4 motor" in said
    assert_wording(said)
    assert "but 3 measured speeds" in said


def test_slow_and_late_telemetry_still_shows_the_order(log):
    time = log.channels["rotor_speed"].time
    slow = with_channel(log, "rotor_speed", speeds(log)[::20][:, [1, 0, 2, 3]], time[::20] + 0.1)
    found = telemetry(slow)
    assert states(found)[:2] == ["swapped", "swapped"]
    assert found.lateness == pytest.approx(0.1 + telemetry(log).lateness, abs=0.06)


def hovering() -> FlightLog:
    """A calm hover, in which only noise tells the rotors apart."""
    t, rng = np.arange(4000) / 200.0, np.random.default_rng(2)
    even = np.full((len(t), 4), 0.4) + 1e-4 * rng.normal(size=(len(t), 4))
    channels = {
        "command": Channel(time=t, values=even, source="made up"),
        "rotor_speed": Channel(
            time=t, values=500.0 + rng.normal(size=(len(t), 4)), source="made up"
        ),
    }
    return FlightLog(path=Path("hover"), sha256="", format="table", channels=channels, seconds=20.0)


def test_a_calm_hover_is_no_fault():
    found = telemetry(hovering())
    assert found.doubts == ()
    assert states(found) == ["unclear"] * 4


@pytest.mark.parametrize(
    "change",
    [
        lambda c: replace(c, time=c.time[:0], values=c.values[:0]),
        lambda c: replace(c, time=c.time[:5], values=c.values[:5]),
        lambda c: replace(c, time=0.0 * c.time),
        lambda c: replace(c, time=c.time[::-1].copy()),
        lambda c: replace(c, time=c.time + 1e6),
        lambda c: replace(c, time=c.time * 1e300),
        lambda c: replace(c, time=np.where(c.time > 5.0, 1e9, c.time)),
        lambda c: replace(c, time=c.time * np.nan),
        lambda c: replace(c, values=c.values * np.nan),
        lambda c: replace(c, values=np.full_like(c.values, np.inf)),
        lambda c: replace(c, values=0.0 * c.values),
        lambda c: replace(c, values=-c.values),
        lambda c: replace(c, values=1e300 * c.values),
        lambda c: replace(c, values=c.values[:, :0]),
    ],
)
@pytest.mark.parametrize("names", [("command",), ("rotor_speed",), ("command", "rotor_speed")])
def test_absurd_channels_are_survived(log, names, change):
    channels = {n: change(c) if n in names else c for n, c in log.channels.items()}
    found = telemetry(replace(log, channels=channels))
    assert len(found.rotors) in (0, 4)
    assert all(word.strip() for word in found.doubts)


@pytest.mark.flights
@pytest.mark.parametrize("name", ["LOG00267", "LOG00271", "LOG00340"])
def test_real_telemetry_and_the_same_with_two_plugs_swapped(flight_data_dir, name, assert_wording):
    path = flight_data_dir / "tudelft-indiflight" / f"{name}.BFL"
    if not path.exists():
        pytest.skip(f"no {path.name}")
    log = read_log(path)
    found = telemetry(log)
    assert found.doubts == ()
    assert min(rotor.correlation for rotor in found.rotors) > 0.98
    assert [rotor.ratio for rotor in found.rotors] == pytest.approx([1.0] * 4, abs=0.03)
    swapped = telemetry(with_channel(log, "rotor_speed", speeds(log)[:, [0, 1, 3, 2]]))
    assert states(swapped) == ["follows", "follows", "swapped", "swapped"]
    [said] = swapped.doubts
    assert "command 3 moves" in said
    assert "speed 4, command 4" in said
    assert "speed 3" in said
    assert_wording(said)


def test_spikes_of_single_samples_in_the_commands_hide_nothing(log, assert_wording):
    """Quick commands that jump for single samples, as by a noisy D term: the mean of each 10 ms
    is what the motors do."""
    quick = log.channels["command"]
    time = np.arange(quick.time[0], quick.time[-1], 0.002)
    even = np.stack([np.interp(time, quick.time, c) for c in quick.values.T], axis=1)
    jumps = np.zeros((len(time), 1))
    # Some 102 times a second: every hundredth of a second by itself would see a beat of 2 Hz.
    jumps[np.round(np.arange(0, len(time) - 1, 4.9)).astype(int)] = 0.4
    found = telemetry(with_channel(log, "command", even + jumps, time=time))
    assert states(found) == ["follows"] * 4
    [words] = found.doubts
    assert "rotor 1, 2, 3," in words
    assert "4 jumps" in words
    assert_wording(words)


def test_a_rotor_that_reads_half_is_named_alone(log, assert_wording):
    values = speeds(log)
    values[:, 0] *= 0.5
    values[len(values) // 3 : len(values) // 2, 0] = 0.0
    found = telemetry(with_channel(log, "rotor_speed", values))
    assert states(found) == ["unlike", "follows", "follows", "follows"]
    assert found.rotors[0].ratio == pytest.approx(0.5, abs=0.03)
    [words] = found.doubts
    assert words.startswith("rotor 1 turns")
    assert "at 0.50 times" in words
    assert_wording(words)


@pytest.mark.parametrize("factor", [0.5, 2.0 / 3.0, 1.5])
@pytest.mark.parametrize("rotor", range(4))
def test_one_rotor_is_blamed_where_all_differ_a_little(log, rotor, factor):
    """Sound motors of a small vehicle differ by 8 %, and one wrong speed bends the law of all."""
    random = np.random.default_rng(10 * rotor + round(10 * factor))
    factors = random.uniform(0.96, 1.04, 4)
    factors[rotor] *= factor
    found = telemetry(with_channel(log, "rotor_speed", factors * speeds(log)))
    assert [one.rotor for one in found.rotors if one.state == "unlike"] == [rotor + 1]
    others = np.delete(factors, rotor)
    assert found.rotors[rotor].ratio == pytest.approx(factors[rotor] / np.median(others), rel=0.02)


@pytest.mark.parametrize("factor", [0.85, 1.15])
@pytest.mark.parametrize("seed", range(8))
def test_a_hover_does_not_bend_the_law_to_an_unlike_rotor(log, seed, factor):
    """Where commands differ more between rotors than in time, law and factors go together."""
    random = np.random.default_rng(seed)
    time = log.channels["command"].time
    slow = np.cumsum(random.normal(size=(len(time), 4)), axis=0)
    middle = random.uniform(0.45, 0.75, 4)
    command = middle + 0.015 * (slow - slow.mean(axis=0)) / slow.std(axis=0)
    factors = random.uniform(0.98, 1.02, 4)
    odd = int(random.integers(4))
    factors[odd] *= factor
    spread = 1.0 + 0.003 * random.normal(size=command.shape)
    made = with_channel(log, "command", command)
    made = with_channel(made, "rotor_speed", factors * (300.0 + 1500.0 * command) * spread)
    found = telemetry(made)
    assert [one.rotor for one in found.rotors if one.state == "unlike"] == [odd + 1]
    others = np.median(np.delete(factors, odd))
    assert found.rotors[odd].ratio == pytest.approx(factors[odd] / others, abs=0.015)


@pytest.mark.parametrize("seconds", [-0.06, 0.1])
@pytest.mark.parametrize("rotor", [0, 3])
def test_one_speed_that_comes_late_is_named(log, rotor, seconds, assert_wording):
    values, time = speeds(log), log.channels["rotor_speed"].time
    values[:, rotor] = np.interp(time - seconds, time, values[:, rotor])
    found = telemetry(with_channel(log, "rotor_speed", values))
    assert [one.rotor for one in found.rotors if one.state == "late"] == [rotor + 1]
    assert found.rotors[rotor].later == pytest.approx(seconds, abs=0.015)
    [words] = found.doubts
    assert_wording(words)


def test_speeds_that_are_all_late_are_no_fault_of_one(log):
    values, time = speeds(log), log.channels["rotor_speed"].time
    late = np.stack([np.interp(time - 0.1, time, v) for v in values.T], axis=1)
    found = telemetry(with_channel(log, "rotor_speed", late))
    assert states(found) == ["follows"] * 4
    assert found.doubts == ()
