"""The settings that inspect names stand in the ready-to-load files, which load as they are."""

from pathlib import Path

import pytest

from rotorfit.report.settings import FILES, TABLES, settings_for

FOLDER = Path(__file__).parents[2] / "examples" / "settings"


@pytest.mark.parametrize("log_format", sorted(TABLES))
def test_every_setting_is_in_the_file(log_format):
    text = (FOLDER / FILES[log_format]).read_text(encoding="utf-8")
    for setting in TABLES[log_format]:
        names = setting.value.split() if setting.name.endswith(":") else [setting.name]
        for name in names:
            if not name.startswith("rpm."):  # only with a deck: a variable that is missing is none
                assert name.strip(",") in text, name


def lines(name):
    text = (FOLDER / name).read_text(encoding="utf-8")
    return [line for line in text.splitlines() if line and not line.startswith("#")]


def test_px4_parameters_have_five_columns_of_known_types():
    for line in lines("px4.params"):
        vehicle, component, name, value, kind = line.split("\t")
        assert (vehicle, component) == ("1", "1")
        assert name.isupper() and kind in ("6", "9") and float(value) >= 0


def test_ardupilot_parameters_are_pairs_with_the_bits_that_are_named():
    pairs = dict(line.split(",") for line in lines("ardupilot.parm"))
    mask = int(pairs["LOG_BITMASK"])
    assert all(mask >> bit & 1 for bit in (0, 9, 10, 18))
    assert mask == 176126 | 1 | 262144


def test_betaflight_lines_are_commands_and_the_last_one_saves():
    *settings, last = lines("betaflight.txt")
    assert last == "save"
    assert all(line.startswith("set ") and " = " in line for line in settings)


def test_only_what_is_lacking_is_advised():
    assert settings_for("blackbox", frozenset()) == ()
    named = [s.name for s in settings_for("ulog", frozenset({"slow motors"}))]
    assert named == ["SDLOG_PROFILE"]
    assert settings_for("table", frozenset({"no gyro"})) == ()
