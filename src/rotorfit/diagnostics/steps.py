"""The steps from the fit of the joint likelihood to the intervals of its numbers, in one list.

A step is a function from a `Fit` to a `Fit`: it fits again, or widens intervals by what the
likelihood does not know, and says so as a finding.
"""

from collections.abc import Callable
from typing import Final

from rotorfit.diagnostics.coupling import drop_absent_coupling
from rotorfit.diagnostics.kt_from_weight import weigh_thrust
from rotorfit.diagnostics.lever_arms import allow_for_sides
from rotorfit.diagnostics.motors.law_uncertainty import allow_for_law
from rotorfit.diagnostics.motors.motor_limits import allow_for_motor_limits
from rotorfit.diagnostics.motors.motor_time_split import allow_for_noise_feedback
from rotorfit.diagnostics.motors.thrust_change import allow_for_thrust_change
from rotorfit.diagnostics.sensors.gyro_scale import allow_for_gyro_scale
from rotorfit.diagnostics.sensors.sensor_faults import (
    allow_for_gyro_lowpass,
    allow_for_velocity_errors,
)
from rotorfit.diagnostics.sensors.sensor_response import allow_for_sensor_response
from rotorfit.fit.fit import Fit
from rotorfit.fit.noise_levels import allow_for_noise_levels

STEPS: Final[tuple[Callable[[Fit], Fit], ...]] = (
    drop_absent_coupling,
    weigh_thrust,
    allow_for_noise_levels,
    allow_for_motor_limits,
    allow_for_law,
    allow_for_velocity_errors,
    allow_for_gyro_lowpass,
    allow_for_gyro_scale,
    allow_for_thrust_change,
    allow_for_sensor_response,
    allow_for_noise_feedback,
    allow_for_sides,
)
"""In the order in which they are taken."""


def every_step(fit: Fit) -> Fit:
    """Take every step from the fit of the joint likelihood to the intervals of its numbers."""
    for step in STEPS:
        fit = step(fit)
    return fit
