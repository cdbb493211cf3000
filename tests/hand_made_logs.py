"""Logs made by hand: hover, throw, hand-carried, on the ground."""

from pathlib import Path

import numpy as np

from rotorfit.flight.motors.motor_model import MotorModel
from rotorfit.flight.prepare import prepare
from rotorfit.logs.flight_log import Channel, FlightLog

G = 9.80665
HOVER = 400.0  # rad/s
COMMANDED = MotorModel(speed="commanded")


def channel(time, values, source="made by hand", resolution=None) -> Channel:
    values = np.asarray(values)
    return Channel(
        time=np.asarray(time, dtype=float),
        values=values[:, None] if values.ndim == 1 else values,
        source=source,
        resolution=resolution,
    )


def flight_log(**channels: Channel) -> FlightLog:
    return FlightLog(
        path=Path("made"), sha256="0" * 64, format="made", channels=channels, seconds=1.0
    )


def motion_log(thrust, *, rate=200.0, force=None, rates=None, seed=0, rotors=4, name="rotor_speed"):
    """A log of a vehicle whose thrust over weight is given; the force follows it unless given."""
    rng = np.random.default_rng(seed)
    n = len(thrust)
    time = 100.0 + np.arange(n) / rate
    accel = np.zeros((n, 3))
    accel[:, 2] = G * np.asarray(thrust)
    accel = (accel if force is None else np.asarray(force)) + 0.2 * rng.normal(size=(n, 3))
    if rates is None:
        rates = 0.3 * np.sin(2 * np.pi * np.outer(time, (0.7, 0.9, 0.4)))
    gyro = rates + 0.01 * rng.normal(size=(n, 3))
    speed = HOVER * np.sqrt(np.maximum(thrust, 0.0))
    steer = 0.03 * np.sin(2 * np.pi * np.outer(time, np.linspace(0.5, 1.5, rotors)))
    motors = speed[:, None] * (1 + steer)
    noise = rng.normal(size=(n, rotors))
    motors = motors / 1000.0 if name == "command" else np.abs(motors + noise)
    return flight_log(
        gyro=channel(time, gyro), accel=channel(time, accel), **{name: channel(time, motors)}
    )


def hover_thrust(seconds, *, rate=200.0, swing=0.1):
    return 1 + swing * np.sin(2 * np.pi * 0.8 * np.arange(int(seconds * rate)) / rate)


def with_channel(log: FlightLog, **changes: Channel | None) -> FlightLog:
    channels = {**log.channels, **changes}
    return flight_log(**{name: c for name, c in channels.items() if c is not None})


def spans(prepared) -> list[tuple[float, float]]:
    """Start and end of each segment, seconds since the first sample."""
    t = prepared.data.time
    return [(float(t[s.start] - t[0]), float(t[s.stop - 1] - t[0])) for s in prepared.data.segments]


def prepared(log, *, rotors=4, **options):
    return prepare(log, rotor_count=rotors, arm=0.2, **options)
