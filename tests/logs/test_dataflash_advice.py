"""What a DataFlash log lacks, and the one value that mends it."""

import pytest
from dataflash_encoder import BAT, KINDS, QUAD_X, esc, imu, log, message, parameters, rcou

from rotorfit.logs import read_log
from rotorfit.tools.inspection.recording import settings_for

REST = ((0.0, 0.0, 0.0), (0.0, 0.0, -9.81))
DEFAULT = 176126
BATTERY_NOTE = "there is no battery voltage: set BATT_MONITOR to your power module"


def read(tmp_path, *, rate=400, mask=DEFAULT, battery=False):
    times = [k / rate for k in range(rate)]
    messages = [m for t in times for m in (imu(t, *REST), rcou(t, [1500.0] * 4))]
    messages += [esc(t, n, 6000.0) for t in times for n in range(4)]
    if battery:
        messages += [message(BAT, round(t * 1e6), 0, 16.0, 16.0) for t in times]
    values = QUAD_X if mask is None else {**QUAD_X, "LOG_BITMASK": float(mask)}
    if mask is None:
        values = {name: value for name, value in QUAD_X.items() if name != "LOG_BITMASK"}
    path = tmp_path / "made.bin"
    path.write_bytes(log(KINDS, [*parameters(values), *messages]))
    return read_log(path)


def advised(found):
    return [note for note in found.notes if "LOG_" in note or "BATT_MONITOR" in note]


def test_a_good_log_is_advised_nothing(tmp_path):
    assert advised(read(tmp_path, battery=True)) == []


@pytest.mark.parametrize("mask", [DEFAULT, 2**21 - 1, -1])
def test_a_missing_battery_asks_for_its_monitor_alone(tmp_path, mask):
    assert advised(read(tmp_path, mask=mask)) == [BATTERY_NOTE]


def test_a_battery_that_is_not_logged_asks_for_its_bit_too(tmp_path, assert_wording):
    [note] = advised(read(tmp_path, mask=DEFAULT & ~(1 << 9)))
    assert note.startswith(f"{BATTERY_NOTE}, and")
    assert f"LOG_BITMASK = {DEFAULT}, which" in note
    assert "(bit 9)" in note
    assert_wording(note)
    [note] = advised(read(tmp_path, mask=None))
    assert note.startswith(f"{BATTERY_NOTE}, and")
    assert_wording(note)


def test_a_slow_imu_of_a_log_without_its_mask_is_given_the_bits(tmp_path, assert_wording):
    found = read(tmp_path, rate=50, mask=None, battery=True)
    [note] = advised(found)
    assert "at 50 Hz" in note
    assert_wording(note)
    assert_wording(found.notes)


@pytest.mark.parametrize("battery", [False, True])
@pytest.mark.parametrize("mask", [0, DEFAULT, 393215, 438271, 2242525])
def test_the_reader_and_the_settings_name_one_value(tmp_path, mask, battery):
    found = read(tmp_path, rate=50, mask=mask, battery=battery)
    lacking = frozenset({"slow gyro"} | (set() if battery else {"no battery"}))
    [setting] = [
        s for s in settings_for("dataflash", lacking, found.metadata) if s.name == "LOG_BITMASK"
    ]
    notes = [note for note in found.notes if "LOG_BITMASK = " in note]
    assert len(notes) == 1
    assert notes[0].endswith(f"set LOG_BITMASK = {setting.value}")
    assert int(setting.value.split(",")[0]) == mask | 1 | 1 << 9 | 1 << 10 | 1 << 18 | 1 << 19
