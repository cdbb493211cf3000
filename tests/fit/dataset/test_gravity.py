"""The accelerometer against gravity, at rest and in flight: without an airframe."""

from dataclasses import replace

import numpy as np
import pytest

from rotorfit.fit.dataset.plausible_units import GravitySeen, gravity_doubts, gravity_seen
from rotorfit.flight.prepare import prepare
from rotorfit.simulation import PERFECT, Scenario, paper_vehicle, simulate_flight, to_flight_log


@pytest.fixture(scope="module")
def log():
    scenario = Scenario(seconds=14.0, ground_seconds=3.0, sensors=PERFECT)
    return to_flight_log(simulate_flight(*paper_vehicle("A"), scenario, seed=1))


def seen(log, force=lambda accel, time: accel) -> GravitySeen:
    accel = log.channels["accel"]
    changed = replace(accel, values=force(accel.values, accel.time))
    log = replace(log, channels={**log.channels, "accel": changed})
    return gravity_seen(prepare(log, rotor_count=4, arm=0.15).data)


def test_a_calibrated_accelerometer_reads_gravity(log):
    found = seen(log)
    assert found.at_rest == pytest.approx(1.0, abs=1e-3)
    assert found.in_flight == pytest.approx(1.0, abs=0.02)
    assert 0.0 < found.in_flight_std < 0.03
    assert gravity_doubts(found) == []


@pytest.mark.parametrize("scale", [0.85, 0.95, 1.05, 1.2])
def test_a_wrong_scale_shows_at_rest_and_in_flight(log, scale, assert_wording):
    found = seen(log, lambda accel, time: scale * accel)
    assert found.at_rest == pytest.approx(scale, abs=1e-3)
    assert found.in_flight == pytest.approx(scale, rel=0.03)
    [said] = gravity_doubts(found)
    assert f"reads {9.80665 * scale:.2f} m/s^2 where" in said
    assert "is 9.81: calibrate" in said
    assert_wording(said)


def test_a_shift_in_flight_alone_is_vibration(log, assert_wording):
    turns = log.channels["rotor_speed"].values.mean(axis=1) > 200.0

    def shifted(accel, time):
        return accel + np.where(turns[:, None], [0.0, 0.0, 1.5], 0.0)

    found = seen(log, shifted)
    assert found.at_rest == pytest.approx(1.0, abs=1e-3)
    [said] = gravity_doubts(found)
    assert "rest 9.81: vibration" in said
    assert_wording(said)


def test_without_rest_the_flight_alone_counts(log, assert_wording):
    found = replace(seen(log, lambda accel, time: 1.2 * accel), at_rest=None)
    [said] = gravity_doubts(found)
    assert "reads 11." in said
    assert_wording(said)
    assert "is 9.81: calibrate" in said


def test_a_flight_from_the_air_has_no_rest(log):
    data = prepare(log, rotor_count=4, arm=0.15).data
    rows = slice(data.segments[0].start, data.segments[0].stop)
    channels = {
        name: replace(c, time=c.time[rows], values=c.values[rows])
        for name, c in log.channels.items()
    }
    found = seen(replace(log, channels=channels))
    assert found.at_rest is None
    assert found.in_flight == pytest.approx(1.0, abs=0.03)
    assert gravity_doubts(found) == []


def test_nothing_seen_is_no_doubt():
    nothing = GravitySeen(at_rest=None, in_flight=None, in_flight_std=None)
    assert gravity_doubts(nothing) == []
