"""Rate controllers as their autopilots' parameters set them, one function an autopilot.

PX4 (v1.14 to main, 2b79738a): src/lib/rate_control/rate_control.cpp,
src/modules/mc_rate_control/MulticopterRateControl.cpp (K scales P, I and D; MC_YAW_TQ_CUTOFF),
src/modules/sensors/vehicle_angular_velocity (D acts on the filtered rate's difference behind
IMU_DGYRO_CUTOFF), src/modules/mc_att_control.

ArduCopter (4.3 to 4.7-dev, 90700977): libraries/AC_PID/AC_PID.cpp update_all,
libraries/AC_AttitudeControl/AC_AttitudeControl_Multi.cpp rate_controller_run.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.flight.filters import first_order_recursion
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.tools.control_loop.plant import (
    GyroFilter,
    delays,
    difference,
    first_order,
    integral,
    smoothing,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from jaxtyping import Float

    from rotorfit.logs.controller_log import ControllerLog
    from rotorfit.tools.control_loop.plant import Response

FULL_INTEGRAL = np.deg2rad(400.0)
"""Rate error at which PX4 stops integrating [rad/s] (rate_control.cpp, updateIntegral)."""


@frozen_dataclass
class RateController:
    """From set point and rate [rad/s] to a torque in parts of full output, of one axis.

    u = P e + I int e + D e' (or - D y') + FF r, e = r - y; cut-offs [Hz] are 0 without a filter.

    - `P`, `I`, `D`, `FF`: gains on the rate error, its integral, the slope, and the set point.
    - `angle`: rate asked for per angle [1/s]; 0 if the outer loop is not known.
    - `period`: between two runs [s].
    - `set_point_lowpass`, `error_lowpass`, `slope_lowpass`, `output_lowpass`: of first order.
    - `slope_of`: whether D acts on the error or on the measured rate.
    - `set_point_age`: how many runs old the set point is when it is used.
    """

    P: float
    I: float
    D: float
    FF: float
    angle: float
    period: float
    set_point_lowpass: float = 0.0
    error_lowpass: float = 0.0
    slope_lowpass: float = 0.0
    output_lowpass: float = 0.0
    slope_of: Literal["error", "rate"] = "error"
    set_point_age: int = 0
    gyro_filters: tuple[GyroFilter, ...] = ()

    def scaled(self, factor: float) -> RateController:
        """Return the controller with P, I and D times a factor."""
        return replace(self, P=factor * self.P, I=factor * self.I, D=factor * self.D)

    def gyro_response(self, frequency: Float[np.ndarray, " f"]) -> Response:
        """Compute the response of the rate that it hears to the gyro, by its filters."""
        response = np.ones(len(frequency), dtype=complex)
        for one in self.gyro_filters:
            response = response * one.response(frequency)
        return response

    def derivative_share(self, frequency: float) -> float:
        """Compute the amplitude ratio of the D part to the P and I parts at a frequency."""
        z, T = delays(np.array([frequency]), self.period), self.period
        by_error = self._on_error(z)
        if self.slope_of == "rate":
            by_error = by_error * first_order(z, self.error_lowpass, T)
        return float(abs(self._slope_path(z)[0]) / max(abs(by_error[0]), np.finfo(float).tiny))

    def from_rate(self, frequency: Float[np.ndarray, " f"]) -> Response:
        """Compute the response of the output to the rate, with the sign turned."""
        z, T = delays(frequency, self.period), self.period
        slope, low = self._slope_path(z), first_order(z, self.error_lowpass, T)
        error = self._on_error(z)
        filtered = error * low + slope if self.slope_of == "rate" else (error + slope) * low
        return self._output_path(z) * filtered

    def from_set_point(self, frequency: Float[np.ndarray, " f"]) -> Response:
        """Compute the response of the output to the set point as it is used."""
        z, T = delays(frequency, self.period), self.period
        on_error = self._on_error(z)
        if self.slope_of == "error":
            on_error = on_error + self._slope_path(z)
        asked = first_order(z, self.set_point_lowpass, T)
        return (
            self._output_path(z)
            * asked
            * (on_error * first_order(z, self.error_lowpass, T) + self.FF)
        )

    def from_angle(self, frequency: Float[np.ndarray, " f"]) -> Response:
        """Compute the response of the output to the rate by way of the attitude loop, turned."""
        asked = self.angle * delays(frequency, self.period) ** -self.set_point_age
        return self.from_set_point(frequency) * asked / (2j * np.pi * frequency)

    def _on_error(self, z: Response) -> Response:
        return self.P + self.I * integral(z, self.period, late=self.slope_of == "rate")

    def _slope_path(self, z: Response) -> Response:
        T = self.period
        return self.D * difference(z, T) * first_order(z, self.slope_lowpass, T)

    def _output_path(self, z: Response) -> Response:
        return first_order(z, self.output_lowpass, self.period)

    def replayed(
        self,
        set_point: Float[np.ndarray, " n"],
        rate: Float[np.ndarray, " n"],
        slope: Float[np.ndarray, " n"] | None = None,
    ) -> Float[np.ndarray, " n"]:
        """Compute the output for set points as used and rates; `slope`: as the log has it."""
        asked = self._low_passed(set_point, self.set_point_lowpass)
        error = self._low_passed(asked - rate, self.error_lowpass)
        followed = error if self.slope_of == "error" else -rate
        steep = self.derivative(followed) if slope is None else -slope
        late = self.slope_of == "rate"
        weight = np.maximum(0.0, 1.0 - (error / FULL_INTEGRAL) ** 2) if late else 1.0
        total = np.cumsum(weight * error) * self.period
        if late:
            total = np.concatenate([[0.0], total[:-1]])
        out = self.P * error + self.I * total + self.D * steep + self.FF * asked
        return self._low_passed(out, self.output_lowpass)

    def derivative(self, values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Compute the derivative that D acts on."""
        change = np.diff(values, prepend=values[:1]) / self.period
        return self._low_passed(change, self.slope_lowpass)

    def _low_passed(
        self, values: Float[np.ndarray, " n"], cutoff: float
    ) -> Float[np.ndarray, " n"]:
        alpha = smoothing(cutoff, self.period)
        if alpha == 1.0:
            return values
        left = 1.0 - alpha
        return first_order_recursion(np.concatenate([values[:1], alpha * values[1:]]), left)


AXES: Final = ("roll", "pitch", "yaw")
FIXED, BY_THROTTLE = 0, 1
"""Modes of ArduPilot's harmonic notches (INS_HNTCH_MODE)."""
HARMONICS: Final = 16


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
        gyro_filters=_px4_filters(log),
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
        gyro_filters=_arducopter_filters(log),
    )


def _px4_filters(log: ControllerLog) -> tuple[GyroFilter, ...]:
    """Read low-pass and fixed notches of the gyro; those that follow the rotors are in the log."""
    # Their delay, that is: `controller_response` measures what these filters leave of it.
    found = _low_pass(log, "IMU_GYRO_CUTOFF")
    for name in ("IMU_GYRO_NF0", "IMU_GYRO_NF1"):
        at, width = (log.parameters.get(f"{name}_{what}", 0.0) for what in ("FRQ", "BW"))
        if at > 0.0 and width > 0.0:
            found += (GyroFilter(frequency=at, order=0, width=width),)
    return found


def _arducopter_filters(log: ControllerLog) -> tuple[GyroFilter, ...]:
    """Read low-pass and harmonic notches, fixed or by the throttle of hover, of the gyro."""
    found = _low_pass(log, "INS_GYRO_FILTER")
    for name in NOTCHES:
        mode = log.parameters.get(f"{name}_MODE", 0.0)
        at, width, depth, bits = (
            log.parameters.get(f"{name}_{what}", 0.0) for what in ("FREQ", "BW", "ATT", "HMNCS")
        )
        on = log.parameters.get(f"{name}_ENABLE", 0.0) > 0.0 and 0.0 < 0.5 * width < at
        # Those that follow a measured speed are treated as PX4's are.
        if not on or mode not in (FIXED, BY_THROTTLE):
            continue
        reference = log.parameters.get(f"{name}_REF", 0.0)
        if mode == BY_THROTTLE and reference > 0.0:
            hover = log.parameters.get("MOT_THST_HOVER", reference)
            at *= max(log.parameters.get(f"{name}_FM_RAT", 1.0), (hover / reference) ** 0.5)
        # HarmonicNotchFilter.cpp, NotchFilter.cpp: A = 10^(-ATT / 40) leaves A^2 in the middle, and
        # all harmonics have one quality.
        octaves = 2.0 * float(np.log2(at / (at - 0.5 * width)))
        quality = 2.0 ** (0.5 * octaves) / (2.0**octaves - 1.0)
        found += tuple(
            GyroFilter(
                frequency=(i + 1) * at,
                order=0,
                width=(i + 1) * at / quality,
                floor=10.0 ** (-0.05 * depth),
            )
            for i in range(HARMONICS)
            if int(bits) >> i & 1
        )
    return found


NOTCHES: Final = ("INS_HNTCH", "INS_HNTC2")
SPLIT: Final = 0b10001
"""Bits of INS_HNTCH_OPTS that make two or three narrow notches of one."""


def moving_filters(log: ControllerLog) -> tuple[str, ...]:
    """Name the notches of the gyro whose places are not among the parameters, as they are set."""
    numbers = log.parameters
    found = [
        f"{name}_MODE {numbers.get(f'{name}_MODE', 0.0):.0f}"
        for name in NOTCHES
        if numbers.get(f"{name}_ENABLE", 0.0) > 0.0
        and numbers.get(f"{name}_MODE", 0.0) not in (FIXED, BY_THROTTLE)
    ]
    found += [
        f"{name}_OPTS {numbers[f'{name}_OPTS']:.0f}"
        for name in NOTCHES
        if numbers.get(f"{name}_ENABLE", 0.0) > 0.0
        and int(numbers.get(f"{name}_OPTS", 0.0)) & SPLIT
    ]
    followed = int(numbers.get("IMU_GYRO_DNF_EN", 0.0))
    return (*found, f"IMU_GYRO_DNF_EN {followed}") if followed else tuple(found)


@frozen_dataclass
class ThrustCurve:
    """Thrust that a mixer takes for a command c: f u^2 + (1 - f) u.

    u = (c - start) / (end - start); `name` is that of the parameter that sets f.
    """

    name: str
    factor: float
    start: float = 0.0
    end: float = 1.0


def thrust_curve(log: ControllerLog) -> ThrustCurve | None:
    """Read the curve by which the mixer commands motors; None if the log does not have it."""
    # PX4: src/lib/mixer_module, THR_MDL_FAC; ArduCopter: AP_Motors_Thrust_Linearization.cpp.
    names = (
        ("THR_MDL_FAC",)
        if log.autopilot == "PX4"
        else ("MOT_THST_EXPO", "MOT_SPIN_MIN", "MOT_SPIN_MAX")
    )
    values = [log.parameters.get(name) for name in names]
    known = [value for value in values if value is not None]
    if len(known) < len(names):
        return None
    if log.autopilot == "PX4":
        return ThrustCurve(name=names[0], factor=known[0])
    factor, start, end = known
    return ThrustCurve(name=names[0], factor=factor, start=start, end=end) if start < end else None


def _low_pass(log: ControllerLog, name: str) -> tuple[GyroFilter, ...]:
    """Read the low-pass of the gyro; empty if it is off."""
    cutoff = log.parameters.get(name, 0.0)
    return (GyroFilter(frequency=cutoff, order=2),) if cutoff > 0.0 else ()


CONTROLLERS: Final[Mapping[str, Callable[[ControllerLog, int], RateController]]] = {
    "PX4": px4,
    "ArduCopter": arducopter,
}


def rate_controller(log: ControllerLog, axis: int) -> RateController:
    """Read the rate controller of an axis: 0 roll, 1 pitch, 2 yaw."""
    return CONTROLLERS[log.autopilot](log, axis)
