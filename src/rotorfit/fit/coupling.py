"""Fit without the gyroscopic coupling of a rigid body where the flights show none.

A body that turns about two axes at once turns about the third: w x I w. Nothing else shows the
scale of the yaw equation, and with it I_zz, k_d and J_r. A simulator that turns its vehicle by
torque over inertia, axis by axis, has no such term; a fit that expects it finds the only body in
which it vanishes, with I_zz near I_xx and I_yy, and all of yaw too small.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.fit.additional_parameters import gained
from rotorfit.fit.fit import Fit, refit
from rotorfit.fit.frame_sides import likeliest_sides
from rotorfit.fit.intervals.numbers import SCALED, Numbers
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.flight_log import SITL
from rotorfit.model.parameters import INERTIA

if TYPE_CHECKING:
    from rotorfit.model.regressor import Regressor

LARGEST_IZZ: Final = 1.05
"""Times the larger of I_xx and I_yy up to which the coupling is looked at: a multirotor, whose
motors stand at the ends of its arms, has 1.2 and more; a body without coupling seems to have less
than 1."""
KNOWN_IZZ: Final = 0.5
"""Half-width of I_zz, as a share, from which on the flights do not show it by any coupling."""
LEAST_GAIN: Final = 10.0
"""Gain of log-likelihood that flights must have without coupling: sound real logs lose
more than that, or do not show I_zz; ArduPilot's simulator gains 17 (I_xx = I_yy) to 900."""
LEFT_SCALE: Final = (0.05, 0.01)
"""k_d and its deviation, as shares of what it is with coupling. Without it nothing fixes the scale
of yaw; with a small one the rotors' gyroscopic torque vanishes from roll and pitch, as it does in
such a program, and the ratios stay what they are."""
_PRODUCTS: Final = ("wxwx", "wywy", "wzwz", "wxwy", "wxwz", "wywz")


@frozen_dataclass
class AbsentCoupling:
    """Gain of log-likelihood without gyroscopic terms, and the least one to drop them, if any."""

    gain: float
    least: float | None


def drop_absent_coupling(fit: Fit) -> Fit:
    """Fit without gyroscopic terms where the flights show none, and withhold the scale of yaw."""
    dataset, estimate = fit.dataset, fit.estimate
    if not _has_suspicious_yaw_inertia(fit):
        return fit
    simulated = any(f.log.simulator == SITL for f in dataset.flights)
    other = dataclasses.replace(dataset, model=without_coupling(dataset.model))
    kd = estimate.estimate.by_name["kd"]
    try:
        uncoupled = refit(
            fit,
            other,
            begin=estimate.estimate.by_name,
            known={"kd": (LEFT_SCALE[0] * kd, LEFT_SCALE[1] * abs(kd))},
        )
    except EstimationError:
        return fit
    gain = uncoupled.estimate.log_likelihood - estimate.log_likelihood
    # In ArduPilot's simulator an I_zz that no multirotor has decides alone: its own frames have no
    # coupling, and what another error of the model gains by one (a wrong expo, say) has no limit.
    # Wrong sides of the frame hide them, too: where a fit with others is likelier, and finds the
    # I_zz of a multirotor, they are there. (Other sides alone can always make a ball of a body.)
    if not simulated and (gain < LEAST_GAIN or _hidden_by_sides(fit, uncoupled)):
        return fit
    least = None if simulated else LEAST_GAIN
    names = uncoupled.numbers.names
    withheld = frozenset(n for n in names if n.partition("@")[0] in SCALED)
    uncoupled = dataclasses.replace(uncoupled, coupled=False, withheld=withheld)
    return uncoupled.with_record(AbsentCoupling(gain=gain, least=least))


def _hidden_by_sides(fit: Fit, uncoupled: Fit) -> bool:
    """Test whether other sides of the frame give back the coupling, and a multirotor's I_zz."""
    moved = likeliest_sides(fit)
    if moved is None or _has_suspicious_yaw_inertia(moved):
        return False
    return gained(uncoupled.estimate, moved.estimate) > 0.0


def _has_suspicious_yaw_inertia(fit: Fit) -> bool:
    """Test whether a configuration's I_zz is known, and too large or small for a multirotor."""
    return any(_no_multirotor(fit.numbers, c.name) for c in fit.configurations)


def _no_multirotor(numbers: Numbers, configuration: str) -> bool:
    moments = [numbers.number(f"{name}_com@{configuration}") for name in ("Ixx", "Iyy", "Izz")]
    (Ixx, _), (Iyy, _), (Izz, half) = moments
    return half < KNOWN_IZZ * abs(Izz) and Izz < LARGEST_IZZ * max(Ixx, Iyy)


def without_coupling(model: Regressor) -> Regressor:
    """Build the model of a body that turns by torque over inertia, without w x I w."""
    products = [i for i, n in enumerate(model.layout.names) if n in _PRODUCTS]
    inertia = [model.names.index(name) for name in INERTIA]
    tensor = model.tensor.copy()
    tensor[np.ix_(inertia, range(tensor.shape[1]), products)] = 0.0
    return dataclasses.replace(model, tensor=tensor)
