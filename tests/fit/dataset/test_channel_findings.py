"""Findings about a channel name the numbers that rest on it, and lost speeds are blamed."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rotorfit
from flown import experiment_file
from rotorfit.errors import FlightError
from rotorfit.findings import doubt
from rotorfit.fit.dataset.channel_findings import (
    FROZEN,
    FROZEN_COMMAND,
    RESTS_ON,
    SPIKY,
    STUCK,
    blame_telemetry,
    find_motor_faults,
    frozen_command_sentences,
    name_resting_numbers,
)
from rotorfit.fit.dataset.load import load_flight
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.flight.motors.rotor_telemetry import telemetry
from rotorfit.logs.flight_log import FlightLog
from rotorfit.model.parameters import EVERY
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight, to_flight_log, variant
from rotorfit.simulation.experiment_files import IMU_AND_COMMAND, write_flight_table


@pytest.fixture(scope="module")
def log() -> FlightLog:
    flown, sensors = variant(paper_vehicle("A"), "real")
    scenario = Scenario(seconds=14.0, ground_seconds=2.0, sensors=sensors)
    return to_flight_log(simulate_flight(*flown, scenario, seed=3))


def with_lost_speed(log: FlightLog, rotor: int, *, every: float, lost: float) -> FlightLog:
    """Return the log with a speed of 0 for `lost` seconds in every `every`."""
    channel = log.channels["rotor_speed"]
    values = channel.values.copy()
    values[channel.time % every < lost, rotor - 1] = 0.0
    return replace(log, channels={**log.channels, "rotor_speed": replace(channel, values=values)})


@pytest.fixture
def flown(log) -> tuple[tuple[float, float], ...]:
    time = log.channels["rotor_speed"].time
    return ((float(time[0]), float(time[-1])),)


def with_frozen_command(
    log: FlightLog, rotor: int, *, begin: float, end: float, rise: float = 0.0
) -> FlightLog:
    """Return the log with a command that stays as it is, or above, between two times [s]."""
    channel = log.channels["command"]
    rows = np.flatnonzero((channel.time >= begin) & (channel.time <= end))
    values = channel.values.copy()
    values[rows, rotor - 1] = values[rows[0], rotor - 1] + rise
    return replace(log, channels={**log.channels, "command": replace(channel, values=values)})


@pytest.mark.parametrize(
    ("begin", "end", "rise"),
    [(0.0, 99.0, 0.0), (6.0, 12.0, 0.0), (6.0, 12.0, 0.4)],
    ids=["always", "late", "above all others"],
)
def test_a_frozen_command_names_what_rests_on_it(log, flown, begin, end, rise):
    """Speeds are measured: thrust and inertia do not rest on the commands."""
    frozen = with_frozen_command(log, 2, begin=begin, end=end, rise=rise)
    [found] = name_resting_numbers(find_motor_faults(frozen, flown, ()))
    assert found.kind == FROZEN_COMMAND
    assert "rotor 2 stays at" in found.sentence
    assert "max_thrust" in found.numbers
    assert not {"kt", "Ixx_com"} & set(found.numbers)
    assert found.doubtful_because


OF_NO_CHANNEL = {
    # Of the whole log, or of another vehicle than the one that is declared.
    "damaged-log", "appended-log", "changed-parameters", "never-armed", "never-flown", "vtol",
    "flight-differs", "payload", "unusual-density", "unusual-loading",
    # Of the model: which terms, and the turn of the axes that is taken out.
    "terms-left-out", "imu-tilt",
    # A sentence of a file of the first schema.
    "warning",
}  # fmt: skip
"""Kinds of doubts that are about no channel of a flight."""


def test_commands_that_never_turn_a_rotor_stand_for_nothing(log):
    """A log whose header lacks the range of the commands; warnings are errors here."""
    command = log.channels["command"]
    idle = replace(command, values=np.zeros_like(command.values))
    quiet = replace(log, channels={**log.channels, "command": idle})
    assert frozen_command_sentences(quiet) == []


def kinds_without_numbers(source: str) -> set[str]:
    """Return the kinds of doubts that a module makes without naming the numbers they are about."""
    if not re.search(r"\bdoubt(s|_or_passed)?\(", source):
        return set()
    tree = ast.parse(source)
    named: dict[str, set[str]] = {}
    for one in ast.walk(tree):
        if isinstance(one, ast.Assign | ast.AnnAssign) and isinstance(one.value, ast.Constant):
            for target in one.targets if isinstance(one, ast.Assign) else [one.target]:
                if isinstance(target, ast.Name) and isinstance(one.value.value, str):
                    named.setdefault(target.id, set()).add(one.value.value)
    found: set[str] = set()
    for call in ast.walk(tree):
        if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Name):
            continue
        makes_doubt = call.func.id in ("doubt", "doubts", "doubt_or_passed") and call.args
        if makes_doubt and not any(word.arg == "numbers" for word in call.keywords):
            kind = call.args[0]
            found |= (
                {str(kind.value)}
                if isinstance(kind, ast.Constant)
                else named.get(ast.unparse(kind), set())
            )
    return found


def test_every_finding_about_a_channel_names_its_numbers():
    """Of all of the source but `inspect`, which has no numbers, and the constructors themselves."""
    source = Path(rotorfit.__file__).parent
    made = {
        kind
        for path in source.rglob("*.py")
        if "inspection" not in path.parts and path.name != "findings.py"
        for kind in kinds_without_numbers(path.read_text(encoding="utf-8"))
    }
    assert len(made) >= 35
    assert made - OF_NO_CHANNEL == set(RESTS_ON)


def test_a_kind_without_numbers_is_found():
    module = 'KIND: Final = "loud"\ndoubt(KIND, "x")\ndoubts("odd", y)\ndoubt("ok", z, numbers=n)'
    assert kinds_without_numbers(module) == {"loud", "odd"}


@pytest.mark.parametrize("kind", RESTS_ON)
def test_the_numbers_exist(kind):
    [named] = name_resting_numbers([doubt(kind, "said")])
    assert named.numbers == RESTS_ON[kind].numbers
    assert named.numbers
    assert set(named.numbers) <= set(EVERY)


def test_speeds_asked_for_make_inertia_doubtful():
    """Twelve simulated bags with `command/motor_speed`: 2 to 3.8 half-widths off, identified."""
    [named] = name_resting_numbers([doubt("speed-asked-for", "said")])
    assert named.doubtful_because is not None
    assert [named.is_about(name) for name in ("kt", "Ixx@A", "com_x@A")] == [True, True, True]


def test_a_finding_that_names_numbers_keeps_them():
    own = doubt(FROZEN, "said", numbers=("kd",))
    assert name_resting_numbers([own]) == (own,)


@pytest.mark.parametrize("rotor", [1, 3])
@pytest.mark.parametrize("every", [0.4, 4.0])
def test_a_lost_speed_makes_thrust_doubtful(log, flown, rotor, every):
    lost = with_lost_speed(log, rotor, every=every, lost=0.12 * every)
    [found] = name_resting_numbers(find_motor_faults(lost, flown, ()))
    assert found.kind == STUCK
    assert found.is_about("kt")
    assert found.is_about("Ixx@A")
    assert not found.is_about("mass@A")
    assert f"rotor {rotor} " in str(found.doubtful_because)


def test_a_sound_log_has_no_lost_speed(log, flown):
    assert list(find_motor_faults(log, flown, ())) == []


def test_only_the_part_that_is_used_counts(log, flown):
    [(begin, end)] = flown
    lost = with_lost_speed(log, 1, every=1e6, lost=begin + 0.4 * (end - begin))
    assert list(find_motor_faults(lost, ((begin + 0.5 * (end - begin), end),), ())) == []
    assert len(list(find_motor_faults(lost, flown, ()))) == 1


def test_a_frozen_channel_is_not_reported_twice(log, flown):
    lost = with_lost_speed(log, 1, every=4.0, lost=0.5)
    assert list(find_motor_faults(lost, flown, [doubt(FROZEN, "said")])) == []


def test_a_lost_speed_is_blamed_for_a_flight_that_makes_no_sense(log, assert_wording):
    error = FlightError("the vehicle never flies")
    blamed = blame_telemetry(error, telemetry(with_lost_speed(log, 2, every=0.4, lost=0.1)))
    assert "rotor 2 is" in str(blamed)
    assert "for 25 %" in str(blamed)
    assert_wording(str(blamed))
    assert blame_telemetry(error, telemetry(log)) is error
    assert blame_telemetry(error, None) is error


def test_commands_that_jump_for_single_samples_are_said(log, flown):
    channel = log.channels["command"]
    values = channel.values.copy()
    values[::4] += 0.3
    spiky = replace(log, channels={**log.channels, "command": replace(channel, values=values)})
    [found] = name_resting_numbers(find_motor_faults(spiky, flown, ()))
    assert found.kind == SPIKY
    assert found.is_about("max_speed")
    assert found.doubtful_because is None


def test_lost_commands_of_a_log_without_speeds_are_mended(tmp_path):
    flown, sensors = variant(paper_vehicle("A"), "lag")
    sound = simulate_flight(*flown, Scenario(seconds=10.0, sensors=sensors), seed=3)
    lost = sound.commanded_speed.copy()
    lost[np.random.default_rng(4).random(lost.shape) < 0.01] = 0.0
    loaded = []
    for name, speed in (("sound", sound.commanded_speed), ("lost", lost)):
        table = tmp_path / f"{name}.csv"
        write_flight_table(replace(sound, commanded_speed=speed), table, channels=IMU_AND_COMMAND)
        path = experiment_file(
            tmp_path / f"{name}.toml",
            sound.vehicle,
            [table],
            mass=sound.truth.mass,
            extra='[motors]\nspeed = "commanded"\n',
        )
        experiment = load_experiment(path)
        loaded.append(load_flight(experiment.configuration[0].flights[0], experiment))
    expected, found = (one.prepared for one in loaded)
    assert SPIKY not in [one.kind for one in expected.findings]
    [said] = [one for one in found.findings if one.kind == SPIKY]
    assert said.is_about("max_thrust")
    rows = expected.data.used_rows
    assert found.motor_channel[rows].mean(axis=0) == pytest.approx(
        expected.motor_channel[rows].mean(axis=0), rel=1e-3
    )
