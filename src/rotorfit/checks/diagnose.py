"""Diagnose a fit: errors of sensors, motors and vehicle outside the likelihood, in two lists.

A step is a function from a `Fit` to a `Fit`: it fits again, or widens intervals by what the
likelihood does not know, and says so as a finding. A diagnostic is a function from the `Fit` of the
last step to its findings. Those that refuse a declaration raise.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Final

from rotorfit.checks import (
    flights_agree,
    hover_thrust,
    left_out_hovers,
    lever_arms,
    reference_test,
    residual_peaks,
    spins,
    vehicle_size,
)
from rotorfit.checks.coupling import absent_coupling
from rotorfit.checks.impossible_inertia import impossible_inertia
from rotorfit.checks.kt_from_weight import weigh_thrust
from rotorfit.checks.motors import changed_thrust, commanded_speeds
from rotorfit.checks.motors.changed_thrust import allow_for_thrust_change
from rotorfit.checks.motors.commanded_speeds import allow_for_law, allow_for_motor_limits
from rotorfit.checks.motors.motor_time_split import allow_for_noise_feedback
from rotorfit.checks.sensors import (
    clocks,
    gyro_scale,
    log_settings,
    sensor_faults,
    sensor_response,
)
from rotorfit.checks.weak_directions import little_excitation, unknown_origin, weak_directions
from rotorfit.findings import Finding
from rotorfit.fit.coupling import drop_absent_coupling
from rotorfit.fit.fit import Fit
from rotorfit.fit.frame_sides import allow_for_sides
from rotorfit.fit.noise_levels import allow_for_noise_levels
from rotorfit.fit.sensors.gyro_scale import allow_for_gyro_scale
from rotorfit.fit.sensors.known_faults import (
    allow_for_gyro_lowpass,
    allow_for_velocity_errors,
)
from rotorfit.fit.sensors.sensor_response import allow_for_sensor_response

Step = Callable[[Fit], Fit]
Diagnostic = Callable[[Fit], Iterable[Finding]]

STEPS: Final[tuple[Step, ...]] = (
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
"""Steps in the order in which they are taken."""


def every_step(fit: Fit) -> Fit:
    """Take every step from the fit of the joint likelihood to the intervals of its numbers."""
    for step in STEPS:
        fit = step(fit)
    return fit


def of_steps(fit: Fit) -> Iterator[Finding]:
    """Yield the findings of the steps that led to the fit."""
    return iter(fit.findings)


DIAGNOSTICS: Final[tuple[Diagnostic, ...]] = (
    *log_settings.CHECKS,
    absent_coupling,
    little_excitation,
    unknown_origin,
    of_steps,
    *gyro_scale.CHECKS,
    *sensor_response.CHECKS,
    *lever_arms.CHECKS,
    *spins.ORDER_REFUSALS,
    *spins.REFUSALS,
    *vehicle_size.REFUSALS,
    *lever_arms.REFUSALS,
    weak_directions,
    *vehicle_size.CHECKS,
    *changed_thrust.CHECKS,
    impossible_inertia,
    *hover_thrust.WRENCH_CHECKS,
    *clocks.CHECKS,
    *sensor_faults.CHECKS,
    *hover_thrust.CHECKS,
    *left_out_hovers.CHECKS,
    *commanded_speeds.CHECKS,
    *residual_peaks.CHECKS,
    *flights_agree.CHECKS,
    *changed_thrust.FLIGHT_CHECKS,
    *hover_thrust.YAW_CHECKS,
    *flights_agree.PAYLOAD_CHECKS,
    *reference_test.CHECKS,
)
"""Diagnostics in the order of their findings. A new one is a function of its topic's module,
named in the `CHECKS` of that module."""


def diagnose(fit: Fit) -> tuple[Finding, ...]:
    """Run every diagnostic on a fit; a contradicted declaration raises `FrameError`."""
    return tuple(finding for diagnostic in DIAGNOSTICS for finding in diagnostic(fit))
