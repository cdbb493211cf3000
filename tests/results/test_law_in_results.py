"""The motors' law in a result: from a simulated flight with commands and speeds, saved, read."""

import json
from dataclasses import replace

import numpy as np
import pytest

import flown
from kept_words import lines_with
from rotorfit.errors import OutputError
from rotorfit.export.targets import TARGETS
from rotorfit.export.write import export
from rotorfit.report.result_page import report_html
from rotorfit.report.text import result_text
from rotorfit.results.result import IdentificationResult
from rotorfit.results.sound_result import load_sound
from rotorfit.results.validation.validate import fitted_response
from rotorfit.simulation import write_flight_table

BOTH = ("gyro", "accel", "rotor_speed", "command")


@pytest.fixture(scope="module")
def flight():
    return flown.simulated("A", "real", seed=3, seconds=20.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("law")


@pytest.fixture(scope="module")
def result(flight, folder):
    write_flight_table(flight, folder / "flight.csv", channels=BOTH)
    path = flown.experiment_file(
        folder / "both.toml", flight.vehicle, [folder / "flight.csv"], mass=flight.truth.mass
    )
    return flown.quietly_identified(path)


def inside(number, truth):
    return number.interval[0] <= truth <= number.interval[1]


def test_lag_and_full_speed_are_those_of_the_simulated_motors(result, flight):
    assert inside(result.parameter("motor_lag"), flight.truth.motor_lag)
    assert inside(result.parameter("max_speed"), flight.max_speed)
    assert result.parameter("max_speed").value == pytest.approx(flight.max_speed, rel=0.05)
    # The simulated speed is in proportion to the command.
    assert inside(result.command_law.number("thrust_factor"), 1.0)
    assert result.command_law.relative_error < 0.02


def test_the_command_lag_is_not_applied_to_measured_speeds(result):
    response = fitted_response(result)
    assert response.lag == 0.0
    assert response.delay == pytest.approx(result.parameter("motor_delay").value)


# The vehicle is a plus, which gym-pybullet-drones does not fly.
NOT_HERE = {"px4-sih", "ardupilot-sitl", "gym-pybullet-drones"}


@pytest.mark.parametrize("target", sorted(set(TARGETS) - NOT_HERE))
def test_every_export_goes_without_assumptions(result, target):
    text = export(result, target).text
    assert "ASSUMED" not in text
    if target == "px4":
        assert "\tTHR_MDL_FAC\t" in text
    if target == "gazebo-motors":
        lag = result.parameter("motor_lag").value
        assert f"<timeConstantUp>{lag:.12g}</timeConstantUp>" in text


def test_a_law_that_is_not_known_is_not_exported(result, assert_wording):
    lost = replace(
        result,
        command_law=replace(result.command_law, known=False),
        parameters=tuple(
            replace(p, value=None, std=None, interval=None, verdict="not-identified", reason="wide")
            if p.name == "max_speed"
            else p
            for p in result.parameters
        ),
    )
    with pytest.raises(OutputError, match=r"max_speed is not-identified \(wide\)"):
        export(lost, "gazebo-motors")
    with pytest.raises(OutputError, match="--assume max_speed=VALUE"):
        export(lost, "betaflight")
    assert_wording(lines_with(export(lost, "px4").text, "MPC_THR_HOVER"))


def test_it_is_saved_and_read_as_it_is(result, folder):
    result.save(folder / "result.json", force=True)
    again = load_sound(folder / "result.json")
    assert again.command_law == result.command_law
    assert again.command_law.law == result.command_law.law


@pytest.mark.parametrize(
    "spoil",
    [
        lambda law: law.pop("numbers"),
        lambda law: law["numbers"].clear(),
        lambda law: law["numbers"][0].update(value=None),
        lambda law: law.update(commands=[0.1]),
        lambda law: law.update(form=[]),
    ],
)
def test_a_damaged_law_is_refused(result, folder, spoil):
    data = json.loads(result.to_json())
    spoil(data["command_law"])
    path = folder / "damaged.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(OutputError, match="is not a rotorfit result"):
        load_sound(path)


def test_text_and_page_say_it(result, assert_wording):
    text = result_text(result)
    assert_wording(text)
    assert '      speed = "commanded"' in text
    page = report_html(result)
    assert '<section id="motor-law"' in page
    assert "over command: measured, and" in page
    assert "motor-law" not in report_html(replace(result, command_law=None)).split("</style>")[1]


def test_a_later_flight_on_commands_takes_the_law(result, flight, folder):
    result.save(folder / "known.json", force=True)
    write_flight_table(flight, folder / "later.csv", channels=("gyro", "accel", "command"))
    path = flown.experiment_file(
        folder / "later.toml",
        flight.vehicle,
        [folder / "later.csv"],
        mass=flight.truth.mass,
        extra='[motors]\nresult = "known.json"\n',
    )
    later = flown.quietly_identified(path)
    assert isinstance(later.command_law, type(None))
    kt = later.parameter("kt")
    assert kt.unit == "N s^2/rad^2"
    assert kt.value == pytest.approx(flight.truth.kt, rel=0.05)
    law = result.command_law.motors["law"]
    assert later.settings["motors"]["law"] == {**law, "exact": False, "stated": False}


def with_battery(table, path):
    """Write a table once more, with a voltage that begins with samples of nothing."""
    header, *lines = table.read_text().splitlines()
    volts = 16.0 + 0.01 * np.random.default_rng(1).standard_normal(len(lines))
    volts[:50] = 0.0
    rows = [f"{line},{v:.3f}" for line, v in zip(lines, volts, strict=True)]
    path.write_text("\n".join([f"{header},battery", *rows, ""]))
    return path


def test_no_log_with_a_voltage_is_said_to_have_none(result, flight, folder, assert_wording):
    assert any("the log has no voltage" in words for words in result.warnings)
    logs = [with_battery(folder / "flight.csv", folder / "volts.csv")]
    path = flown.experiment_file(
        folder / "volts.toml", flight.vehicle, logs, mass=flight.truth.mass
    )
    known = flown.quietly_identified(path)
    assert not any("the log has no voltage" in words for words in known.warnings)
    assert any("hardly changes" in words for words in known.warnings)
    assert known.command_law.motors["law"]["voltage"]["nominal"] == pytest.approx(16.0, abs=0.01)
    path = flown.experiment_file(
        folder / "some.toml",
        flight.vehicle,
        [*logs, folder / "flight.csv"],
        mass=flight.truth.mass,
    )
    some = flown.quietly_identified(path)
    assert_wording(some.warnings)


def test_a_flight_without_commands_has_no_law(flight, folder):
    later = flown.identified(folder, [flight])
    assert later.command_law is None
    assert "max_speed" not in {p.name for p in later.parameters}
    assert IdentificationResult.load(_saved(later, folder)).command_law is None


def _saved(result, folder):
    path = folder / "without.json"
    result.save(path, force=True)
    return path
