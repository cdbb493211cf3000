"""The log and the experiment file that a user would have of a world, and what is true of it."""

from pathlib import Path
from typing import Final

import numpy as np
from benchmarks.worlds.engine import Record
from benchmarks.worlds.pilot import STEP
from benchmarks.worlds.world import World
from scipy.signal import butter, lfilter, lfilter_zi

FULL_VOLTS: Final = 16.0
RULER: Final = 1e-3
"""Deviation of a side that is measured [m]."""
FLEXIBLE: Final = 0.005
"""Deviation of a frame's sides by bending, as a share."""
DIGITS: Final = {"time": "%.6f"}


def write_world(world: World, record: Record, folder: Path) -> Path:
    """Write table and experiment file; return the path of the latter."""
    columns = table(world, record)
    path = folder / f"w{world.index}.csv"
    rows = np.column_stack(list(columns.values()))
    forms = [DIGITS.get(name, "%.7g") for name in columns]
    np.savetxt(path, rows, fmt=forms, delimiter=",", header=",".join(columns), comments="")
    declared = path.with_suffix(".toml")
    declared.write_text(experiment_text(world, path.name), encoding="utf-8")
    return declared


def table(world: World, record: Record) -> dict[str, np.ndarray]:
    """Return the columns of the log."""
    log, rng = world.log, world.chance(6)
    every = max(round(1.0 / (log.rate * STEP)), 1)
    rows = np.arange(10, len(record.gyro) - 30, every)
    rows = rows[_kept(rng, len(rows), log.lost, log.rate)]
    columns = {"time": (rows - rows[0]) * STEP * log.clock_scale}
    channels = _channels(world, record, rng)
    for name, labels in _labels(world).items():
        if name in log.has:
            columns |= dict(zip(labels, channels[name][rows].T, strict=True))
    return columns


def _labels(world: World) -> dict[str, list[str]]:
    rotors = range(1, len(world.vehicle.spins) + 1)
    return {
        **{name: [f"{name}_{a}" for a in "xyz"] for name in ("gyro", "accel")},
        **{name: [f"{name}_{i}" for i in rotors] for name in ("rotor", "command")},
        "vel": [f"vel_{a}" for a in "xyz"],
        "battery": ["battery"],
    }


def _kept(rng: np.random.Generator, n: int, lost: float, rate: int) -> np.ndarray:
    """Return which rows are in the log: bursts of some 30 ms are not."""
    burst = max(round(0.03 * rate), 1)
    starts = rng.random(n) < lost / burst
    gone = np.convolve(starts, np.ones(burst))[:n] > 0
    gone[0] = False
    return ~gone


def _channels(world: World, record: Record, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return what each channel of the log reads, a row a step."""
    s, log = world.sensors, world.log
    gyro = record.filtered if log.filtered_gyro else record.gyro
    accel = record.accel.copy()
    accel[:-1] += record.accel[1:]
    accel[:-1] *= 0.5
    accel = _lowpassed(accel, log.accel_lowpass)
    gyro, accel = (x @ s.turn * scale for x, scale in ((gyro, s.scale[:3]), (accel, s.scale[3:])))
    speed = record.speed + log.speed_noise * rng.standard_normal(record.speed.shape)
    lever = np.cross(
        record.rates, s.imu - world.vehicle.com if not log.imu_declared else -world.vehicle.com
    )
    velocity = record.velocity + lever
    velocity = velocity + s.velocity_std * rng.standard_normal(velocity.shape)
    volts = FULL_VOLTS * record.voltage + 0.02 * rng.standard_normal(len(record.voltage))
    steps = log.steps
    return {
        "gyro": _stepped(gyro, steps[0]),
        "accel": _stepped(accel, steps[1]),
        "rotor": _stepped(np.abs(_motor_data(world, speed)), steps[2]),
        "command": _stepped(_motor_data(world, commands(world, record.wanted)), steps[3]),
        "vel": velocity,
        "battery": _stepped(volts, 0.01)[:, None],
    }


def commands(world: World, wanted: np.ndarray) -> np.ndarray:
    """Return the commands (0 to 1) for the speeds that are wanted [rad/s]."""
    m = world.motors
    share = np.clip(wanted / m.full, 0.0, 1.0) ** (1.0 / m.exponent)
    return np.clip((share - m.offset) / (1.0 - m.offset), 0.0, 1.0)


def _motor_data(world: World, values: np.ndarray) -> np.ndarray:
    """Return motor data as another clock and a slow telemetry hand them on."""
    log, n = world.log, len(values)
    at = np.arange(n) * STEP
    if log.telemetry == "lowpass":
        values = _lowpassed(values, 15.0)
    if log.telemetry == "10hz":
        stamps = np.arange(0.0, n * STEP, 0.1)
        rows = np.minimum((stamps / STEP).astype(int), n - 1)
        values = np.column_stack([np.interp(at, stamps, column[rows]) for column in values.T])
    if log.late_ms:
        rows = np.clip(np.round((at - 1e-3 * log.late_ms) / STEP).astype(int), 0, n - 1)
        values = values[rows]
    return values


def late_seconds(world: World) -> float:
    """Return by how much the motors' stamps are late [s]."""
    return 1e-3 * round(world.log.late_ms)


def _lowpassed(values: np.ndarray, frequency: float) -> np.ndarray:
    if frequency <= 0.0:
        return values
    b, a = butter(2, frequency, fs=1.0 / STEP)
    return lfilter(b, a, values, axis=0, zi=lfilter_zi(b, a)[:, None] * values[:1])[0]


def _stepped(values: np.ndarray, step: float) -> np.ndarray:
    return np.round(values / step) * step


def experiment_text(world: World, file: str) -> str:
    """Return the experiment file."""
    vehicle, log = world.vehicle, world.log
    places = measured_places(world) * log.arm_scale
    spins = vehicle.spins.copy()
    axes = vehicle.axes
    if "wrong_sides" in log.mislaid:
        places = places * [1.25, 1.0, 1.0]
    if "wrong_order" in log.mislaid:
        order = _exchanged(len(spins))
        places, spins, axes = places[order], spins[order], axes[order]
    if "wrong_spins" in log.mislaid:
        spins = -spins
    lines = [
        f'name = "world {world.seed}/{world.index}"',
        "[airframe]",
        'axes = "FLU"',
        "rotors = [",
    ]
    for place, spin, axis in zip(places.tolist(), spins, axes.tolist(), strict=True):
        way = "ccw" if spin > 0 else "cw"
        lean = f", axis = {axis}" if log.axes_declared else ""
        lines.append(f'  {{ position = {place}, spin = "{way}"{lean} }},')
    lines.append("]")
    if log.imu_declared:
        lines.append(f"imu = {{ position = {world.sensors.imu.tolist()} }}")
    if log.tilt_declared is not None:
        lines.append(f"imu_tilt_deg = {list(log.tilt_declared)}")
    lines += ["[motors]", f'speed = "{log.driven}"']
    if log.driven == "commanded" and log.law == "given":
        lines.append(_law(world))
    lines += _times(world)
    lines += ["[[configuration]]", 'name = "A"', f"mass = {float(vehicle.mass * log.mass_scale)!r}"]
    return "\n".join([*lines, f'flights = ["{file}"]', ""])


def measured_places(world: World) -> np.ndarray:
    """Return the rotors' places as a ruler gives them [m], with the mean of both sides right.

    Both sides to a millimetre, of a frame that bends by half a percent.
    """
    places = world.vehicle.places
    sides = np.ptp(places[:, :2], axis=0)
    std = np.hypot(0.5 * RULER * np.linalg.norm(1.0 / sides), FLEXIBLE)
    off = float(world.chance(9).normal(0.0, std))
    centre = places.mean(axis=0)
    return centre + (places - centre) * [1.0 + off, 1.0 - off, 1.0]


def _exchanged(n: int) -> list[int]:
    return [1, 0, *range(2, n)]


def _times(world: World) -> list[str]:
    """Return what the experiment file says of the motors' times [s]."""
    m, log = world.motors, world.log
    lines = [] if log.delay_declared is None else [f"delay = {log.delay_declared!r}"]
    if log.lag_declared:
        lines += [f"lag = {m.lag_up!r}"] + [f"lag_down = {m.lag_down!r}"] * (m.lag_down != m.lag_up)
        lines += ['lag_on = "thrust"'] * m.on_thrust
    return lines


def _law(world: World) -> str:
    m = world.motors
    power = f"full_speed = {m.full!r}, offset = {m.offset!r}"
    law = (
        f"law = {{ power = {{ {power}, exponent = {float(m.exponent + world.log.law_error)!r} }} }}"
    )
    if (m.sag or m.sag_load) and "battery" in world.log.has:
        law = law[:-2] + f", voltage = {{ nominal = {FULL_VOLTS}, exponent = 1.0 }} }}"
    return law


def truth(world: World) -> dict[str, float]:
    """Return what is true of each number that the result may give; what is ambiguous is not there.

    No twist of rotors with unlike k_d, whose yaw torques need not cancel either.
    No kd of motors that are tilted (their thrust turns as their drag does). No kt, kd, Jr and what
    follows from them where only commands are in the log and their scale is not known (no law, a
    wrong one, or a voltage that sags unlogged); no lag of motors that rise and fall unlike, or
    whose data a slow telemetry hands on; no delay where a filter delays the IMU.
    """
    v = world.vehicle
    kt, kd = float(v.kt.mean()), float(v.kd.mean())
    known: dict[str, float] = {"kd_over_kt": kd / kt}
    I = v.inertia
    for name, i, j in (
        ("xx", 0, 0),
        ("yy", 1, 1),
        ("zz", 2, 2),
        ("xy", 0, 1),
        ("xz", 0, 2),
        ("yz", 1, 2),
    ):
        known[f"I{name}_com"] = float(I[i, j])
    origin = np.zeros(3) if world.log.imu_declared else world.sensors.imu
    known |= {f"com_{a}": float(x) for a, x in zip("xyz", v.com - origin, strict=True)}
    turn = np.cross(v.places, v.axes)[:, 2] * v.kt
    if "unlike_rotors" not in world.hazards:
        known["twist"] = float(turn.sum() / v.kt.sum())
    known |= _timing(world)
    if _scale_known(world):
        known |= {"kt": kt, "kd": kd, "Jr": v.Jr, "hover_speed": v.hover_speed}
        known |= {f"kt_{i + 1}": float(x) for i, x in enumerate(v.kt)}
        known |= {f"I{a}_over_kt": float(I[i, i] / kt) for i, a in enumerate(("xx", "yy", "zz"))}
        known |= {"kd_over_Izz": kd / float(I[2, 2]), "Jr_over_Izz": v.Jr / float(I[2, 2])}
    if world.hazards.isdisjoint(
        {"misaligned", "tilted_imu", "turned_imu", "tilted_motors", "wall", "tether"}
    ):
        known |= {
            f"accel_bias_{a}": float(x) for a, x in zip("xyz", world.sensors.bias[3:], strict=True)
        }
    if "tilted_motors" in world.hazards:
        known = {name: x for name, x in known.items() if not name.startswith("kd")}
    return known


def _scale_known(world: World) -> bool:
    if world.log.driven == "measured":
        return True
    sags = "sag" in world.hazards and "battery" not in world.log.has
    return world.hazards.isdisjoint({"no_law", "law_wrong"}) and not sags


def _timing(world: World) -> dict[str, float]:
    m, known = world.motors, dict[str, float]()
    slow = {"telemetry_10hz", "telemetry_lowpass", "no_law", "law_wrong"}
    delays = {"soft_mount", "filtered_gyro", "filtered_accel", "lag_on_thrust", *slow}
    if "command" in world.log.has and world.hazards.isdisjoint(slow):
        if world.log.driven == "measured":
            known["command_delay"] = 1e-3 * m.delay_ms
            known |= {} if "sag" in world.hazards else {"max_speed": m.full}
        if m.lag_up == m.lag_down:
            known["motor_lag"] = m.lag_up
        elif not m.on_thrust:
            known |= {"motor_lag_up": m.lag_up, "motor_lag_down": m.lag_down}
    if world.hazards.isdisjoint(delays):
        acts = 1e-3 * m.delay_ms if world.log.driven == "commanded" else 0.0
        known["motor_delay"] = acts - late_seconds(world)
    return known
