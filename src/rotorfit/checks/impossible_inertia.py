r"""Whether a body with that inertia can exist, and the nearest one that can.

A body of positive mass everywhere has a positive semidefinite pseudo-inertia (Wensing, Kim and
Slotine 2017, arXiv 1701.04395)

.. math:: \begin{pmatrix} \tfrac12 tr(I) 1 - I & ms \\ ms^T & m \end{pmatrix} \succeq 0 ,

the second moments of its mass. About the centre of mass that is :math:`\tfrac12 tr(I_C) 1 - I_C
\succeq 0`: no principal moment is over the sum of the two others.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.checks.verdicts.parameters import joint_parameters
from rotorfit.digits import with_half
from rotorfit.findings import Evidence, Finding, doubt_or_passed
from rotorfit.fit.dataset.channel_findings import BY_YAW
from rotorfit.fit.intervals.numbers import SCALED, Numbers
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import INERTIA, inertia_matrix

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Float

    from rotorfit.checks.verdicts.judge import Parameter
    from rotorfit.fit.fit import Fit

IMPOSSIBLE = "no body has these moments of inertia: one exceeds the sum of the two others"
ESTIMATE = "impossible_"
"""Prefix of the diagnostics that keep withheld estimates."""
NEGATIVE = "it comes out negative, which no inertia is"
SURELY = 2.0
"""Half-widths below nothing from which a rotor inertia is surely negative."""
NEGATIVE_ROTORS = "the rotors' inertia comes out negative, which no inertia is"
ROTOR_INERTIA: Final = {
    "Jr": "the rotors' inertia comes out negative, {} kg m^2",
    "Jr_over_Izz": "the rotors' inertia over Izz comes out negative, {}",
}
UNFILTERED = "log the gyro unfiltered, all axes by one clock"
DECLARE = (
    "compare order, places and spins of the rotors under [airframe] with the vehicle, and the axes "
    "of the log"
)
FLY = "fly longer and livelier about all three axes, 20 s each, then identify all flights together"


@frozen_dataclass
class SecondMoment:
    """The smallest second moment of the mass about the CoM; negative for an impossible body.

    - `value`, `half_width`: with half of its 95 % interval [kg m^2].
    - `share`: the value over half the trace of the inertia, which no second moment can exceed.
    """

    value: float
    half_width: float
    share: float

    @property
    def impossible(self) -> bool:
        """Whether the whole interval is negative."""
        return self.value + self.half_width < 0.0


def second_moments(inertia: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Return the second moments of the mass, 1/2 tr(I) 1 - I, about the same point [kg m^2]."""
    return 0.5 * np.trace(inertia) * np.eye(3) - inertia


def smallest_second_moment(numbers: Numbers, configuration: str) -> SecondMoment:
    """Return the smallest second moment of a configuration's mass with its interval."""
    places = [numbers.index(f"{name}_com@{configuration}") for name in INERTIA]
    values = numbers.values[places]
    moments, axes = np.linalg.eigh(second_moments(inertia_matrix(values)))
    slope = np.array([axes[:, 0] @ matrix @ axes[:, 0] for matrix in moment_slopes()])
    half = numbers.half_width[places]
    variance = np.inf
    if np.isfinite(half).all():
        spread = slope * half
        variance = float(spread @ numbers.correlation[np.ix_(places, places)] @ spread)
    return SecondMoment(
        value=float(moments[0]),
        half_width=float(np.sqrt(max(variance, 0.0))),
        share=_moment_share(float(moments[0]), 0.5 * float(values[:3].sum())),
    )


def _moment_share(moment: float, total: float) -> float:
    """Return a second moment over their sum; infinitely impossible where no sum is positive."""
    return moment / total if total > 1e-9 * abs(moment) else float("-inf")


def moment_slopes() -> list[Float[np.ndarray, "3 3"]]:
    """Return the derivative of the second moments by each element of the inertia."""
    return [second_moments(inertia_matrix(unit)) for unit in np.eye(len(INERTIA))]


def possible_sentence(moment: SecondMoment, configuration: str) -> str | None:
    """Describe an impossible body in words; None if it can exist."""
    if moment.value >= 0.0:
        return None
    percent = 100.0 * abs(moment.share)
    if moment.impossible:
        return f"{configuration}: {IMPOSSIBLE} (by {percent:.0f} %); {FLY}"
    return (
        f"{configuration}: {IMPOSSIBLE} (by {percent:.1f} %), but their intervals allow a body "
        "that can exist: for a simulator take the nearest one (rotorfit.project_to_physical)"
    )


def impossible_inertia(fit: Fit) -> Iterator[Finding]:
    """Check that every body can exist, and withhold an inertia that no body has."""
    parameters = joint_parameters(fit)
    for name in (c.name for c in fit.configurations):
        # A moment that a step has withheld disproves no body.
        if fit.withheld & {f"{axis}@{name}" for axis in ("Ixx", "Iyy", "Izz")}:
            continue
        negative = negative_moment(fit.numbers, name, parameters)
        if negative is not None:
            yield negative
            continue
        moment = smallest_second_moment(fit.numbers, name)
        # What the yaw equation gives, k_d / I_zz and J_r / I_zz, is sound whatever the other
        # moments are, and stays; I_zz, k_d and J_r depend on one scale, which the impossible body
        # disproves for all configurations.
        yield body_finding(moment, name, parameters, fit.numbers.names)


def negative_moment(
    numbers: Numbers, configuration: str, parameters: Sequence[Parameter]
) -> Finding | None:
    """Withhold the inertia of a body of which a reported moment's whole interval is negative."""
    reported = {p.full_name for p in parameters if p.value is not None}
    for axis, motion in (("Ixx", "rolls"), ("Iyy", "pitches"), ("Izz", "yaws")):
        value, half = numbers.number(f"{axis}_com@{configuration}")
        # No flight of rotors that are declared rightly is 2 deviations below nothing: the vehicle
        # turns against the torque of the declared ones.
        if not value + half < 0.0 or f"{axis}@{configuration}" not in reported:
            continue
        ends = (value - half, value + half)
        return Finding(
            kind="impossible-inertia",
            severity="doubt",
            sentence=f"{configuration}: {axis} comes out negative, {with_half(value, half)} kg m^2:"
            f" the vehicle {motion} against the torque of the declared rotors; {DECLARE}",
            numbers=tuple(name for name in numbers.names if _is_disproved(name, configuration)),
            evidence=(
                Evidence(
                    name=f"negative_inertia@{configuration}", value=value, interval=ends, limit=0.0
                ),
            ),
            next_step=DECLARE,
            withheld_because=NEGATIVE,
        )
    return None


def negative_rotor_inertia(fit: Fit) -> Iterator[Finding]:
    """Check that the rotors' inertia is not negative: nothing of yaw holds where it surely is."""
    for name in fit.numbers.names:
        base = name.partition("@")[0]
        # Where I_zz is unknown the flight knows their inertia over it alone.
        if base not in ROTOR_INERTIA:
            continue
        value, half = fit.numbers.number(name)
        # Where the rotors have next to none, one interval in forty is negative by chance.
        if value + SURELY * half < 0.0:
            yield _negative_rotors(ROTOR_INERTIA[base].format(with_half(value, half)), value, half)
            return


def _negative_rotors(words: str, value: float, half: float) -> Finding:
    """Doubt all of yaw for a negative inertia of the rotors, put in words."""
    return Finding(
        kind="impossible-rotor-inertia",
        severity="doubt",
        sentence=f"{words}: yaw does not turn as the rotors speed up and slow down, as where the "
        "yaw gyro is filtered more or stamped later than roll and pitch, or where gusts make most "
        f"of yaw; {UNFILTERED}, and fly yaw",
        numbers=BY_YAW,
        evidence=(
            Evidence(
                name="negative_rotor_inertia",
                value=value,
                interval=(value - half, value + half),
                limit=0.0,
            ),
        ),
        next_step=UNFILTERED,
        doubtful_because=NEGATIVE_ROTORS,
    )


def body_finding(
    moment: SecondMoment, configuration: str, parameters: Sequence[Parameter], names: Sequence[str]
) -> Finding:
    """Judge one body by its smallest second moment; `names` are those of all numbers."""
    disproved = tuple(name for name in names if _is_disproved(name, configuration))
    lost = {p.full_name for p in parameters if p.value is None}
    # What is not reported needs no doubt.
    shown = not lost & {f"{axis}@{configuration}" for axis in ("Ixx", "Iyy", "Izz")}
    sentence = possible_sentence(moment, configuration) if shown else None
    measured = {f"smallest_second_moment@{configuration}": moment.share}
    if moment.impossible:
        measured |= _withheld_estimates([p for p in parameters if p.full_name in disproved])
    found = doubt_or_passed("impossible-inertia", sentence, measured, numbers=disproved)
    if not moment.impossible:
        # A number that is right within its interval is no reason to doubt it.
        return dataclasses.replace(found, severity="note") if sentence else found
    return dataclasses.replace(found, next_step=FLY, withheld_because=IMPOSSIBLE)


def _is_disproved(full_name: str, configuration: str) -> bool:
    """Return whether an impossible body of a configuration disproves a number."""
    name, _, owner = full_name.partition("@")
    return name in SCALED or (owner == configuration and name.startswith(INERTIA))


def _withheld_estimates(withheld: Sequence[Parameter]) -> dict[str, float]:
    """Return values and deviations of withheld moments, from which `project_to_physical` begins."""
    return {
        f"{ESTIMATE}{what}_{p.full_name}": float(number)
        for p in withheld
        if p.name in INERTIA
        for what, number in (("value", p.value), ("std", p.std))
        if number is not None
    }
