"""rotorfit settings: only what must change, from the log's own values, as inspect advises it."""

import json

import numpy as np
import pytest
from blackbox_file import blackbox_of
from dataflash_encoder import KINDS, QUAD_X, imu, log, parameters, rcou

from rotorfit.tools.inspection.recording import settings_for
from rotorfit.tools.inspection.settings_to_change import LINES

NEWER_DEFAULT = 180222
"""LOG_BITMASK of ArduCopter 4.6; before it was 176126, without bit 12."""
WIRED = {f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 5)}


def slow_log(mask):
    """A flight at 25 Hz, without rotor speeds."""
    at_rest = ((0.0, 0.0, 0.0), (0.0, 0.0, -9.81))
    times = np.arange(200) / 25
    messages = [m for t in times.tolist() for m in (imu(t, *at_rest), rcou(t, [1500.0] * 4))]
    values = {**QUAD_X, "LOG_BITMASK": float(mask), "INS_RAW_LOG_OPT": 0.0, **WIRED}
    return log(KINDS, [*parameters(values), *messages])


@pytest.fixture
def slow(here):
    (here / "slow.bin").write_bytes(slow_log(NEWER_DEFAULT))
    return here / "slow.bin"


def pairs(text):
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return dict(line.split(",") for line in lines)


def test_old_and_new_of_this_log(run, slow, assert_wording):
    out = run("settings", "slow.bin").out
    mask = NEWER_DEFAULT | 1 | 1 << 18 | 1 << 19
    assert f"-LOG_BITMASK,{NEWER_DEFAULT}\n  +LOG_BITMASK,{mask}\n" in out
    assert "+SERVO_BLH_BDMASK,15" in out
    assert "INS_RAW_LOG_OPT" not in out  # it is 0 already
    assert_wording(out)


def test_the_file_holds_what_changes_and_no_guess(run, slow, here, assert_wording):
    ended = run("settings", "slow.bin", "-o", "new.parm")
    assert ended.err.endswith("rotorfit: wrote new.parm\n")
    text = (here / "new.parm").read_text()
    found = pairs(text)
    assert int(found["LOG_BITMASK"]) & NEWER_DEFAULT == NEWER_DEFAULT  # no bit is lost
    assert f"It was {NEWER_DEFAULT}." in text
    assert "SERVO_BLH_POLES" not in found
    assert_wording(text)


def test_a_file_is_not_overwritten_without_force(refused, run, slow, here):
    (here / "new.parm").write_text("mine")
    assert "--force" in refused("settings", "slow.bin", "-o", "new.parm")
    assert (here / "new.parm").read_text() == "mine"
    run("settings", "slow.bin", "-o", "new.parm", "--force")
    assert "LOG_BITMASK" in pairs((here / "new.parm").read_text())


def test_inspect_gives_the_same_advice(run, slow):
    [report] = run("inspect", "slow.bin", "--json").json
    found = run("settings", "slow.bin", "--json").json
    advised = [(s["name"], s["old"], s["new"]) for s in report["settings"]]
    assert advised == [(s["name"], s["old"], s["new"]) for s in found["settings"]]
    assert "rotorfit settings slow.bin" in run("inspect", "slow.bin").out


def test_what_was_loaded_is_not_asked_for_again(here, run, slow):
    run("settings", "slow.bin", "-o", "new.parm")
    loaded = int(pairs((here / "new.parm").read_text())["LOG_BITMASK"])
    (here / "again.bin").write_bytes(slow_log(loaded))
    assert "+LOG_BITMASK" not in run("settings", "again.bin").out


def test_other_logs_have_no_settings(refused, here, assert_wording):
    message = refused("settings", "flight.csv")
    assert_wording(message)


def test_a_cli_gets_lines_that_end_with_save(run, here, columns, assert_wording):
    (here / "a.bbl").write_bytes(
        blackbox_of({name: values[::4] for name, values in columns.items()})
    )
    found = run("settings", "a.bbl", "--json").json["settings"]
    ended = run("settings", "a.bbl", "-o", "cli.txt")
    known = [s for s in found if s["new"] is not None]
    if not known:
        assert_wording(ended.err)
        return
    lines = [x for x in (here / "cli.txt").read_text().splitlines() if not x.startswith("#")]
    assert lines == [*(f"set {s['name']} = {s['new']}" for s in known), "save"]


def test_dshot_goes_to_the_outputs_of_the_motors():
    wired = {"SERVO5_FUNCTION": "33", "SERVO6_FUNCTION": "34", "SERVO8_FUNCTION": "35"}
    found = settings_for("dataflash", frozenset({"no rotor speed"}), wired)
    assert [s.new for s in found if s.name == "SERVO_BLH_BDMASK"] == ["176"]


def test_a_simulator_has_no_wires_for_rotor_speed():
    simulated = {"Simulator": "ArduPilot SITL"}
    assert settings_for("dataflash", frozenset({"no rotor speed"}), simulated) == ()


@pytest.mark.parametrize(
    ("logged", "expected"),
    [
        ({"acc_lpf_hz": "2500"}, ("25", "100")),
        ({"acc_lpf_hz": "10000"}, None),  # hundredths: it is set already
        ({}, (None, "100")),
    ],
)
def test_betaflight_writes_its_low_pass_in_hundredths(logged, expected):
    found = settings_for("blackbox", frozenset({"filtered accel"}), logged)
    assert [(s.old, s.new) for s in found] == ([] if expected is None else [expected])


@pytest.mark.parametrize(("logged", "new"), [({"DSHOT_BIDIR_EN": "0"}, "1"), ({}, None)])
def test_a_parameter_some_firmware_lacks_is_written_where_it_is(logged, new):
    found = {s.name: s for s in settings_for("ulog", frozenset({"no rotor speed"}), logged)}
    assert found["DSHOT_BIDIR_EN"].new == new
    assert found["MOT_POLE_COUNT"].new is None  # never 14 by silence
    assert found["UAVCAN_ENABLE"].new is None  # in place of another


def test_dshot_is_not_written_for_motors_on_pwm():
    logged = {"DSHOT_BIDIR_EN": "0", "motor outputs": "PWM"}
    found = {s.name: s for s in settings_for("ulog", frozenset({"no rotor speed"}), logged)}
    assert found["DSHOT_BIDIR_EN"].new is None
    assert found["DSHOT_BIDIR_EN"].value.endswith("(they are PWM now)")


def test_every_autopilot_has_its_form():
    assert LINES["px4.params"][0]("SDLOG_PROFILE", "17") == "1\t1\tSDLOG_PROFILE\t17\t6"
    assert LINES["ardupilot.parm"][0]("LOG_BITMASK", "1") == "LOG_BITMASK,1"
    assert json.dumps(sorted(LINES)) == json.dumps(
        ["ardupilot.parm", "betaflight.txt", "config.txt", "inav.txt", "px4.params"]
    )
