"""What ArduPilot's parameters say of the motors, and whether its simulator flew."""

from rotorfit.logs.dataflash.parameters import Parameters
from rotorfit.logs.dataflash.remix import thrust_curve
from rotorfit.logs.flight_log import LoggedMotors
from rotorfit.logs.simulators import SITL
from rotorfit.logs.speed_law import SpeedLaw, SquareRootLaw, VoltageFactor


def simulator_of(parameters: Parameters) -> str:
    """Return ArduPilot's simulator where its own parameters are in the log; empty elsewhere."""
    return SITL if "SIM_RATE_HZ" in parameters.values or "SIM_SPEEDUP" in parameters.values else ""


def logged_motors(parameters: Parameters, *, battery: bool) -> LoggedMotors | None:
    """Return the law by which the firmware makes thrust linear, with the battery it makes up for.

    Parameters
    ----------
    battery
        Whether the log has the battery's voltage.

    Returns
    -------
    motors
        Speed in parts of that at full output and, where MOT_BAT_VOLT_MAX is set, at that voltage;
        None where the log has no MOT_THST_EXPO, MOT_SPIN_MIN and MOT_SPIN_MAX (before 3.5).
    """
    curve = thrust_curve(parameters)
    if curve is None or curve.expo < 0.0:
        return None
    law = SpeedLaw(
        curve=SquareRootLaw(1.0, *map(_short, (curve.expo, curve.spin_min, curve.spin_max))),
        voltage=_voltage(parameters) if battery else None,
    )
    names = ["MOT_THST_EXPO", "MOT_SPIN_MIN", "MOT_SPIN_MAX"]
    names += [] if law.voltage is None else ["MOT_BAT_VOLT_MAX"]
    return LoggedMotors(law=law, words=", ".join(names))


def _short(value: float) -> float:
    """Return a parameter as it was typed: logs hold them in single precision."""
    return float(f"{value:.6g}")


def _voltage(parameters: Parameters) -> VoltageFactor | None:
    """Return the battery's factor where the firmware makes up for it: both limits are set."""
    low, high = (parameters.number(f"MOT_BAT_VOLT_{end}") or 0.0 for end in ("MIN", "MAX"))
    return VoltageFactor(_short(high), 1.0) if 0.0 < low < high else None
