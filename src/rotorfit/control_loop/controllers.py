"""Rate controllers as their autopilots' parameters set them, one function an autopilot.

PX4 (v1.14 to main, 2b79738a): src/lib/rate_control/rate_control.cpp,
src/modules/mc_rate_control/MulticopterRateControl.cpp (K scales P, I and D; MC_YAW_TQ_CUTOFF),
src/modules/sensors/vehicle_angular_velocity (D acts on the filtered rate's difference behind
IMU_DGYRO_CUTOFF), src/modules/mc_att_control.

ArduCopter (4.3 to 4.7-dev, 90700977): libraries/AC_PID/AC_PID.cpp update_all,
libraries/AC_AttitudeControl/AC_AttitudeControl_Multi.cpp rate_controller_run.
"""

from collections.abc import Callable, Mapping
from typing import Final

from rotorfit.control_loop.filters import GyroFilter
from rotorfit.control_loop.rate_controller import RateController
from rotorfit.logs.controller_log import ControllerLog

AXES: Final = ("roll", "pitch", "yaw")


def px4(log: ControllerLog, axis: int) -> RateController:
    """Read PX4's rate controller of an axis."""
    name = ("ROLL", "PITCH", "YAW")[axis]
    K = log.number(f"MC_{name}RATE_K")
    P, I, D = (K * log.number(f"MC_{name}RATE_{gain}") for gain in "PID")
    return RateController(
        P=P,
        I=I,
        D=D,
        FF=log.number(f"MC_{name}RATE_FF"),
        angle=log.number(f"MC_{name}_P"),
        period=log.period,
        set_point_age=1,
        slope_of="rate",
        slope_lowpass=log.number("IMU_DGYRO_CUTOFF"),
        output_lowpass=log.parameters.get("MC_YAW_TQ_CUTOFF", 0.0) if name == "YAW" else 0.0,
        hears_through=_low_pass(log, "IMU_GYRO_CUTOFF"),
    )


def arducopter(log: ControllerLog, axis: int) -> RateController:
    """Read ArduCopter's rate controller of an axis."""
    name = ("RLL", "PIT", "YAW")[axis]

    def gain(which: str) -> float:
        return log.number(f"ATC_RAT_{name}_{which}")

    return RateController(
        P=gain("P"),
        I=gain("I"),
        D=gain("D"),
        FF=gain("FF"),
        angle=log.number(f"ATC_ANG_{name}_P"),
        period=1.0 / log.parameters.get("SCHED_LOOP_RATE", 1.0 / log.period),
        set_point_lowpass=gain("FLTT"),
        error_lowpass=gain("FLTE"),
        slope_lowpass=gain("FLTD"),
        set_point_age=1,
        hears_through=_low_pass(log, "INS_GYRO_FILTER"),
    )


def _low_pass(log: ControllerLog, name: str) -> tuple[GyroFilter, ...]:
    """Read the low-pass of the gyro; none where it is off."""
    cutoff = log.parameters.get(name, 0.0)
    return (GyroFilter(frequency=cutoff, order=2),) if cutoff > 0.0 else ()


CONTROLLERS: Final[Mapping[str, Callable[[ControllerLog, int], RateController]]] = {
    "PX4": px4,
    "ArduCopter": arducopter,
}


def rate_controller(log: ControllerLog, axis: int) -> RateController:
    """Read the rate controller of an axis: 0 roll, 1 pitch, 2 yaw."""
    return CONTROLLERS[log.autopilot](log, axis)
