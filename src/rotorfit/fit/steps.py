"""The steps from the fit of the joint likelihood to the intervals of its numbers.

A step is a function from a `Fit` to a `Fit`: it fits again, or widens intervals by what the
likelihood does not know, and records what it measured for the checks (`Fit.records`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from rotorfit.fit.alternatives.flights_alone import fit_each_alone
from rotorfit.fit.alternatives.free_bodies import fit_free_bodies
from rotorfit.fit.alternatives.spin_search import compare_spins
from rotorfit.fit.coupling import drop_absent_coupling
from rotorfit.fit.fit import Fit
from rotorfit.fit.frame_sides import allow_for_sides
from rotorfit.fit.motors.commanded_speeds import allow_for_law, allow_for_motor_limits
from rotorfit.fit.motors.motor_time_split import allow_for_noise_feedback
from rotorfit.fit.noise_levels import allow_for_noise_levels
from rotorfit.fit.rotor_scales import allow_for_rotor_scale
from rotorfit.fit.sensors.gyro_scale import allow_for_gyro_scale
from rotorfit.fit.sensors.known_faults import (
    allow_for_gyro_lowpass,
    allow_for_velocity_errors,
)
from rotorfit.fit.sensors.late_accelerometer import allow_for_force_delays
from rotorfit.fit.sensors.sensor_response import allow_for_sensor_response
from rotorfit.fit.weight.thrust_change import allow_for_thrust_change
from rotorfit.fit.weight.weigh_thrust import weigh_thrust

Step = Callable[[Fit], Fit]

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
    allow_for_force_delays,
    allow_for_sides,
    allow_for_rotor_scale,
    compare_spins,
    fit_each_alone,
    fit_free_bodies,
)
"""Steps in the order in which they are taken; the last three record evidence alone."""


def every_step(fit: Fit) -> Fit:
    """Take every step from the fit of the joint likelihood to the intervals of its numbers."""
    for step in STEPS:
        fit = step(fit)
    return fit
