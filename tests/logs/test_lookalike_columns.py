"""Tables with columns that are named like a sensor or a motor, and are neither."""

from __future__ import annotations

import numpy as np
import pytest

from rotorfit.errors import LogError
from rotorfit.logs.proposal import propose_columns
from rotorfit.logs.table import read_table

G = 9.80665
ROWS = 400
TIME = 0.005 * np.arange(ROWS)
RNG = np.random.default_rng(5)
GYRO = RNG.normal(0.0, 0.6, (ROWS, 3))
ACCEL = np.array([0.0, 0.0, G]) + RNG.normal(0.0, 0.3, (ROWS, 3))
SHARE = 0.4 + 0.1 * np.sin(3.0 * TIME[:, None] + np.arange(4))
ASKED = np.roll(GYRO, 8, axis=0)
SPEED = 900.0 * np.sqrt(SHARE)


def block(names, values):
    """Name the columns of a block of values."""
    return dict(zip(names.split(), np.asarray(values).T, strict=True))


SENSORS = block("t_s gyr_x_rads gyr_y_rads gyr_z_rads", np.column_stack([TIME, GYRO])) | block(
    "acc_x acc_y acc_z", ACCEL
)
MOTORS = block("omega_1 omega_2 omega_3 omega_4", SPEED)


def proposed(tmp_path, columns, **stated):
    """Write columns as a table, propose which is which, and read it so."""
    path = tmp_path / "table.csv"
    rows = np.column_stack(list(columns.values())).tolist()
    path.write_text("\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]))
    proposal = propose_columns(path, **stated)
    return proposal, read_table(path, columns=proposal.columns, axes=proposal.axes).channels


def test_thrust_and_torques_are_no_motors(tmp_path):
    """U1 to U4 in most textbooks are the thrust and the torques about x, y and z."""
    wrench = np.column_stack([12.0 + ASKED[:, 0], 0.02 * ASKED])
    columns = {**SENSORS, **block("U1 U2 U3 U4", wrench)}
    with pytest.raises(LogError, match="U2 and U3 change their sign"):
        proposed(tmp_path, columns)
    _, channels = proposed(tmp_path, columns | MOTORS, units={"motors": "rad/s"})
    np.testing.assert_allclose(channels["rotor_speed"].values, SPEED, rtol=1e-9)


def test_speeds_with_the_sign_of_their_spin_are_motors(tmp_path):
    rest = np.arange(ROWS) < 80
    signed = np.where(rest[:, None], RNG.normal(0.0, 2.0, (ROWS, 4)), SPEED) * [1, -1, 1, -1]
    columns = {**SENSORS, **block("w1 w2 w3 w4", signed)}
    _, channels = proposed(tmp_path, columns, units={"motors": "rad/s"})
    np.testing.assert_allclose(channels["rotor_speed"].values, signed, rtol=1e-9)
