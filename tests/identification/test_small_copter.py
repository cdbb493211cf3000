"""A small copter with gentle gains behind ArduPilot's gyro filter shows its inertia."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

import flown
import rotorfit.fit.dataset.load as loading
import rotorfit.flight.prepare as preparing
from rotorfit.logs.firmware import Filter
from rotorfit.simulation import Scenario, Sensors, simulate_flight, write_flight_table
from rotorfit.simulation.controller import Gains

MASS, ARM, RATE, CUT_OFF = 0.45, 0.12, 400.0, 20.0
GENTLE = Gains(rate=(10.0, 10.0, 3.0), attitude=(4.0, 4.0, 0.3), damping=(0.0, 0.0, 0.0))
FILTER = Filter(
    channel="gyro",
    kind="low-pass",
    low=CUT_OFF,
    high=CUT_OFF,
    shape="butterworth",
    setting="INS_GYRO_FILTER",
    passed=True,
)


def small_vehicle():
    """Return the truth of the layout quad-x, made small, with motors next to without lag."""
    truth, vehicle = flown.simulated_vehicle("quad-x")
    weight = MASS / truth.mass
    size = ARM / float(np.linalg.norm(vehicle.positions[0][:2]))
    rotors = tuple(replace(r, position=tuple(size * x for x in r.position)) for r in vehicle.rotors)
    imu = tuple(size * x for x in vehicle.imu_position or (0.0, 0.0, 0.0))
    small = replace(
        truth,
        mass=MASS,
        first_moments=tuple(weight * size * x for x in truth.first_moments),
        inertia=tuple(weight * size**2 * x for x in truth.inertia),
        kt=weight * truth.kt,
        kd=weight * size * truth.kd,
        Jr=0.0,
        motor_lag=5e-4,
        rotor_drag=0.0,
    )
    return small, replace(vehicle, rotors=rotors, imu_position=imu)


def behind_filter(values):
    sos = signal.butter(2, CUT_OFF, fs=RATE, output="sos")
    begun = signal.sosfilt_zi(sos)[:, :, None] * values[0]
    return signal.sosfilt(sos, values, axis=0, zi=begun)[0]


@pytest.mark.slow
def test_a_small_copter_behind_its_gyro_filter_keeps_its_inertia(tmp_path, monkeypatch):
    truth, vehicle = small_vehicle()
    scenario = Scenario(
        seconds=20.0,
        ground_seconds=3.0,
        sample_rate=RATE,
        gains=GENTLE,
        sensors=Sensors(gyro_std=0.004, accel_std=0.15),
    )
    table = tmp_path / "small.csv"
    write_flight_table(simulate_flight(truth, vehicle, scenario, seed=5), table)
    path = flown.experiment_file(tmp_path / "small.toml", vehicle, [table], mass=MASS)
    read = loading.read_log

    def read_behind_filter(*args, **options):
        log = read(*args, **options)
        gyro = log.channels["gyro"]
        filtered = replace(gyro, values=behind_filter(gyro.values))
        return replace(log, channels={**log.channels, "gyro": filtered})

    monkeypatch.setattr(loading, "read_log", read_behind_filter)
    monkeypatch.setattr(preparing, "applied_filters", lambda log: (FILTER,))
    result = flown.quietly_identified(path)
    moments = np.diagonal(truth.com_inertia)
    for name, true in zip(("Ixx_com", "Iyy_com", "Izz_com"), moments.tolist(), strict=True):
        number = result.derived_value(name)
        low, high = number.interval
        assert number.verdict == "identified"
        assert low <= true <= high < 1.1 * true, name
    # The filter delays by 11 ms, which is not the motors'.
    assert abs(result.parameter("motor_delay").value) < 2e-3
