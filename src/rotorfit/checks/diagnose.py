"""Diagnose a fit: errors of sensors, motors and vehicle, in one list of checks.

A diagnostic is a function from the `Fit` of the last step to its findings, and changes nothing.
Diagnostics that refuse a declaration raise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Final

from rotorfit.checks import (
    flights_agree,
    hover_thrust,
    known_payloads,
    left_out_hovers,
    lever_arms,
    moved_balance,
    reference_test,
    residual_peaks,
    spins,
    thrust_against_weight,
    vehicle_size,
)
from rotorfit.checks.coupling import absent_coupling
from rotorfit.checks.impossible_inertia import impossible_inertia, negative_rotor_inertia
from rotorfit.checks.motors import changed_thrust, jumping_thrust, motor_law, motor_limits
from rotorfit.checks.sensors import (
    clock_drift,
    clocks,
    gyro_scale,
    log_settings,
    sensor_faults,
    sensor_response,
)
from rotorfit.checks.weak_directions import little_excitation, unknown_origin, weak_directions
from rotorfit.findings import Finding
from rotorfit.fit.dataset.channel_findings import name_resting_numbers
from rotorfit.fit.fit import Fit

Diagnostic = Callable[[Fit], Iterable[Finding]]


def reported_by_fit(fit: Fit) -> Iterator[Finding]:
    """Yield what the fit itself reports: terms that it added, or left out."""
    return iter(fit.findings)


DIAGNOSTICS: Final[tuple[Diagnostic, ...]] = (
    *log_settings.CHECKS,
    absent_coupling,
    little_excitation,
    unknown_origin,
    reported_by_fit,
    *motor_law.FLIGHT_CHECKS,
    *thrust_against_weight.CHECKS,
    *motor_law.CHECKS,
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
    negative_rotor_inertia,
    *hover_thrust.WRENCH_CHECKS,
    *clocks.CHECKS,
    *clock_drift.CHECKS,
    *sensor_faults.CHECKS,
    *hover_thrust.CHECKS,
    *left_out_hovers.CHECKS,
    *motor_limits.CHECKS,
    *residual_peaks.CHECKS,
    *flights_agree.CHECKS,
    *changed_thrust.FLIGHT_CHECKS,
    *moved_balance.CHECKS,
    *jumping_thrust.CHECKS,
    *hover_thrust.YAW_CHECKS,
    *known_payloads.CHECKS,
    *reference_test.CHECKS,
)
"""Diagnostics in the order of their findings. A new one is a function of its topic's module,
named in the `CHECKS` of that module."""


def diagnose(fit: Fit) -> tuple[Finding, ...]:
    """Run every diagnostic on a fit; a contradicted declaration raises `FrameError`."""
    found = (finding for diagnostic in DIAGNOSTICS for finding in diagnostic(fit))
    return name_resting_numbers(found)
