"""Read the vehicle of a PX4 log: geometry, settings, simulator, and when it flew."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.findings import Finding, doubt
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.flight_log import GAZEBO, PX4_OTHER, SIH, Circumstances, LoggedMotors, in_air
from rotorfit.logs.motor_law import MotorLaw, PolynomialCurve, SquareRootCurve
from rotorfit.logs.ulog.firmware import MOTOR_OUTPUTS, PWM
from rotorfit.logs.ulog.motors import (
    commanded_law,
    has_pwm_motors,
    is_vtol,
    motor_count,
    output_speeds,
    thrust_curve,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from jaxtyping import Bool, Float

    from rotorfit.logs.ulog.messages import Topic
    from rotorfit.logs.ulog.scan import Scan

    _State = tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]

_GPS: Final = ("vehicle_gps_position", "sensor_gps")
TOPICS: Final[Mapping[str, tuple[str, ...]]] = {
    "actuator_armed": ("timestamp", "armed"),
    "vehicle_status": ("timestamp", "arming_state"),
    "vehicle_land_detected": ("timestamp", "landed"),
    "vehicle_air_data": (
        *("timestamp", "baro_pressure_pa", "baro_temp_celcius"),
        "ambient_temperature",
    ),
    **dict.fromkeys(_GPS, ("timestamp", "time_utc_usec")),
}
"""Topics and the fields of them that are used."""
ARMED: Final = 2
"""vehicle_status.arming_state of an armed vehicle."""
GENERIC: Final = (4001, 5001, 6001, 7001, 8001, 9001, 11001, 12001, 14001, 4601)
"""Airframes that stand for any vehicle of their layout."""
ON_CIRCLE: Final = 0.005
"""Distance by which directions of two or three digits miss a circle of 1."""
MULTIROTORS: Final = (0, 8)
"""CA_AIRFRAME of multirotors, and of those with tilt."""
VTOL: Final = (
    "the vehicle is a VTOL by its parameters: its wing carries in forward flight, and some of its "
    "outputs are servos and pushers; give start and end of a part in which it hovers, and list the "
    "lifting rotors alone"
)
_AXES: Final = ("X", "Y", "Z")
_SETTINGS: Final = (
    *("SYS_AUTOSTART", "CA_AIRFRAME", "THR_MDL_FAC", "MPC_THR_HOVER", "MOT_POLE_COUNT"),
    *("DSHOT_BIDIR_EN", "SYS_HITL"),
    *("IMU_GYRO_CUTOFF", "IMU_ACCEL_CUTOFF", "IMU_GYRO_RATEMAX", "IMU_INTEG_RATE"),
    *("IMU_GYRO_NF0_FRQ", "IMU_GYRO_NF0_BW", "IMU_GYRO_NF1_FRQ", "IMU_GYRO_NF1_BW"),
    *("IMU_GYRO_DNF_EN", "IMU_GYRO_DNF_BW", "IMU_GYRO_DNF_HMC", "IMU_GYRO_DNF_MIN"),
    *("SDLOG_PROFILE", "SENS_BOARD_ROT", "DSHOT_TEL_CFG"),
)
_MATTERS: Final = ("CA_", "THR_MDL", "PWM_", "DSHOT_", "IMU_", "SENS_BOARD", "MOT_", "SIM_GZ")
_LISTED: Final = 8


@frozen_dataclass
class RotorSite:
    """A rotor by the parameters, in body axes FLU."""

    position: tuple[float, float, float]
    axis: tuple[float, float, float]
    spin: str


def rotor_sites(scan: Scan) -> tuple[RotorSite, ...]:
    """Return the rotors by CA_ROTOR*; empty if the log has no geometry."""
    count = motor_count(scan) or 0
    sites = [_rotor_site(scan, i) for i in range(count)]
    if any(site is None for site in sites) or "CA_ROTOR_COUNT" not in scan.parameters:
        return ()
    found = tuple(site for site in sites if site is not None)
    return found if any(any(site.position) for site in found) else ()


def _rotor_site(scan: Scan, number: int) -> RotorSite | None:
    """Return one rotor; FRD is FLU turned by half a turn about x."""
    name = f"CA_ROTOR{number}"
    place = [scan.number(f"{name}_P{axis}") for axis in _AXES]
    x, y, z = (0.0 if value is None else value for value in place)
    moment = scan.number(f"{name}_KM")
    axis = [scan.number(f"{name}_A{letter}") for letter in _AXES]
    ax, ay, az = (
        default if value is None else value
        for value, default in zip(axis, (0.0, 0.0, -1.0), strict=True)
    )
    numbers = (x, y, z, ax, ay, az)
    if place[0] is None or place[1] is None or moment is None:
        return None
    if not all(map(math.isfinite, numbers)) or not any((ax, ay, az)):
        return None
    # A positive moment coefficient is that of a rotor turning counter-clockwise seen from above.
    return RotorSite(
        position=(x, _negate_value(y), _negate_value(z)),
        axis=(ax, _negate_value(ay), _negate_value(az)),
        spin="ccw" if moment > 0 else "cw",
    )


def _negate_value(value: float) -> float:
    return -value if value else 0.0


def airframe_text(sites: tuple[RotorSite, ...]) -> str:
    """Write the rotors as a line of the ``[airframe]`` table of an experiment file."""
    rows: list[str] = []
    for site in sites:
        place = ", ".join(f"{value!r}" for value in site.position)
        upright = math.isclose(site.axis[2], math.hypot(*site.axis), rel_tol=1e-9)
        tilt = "" if upright else f", axis = [{', '.join(f'{v!r}' for v in site.axis)}]"
        rows.append(f'{{ position = [{place}], spin = "{site.spin}"{tilt} }}')
    return f"rotors = [{', '.join(rows)}]"


def geometry_notes(scan: Scan) -> tuple[str, ...]:
    """Describe the geometry: whose it is, and whether it was ever measured."""
    sites = rotor_sites(scan)
    notes: list[str] = []
    kind = scan.number("CA_AIRFRAME")
    if is_vtol(scan):
        pass  # said as a warning
    elif kind is not None and int(kind) not in MULTIROTORS:
        notes.append(f"CA_AIRFRAME = {int(kind)}: this is no multirotor with fixed rotors.")
    if not sites:
        notes.append(
            "The log has no rotor geometry (CA_ROTOR*): measure your arms and describe them under "
            "[airframe]."
        )
        return tuple(notes)
    arms = [math.hypot(*site.position[:2]) for site in sites]
    ends = dict.fromkeys(f"{arm:.3g}" for arm in (min(arms), max(arms)))
    shown = f"arms of {' to '.join(ends)} m"
    if _is_template(scan, sites):
        notes.append(
            f"CA_ROTOR* is the default geometry ({shown}), not this vehicle: measure your arms; "
            "only the order and the spin directions of the motors can be taken from it."
        )
    else:
        notes.append(f"Rotor geometry by CA_ROTOR* ({shown}): compare it with the vehicle.")
    return tuple(notes)


def _is_template(scan: Scan, sites: tuple[RotorSite, ...]) -> bool:
    """Return whether the geometry was left as it is delivered."""
    places = [site.position[:2] for site in sites]
    # All at +-1, or on a circle of 1: a table of directions, not of metres.
    if all(abs(abs(value) - 1.0) < 1e-6 for place in places for value in place):
        return True
    if all(abs(math.hypot(*place) - 1.0) < ON_CIRCLE for place in places):
        return True
    # The log names a default where a parameter differs from it: where none of the airframe's is
    # named for the places of the rotors, they are the airframe's own. That of a generic airframe is
    # no vehicle's.
    names = [f"CA_ROTOR{i}_P{axis}" for i in range(len(sites)) for axis in "XY"]
    untouched = scan.knows_defaults and not any(n in scan.airframe_defaults for n in names)
    return untouched and int(scan.number("SYS_AUTOSTART") or 0) in GENERIC


def metadata_of(scan: Scan) -> dict[str, str]:
    """Read what the log says of vehicle, firmware and settings."""
    found: dict[str, str] = {}
    if isinstance(scan.info.get("ver_sw_release"), int):
        found["Firmware revision"] = f"PX4 {_version_text(int(scan.info['ver_sw_release']))}"
    for key, name in (("ver_sw", "Commit"), ("ver_hw", "Board")):
        if key in scan.info:
            found[name] = str(scan.info[key])
    found |= {name: f"{scan.parameters[name]:g}" for name in _SETTINGS if name in scan.parameters}
    if has_pwm_motors(scan):
        found[MOTOR_OUTPUTS] = PWM
    sites = rotor_sites(scan)
    if sites:
        found["airframe"] = airframe_text(sites)
        found["airframe is"] = "default" if _is_template(scan, sites) else "set"
    if commanded_law(scan):
        found["motors"] = commanded_law(scan)
    return found


def _version_text(packed: int) -> str:
    """Return a version of four bytes: three numbers and the kind of the release."""
    major, minor, patch, kind = (packed >> shift & 255 for shift in (24, 16, 8, 0))
    kinds = ((255, ""), (192, " release candidate"), (128, " beta"), (64, " alpha"))
    word = next((word for least, word in kinds if kind >= least), " development")
    return f"{major}.{minor}.{patch}{word}"


def change_notes(scan: Scan) -> tuple[str, ...]:
    """Describe parameters that were changed in the log."""
    if not scan.changes:
        return ()
    # Those that change what is measured come first.
    ordered = sorted(scan.changes, key=lambda change: not change[0].startswith(_MATTERS))
    shown = [f"{name} {before:g} to {after:g}" for name, before, after in ordered[:_LISTED]]
    more = f" and {len(ordered) - _LISTED} more" if len(ordered) > _LISTED else ""
    return (f"Parameters changed in this log: {', '.join(shown)}{more}.",)


def flown_notes(scan: Scan, begin: float) -> tuple[str, ...]:
    """State when the vehicle was armed, and when it was off the ground, as the autopilot saw it."""
    notes: list[str] = []
    for what, state in (("Armed", _armed_state(scan)), ("Off the ground", _in_air(scan))):
        if state is not None and state[1].any():
            spans = ", ".join(
                f"{max(a - begin, 0.0):.1f} to {b - begin:.1f} s"
                for a, b in _true_spans(*state)
                if b > begin
            )
            notes.append(f"{what} {spans}.")
    return tuple(notes)


def flight_doubts(scan: Scan) -> Iterator[Finding]:
    """Find where the vehicle never flew, by its own account, or not on rotors alone."""
    if is_vtol(scan):
        yield doubt("vtol", VTOL)
    armed, air = _armed_state(scan), _in_air(scan)
    if armed is not None and not armed[1].any():
        yield doubt(
            "never-armed",
            "the vehicle was never armed in this log: there is no flight in it; give the log of a "
            "flight (SDLOG_MODE = 0 logs from arming to disarming)",
        )
    elif air is not None and not air[1].any():
        yield doubt(
            "never-flown",
            "the autopilot never saw the vehicle leave the ground (vehicle_land_detected): give "
            "the log of a flight",
        )


def _armed_state(scan: Scan) -> _State | None:
    topic, flag = scan.first("actuator_armed"), None
    if topic is not None:
        flag = topic.number("armed")
    if topic is not None and flag is not None:
        return topic.time, flag != 0
    topic = scan.first("vehicle_status")
    state = None if topic is None else topic.number("arming_state")
    return None if topic is None or state is None else (topic.time, state == ARMED)


def _in_air(scan: Scan) -> _State | None:
    topic: Topic | None = scan.first("vehicle_land_detected")
    landed = None if topic is None else topic.number("landed")
    return None if topic is None or landed is None else (topic.time, landed == 0)


def _true_spans(
    time: Float[np.ndarray, " n"], state: Bool[np.ndarray, " n"]
) -> list[tuple[float, float]]:
    """Find the first few stretches of True [s]; each ends at the first False after it."""
    edges = np.diff(np.concatenate([[False], state, [False]]).astype(int))
    begins, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    last = len(time) - 1
    spans = [(float(time[a]), float(time[min(b, last)])) for a, b in zip(begins, ends, strict=True)]
    return spans[:_LISTED]


BOARD: Final = "PX4_SITL"
"""ver_hw of PX4 on a computer."""
SIH_IN_HARDWARE, HITL = 2, 1
"""SYS_HITL."""
QUADCOPTER: Final = 0
"""SIH_VEHICLE_TYPE; of others the thrust goes otherwise with the signal."""
_SIH_SETTINGS: Final = (
    *("SIH_VEHICLE_TYPE", "SIH_MASS", "SIH_IXX", "SIH_IYY", "SIH_IZZ", "SIH_IXY", "SIH_IXZ"),
    *("SIH_IYZ", "SIH_T_MAX", "SIH_Q_MAX", "SIH_L_ROLL", "SIH_L_PITCH", "SIH_T_TAU", "SIH_KDV"),
    *("SIH_KDW", "IMU_GYRO_RATEMAX"),
)


def simulator_of(scan: Scan) -> str:
    """Name the simulator that flew, by board and parameters; empty for a vehicle."""
    on_computer = str(scan.info.get("ver_hw", "")) == BOARD
    hitl = scan.number("SYS_HITL")
    if output_speeds(scan) is not None and (on_computer or hitl == HITL):
        return GAZEBO
    if scan.number("SIH_T_MAX") is not None and (on_computer or hitl == SIH_IN_HARDWARE):
        return SIH
    return PX4_OTHER if on_computer or hitl == HITL else ""


def logged_motors(scan: Scan) -> LoggedMotors | None:
    """Find the law of simulated motors, or the one that was set by THR_MDL_FAC."""
    simulator = simulator_of(scan)
    speeds = output_speeds(scan)
    if simulator == GAZEBO and speeds is not None:
        curve = PolynomialCurve((speeds[0], speeds[1] - speeds[0]))
        law = MotorLaw(curve=curve, exact=True)
        return LoggedMotors(law=law, words="SIM_GZ_EC_MIN, SIM_GZ_EC_MAX", lag_on="speed")
    if simulator == SIH and scan.number("SIH_VEHICLE_TYPE") in (None, QUADCOPTER):
        law = MotorLaw(curve=SquareRootCurve(1.0, 0.0), exact=True)
        words = "SIH: thrust is proportional to the motor signal"
        return LoggedMotors(law=law, words=words, lag_on="thrust")
    factor = thrust_curve(scan)
    # An untouched THR_MDL_FAC of 0 is no measurement, and says nothing.
    if factor > 0.0:
        law = MotorLaw(curve=SquareRootCurve(1.0, factor), stated=True)
        return LoggedMotors(law=law, words=f"THR_MDL_FAC = {factor:g}")
    return None


def simulated_metadata(scan: Scan) -> dict[str, str]:
    """Read the simulator and its vehicle, as the log left them."""
    simulator = simulator_of(scan)
    if not simulator:
        return {}
    logged = {name: scan.last(name) for name in _SIH_SETTINGS if simulator == SIH}
    return {"Simulator": simulator} | {n: f"{v:g}" for n, v in logged.items() if v is not None}


KELVIN: Final = 273.15
_A_DATE: Final = 1e9
"""Seconds since 1970 from which a clock was set: before it is 2001."""


def circumstances_of(scan: Scan, begin: float) -> Circumstances:
    """Collect the metadata of the log; `begin` is its first sample [s]."""
    pressure, temperature = _read_air(scan)
    number = str(scan.info.get("sys_uuid", "")).strip()
    return Circumstances(
        hardware=number if number.strip("0") else "",  # simulators have none
        started=_start_time(scan, begin),
        air_pressure=pressure,
        air_temperature=temperature,
    )


def _read_air(scan: Scan) -> tuple[float | None, float | None]:
    topic = scan.first("vehicle_air_data")
    pressure = None if topic is None else topic.number("baro_pressure_pa")
    if topic is None or pressure is None:
        return None, None
    # The name with the slip of the pen is that of PX4 before 1.15.
    for name in ("ambient_temperature", "baro_temp_celcius"):
        celsius = topic.number(name)
        if celsius is not None:
            return in_air(pressure, celsius + KELVIN)
    return None, None


def _start_time(scan: Scan, begin: float) -> float | None:
    """Find when the log began, by the clock of the satellites."""
    for name in _GPS:
        topic = scan.first(name)
        clock = None if topic is None else topic.number("time_utc_usec")
        if topic is None or clock is None:
            continue
        offset = clock * 1e-6 - topic.time
        known = offset > _A_DATE
        if known.any():
            return float(np.median(offset[known])) + begin
    return None
