"""Was a PX4 log flown in a simulator, in which one, and what its parameters say of the motors."""

from typing import Final

from rotorfit.logs.flight_log import LoggedMotors
from rotorfit.logs.simulators import GAZEBO, PX4_OTHER, SIH
from rotorfit.logs.speed_law import PolynomialLaw, SpeedLaw, SquareRootLaw
from rotorfit.logs.ulog.motors import output_speeds, thrust_curve
from rotorfit.logs.ulog.scan import Scan

BOARD: Final = "PX4_SITL"
"""ver_hw of PX4 on a computer."""
SIH_IN_HARDWARE, HITL = 2, 1
"""SYS_HITL."""
QUADCOPTER: Final = 0
"""SIH_VEHICLE_TYPE; of others the thrust goes otherwise with the signal."""
_SAID: Final = (
    *("SIH_VEHICLE_TYPE", "SIH_MASS", "SIH_IXX", "SIH_IYY", "SIH_IZZ", "SIH_IXY", "SIH_IXZ"),
    *("SIH_IYZ", "SIH_T_MAX", "SIH_Q_MAX", "SIH_L_ROLL", "SIH_L_PITCH", "SIH_T_TAU", "SIH_KDV"),
    *("SIH_KDW", "IMU_GYRO_RATEMAX"),
)


def simulator_of(scan: Scan) -> str:
    """Return which simulator flew, by board and parameters; empty for a vehicle."""
    on_computer = str(scan.info.get("ver_hw", "")) == BOARD
    hitl = scan.number("SYS_HITL")
    if output_speeds(scan) is not None and (on_computer or hitl == HITL):
        return GAZEBO
    if scan.number("SIH_T_MAX") is not None and (on_computer or hitl == SIH_IN_HARDWARE):
        return SIH
    return PX4_OTHER if on_computer or hitl == HITL else ""


def logged_motors(scan: Scan) -> LoggedMotors | None:
    """Return the law of simulated motors, or the one that was set by THR_MDL_FAC.

    An untouched THR_MDL_FAC of 0 is no measurement, and says nothing.
    """
    simulator = simulator_of(scan)
    speeds = output_speeds(scan)
    if simulator == GAZEBO and speeds is not None:
        curve = PolynomialLaw((speeds[0], speeds[1] - speeds[0]))
        return LoggedMotors(law=SpeedLaw(curve=curve), words="SIM_GZ_EC_MIN, SIM_GZ_EC_MAX")
    if simulator == SIH and scan.number("SIH_VEHICLE_TYPE") in (None, QUADCOPTER):
        law = SpeedLaw(curve=SquareRootLaw(1.0, 0.0))
        return LoggedMotors(
            law=law, words="SIH: thrust is proportional to the motor signal", lag_on="thrust"
        )
    factor = thrust_curve(scan)
    if factor > 0.0:
        law = SpeedLaw(curve=SquareRootLaw(1.0, factor))
        return LoggedMotors(law=law, words=f"THR_MDL_FAC = {factor:g}")
    return None


def simulated_metadata(scan: Scan) -> dict[str, str]:
    """Return the simulator and its vehicle, as the log left them."""
    simulator = simulator_of(scan)
    if not simulator:
        return {}
    told = {name: scan.last(name) for name in _SAID if simulator == SIH}
    return {"Simulator": simulator} | {n: f"{v:g}" for n, v in told.items() if v is not None}
