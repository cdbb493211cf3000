"""Diagnose a fit: every check that needs the fit, its flights, or both, in one list.

A diagnostic is a function from a `Fit` to its findings. Those that refuse a declaration raise.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Final

from rotorfit.diagnostics import (
    flights_agree,
    hover_thrust,
    lever_arms,
    payload,
    residual_peaks,
    rotor_order,
    spins,
    steady_wrench,
    vehicle_size,
)
from rotorfit.diagnostics.instruments import reference_test
from rotorfit.diagnostics.motors import changed_rotor, motor_limits
from rotorfit.diagnostics.sensors import clocks, imu_tilt, log_settings
from rotorfit.findings import Finding
from rotorfit.fit.fit import NO_COUPLING, Fit
from rotorfit.results.parameter_tables import little_excitation, unknown_origin
from rotorfit.results.physical_inertia import impossible_inertia
from rotorfit.results.weak_directions import weak_directions

Diagnostic = Callable[[Fit], Iterable[Finding]]


def absent_coupling(fit: Fit) -> Iterator[Finding]:
    """Yield the finding of the step that fits without gyroscopic terms."""
    return (one for one in fit.findings if one.kind == NO_COUPLING)


def of_steps(fit: Fit) -> Iterator[Finding]:
    """Yield the findings of the other steps that led to the fit."""
    return (one for one in fit.findings if one.kind != NO_COUPLING)


DIAGNOSTICS: Final[tuple[Diagnostic, ...]] = (
    *log_settings.CHECKS,
    absent_coupling,
    little_excitation,
    unknown_origin,
    of_steps,
    *rotor_order.REFUSALS,
    *spins.REFUSALS,
    *vehicle_size.REFUSALS,
    *lever_arms.REFUSALS,
    weak_directions,
    *vehicle_size.CHECKS,
    *changed_rotor.CHECKS,
    impossible_inertia,
    *steady_wrench.CHECKS,
    *clocks.CHECKS,
    *imu_tilt.CHECKS,
    *hover_thrust.CHECKS,
    *motor_limits.CHECKS,
    *residual_peaks.CHECKS,
    *flights_agree.CHECKS,
    *changed_rotor.FLIGHT_CHECKS,
    *steady_wrench.YAW_CHECKS,
    *payload.CHECKS,
    *reference_test.CHECKS,
)
"""In the order in which their findings are reported. A new one is a function of its topic's module,
named in the `CHECKS` of that module."""


def diagnose(fit: Fit) -> tuple[Finding, ...]:
    """Run every diagnostic on a fit.

    Raises
    ------
    FrameError
        If the flights contradict the declared vehicle for certain.
    """
    return tuple(finding for diagnostic in DIAGNOSTICS for finding in diagnostic(fit))
