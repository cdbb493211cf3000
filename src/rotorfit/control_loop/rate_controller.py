"""The rate controller of one axis: its response, and the output it gives for a logged flight."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy import signal

from rotorfit.control_loop.filters import (
    GyroFilter,
    Response,
    delays,
    difference,
    first_order,
    integral,
    smoothing,
)

FULL_INTEGRAL = np.deg2rad(400.0)
"""Rate error at which PX4 stops integrating [rad/s] (rate_control.cpp, updateIntegral)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RateController:
    """From set point and rate [rad/s] to a torque in parts of full output, of one axis.

    u = P e + I int e + D e' (or - D y') + FF r, e = r - y; cut-offs [Hz] are 0 without a filter.

    Attributes
    ----------
    P, I, D, FF
        Gains on the rate error, its integral, the slope, and the set point.
    angle
        Rate asked for per angle [1/s]; 0 where the outer loop is not known.
    period
        Between two runs [s].
    set_point_lowpass, error_lowpass, slope_lowpass, output_lowpass
        First-order low-passes.
    slope_of
        Whether D acts on the error or on the measured rate.
    set_point_age
        How many runs old the set point is when it is used.
    gyro_filters
        Filters between the gyro and the rate.
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

    def scaled(self, factor: float) -> "RateController":
        """Return the controller with P, I and D times a factor."""
        return replace(self, P=factor * self.P, I=factor * self.I, D=factor * self.D)

    def gyro_response(self, frequency: Float[np.ndarray, " f"]) -> Response:
        """Compute the response of the rate that it hears to the gyro, by its filters."""
        response = np.ones(len(frequency), dtype=complex)
        for one in self.gyro_filters:
            response = response * one.response(frequency)
        return response

    def derivative_share(self, frequency: float) -> float:
        """Compute the size of what D adds to the output over that of P and I, at one frequency."""
        z, T = delays(np.array([frequency]), self.period), self.period
        by_error = self._on_error(z)
        if self.slope_of == "rate":
            by_error = by_error * first_order(z, self.error_lowpass, T)
        return float(abs(self._slope(z)[0]) / max(abs(by_error[0]), np.finfo(float).tiny))

    def from_rate(self, frequency: Float[np.ndarray, " f"]) -> Response:
        """Compute the response of the output to the rate, with the sign turned."""
        z, T = delays(frequency, self.period), self.period
        slope = self._slope(z)
        return self._out(z) * (self._on_error(z) * first_order(z, self.error_lowpass, T) + slope
                               if self.slope_of == "rate"
                               else (self._on_error(z) + slope)
                               * first_order(z, self.error_lowpass, T))  # fmt: skip

    def from_set_point(self, frequency: Float[np.ndarray, " f"]) -> Response:
        """Compute the response of the output to the set point as it is used."""
        z, T = delays(frequency, self.period), self.period
        on_error = self._on_error(z)
        if self.slope_of == "error":
            on_error = on_error + self._slope(z)
        asked = first_order(z, self.set_point_lowpass, T)
        return self._out(z) * asked * (on_error * first_order(z, self.error_lowpass, T) + self.FF)

    def from_angle(self, frequency: Float[np.ndarray, " f"]) -> Response:
        """Compute the response of the output to the rate by way of the attitude loop, turned."""
        asked = self.angle * delays(frequency, self.period) ** -self.set_point_age
        return self.from_set_point(frequency) * asked / (2j * np.pi * frequency)

    def _on_error(self, z: Response) -> Response:
        return self.P + self.I * integral(z, self.period, late=self.slope_of == "rate")

    def _slope(self, z: Response) -> Response:
        T = self.period
        return self.D * difference(z, T) * first_order(z, self.slope_lowpass, T)

    def _out(self, z: Response) -> Response:
        return first_order(z, self.output_lowpass, self.period)

    def replayed(
        self,
        set_point: Float[np.ndarray, " n"],
        rate: Float[np.ndarray, " n"],
        slope: Float[np.ndarray, " n"] | None = None,
    ) -> Float[np.ndarray, " n"]:
        """Compute the output for set points as used and rates; `slope`: as the log has it."""
        asked = self._low(set_point, self.set_point_lowpass)
        error = self._low(asked - rate, self.error_lowpass)
        followed = error if self.slope_of == "error" else -rate
        steep = self.derivative(followed) if slope is None else -slope
        late = self.slope_of == "rate"
        weight = np.maximum(0.0, 1.0 - (error / FULL_INTEGRAL) ** 2) if late else 1.0
        total = np.cumsum(weight * error) * self.period
        if late:
            total = np.concatenate([[0.0], total[:-1]])
        out = self.P * error + self.I * total + self.D * steep + self.FF * asked
        return self._low(out, self.output_lowpass)

    def derivative(self, values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Compute the derivative that D acts on."""
        change = np.diff(values, prepend=values[:1]) / self.period
        return self._low(change, self.slope_lowpass)

    def _low(self, values: Float[np.ndarray, " n"], cutoff: float) -> Float[np.ndarray, " n"]:
        alpha = smoothing(cutoff, self.period)
        if alpha == 1.0:
            return values
        left = 1.0 - alpha
        return signal.lfilter([alpha], [1.0, -left], values, zi=[left * values[0]])[0]
