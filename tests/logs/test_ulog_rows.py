"""Rows of the fields that are used, grown block by block."""

import numpy as np

from rotorfit.logs.ulog.messages import appended

ESC = np.dtype([("timestamp", "<u8"), ("esc_rpm", "<i4"), ("esc_voltage", "<f4")])
STATUS = np.dtype([("timestamp", "<u8"), ("counter", "<u2"), ("esc", ESC, (8,))])
MOTORS = np.dtype([("timestamp", "<u8"), ("control", "<f4", (12,))])
USED = ("timestamp", "esc", "esc_rpm")


def status(turning: int, n: int = 5) -> np.ndarray:
    rows = np.zeros(n, STATUS)
    rows["timestamp"] = 1000 + np.arange(n)
    rows["counter"] = 7
    rows["esc"]["esc_rpm"][:, :turning] = 5000 + np.arange(turning)
    rows["esc"]["esc_voltage"] = 16.0  # of all eight, and not used
    return rows


def test_only_used_fields_and_speaking_escs_are_kept():
    kept = appended(None, status(4), USED)
    assert kept.dtype.names == ("timestamp", "esc")
    assert kept["esc"].dtype.names == ("timestamp", "esc_rpm")
    assert kept["esc"].shape == (5, 4)
    assert kept["esc"]["esc_rpm"][2].tolist() == [5000, 5001, 5002, 5003]


def test_an_esc_that_speaks_later_is_zero_before():
    kept = appended(appended(None, status(2), USED), status(6, n=3), USED)
    kept = appended(kept, status(1, n=1), USED)
    assert kept["esc"].shape == (9, 6)
    expected = np.concatenate([status(2), status(6, n=3), status(1, n=1)])
    assert np.array_equal(kept["esc"]["esc_rpm"], expected["esc"]["esc_rpm"][:, :6])
    assert np.array_equal(kept["timestamp"], expected["timestamp"])


def test_controls_that_come_later_are_nan_before():
    first, later = np.zeros(2, MOTORS), np.zeros(3, MOTORS)
    first["control"][:, 3:], later["control"][:, 6:] = np.nan, np.nan
    later["control"][:, :6] = 0.5
    kept = appended(
        appended(None, first, ("timestamp", "control")), later, ("timestamp", "control")
    )
    assert kept["control"].shape == (5, 6)
    assert np.array_equal(
        np.isnan(kept["control"]),
        np.repeat([[False] * 3 + [True] * 3] * 2 + [[False] * 6] * 3, 1, axis=0),
    )
    back = appended(kept, first, ("timestamp", "control"))
    assert np.isnan(back["control"][-1, 3:]).all()
    assert np.array_equal(back["control"][-1, :3], [0, 0, 0])


def test_all_fields_are_kept_whole_where_none_is_named():
    kept = appended(appended(None, status(4), None), status(1), None)
    assert np.array_equal(kept, np.concatenate([status(4), status(1)]))
