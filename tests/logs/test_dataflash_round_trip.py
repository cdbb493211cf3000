"""A simulated flight as a DataFlash log has the channels that were measured."""

import numpy as np
import pytest
from dataflash_encoder import Logging, write_dataflash

from flown import simulated
from rotorfit.logs import read_log


@pytest.fixture(scope="module")
def flight():
    return simulated("quad-x", "noisy", seed=3, seconds=20.0)


@pytest.fixture(scope="module")
def folder(flight, tmp_path_factory):
    made = tmp_path_factory.mktemp("round_trip")
    write_dataflash(flight, made / "flight.bin")
    return made


def test_channels_are_what_was_measured(folder, flight):
    log = read_log(folder / "flight.bin")
    np.testing.assert_allclose(log.channels["gyro"].values, flight.gyro, atol=1e-6)
    np.testing.assert_allclose(log.channels["accel"].values, flight.accel, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        log.channels["rotor_speed"].values, flight.rotor_speed_measured, rtol=1e-6
    )
    np.testing.assert_allclose(log.channels["command"].values, flight.command, atol=0.00051)
    np.testing.assert_allclose(log.channels["gyro"].time, flight.time, atol=1e-6)
    assert log.warnings == ()


def test_slow_commands_have_their_own_clock(tmp_path, flight):
    logging = Logging(command_every=10, with_esc=False)
    log = read_log(write_dataflash(flight, tmp_path / "flight.bin", logging=logging))
    assert len(log.channels["command"].time) == -(-len(flight.time) // 10)
    assert "rotor_speed" not in log.channels
