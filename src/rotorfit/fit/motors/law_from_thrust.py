r"""Find the law from command to rotor speed in the flight, where none is given or a wrong one.

In hover the weight says how much thrust a command makes, and changes of thrust say how steeply the
thrust grows there. Their ratio is the exponent :math:`p` of the relative speed :math:`u^p` over the
command :math:`u`, as thrust goes with the squared speed. That speed is 1 at full command: k_t and
k_d are thrust and drag torque of one rotor there.

A fit with another exponent than the true one sees thrust, lag and inflow of bent changes, so that
the exponent :math:`r` which it shows depends on the :math:`p` that it is made with. The flights'
own exponent is where :math:`r(p) = p`, found by Steffensen's steps: with a growth :math:`q = dr/dp`
it is :math:`p + (r - p) / (1 - q)`, less certain than :math:`r` by the factor :math:`1 - q`.

The exponent is measured about hover. What it may differ up to full command widens k_t and k_d.

A law that is given is right, or, one in twenty, another vehicle's, or from command to thrust
instead of speed: then the speed goes with another power of the one it gives. The posterior of that
power is a mixture of both; the fit is made with its mean, and what holds 95 % of it is in the
intervals. The law of a simulator's own motors is right.

A law by a setting of the firmware (MOT_THST_EXPO, THR_MDL_FAC) is a default that nobody need have
measured: real motors have powers of it, with a deviation of `STATED_STD`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.distributions import normal_density, normal_tail
from rotorfit.estimation.measured import Measured, combine_scales
from rotorfit.estimation.root import root_between
from rotorfit.fit.motors.bent_law import bend_law, bend_speed
from rotorfit.fit.motors.commanded_speeds import with_other_speeds
from rotorfit.fit.motors.hovers_by_mass import exponent_share_by_masses, rms_speed
from rotorfit.fit.reduction.frequency_bands import retimed
from rotorfit.fit.weight.weigh_thrust import kt_from_changes, weight_of
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.motor_law import MotorLaw, PowerCurve

if TYPE_CHECKING:
    from rotorfit.fit.dataset.dataset import Kind
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.timing.timed_dataset import TimedDataset

USUAL: Final = Measured(value=0.8, std=0.2)
"""Exponent of the speed over the command before the flight: thrust goes with the command's power of
one to two."""
MISTAKES: Final = 0.05
"""Share of given laws that are wrong."""
ROUNDING: Final = 1e-4
"""Deviation of that power of a right law."""
STEADY: Final = 0.95
"""Largest growth of the exponent that a fit shows with that it is made with."""
LOST: Final = 5.0
"""Deviations from what is predicted that no fit which follows the flight shows."""
NEAR: Final = 0.1
"""Deviations between two exponents that count as one."""
FAR: Final = 0.1
"""Difference of two exponents over which their growth is seen."""
LEAST: Final = 0.005
"""Difference of two exponents that count as one, as a share: inertia goes with it."""
LEAST_POWER: Final = 0.25
"""Least exponent that a fit is made with: thrust rises with the command, and a fit far off may show
that it falls."""
FULL_STD: Final = 0.05
"""Deviation of the mean exponent from hover to full command from that in hover: rms of thrust
curves f u^2 + (1 - f) u, f from 0 to 1, that start at -10 to 15 % of the command, with hover at 30
to 70 %."""
WRONG_STD: Final = 0.3
"""Deviation of the power of a wrong law's speed that is right: between two such curves."""
WRONG_FULL_STD: Final = 0.1
"""Deviation of that power's mean, from hover to full command, from that in hover."""
STATED_STD: Final = 0.2
"""Deviation of the power of a stated law's speed that real motors have, from hover to full command.

Of seven motors on thrust stands (six of github.com/StrawsonDesign/motor_propeller_testing and
github.com/diegosdantonio/thruststand_test, the Crazyflie's) that hover on 1/5 to 1/2 of their full
thrust: .16 to .22 about MOT_THST_EXPO .65 and .55 with MOT_SPIN_MIN .15 to .05, and .20 about
THR_MDL_FAC .5."""
STATED_FULL_STD: Final = 0.1
"""Deviation of that power, up to full command, from that in hover: the same stands, .11 to .13.

Of five curves of theirs (thrust over hover .65 to 1.4, any expo and spin-up) it is .11 where the
power in hover agrees with the setting to 5 %, and .12 where it is off by 20 to 40 %: a flight near
hover shows the slope, not what lies above. Nor do flights up to twice the thrust of hover (.11)."""


@frozen_dataclass
class Trial:
    """A fit with a law, and what it shows.

    - `power`: the exponent that the fit was made with.
    - `shown`: the exponent by its weight and changes of thrust; None if it shows none.
    """

    power: float
    shown: Measured | None

    def growth_since(self, other: Trial) -> float:
        """Return the growth of the exponent that a fit shows with the exponent that it assumes."""
        if self.shown is None or other.shown is None:
            return 0.0
        growth = (self.shown.value - other.shown.value) / (self.power - other.power)
        return min(max(growth, 0.0), STEADY)

    def fixed_point(self, growth: float) -> Measured | None:
        """Return the exponent that a fit made with it would show again."""
        if self.shown is None:
            return None
        step = (self.shown.value - self.power) / (1.0 - growth)
        return Measured(value=self.power + step, std=self.shown.std / (1.0 - growth))


@frozen_dataclass
class LawFromThrust:
    """The law from command to rotor speed by a flight.

    - `exponent`: of the speed over the command, or over the speed of the law that is given.
    - `flown`: the exponent by weight and changes of thrust alone; None if they show none.
    - `hover`: rms speed of the heaviest hover before, over the `anchor`.
    - `anchor`: speed that stays as it is, that at full command of relative speeds.
    - `given`: the law that is given; `setting`: its name in the log, of one that is stated.
    - `trial`: the last fit.
    - `growth`: of the exponent that a fit shows with that it is made with; None until it is seen.
    """

    exponent: Measured
    flown: Measured | None
    hover: float
    anchor: float = 1.0
    given: MotorLaw | None = None
    setting: str = ""
    trial: Trial = Trial(power=1.0, shown=None)
    growth: float | None = None

    @property
    def next_power(self) -> float:
        """The exponent to fit with next: its own, or one far enough off to see the growth."""
        if self.growth is None and self.flown is not None and abs(self.step) < FAR:
            return self.trial.power + math.copysign(FAR, self.flown.value - self.trial.power)
        return max(self.exponent.value, LEAST_POWER)

    def has_lost(self, trial: Trial) -> bool:
        """Whether a fit shows another exponent than those before predict: it lost its way."""
        before, shown = self.trial.shown, trial.shown
        if self.growth is None or before is None or shown is None:
            return False
        predicted = before.value + self.growth * (trial.power - self.trial.power)
        spread = float(np.hypot(before.std, shown.std))
        return abs(shown.value - predicted) > max(LOST * spread, FAR)

    @property
    def slope_std(self) -> float:
        """Deviation of the exponent, as a share: that of inertia by the law."""
        return self.exponent.share

    @property
    def thrust_std(self) -> float:
        """Deviation of the thrust at full command by the law, as a share."""
        return 2.0 * self._log_command_span * float(np.hypot(self.exponent.std, self._full_std))

    @property
    def _full_std(self) -> float:
        """Deviation of the mean exponent, up to full command, from that in hover."""
        if self.given is None:
            return FULL_STD
        if self.given.stated:
            return STATED_FULL_STD
        return WRONG_FULL_STD * mistaken(self.flown, self.given) ** 0.5 * self.from_flight

    @property
    def _log_command_span(self) -> float:
        """Logarithm of full command over that in hover."""
        return abs(float(np.log(self.hover)))

    @property
    def is_stated(self) -> bool:
        """Whether the law is a setting of the firmware."""
        return self.given is not None and self.given.stated

    @property
    def from_flight(self) -> bool:
        """Whether the speeds are by the flight, not by the law that is given."""
        return self.given is None or self.trial.power != 1.0

    @property
    def law(self) -> MotorLaw:
        """The law with this exponent."""
        return self.law_at(self.exponent.value)

    def law_at(self, power: float) -> MotorLaw:
        """Return the law with another exponent."""
        known = self.given or MotorLaw(curve=PowerCurve(1.0, 0.0, 1.0))
        speed_std = float(np.hypot(known.speed_std, self._full_std * self._log_command_span))
        return replace(
            bend_law(known, power, anchor=self.anchor),
            slope_std=min(self.slope_std, 1.0),
            speed_std=min(speed_std, 1.0),
            usual_speed=self.anchor,
        )

    @property
    def step(self) -> float:
        """From the exponent of the last fit to this one."""
        return self.exponent.value - self.trial.power

    @property
    def settled(self) -> bool:
        """Whether a fit with this exponent shows nothing new."""
        # A law that is given stands until a deviation speaks against it.
        near = NEAR if self.from_flight else 1.0
        return abs(self.step) < max(near * self.exponent.std, LEAST * self.exponent.value)

    @property
    def fitted(self) -> LawFromThrust:
        """The law that the last fit was made with, and how well it is known."""
        power = self.trial.power
        if self.given is None:
            exponent = Measured(value=power, std=float(np.hypot(self.exponent.std, self.step)))
        else:
            exponent = exponent_of(self.flown, self.given, about=power)
        return replace(self, exponent=exponent)


def find_law(fit: Fit) -> LawFromThrust | None:
    """Find the exponent of the speed over the command; None if speeds are given.

    `fit`: with the law that is given, or with speeds in proportion to the command.
    """
    dataset, given = fit.dataset, fit.dataset.motors.law
    if dataset.motors.speed != "commanded" or dataset.speeds_commanded:
        return None
    trial = _try_power(fit, 1.0)
    flights = dataset.flights
    hover = heaviest_hover(dataset, mass_known=fit.mass_known)
    anchor = 1.0 if given is None else anchor_of(given, hover)
    logged = flights[0].log.motors
    return LawFromThrust(
        exponent=exponent_of(trial.shown, given),
        flown=trial.shown,
        hover=hover / anchor,
        anchor=anchor,
        given=given,
        setting="" if logged is None else logged.words,
        trial=trial,
    )


def heaviest_hover(dataset: TimedDataset, *, mass_known: bool) -> float:
    """Return the rms speed of the configuration that hovers on most thrust."""
    flights = [
        [retimed(flight.prepared, dataset.timing) for flight in configured.flights]
        for configured in dataset.configurations
    ]
    if mass_known:
        # The weight gives the thrust of each, so that the law is open from the largest one on.
        return max(rms_speed(own) for own in flights if own)
    return rms_speed([one for own in flights for one in own])


def anchor_of(law: MotorLaw, hover: float) -> float:
    """Return the speed of a law that stands whatever its slope."""
    # Full command of relative speeds, as k_t is thrust at full command.
    return 1.0 if law.is_relative else law.usual_speed or hover


def find_again(law: LawFromThrust, fit: Fit) -> LawFromThrust:
    """Find the exponent by a fit with the law that was found before."""
    trial = _try_power(fit, law.next_power)
    if law.has_lost(trial):
        trial = replace(trial, shown=None)
    growth = law.growth
    if growth is None or abs(trial.power - law.trial.power) >= FAR:
        growth = trial.growth_since(law.trial)
    flown = trial.fixed_point(growth)
    if flown is None:
        return replace(law, trial=trial)
    exponent = exponent_of(flown, law.given)
    return replace(law, exponent=exponent, flown=flown, trial=trial, growth=growth)


def _try_power(fit: Fit, power: float) -> Trial:
    # Without an accelerometer, whose bias can be free, changes of thrust hang on the weight.
    free = any(name.startswith("accel_bias_z@") for name in fit.estimate.estimate.names)
    by_changes = thrust_ratio(kt_from_changes(fit), weight_of(fit)) if free else None
    shares = [one for one in (by_changes, exponent_share_by_masses(fit)) if one is not None]
    if not shares:
        return Trial(power=power, shown=None)
    share = shares[0] if len(shares) == 1 else shares[0].reconciled_with(shares[1])
    return Trial(power=power, shown=Measured(value=share.value * power, std=share.std * power))


def thrust_ratio(changes: Measured | None, weight: Measured | None) -> Measured | None:
    """Divide k_t by changes of thrust by k_t by the weight; None if either is unknown."""
    return None if changes is None or weight is None else changes.over(weight)


def exponent_of(
    flown: Measured | None, given: MotorLaw | None = None, *, about: float | None = None
) -> Measured:
    """Combine the exponent from the flights with its prior.

    `about`: exponent that is taken in place of the mean, of a law that is given.
    """
    if given is None:
        return USUAL if flown is None else combine_scales(USUAL, flown)
    right, wrong = _exponents_of_kinds(given)
    if flown is not None:
        right, wrong = right.with_other(flown), wrong.with_other(flown)
    return mixed(right, wrong, mistaken(flown, given), about=about)


def mistaken(flown: Measured | None, given: MotorLaw) -> float:
    """Return how likely a law that is given is wrong."""
    before = 0.0 if given.exact else MISTAKES
    if flown is None or not before:
        return before
    likely = [
        share * float(normal_density(flown.value - one.value, float(np.hypot(flown.std, one.std))))
        for share, one in zip((1.0 - before, before), _exponents_of_kinds(given), strict=True)
    ]
    # Where the flight is far from both, both are zero.
    return likely[1] / sum(likely) if sum(likely) else 1.0


def _exponents_of_kinds(given: MotorLaw) -> tuple[Measured, Measured]:
    """Return the exponent of a right law and of a wrong one."""
    known = float(np.hypot(given.slope_std, STATED_STD)) if given.stated else given.slope_std
    right = max(known, ROUNDING)
    wrong = float(np.hypot(right, WRONG_STD))
    return Measured(value=1.0, std=right), Measured(value=1.0, std=wrong)


def mixed(
    right: Measured, wrong: Measured, by_mistake: float, *, about: float | None = None
) -> Measured:
    """Average two normal distributions; 1.96 deviations about the value hold 95 % of both.

    `about`: the value, in place of their mean.
    """
    both = ((1.0 - by_mistake, right), (by_mistake, wrong))
    mean = sum(share * one.value for share, one in both) if about is None else about

    def beyond(half: float) -> float:
        return -0.05 + sum(
            share * normal_tail((half - side * (one.value - mean)) / one.std)
            for share, one in both
            for side in (-1.0, 1.0)
        )

    farthest = max(abs(one.value - mean) + 3.0 * one.std for _, one in both)
    return Measured(value=mean, std=root_between(beyond, 0.0, farthest) / 1.96)


def with_found_law(dataset: TimedDataset, found: LawFromThrust) -> TimedDataset:
    """Return flights with the speeds of a found law, their motors not timed."""
    power = found.next_power
    dataset = replace(dataset, motor_timing=None)
    dataset = with_other_speeds(
        dataset, lambda speed, _: bend_speed(speed, power, anchor=found.anchor)
    )
    return with_law(dataset, found.law_at(power))


def with_law(dataset: Kind, law: MotorLaw) -> Kind:
    """Return a dataset whose motors, and those of its flights, have a law."""
    from rotorfit.fit.dataset.dataset import with_motor_settings  # `inspect` needs no data set

    return with_motor_settings(dataset, law=law)
