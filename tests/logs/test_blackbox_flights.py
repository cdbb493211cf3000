"""Real logs: equal to another decoder field by field, and true to gravity and gyro."""

import contextlib
import io
import logging

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rotorfit.logs.blackbox.decode import decode
from rotorfit.logs.blackbox.read import read_blackbox

pytestmark = pytest.mark.flights

LOGS = {
    # file: I, P, S, G, H frames, events
    "betaflight/LOG00007.BFL": (7073, 106085, 29, 2243, 1, 4),
    "betaflight/LOG00037.BFL": (525, 16249, 3, 86, 1, 3),
    "tudelft-indiflight/LOG00267.BFL": (1039, 15573, 8, 541, 1, 8),
    "tudelft-indiflight/LOG00271.BFL": (262, 3930, 3, 143, 1, 4),
    "tudelft-indiflight/LOG00340.BFL": (570, 8550, 4, 161, 1, 4),
}
INDIFLIGHT = [name for name in LOGS if name.startswith("tudelft")]


def read_with_orangebox(path) -> dict[str, list[tuple[int, ...]]]:
    """Every frame that orangebox reads, by letter; main frames only those it yields.

    Its frames are taken where they are parsed, since it hands out S and G frames merged into
    main frames and H frames not at all. It does not know event 15 (disarmed), says so, and
    resynchronises at the next frame without loss.
    """
    orangebox = pytest.importorskip("orangebox")
    logging.disable(logging.CRITICAL)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            parser = orangebox.Parser.load(str(path))
            frames: dict[str, list[tuple[int, ...]]] = {letter: [] for letter in "MSGHIP"}
            parse = parser._parse_frame

            def recording(definitions, reader):
                frame = parse(definitions, reader)
                frames[frame.type.value].append(frame.data)
                return frame

            parser._parse_frame = recording
            frames["M"] = [frame.data for frame in parser.frames()]
    finally:
        logging.disable(logging.NOTSET)
    return frames


LONGEST = "betaflight/LOG00007.BFL"


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (name == LONGEST)) for name in LOGS],
)
def test_every_field_of_every_frame_equals_orangebox(flight_data_dir, name):
    path = flight_data_dir / name
    log = decode(path.read_bytes())
    oracle = read_with_orangebox(path)
    fields = len(log.main.names)  # orangebox appends the fields of S and G frames
    assert np.array_equal(log.main.values, [frame[:fields] for frame in oracle["M"]])
    assert len(oracle["I"]) == log.is_intra.sum()
    assert len(oracle["P"]) == (~log.is_intra).sum()
    assert np.array_equal(log.slow.values, oracle["S"])
    assert np.array_equal(log.home.values, oracle["H"])
    # Field 0 of the G frames, time, is relative to the time of the last main frame. orangebox 0.4
    # adds the loopIteration of the main frame before that instead, so we add it up ourselves.
    gps = np.array(oracle["G"])
    assert log.gps.names[0] == "time"
    assert np.array_equal(log.gps.values[:, 1:], gps[:, 1:])
    row = np.searchsorted(log.main.positions, log.gps.positions) - 1
    assert (row >= 0).all()
    before = np.where(log.is_intra[row], row, row - 1)  # an I frame fills its whole history
    written = gps[:, 0] - log.main.column("loopIteration")[before]
    assert np.array_equal(log.gps.values[:, 0], log.main.column("time")[row] + written)


@pytest.mark.parametrize("name", LOGS)
def test_every_byte_of_the_logs_is_accounted_for(flight_data_dir, name):
    log = decode((flight_data_dir / name).read_bytes())
    intra = int(log.is_intra.sum())
    others = (len(log.slow), len(log.gps), len(log.home), len(log.events))
    assert (intra, len(log.main) - intra, *others) == LOGS[name]
    assert (log.skipped_bytes, log.dropped_frames, log.trailing_bytes) == (0, 0, 0)
    assert log.ended
    time = log.main.column("time")
    assert (np.diff(time) > 0).all()


def followed(log):
    """Return how the gyro goes with what was asked for 60 ms before, in flight, axis by axis."""
    gyro, asked = (log.channels[name] for name in ("gyro", "reference"))
    steps = round(0.06 / np.median(np.diff(gyro.time)))
    wide = np.ones(2 * steps) / (2 * steps)
    flying = log.channels["command"].values.mean(axis=1) > 0.15
    flying[-steps:] = False
    for k in range(3):
        one, other = (np.convolve(c.values[:, k], wide, "same") for c in (asked, gyro))
        yield np.corrcoef(one[flying], np.roll(other, -steps)[flying])[0, 1]


def test_channels_of_indiflight(flight_data_dir):
    log = read_blackbox(flight_data_dir / INDIFLIGHT[0])
    assert log.seconds == pytest.approx(32.937376)
    assert list(log.channels) == [
        "gyro",
        "accel",
        "rotor_speed",
        "command",
        "position",
        "attitude",
        "reference",
    ]
    assert log.channels["rotor_speed"].values.shape == (16612, 4)
    assert log.channels["rotor_speed"].source == "omegaUnfiltered[0..3], rad/s"
    assert log.channels["gyro"].resolution == pytest.approx(np.radians(0.1))
    assert all(0.6 < at < 1.0 for at in followed(log))
    still = log.channels["accel"].values[:400].mean(axis=0)
    assert still == pytest.approx([0, 0, 9.6], abs=0.7)
    assert log.metadata["Firmware revision"] == "Indiflight 5.0.0 (ae0775a84) STM32H743"
    assert log.metadata["Log start datetime"] == "2024-03-05T16:10:13.248+00:00"


def test_channels_of_betaflight(flight_data_dir):
    log = read_blackbox(flight_data_dir / "betaflight/LOG00007.BFL")
    assert list(log.channels) == ["gyro", "accel", "rotor_speed", "battery"]
    battery = log.channels["battery"].values[:, 0]
    assert (battery.min(), battery.max()) == (pytest.approx(22.13), pytest.approx(26.08))
    assert np.median(log.channels["rotor_speed"].values[:, 0]) == pytest.approx(2178.17, abs=0.01)
    assert "Log start datetime" not in log.metadata  # the clock was not set
    commanded = read_blackbox(flight_data_dir / "betaflight/LOG00037.BFL")
    assert list(commanded.channels) == ["gyro", "accel", "command", "battery", "reference"]
    assert all(0.8 < at < 1.0 for at in followed(commanded))
    assert commanded.metadata["Craft name"] == "AR8"


@pytest.mark.parametrize("name", INDIFLIGHT)
def test_attitude_agrees_with_gyro_and_gravity(flight_data_dir, name):
    channels = read_blackbox(flight_data_dir / name).channels
    attitude, gyro, accel = (channels[key].values for key in ("attitude", "gyro", "accel"))
    time = channels["attitude"].time
    rotation_body_to_world = Rotation.from_quat(attitude[:, [1, 2, 3, 0]])
    step = 20
    turn = rotation_body_to_world[:-step].inv() * rotation_body_to_world[step:]
    rate = turn.as_rotvec() / (time[step:] - time[:-step])[:, None]
    total = np.cumsum(gyro, axis=0)
    mean_gyro = (total[step:] - total[:-step]) / step
    calm = np.linalg.norm(mean_gyro, axis=1) < 10
    for axis in range(3):
        slope, _ = np.polyfit(mean_gyro[calm, axis], rate[calm, axis], 1)
        assert slope == pytest.approx(1, abs=0.03)
        assert np.corrcoef(mean_gyro[calm, axis], rate[calm, axis])[0, 1] > 0.997
    at_rest = (np.linalg.norm(gyro, axis=1) < 0.05) & (
        np.abs(np.linalg.norm(accel, axis=1) - 9.81) < 0.3
    )
    up = rotation_body_to_world.apply(accel)[at_rest].mean(axis=0)
    assert np.degrees(np.arccos(up[2] / np.linalg.norm(up))) < 5
