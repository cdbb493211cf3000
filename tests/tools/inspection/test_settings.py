"""The settings that inspect names: right for the log at hand, in files that load as they are."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import get_args

import pytest

from hand_made_logs import hover_thrust, motion_log
from rotorfit.checks.sensors.log_settings import USE_SPEED, better_log, log_with_speed
from rotorfit.logs.firmware import Lack
from rotorfit.logs.formats import FORMATS
from rotorfit.tools.inspection.recording import settings_file, settings_for

DOCS = Path(__file__).parents[3] / "docs"
SLOW = frozenset({"slow gyro", "slow accel", "slow motors"})
INAV = {"Firmware revision": "INAV 7.1.2 (abcdef012)  STM32F745"}
TABLES = ["inav", *(form.name for form in FORMATS if form.advice)]


def log_of(table):
    return ("blackbox", INAV) if table == "inav" else (table, {})


def text_of(table):
    return settings_file(*log_of(table)).read_text(encoding="utf-8")


@pytest.mark.parametrize("table", sorted(TABLES))
def test_every_setting_is_in_the_file(table):
    text = text_of(table)
    log_format, metadata = log_of(table)
    settings = settings_for(log_format, frozenset(get_args(Lack)), metadata)
    assert len(settings) > 3
    for setting in settings:
        names = setting.value.split() if setting.name == "config.txt:" else [setting.name]
        for name in [setting.value] if setting.name == "CLI:" else names:
            if not name.startswith("rpm."):  # only with a deck: a variable that is missing is none
                assert name.strip(",") in text, name


def lines(table):
    return [line for line in text_of(table).splitlines() if line and not line.startswith("#")]


def test_px4_parameters_have_five_columns_of_known_types():
    for line in lines("ulog"):
        vehicle, component, name, value, kind = line.split("\t")
        assert (vehicle, component) == ("1", "1")
        assert name.isupper() and kind in ("6", "9") and float(value) >= 0


def test_ardupilot_parameters_are_pairs_with_the_named_bits():
    pairs = dict(line.split(",") for line in lines("dataflash"))
    mask = int(pairs["LOG_BITMASK"])
    assert all(mask >> bit & 1 for bit in (0, 9, 10, 18))
    assert mask == 176126 | 180222 | 1 | 262144


@pytest.mark.parametrize("table", ["blackbox", "inav"])
def test_lines_for_a_cli_are_commands_and_the_last_one_saves(table):
    *settings, last = lines(table)
    assert last == "save"
    for line in settings:
        assert (line.startswith("set ") and " = " in line) or line.startswith("blackbox "), line


def test_only_what_is_lacking_is_advised():
    assert settings_for("blackbox", frozenset()) == ()
    named = [s.name for s in settings_for("ulog", frozenset({"slow motors"}))]
    assert named == ["SDLOG_PROFILE"]
    assert settings_for("table", frozenset({"no gyro"})) == ()
    assert settings_file("table") is None


def value(found, name):
    [setting] = [s for s in found if s.name == name]
    return setting.value


@pytest.mark.parametrize(
    ("mask", "lacking", "expected"),
    [
        (393215, SLOW, "917503, which adds raw IMU (bit 19)"),  # adding gave 655360: 17 bits lost
        (176126, {"slow motors"}, "438271, which adds fast attitude (bit 0), fast IMU (bit 18)"),
        (176126 - 512, {"no battery"}, "176126, which adds battery (bit 9)"),
    ],
)
def test_bits_of_ardupilot_are_set_next_to_those_of_the_log(mask, lacking, expected):
    found = settings_for("dataflash", frozenset(lacking), {"LOG_BITMASK": f"{mask}"})
    words = value(found, "LOG_BITMASK")
    assert words.startswith(expected)
    assert int(words.split(",")[0]) & mask == mask  # no bit is lost


@pytest.mark.parametrize("text", [None, "2.09715e+06"])
def test_an_unknown_mask_is_advised_in_bits(text, assert_wording):
    metadata = {} if text is None else {"LOG_BITMASK": text}
    words = value(settings_for("dataflash", SLOW, metadata), "LOG_BITMASK")
    assert "(bit 18), raw" in words
    assert "(bit 19) ticked," in words
    assert_wording(words)
    assert "do not add numbers" in words and "262145" not in words


@pytest.mark.parametrize("mask", [2**21 - 1, -1])
def test_a_full_mask_points_to_the_limit_of_the_rate(mask):
    metadata = {"LOG_BITMASK": f"{mask}"}
    names = [s.name for s in settings_for("dataflash", SLOW, metadata)]
    assert "LOG_FILE_RATEMAX" in names and "LOG_BITMASK" not in names
    [only] = settings_for("dataflash", frozenset({"no battery"}), metadata)
    assert only.name == "BATT_MONITOR"


def test_a_missing_battery_alone_asks_for_nothing_faster():
    found = settings_for("dataflash", frozenset({"no battery"}), {"LOG_BITMASK": "176126"})
    assert [s.name for s in found] == ["BATT_MONITOR"]


@pytest.mark.parametrize(
    ("profile", "expected"),
    [
        ("1", "17, which adds high rate (bit 4)"),
        ("131", "147, which adds high rate (bit 4)"),  # replay and motion capture stay
        ("16", "17, which adds default set (bit 0)"),
        (None, "what it is with default set (bit 0), high rate (bit 4) ticked, too"),
    ],
)
def test_the_logging_profile_of_px4_keeps_its_other_bits(profile, expected):
    metadata = {} if profile is None else {"SDLOG_PROFILE": profile}
    found = settings_for("ulog", SLOW, metadata)
    assert [s.name for s in found] == ["SDLOG_PROFILE"]  # no low-pass mends a slow IMU
    assert found[0].value.startswith(expected)


def test_a_logging_profile_that_has_the_bits_is_not_named():
    assert settings_for("ulog", SLOW, {"SDLOG_PROFILE": "145"}) == ()


def test_parameters_that_px4_dropped_are_named_with_versions(assert_text):
    found = settings_for("ulog", frozenset({"no rotor speed"}))
    assert_text(value(found, "DSHOT_BIDIR_EN"))
    assert "from 1.18 on DSHOT_MOT_POL1" in value(found, "MOT_POLE_COUNT")
    text = text_of("ulog")
    assert "BDShot" in text and "DSHOT_MOT_POL1" in text


def test_inav_gets_its_own_names_and_file():
    lacking = SLOW | {"no accel", "no motors", "no rotor speed", "filtered accel"}
    found = settings_for("blackbox", lacking, INAV)
    assert [(s.name, s.value) for s in found] == [
        ("acc_lpf_hz", "100"),
        ("blackbox_rate_denom", "2"),
        ("blackbox_rate_num", "1"),
        ("CLI:", "blackbox ACC"),
        ("CLI:", "blackbox MOTORS"),
    ]
    assert settings_file("blackbox", INAV).name == "inav.txt"
    betaflight = {"Firmware revision": "Betaflight 4.5.1 (77d01ba3b) STM32F7X2"}
    assert "dshot_bidir" in [s.name for s in settings_for("blackbox", lacking, betaflight)]
    assert settings_file("blackbox", betaflight).name == "betaflight.txt"


@pytest.mark.parametrize(
    ("version", "expected"),
    [
        ("4.2.0", "firmware"),
        ("4.4.3", "firmware"),
        ("4.5.1", "blackbox_disable_rpm"),
        ("2026.6", "blackbox_disable_rpm"),
    ],
)
def test_an_old_betaflight_is_flashed_and_gets_no_unknown_line(version, expected):
    header = {
        "Firmware revision": f"Betaflight {version} (8f2d21460) STM32F745",
        "dshot_bidir": "1",
    }
    found = settings_for("blackbox", frozenset({"no rotor speed"}), header)
    assert [s.name for s in found if s.name != "motor_poles"] == [expected]
    assert [s.new for s in found if s.name == "firmware"] in ([], [None])  # no line of the file


def test_the_outputs_of_the_motors_are_not_taken_for_granted(assert_wording):
    words = value(settings_for("dataflash", frozenset({"no rotor speed"})), "SERVO_BLH_BDMASK")
    assert words.startswith("2^(output - 1) of")
    assert_wording(words)


def test_the_files_are_where_they_are_said_to_be():
    for table in TABLES:
        assert text_of(table).startswith(("#", "1 "))
    assert "logs every IMU" in text_of("dataflash")


def page(name):
    return (DOCS / name).read_text(encoding="utf-8")


def test_the_page_of_settings_names_each_file(capsys):
    [block] = re.findall(r"```python\n(.*?)```", page("settings.md"), re.S)
    exec(block, {})
    folder = Path(capsys.readouterr().out.strip())
    names = {settings_file(*log_of(table)).name for table in TABLES}
    assert {path.name for path in folder.iterdir()} == names
    assert all(f"| `{name}` |" in page("settings.md") for name in names)


def test_pages_tick_bits_and_never_add_them():
    for name in ("settings.md", "howto/px4.md", "howto/ardupilot.md"):
        assert not re.search(r"\badd (the )?bits?\b|its value \+", page(name)), name
    assert "17, if no other is" in page("howto/px4.md")


def test_pages_name_the_versions_of_px4_and_what_inav_has():
    for name in ("settings.md", "howto/px4.md"):
        text = page(name)
        assert "1.18" in text and "BDShot" in text and "DSHOT_MOT_POL1" in text, name
    assert "has no such DShot" in page("howto/betaflight.md")


def test_the_page_of_motion_capture_says_what_px4_logs_of_it():
    text = page("howto/mocap.md")
    assert "bit 7 of `SDLOG_PROFILE`" in text
    assert f"`SDLOG_PROFILE = {1 | 1 << 1 | 1 << 4}`" in text
    assert "times of receipt over" in text


def test_low_passes_of_px4_are_described_in_one_way():
    assert "need no change" in page("settings.md")
    commented = [line for line in text_of("ulog").splitlines() if "CUTOFF" in line]
    assert len(commented) == 2 and all(line.startswith("# 1\t1\t") for line in commented)
    advised = settings_for("ulog", frozenset(get_args(Lack)))
    assert not any("CUTOFF" in setting.name for setting in advised)


def test_sentences_of_the_guides_do_not_run_together():
    for guide in sorted((DOCS / "howto").glob("*.md")):
        assert not re.search(r":\nReady to load", guide.read_text(encoding="utf-8")), guide.name


def test_next_steps_say_where_each_setting_goes(assert_text, assert_wording):
    log = replace(motion_log(hover_thrust(3), name="command"), format="crazyflie")
    prepared = SimpleNamespace(slowest_rate=500.0)
    assert_text(log_with_speed(log, prepared))
    old = {"Firmware revision": "Betaflight 4.2.0 (8f2d21460) STM32F745", "dshot_bidir": "1"}
    flashed = log_with_speed(replace(log, format="blackbox", metadata=old), prepared) or ""
    assert "Betaflight 4.5 or" in flashed
    assert_wording(flashed)
    inav = better_log(replace(log, format="blackbox", metadata=INAV), frozenset({"no accel"}))
    assert_wording(inav or "")
    unknown = better_log(replace(log, format="ulog", metadata={}), SLOW)
    assert "(bit 0)" in (unknown or "")
    assert_wording(unknown or "")


def test_a_speed_that_the_log_has_is_to_be_used():
    assert log_with_speed(motion_log(hover_thrust(3)), SimpleNamespace()) == USE_SPEED


def test_an_old_slow_log_asks_for_all_at_once(assert_wording):
    """ArduCopter 3.3 at 50 Hz: its firmware has no bidirectional DShot, and the log is slow."""
    log = replace(motion_log(hover_thrust(3), name="command"), format="dataflash")
    old = {"Firmware revision": "APM:Copter V3.3-dev (ae3192b8)", "LOG_BITMASK": "131071"}
    step = log_with_speed(replace(log, metadata=old), SimpleNamespace(slowest_rate=50.0)) or ""
    assert "ArduCopter 4.1 or" in step
    assert "LOG_BITMASK = 917503" in step
    assert_wording(step)
    assert "SERVO_BLH_BDMASK" in step
    new = old | {"Firmware revision": "ArduCopter V4.7.0 (90700977)"}
    step = log_with_speed(replace(log, metadata=new), SimpleNamespace(slowest_rate=400.0)) or ""
    assert_wording(step)
