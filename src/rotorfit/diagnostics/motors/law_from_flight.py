r"""Find the law from command to rotor speed in the flight, where none is given.

In hover the weight says how much thrust a command makes, and changes of thrust say how steeply the
thrust grows there. Their ratio is the exponent :math:`p` of the relative speed :math:`u^p` over the
command :math:`u`, as thrust goes with the squared speed. That speed is 1 at full command: k_t and
k_d are thrust and drag torque of one rotor there.

A fit with another exponent than the true one sees thrust, lag and inflow of bent changes, so that
the exponent :math:`r` which it shows depends on the :math:`p` that it is made with. The flights'
own exponent is where :math:`r(p) = p`, found by Steffensen's steps: with a growth :math:`q = dr/dp`
it is :math:`p + (r - p) / (1 - q)`, and as much less certain than :math:`r` as :math:`1 - q` is
small.

The exponent is measured about hover. What it may differ up to full command widens k_t and k_d.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rotorfit.dataset.carried_weight import Measured
from rotorfit.dataset.dataset import Kind, with_flights
from rotorfit.diagnostics.kt_from_weight import kt_from_changes, weight_of
from rotorfit.diagnostics.motors.commanded_speeds import with_other_speeds
from rotorfit.experiment.experiment import MotorsEntry
from rotorfit.experiment.law_table import LawEntry, PowerEntry
from rotorfit.findings import Evidence, Finding
from rotorfit.fit.fit import Fit
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.preprocessing.flight_data import FlightData
from rotorfit.reduction.frequency_bands import retimed

USUAL: Final = Measured(value=0.8, std=0.2)
"""Exponent of the speed over the command before the flight: thrust goes with the command's power of
one to two."""
STEADY: Final = 0.95
"""Largest growth of the exponent that a fit shows with that it is made with."""
NEAR: Final = 0.1
"""Deviations between two exponents that count as one."""
FULL_STD: Final = 0.05
"""Deviation of the mean exponent from hover to full command from that in hover: rms of thrust
curves f u^2 + (1 - f) u, f from 0 to 1, that start at -10 to 15 % of the command, with hover at 30
to 70 %."""
FOUND: Final = "law-found"
GIVE: Final = "log the rotor speed, or measure thrust over command and give law under [motors]"


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundLaw:
    """The law from command to relative speed by a flight.

    - `exponent`: of the relative speed over the command.
    - `flown`: the exponent by weight and changes of thrust alone; None where the flight does not
      show it.
    - `hover`: rms command of the flights, 0 to 1.
    - `trial`: the fit that showed it, where one did.
    - `growth`: of the exponent that a fit shows with that it is made with.
    """

    exponent: Measured
    flown: Measured | None
    hover: float
    trial: "Trial | None" = None
    growth: float = 0.0

    @property
    def slope_std(self) -> float:
        """Deviation of the exponent, as a share: that of inertia by the law."""
        return self.exponent.std / self.exponent.value

    @property
    def thrust_std(self) -> float:
        """Deviation of the thrust at full command by the law, as a share."""
        return 2.0 * self._span * float(np.hypot(self.exponent.std, FULL_STD))

    @property
    def _span(self) -> float:
        """Logarithm of full command over that in hover."""
        return abs(float(np.log(self.hover)))

    @property
    def entry(self) -> LawEntry:
        """The law as the experiment file has it."""
        return LawEntry(
            power=PowerEntry(full_speed=1.0, exponent=self.exponent.value),
            slope_std=min(self.slope_std, 1.0),
            speed_std=min(FULL_STD * self._span, 1.0),
            usual_speed=1.0,
        )

    @property
    def step(self) -> float:
        """From the exponent of the last fit to this one."""
        return 0.0 if self.trial is None else self.exponent.value - self.trial.power

    @property
    def settled(self) -> bool:
        """Whether a fit with this exponent shows nothing new."""
        return abs(self.step) < NEAR * self.exponent.std

    @property
    def fitted(self) -> "FoundLaw":
        """The law that the last fit was made with, and how well it is known."""
        value, std = self.exponent.value - self.step, np.hypot(self.exponent.std, self.step)
        return replace(self, exponent=Measured(value=value, std=float(std)))

    @property
    def finding(self) -> Finding:
        """Say which law was taken, and from where."""
        power, half = 2.0 * self.exponent.value, 2.0 * 1.96 * self.exponent.std
        shown = (
            "this flight does not show it either: as motors usually do, thrust is taken to grow"
            if self.flown is None
            else "weight and changes of thrust show that thrust grows"
        )
        return Finding(
            kind=FOUND,
            severity="note",
            sentence=(
                f"no law from command to rotor speed is given; {shown} with the command to the "
                f"power of {power:.2f} +- {half:.2f} (2: speed in proportion to the command), and "
                "the intervals cover what that leaves open, up to full command; for narrower ones "
                f"{GIVE}"
            ),
            next_step=GIVE,
            evidence=self._evidence,
        )

    @property
    def _evidence(self) -> tuple[Evidence, ...]:
        numbers = {"law_exponent": self.exponent, "law_exponent_flown": self.flown}
        return tuple(
            Evidence(name=name, value=one.value, interval=one.interval)
            for name, one in numbers.items()
            if one is not None
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """A fit with a law, and what it shows.

    - `power`: the exponent that the fit was made with.
    - `shown`: the exponent by its weight and changes of thrust.
    """

    power: float
    shown: Measured

    def growth_since(self, other: "Trial") -> float:
        """Return by how much what the fits show grows with what they are made with."""
        growth = (self.shown.value - other.shown.value) / (self.power - other.power)
        return min(max(growth, 0.0), STEADY)

    def fixed_point(self, growth: float) -> Measured:
        """Return the exponent that a fit made with it would show again."""
        step = (self.shown.value - self.power) / (1.0 - growth)
        return Measured(value=self.power + step, std=self.shown.std / (1.0 - growth))


def find_law(fit: Fit) -> FoundLaw | None:
    """Find the exponent of the speed over the command; None where a law or speeds are given.

    `fit`: with speeds in proportion to the command.
    """
    dataset = fit.dataset
    if dataset.motors.speed != "commanded" or dataset.motors.law or dataset.speeds_commanded:
        return None
    trial = _trial(fit, 1.0)
    flown = None if trial is None else trial.shown
    flights = [f for c in dataset.configurations for f in c.flights]
    hover = hover_command([retimed(flight.prepared, dataset.timing) for flight in flights])
    return FoundLaw(exponent=exponent_of(flown), flown=flown, hover=hover, trial=trial)


def find_again(law: FoundLaw, fit: Fit) -> FoundLaw:
    """Find the exponent by a fit with the law that was found before."""
    trial = _trial(fit, law.exponent.value)
    if law.trial is None or trial is None:
        return law
    growth = law.growth if law.settled else trial.growth_since(law.trial)
    flown = trial.fixed_point(growth)
    return replace(law, exponent=exponent_of(flown), flown=flown, trial=trial, growth=growth)


def _trial(fit: Fit, power: float) -> Trial | None:
    """Read the exponent of a fit; None where it shows none."""
    # Without an accelerometer, whose bias can be free, changes of thrust hang on the weight.
    free = any(name.startswith("accel_bias_z@") for name in fit.estimate.estimate.names)
    left = thrust_ratio(kt_from_changes(fit), weight_of(fit)) if free else None
    if left is None:
        return None
    return Trial(power=power, shown=Measured(value=left.value * power, std=left.std * power))


def thrust_ratio(changes: Measured | None, weight: Measured | None) -> Measured | None:
    """Divide k_t by changes of thrust by k_t by the weight; None where either is unknown."""
    return None if changes is None or weight is None else changes.over(weight)


def exponent_of(flown: Measured | None) -> Measured:
    """Estimate the exponent of the speed by what flights show and by what motors usually have."""
    return USUAL if flown is None else USUAL.with_other(flown)


def hover_command(flights: Sequence[FlightData]) -> float:
    """Compute the rms command in flight, 0 to 1."""
    squares = np.concatenate([one.rotor_speed[one.used_rows].ravel() ** 2 for one in flights])
    return float(np.sqrt(squares.mean()))


def with_found_law(dataset: TimedDataset, found: FoundLaw) -> TimedDataset:
    """Return flights with the speeds of a found law in place of commands, motors not timed."""
    power = found.exponent.value
    dataset = replace(dataset, motor_timing=None, law_found=True)
    dataset = with_other_speeds(dataset, lambda speed, _: np.maximum(speed, 0.0) ** power)
    return declared(dataset, found.entry)


def declared(dataset: Kind, law: LawEntry) -> Kind:
    """Return a dataset whose motors, and those of its flights, have a law."""

    def with_it(motors: MotorsEntry) -> MotorsEntry:
        return motors.model_copy(update={"law": law})

    dataset = replace(dataset, motors=with_it(dataset.motors))
    return with_flights(dataset, lambda flight: replace(flight, motors=with_it(flight.motors)))
