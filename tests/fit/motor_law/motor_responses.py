"""Commands and the speeds of motors that follow them, made without a line of the estimate."""

import numpy as np
from scipy import signal

from rotorfit.flight.motors.command_response import MeasuredResponse

OFFSET, EXPONENT, FULL = 0.055, 0.75, 4450.0
FACTORS = np.array([1.010, 0.985, 0.998, 1.007])
LAG, DELAY = 0.024, 0.003
VOLTAGE_EXPONENT, NOMINAL = 0.8, 16.0


def coloured(rng, samples, step, time_constant, columns=1):
    """Gauss-Markov noise of deviation one."""
    a = np.exp(-step / time_constant)
    white = rng.normal(size=(samples, columns)) * np.sqrt(1.0 - a * a)
    return signal.lfilter([1.0], [1.0, -a], white, axis=0)


def motor_responses(
    seed,
    *,
    seconds=16.0,
    lively=0.08,
    pulses=True,
    voltage=True,
    up=LAG,
    down=LAG,
    latency=0.0,
    air=0.01,
    noise=4.0,
    rate=500.0,
    speed_rate=None,
):
    """One flight of four motors, stepped eight times as fast as the log; what air and battery do
    to a speed is coloured and not in any channel."""
    rng = np.random.default_rng(seed)
    loop = 8
    step = 1.0 / (loop * rate)
    n = int(seconds * rate)
    base = 0.3 + 0.5 * lively * coloured(rng, n, loop * step, 0.6)
    command = base + lively * coloured(rng, n, loop * step, 0.08, 4)
    if pulses:
        for i in range(4):
            begin = int((2.0 + 0.6 * i) * rate)
            command[begin : begin + int(0.1 * rate), i] += 0.5
    command = np.clip(command, 0.0, 1.0)
    time = np.arange(n) / rate
    volts = 16.4 - 0.05 * time + 0.15 * coloured(rng, n, loop * step, 1.0)[:, 0]
    volts = volts - 1.2 * (command.mean(axis=1) - 0.3) if voltage else volts * 0.0 + NOMINAL
    settled = FULL * (OFFSET + (1.0 - OFFSET) * command) ** EXPONENT * FACTORS
    settled = settled * (volts[:, None] / NOMINAL) ** VOLTAGE_EXPONENT
    fine = np.repeat(settled, loop, axis=0)
    fine = fine * (1.0 + air * coloured(rng, n * loop, step, 0.3, 4))
    rising, falling = 1.0 - np.exp(-step / up), 1.0 - np.exp(-step / down)
    speed, now = np.empty_like(fine), fine[0]
    for k, wanted in enumerate(fine):
        speed[k] = now
        now = now + np.where(wanted > now, rising, falling) * (wanted - now)
    at = time if speed_rate is None else np.arange(0.05, seconds, 1.0 / speed_rate)
    clock = np.arange(n * loop) * step
    return [
        MeasuredResponse(
            rotor=i,
            command_time=time,
            command=command[:, i],
            voltage=volts + 0.02 * rng.normal(size=n) if voltage else None,
            speed_time=at,
            speed=np.round(
                np.interp(at - DELAY - latency, clock, speed[:, i])
                + noise * rng.normal(size=len(at))
            ),
        )
        for i in range(4)
    ]
