"""What can be different in a world: each hazard with its chance, and which finding it causes."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

Kind = Literal["sound", "ruin", "wrong", "invisible"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Hazard:
    """One thing that a world may have.

    Attributes
    ----------
    name
        Of the switch.
    chance
        That a world has it, unless it is set.
    kind
        ``sound``: such flights are identified, and every number holds; ``ruin``: the log itself is
        spoilt, so that it may be refused, but no number may be wrong; ``wrong``: the declaration is
        wrong, so that it should be refused or doubted; ``invisible``: no log can show it (counted
        apart, and only drawn where it is named).
    what
        In words.
    """

    name: str
    chance: float
    kind: Kind = "sound"
    what: str


def _hazard(name: str, chance: float, what: str, kind: Kind = "sound") -> Hazard:
    return Hazard(name=name, chance=chance, what=what, kind=kind)


HAZARDS: Final = (
    _hazard("unlike_rotors", 0.35, "k_t and k_d of each rotor differ by 1 to 3 %, each by itself"),
    _hazard("off_centre", 0.18, "centre of mass 3 to 10 % of an arm off the rotors' centre"),
    _hazard("products", 0.18, "principal axes turned by 5 to 12 degrees"),
    _hazard("tilted_motors", 0.10, "each motor tilted by .3 to 1.5 degrees, undeclared"),
    _hazard("lag_unlike", 0.14, "motors fall 1.2 to 2 times as slowly as they rise"),
    _hazard("lag_on_thrust", 0.08, "the lag acts on thrust, undeclared"),
    _hazard("sag", 0.10, "battery sags with time and load"),
    _hazard("command_delay", 0.15, "2 to 12 ms from command to motor"),
    _hazard("weak_motors", 0.08, "thrust 1.25 to 1.5 times the weight at most, idle at half"),
    _hazard("limit_cycle", 0.04, "rate loop in a limit cycle at the motors' limits", "ruin"),
    _hazard("no_law", 0.04, "law from command to speed not given", "ruin"),
    _hazard("law_wrong", 0.03, "law given with an exponent .2 off", "wrong"),
    _hazard("accel_hold", 0.25, "altitude hold hears the accelerometer"),
    _hazard("airmode", 0.20, "mixer raises thrust to keep torque"),
    _hazard("indi", 0.10, "incremental rate loop"),
    _hazard("notch", 0.12, "notch at the rotors' speed in the gyro"),
    _hazard("slow_filter", 0.12, "gyro low-pass of second order, 20 to 40 Hz"),
    _hazard("noise", 0.20, "white noise 3 to 8 times the usual"),
    _hazard("coloured_noise", 0.15, "noise of 2 to 15 Hz in gyro and accelerometer"),
    _hazard("vibration", 0.20, "rotors out of balance: their harmonics in the IMU"),
    _hazard("soft_mount", 0.08, "IMU on a spring of 15 to 60 Hz", "ruin"),
    _hazard("accel_bias", 0.22, "accelerometer bias of .05 to .4 m/s^2"),
    _hazard("gyro_bias", 0.20, "gyro bias of up to .05 rad/s"),
    _hazard("accel_scale", 0.05, "accelerometer scale .3 to 1.5 % off"),
    _hazard("gyro_scale", 0.03, "gyro scale 2 to 5 % off", "ruin"),
    _hazard("misaligned", 0.08, "IMU mounted .5 to 2 degrees off"),
    _hazard("imu_clock", 0.10, "motors stamped 2 to 15 ms early or late"),
    _hazard("filtered_gyro", 0.12, "log of the autopilot's filtered gyro"),
    _hazard("filtered_accel", 0.05, "accelerometer low-passed at 10 to 40 Hz, gyro raw", "ruin"),
    _hazard("quantised", 0.15, "coarse steps in gyro, accelerometer and motors"),
    _hazard("dropouts", 0.08, "rows missing in bursts"),
    _hazard("low_rate", 0.08, "log of 50 Hz"),
    _hazard("telemetry_10hz", 0.03, "motor data interpolated from 10 Hz", "ruin"),
    _hazard("telemetry_lowpass", 0.03, "motor data low-passed at 15 Hz", "ruin"),
    _hazard("gusts", 0.28, "forces and torques of turbulent air"),
    _hazard("drag", 0.32, "drag of frame and rotors, off the centre"),
    _hazard("inflow", 0.14, "rotors lose thrust in a climb"),
    _hazard("ground_effect", 0.03, "3 to 10 % more thrust in half the flight", "ruin"),
    _hazard("wall", 0.04, "a wall pushes in a third of the flight"),
    _hazard("tether", 0.03, "a slack tether, 1 to 4 % of the weight a metre", "ruin"),
    _hazard("wrong_spins", 0.015, "all spins declared the other way", "wrong"),
    _hazard("wrong_order", 0.015, "two rotors declared in each other's place", "wrong"),
    _hazard("wrong_sides", 0.02, "front to back declared 1.25 times too long", "wrong"),
    _hazard("tilted_imu", 0.02, "IMU mounted 5 to 12 degrees off in roll or pitch", "wrong"),
    _hazard("turned_imu", 0.015, "IMU mounted 10 to 30 degrees off in yaw", "wrong"),
    _hazard("changed_rotor", 0.02, "one rotor makes 10 to 25 % less thrust", "wrong"),
    _hazard("mass_scale", 0.05, "mass 3 to 10 % off", "invisible"),
    _hazard("arm_scale", 0.05, "arms 2 to 5 % off", "invisible"),
    _hazard("clock_scale", 0.05, "the log's clock runs 1 to 5 % fast or slow", "invisible"),
)
"""Chances add up to about five."""
NAMED: Final[Mapping[str, Hazard]] = {one.name: one for one in HAZARDS}


def chances(asked: list[str] | None, invisible: bool = False) -> dict[str, float]:
    """Return the chance of each hazard: the usual ones, or only those of ``name`` or ``name=p``."""
    if asked is None:
        return {h.name: h.chance for h in HAZARDS if invisible or h.kind != "invisible"}
    pairs = [text.partition("=") for text in asked]
    return {name: float(p) if p else NAMED[name].chance for name, _, p in pairs}


_THRUST = {
    "sag", "no_law", "law_wrong", "accel_scale", "inflow", "drag", "ground_effect", "tether",
    "telemetry_10hz", "telemetry_lowpass", "limit_cycle", "filtered_accel", "lag_on_thrust",
    "lag_unlike", "changed_rotor", "wall", "mass_scale", "soft_mount", "accel_bias", "tilted_imu",
}  # fmt: skip
_LATE = {"soft_mount", "filtered_gyro", "filtered_accel", "slow_filter"}
_TORN = {"telemetry_10hz", "telemetry_lowpass", "limit_cycle"}
CAUSES: Final[Mapping[str, set[str]]] = {
    "wrong-spin": {"wrong_spins", "wrong_order"},
    "declaration": {
        "wrong_spins",
        "wrong_order",
        "turned_imu",
        "wrong_sides",
        "tilted_imu",
        *_TORN,
    },
    "lever-arms": {"wrong_sides", "arm_scale", "turned_imu", "gyro_scale", "soft_mount"},
    "rotor-unlike": {"changed_rotor"},
    "rotor-pattern": {"drag", "gusts", "inflow", "wall", "tether", "changed_rotor", *_TORN},
    "rotor-changed": {"changed_rotor"},
    "constant-wrench-missing": {"tilted_motors", "wall", "changed_rotor", "tilted_imu"},
    "steady-yaw-torque": {"tilted_motors", "wall", "unlike_rotors", "changed_rotor"},
    "residual-peak": {"vibration", "soft_mount", "limit_cycle", "coloured_noise"},
    "impossible-size": {"mass_scale", "arm_scale"},
    "unusual-density": {"mass_scale", "arm_scale"},
    "unusual-loading": {"mass_scale", "arm_scale"},
    "weight-contradicts-thrust": _THRUST,
    "weight-is-surer": _THRUST,
    "weight-taken-for-bias": _THRUST,
    "thrust-misses-weight": _THRUST,
    "thrust-against-weight": _THRUST,
    "thrust-jumps": {"changed_rotor", "ground_effect"},
    "thrust-sags": {"sag", "ground_effect", "changed_rotor"},
    "gyro-scale": {"gyro_scale"},
    "force-by-height": {"tether", "ground_effect", "wall"},
    "accelerometer-against-gravity": {"accel_bias", "accel_scale", "tether", "ground_effect"},
    "imu-leans": {"tilted_imu", "misaligned", "accel_bias", "tilted_motors"},
    "imu-tilt": {"tilted_imu", "misaligned"},
    "sensor-saturated": set(),
    "imu-clocks": _LATE,
    "motors-early": {"imu_clock", *_LATE, "command_delay"},
    "speeds-late": {
        "imu_clock",
        "telemetry_10hz",
        "telemetry_lowpass",
        "filtered_gyro",
        "soft_mount",
        "lag_on_thrust",
    },
    "reference-response": {*_LATE, "wrong_sides"},
    "impossible-inertia": {"wrong_sides", *_TORN, *_LATE},
    "gyro-lowpass": _LATE,
    "clock-drift": set(),
    "no-coupling": set(),
}
"""Hazards that a finding of each kind may rightly come from; kinds that are not here inform."""
