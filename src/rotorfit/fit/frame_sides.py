r"""Are the rotors as far apart front to back, over left to right, as declared? The flight tells.

Longer arms all over look like a heavier body; longer ones along x alone do not: turns about two
axes at once, and the centre of mass beside the accelerometer, tie roll and pitch together. So the
sides are one parameter beside the fit: with the rotors at :math:`(x (1 + s), y (1 - s))`, s is
estimated with its deviation, and no other shape of the frame is fitted.

What it says is weighed against how people measure. Nearly all declare sides that a ruler gives
(to a millimetre each); one in fifty is grossly wrong: x and y exchanged, a square for a rectangle,
another vehicle, or one side alone, with which the mean arm is wrong by as much. With these two
explanations as the prior of s, the half-width of its posterior about what was declared goes into
every number as it moves with s: one that flights hardly tell stays at the ruler's, one that they
contradict grows to what they say, and nothing jumps in between. `checks/lever_arms.py` judges s.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.estimation.distributions import normal_density, student_density, student_quantile
from rotorfit.fit.additional_parameters import Added, Additional, estimate_additional, gained
from rotorfit.fit.fit import Fit, refit
from rotorfit.fit.intervals.excitation import weighed_excitation
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.intervals.joint_numbers import slopes_of_numbers
from rotorfit.fit.intervals.numbers import LEAST_EXCITATION, NO_EXCITATION, inertia_bias
from rotorfit.logs.flight_log import SITL
from rotorfit.model.parameters import INERTIA, INERTIA_COM
from rotorfit.model.regressor import regressor

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.fit.timing.timed_dataset import TimedDataset
    from rotorfit.model.signals import SignalLayout
    from rotorfit.model.terms.term import Block
    from rotorfit.model.vehicle import Vehicle

RULER: Final = 1e-3
"""Deviation of a measured side [m]."""
FLEXIBLE: Final = 0.005
"""Deviation of s of any frame: it bends, motors sit in slots, large sizes are rounded."""
MISTAKEN: Final = 0.25
"""Deviation of s of a frame that was not measured: exchanged sides of 1.4 to 1 are 0.33 away, a
square 0.17."""
MISTAKES: Final = 0.02
"""Share of declarations that are mistaken. Well under the 5 % that an interval leaves out: or a
flight that tells next to nothing of the sides would decide whether it counts."""
LACKING: Final = 0.05
"""Deviation of s by what the model lacks in all flights of a vehicle: thirteen of a 3-inch
quadrotor agree on -0.05 +- 0.01, alone they state 0.02 to 0.1."""
COHERENT: Final = 0.6
"""Share of what one block leaves unexplained that the model can lack at most: where it explains all
but a little, it lacks little."""
OPEN: Final = 0.5
"""Deviation of s for the estimate alone: as good as free."""
NEAR: Final = 0.1
"""Of s: as far from the declared sides an estimate by the slopes there is that of a new fit, on the
thirteen flights to .005."""
FARTHEST: Final = 0.6
"""Of s in a new fit, and of a doubt: four times the ratio that was declared. What fits a flight
with one arm next to nothing is no frame but an axis that hardly moves."""
BY_ARM: Final = ("Ixx", "Iyy", "Ixx_com", "Iyy_com", "Ixx_over_kt", "Iyy_over_kt")
TOUCHED: Final = (*INERTIA, *INERTIA_COM, "kd", "Jr", "kd_over_kt", *BY_ARM[4:], "Izz_over_kt")
"""In proportion to the arms: a mistake in one side alone makes the mean arm longer, too."""
BY_PLACE: Final = ("com_x", "com_y", "msx", "msy")
"""The same where the origin is that of the rotors, and not an IMU whose place is unknown."""
_GRID: Final = np.linspace(-0.95, 0.95, 3801)


@dataclass(frozen=True, kw_only=True)
class FrameSides:
    """The sides of the frame: s, by which the flights would have x longer and y shorter.

    - `declared`: ratio of the rotors' distances, front to back over left to right.
    - `ruler`: deviation of s of sides that were measured.
    - `value`, `std`: of s, by the flights alone; zero and infinite where they do not tell it.
    - `blocks`: independent ones that tell it.
    - `slopes`, `by_mistake`: of the numbers by s, positive: with the mean arm as declared, and with
      one side wrong alone.
    """

    declared: float
    ruler: float
    value: float
    std: float
    blocks: float
    slopes: Float[np.ndarray, " q"]
    by_mistake: Float[np.ndarray, " q"]

    @property
    def whole_std(self) -> float:
        """Deviation of s with what the model lacks, which no length of a flight averages."""
        # std sqrt(blocks) is the deviation by one block: what the model lacks in all blocks alike
        # is a part of that, and no more.
        lacking = min(LACKING, COHERENT * self.std * float(np.sqrt(self.blocks)))
        return float(np.hypot(self.std, lacking)) if np.isfinite(self.std) else self.std

    @property
    def degrees(self) -> float:
        """Degrees of freedom of that (Satterthwaite): those of the part by chance."""
        return self.blocks * (self.whole_std / self.std) ** 4 if self.std > 0.0 else np.inf

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the ratio, by the flights alone."""
        reach = float(student_quantile(0.975, self.degrees)) * self.whole_std
        return self.ratio(self.value - reach), self.ratio(self.value + reach)

    def ratio(self, s: float) -> float:
        """Return the ratio of the rotors' distances with the sides moved."""
        s = min(max(s, float(_GRID[0])), float(_GRID[-1]))
        return self.declared * (1.0 + s) / (1.0 - s)

    @cached_property
    def _posterior_parts(self) -> Float[np.ndarray, "2 n"]:
        """The posterior of s over the grid: measured with a ruler, and mistaken."""
        # Flights that tell nothing leave the prior as it is.
        seen = np.ones(len(_GRID))
        if np.isfinite(self.std):
            seen = student_density((_GRID - self.value) / self.whole_std, self.degrees)
        prior = [
            (1.0 - MISTAKES) * normal_density(_GRID, self.ruler),
            MISTAKES * normal_density(_GRID, MISTAKEN),
        ]
        parts: Float[np.ndarray, "2 n"] = np.array(prior) * seen
        return parts / parts.sum()

    @property
    def measured(self) -> float:
        """Chance that the sides were measured, and not mistaken."""
        return float(self._posterior_parts[0].sum())

    @property
    def half_widths(self) -> Float[np.ndarray, " q"]:
        """What holds 95 % of the posterior of each number about its value, for the sides alone."""
        far, weights = np.abs(_GRID), self._posterior_parts.ravel()
        out = np.zeros(len(self.slopes))
        for i, (slope, by_mistake) in enumerate(zip(self.slopes, self.by_mistake, strict=True)):
            off = np.concatenate([slope * far, by_mistake * far])
            order = np.argsort(off, kind="stable")
            within = np.cumsum(weights[order])
            out[i] = off[order][int(np.searchsorted(within, 0.95))]
        return out


def allow_for_sides(fit: Fit) -> Fit:
    """Add the uncertainty of the frame's sides, and record which sides the flights show."""
    sides = frame_sides(fit)
    if sides is None:
        return fit
    term = IntervalTerm(
        name="frame sides",
        half_width=sides.half_widths,
        source="the declared sides against those that the flights show",
    )
    return fit.with_terms(term).with_record(sides)


def frame_sides(fit: Fit) -> FrameSides | None:
    """Estimate the sides of the frame; None if it has no two sides."""
    first = _frame_sides(fit)
    if first is None:
        return first
    # With sides that are far off a fit may lose yaw, and with it what shows the sides: so where the
    # estimate leaves the neighbourhood of the declared ones open, it is repeated from where it ends
    # and from as far as it is open, and the likeliest of these fits says what the sides are.
    moved = _find_likeliest_sides(fit, first)
    again = None if moved is None else _frame_sides(moved[1])
    if moved is None or again is None or not np.isfinite(again.std):
        return first
    # Ratios multiply: s adds as velocities do.
    by = moved[0]
    slope = (1.0 - by * by) / (1.0 + by * again.value) ** 2
    return replace(
        first,
        value=(by + again.value) / (1.0 + by * again.value),
        std=slope * again.std,
        blocks=again.blocks,
    )


def likeliest_sides(fit: Fit) -> Fit | None:
    """Fit with the sides of the frame that are likelier by far; None if the declared ones are.

    As far off as `frame_sides` looks.
    """
    first = _frame_sides(fit)
    moved = None if first is None else _find_likeliest_sides(fit, first)
    return None if moved is None else moved[1]


def _find_likeliest_sides(fit: Fit, first: FrameSides) -> tuple[float, Fit] | None:
    """Return s of the likeliest fit about an estimate, with it; None if the fit's own is."""
    if not np.isfinite(first.std) or abs(first.value) + first.std < NEAR:
        return None
    open_by = [0.0] if first.std < NEAR else [-first.std, 0.0, first.std]
    moved = [one for off in open_by for one in _fit_with_sides_moved(fit, first.value + off)]
    best = max(moved, key=lambda one: gained(fit.estimate, one[1].estimate), default=None)
    return best if best and gained(fit.estimate, best[1].estimate) > 0.0 else None


def _fit_with_sides_moved(fit: Fit, by: float) -> list[tuple[float, Fit]]:
    """Fit the flights with other sides, where that comes to an end; return s with the fit."""
    by = float(np.clip(by, -FARTHEST, FARTHEST))
    try:
        return [(by, _with_sides(fit, by))]
    except EstimationError:
        return []


def _with_sides(fit: Fit, by: float) -> Fit:
    """Fit the flights with the rotors further out along x by a share, and nearer along y."""
    vehicle = fit.dataset.vehicle
    centre = vehicle.positions.mean(axis=0)
    places = centre + (vehicle.positions - centre) * np.array([1.0 + by, 1.0 - by, 1.0])
    rotors = (
        replace(rotor, position=(x, y, z))
        for rotor, (x, y, z) in zip(vehicle.rotors, places.tolist(), strict=True)
    )
    moved = replace(vehicle, rotors=tuple(rotors))
    model = regressor(moved, added=fit.dataset.model.layout.added)
    dataset: TimedDataset = replace(fit.dataset, vehicle=moved, model=model)
    return refit(fit, dataset, guess=fit.estimate.estimate.by_name)


def _frame_sides(fit: Fit) -> FrameSides | None:
    """Estimate them by the slopes at the sides with which a fit was made; see `frame_sides`."""
    x, y = np.ptp(fit.dataset.vehicle.positions[:, :2], axis=0).tolist()
    if min(x, y) < 0.05 * max(x, y):
        return None
    added = Added(
        name="sides",
        entries=sides_block(fit.dataset.vehicle, fit.dataset.model.layout),
        times="kt",
        prior=OPEN,
    )
    try:
        found = estimate_additional(fit.estimate, fit.configurations, [added])
    except EstimationError:
        return None
    open_by_gusts = _std_by_gusts(fit, found) if _is_coupled(fit) else np.inf
    identifiable = bool(np.isfinite(open_by_gusts))
    slopes = _slopes_by_sides(fit, found)
    touched = touched_numbers(fit)
    by_arm = np.array([name in touched for name in fit.numbers.names])
    return FrameSides(
        declared=x / y,
        ruler=float(np.hypot(0.5 * RULER * np.hypot(1.0 / x, 1.0 / y), FLEXIBLE)),
        value=float(found.values[0]) if identifiable else 0.0,
        std=float(np.hypot(_std_of_sides(fit, found), open_by_gusts)) if identifiable else np.inf,
        blocks=found.blocks,
        slopes=slopes,
        by_mistake=slopes + by_arm * np.abs(fit.numbers.values),
    )


def _std_of_sides(fit: Fit, found: Additional) -> float:
    """Return the deviation of s, at least as large as its gain of likelihood leaves it."""
    # Far off the likelihood is flat, and its slopes there say nothing of what was declared.
    gain = max(found.estimate.log_likelihood - fit.estimate.log_likelihood, 0.0)
    return max(float(found.std[0]), abs(float(found.values[0])) / float(np.sqrt(2.0 * gain + 1.0)))


def _std_by_gusts(fit: Fit, found: Additional) -> float:
    """Return the deviation of s by gusts where an axis is hardly flown; infinite if not at all."""
    by_weight = (weighed_excitation(e, fit.configurations) for e in (fit.estimate, found.estimate))
    # Wrong sides leave motion unexplained that is no gust: the sides that were found count, too.
    lively = [fit.numbers.excitation, *by_weight]
    rho = {
        axis: max(by[key] for by in lively for key in by if key.startswith(axis))
        for axis in ("roll", "pitch")
    }
    if min(rho.values()) < NO_EXCITATION:
        return np.inf
    off = [inertia_bias(1.0, one) for one in rho.values() if one < LEAST_EXCITATION]
    # Each axis may be as far off as its moment of inertia; s has half the difference of the two.
    return 0.5 * float(np.linalg.norm(off)) / 1.96


def _is_coupled(fit: Fit) -> bool:
    """Return whether turns about two axes tie them together: not in each simulator."""
    simulated = any(f.log.simulator == SITL for f in fit.dataset.flights)
    return fit.coupled and not simulated


def sides_block(vehicle: Vehicle, layout: SignalLayout) -> Block:
    """Return the torque of thrust by s: rotors further out along x, and nearer along y."""
    places = vehicle.positions - vehicle.positions.mean(axis=0)
    torque = np.cross(places * np.array([1.0, -1.0, 0.0]), vehicle.axes)
    out = np.zeros((6, len(layout)))
    out[3:, [layout.index(f"O2_{i + 1}") for i in range(len(torque))]] = -torque.T
    return out


def _slopes_by_sides(fit: Fit, found: Additional) -> Float[np.ndarray, " q"]:
    """Return by how much each number moves with s, all others following."""
    names, estimate, mapped = fit.numbers.names, found.estimate.estimate, found.estimate.problem.map
    covariance = estimate.covariance
    moved = covariance[:, -1] / covariance[-1, -1]
    by_parameters = slopes_of_numbers(
        names, estimate.values, estimate.std, mapped, fit.configurations
    )
    slopes = np.abs(by_parameters @ moved)
    bases = [name.partition("@")[0] for name in names]
    # Moments of roll and pitch at least in proportion to their own arm: the coupling that holds
    # them near the declared sides may hold less well far off.
    by_arm = np.array([base in BY_ARM for base in bases])
    return np.maximum(slopes, by_arm * np.abs(fit.numbers.values))


def touched_numbers(fit: Fit) -> tuple[str, ...]:
    """Return the numbers that a wrong side makes wrong."""
    names = fit.numbers.names
    placed = () if any(n.startswith("rotor_center_x") for n in names) else BY_PLACE
    return tuple(n for n in names if n.partition("@")[0] in (*TOUCHED, *placed))
