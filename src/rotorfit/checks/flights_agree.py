"""Whether flights of one vehicle agree, and bodies with and without a known payload.

The flights of a configuration are each held against the others. They differ by chance, by weather
and by how they were flown; another propeller, load or vehicle makes more. A joint fit does not show
it: the flight that is more certain wins.

A known payload is held against what the flights say of both bodies. It is left out, both bodies are
fitted freely, and what B's moments have beyond A's is compared with what the payload should add.
Everything in the moment rows is relative to the arm of the rotors: an arm that is wrong by a factor
s gives first moments, inertia and k_d that are wrong by s, while the payload was weighed and
measured without it. So a wrong arm shows as one factor.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.digits import with_half
from rotorfit.errors import EstimationError
from rotorfit.estimation.distributions import chi_square_tail, normal_tail
from rotorfit.estimation.measured import Measured, mean_scale
from rotorfit.findings import Finding, doubt, doubt_or_passed
from rotorfit.fit.experiment.payload import MOMENTS, added_moments, tolerances
from rotorfit.fit.intervals.joint_numbers import joint_numbers
from rotorfit.fit.joint.closed_loop import NOMINAL_RESPONSE
from rotorfit.fit.joint.joint_fit import INTERMEDIATE
from rotorfit.fit.joint.joint_problem import JointConfiguration, joint_estimate, only
from rotorfit.fit.joint.trims import TRIM
from rotorfit.fit.row_fits import fit_rows
from rotorfit.model.parameters import PARAMETERS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.estimation.banded import BandedEstimate
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.intervals.numbers import Numbers

LOOKED_AT: Final = ("kt", "Ixx_over_kt", "Iyy_over_kt", "Izz_over_kt", "kd_over_Izz", "Jr_over_Izz")
LEAST_SHARE: Final = 0.05
"""Least share of a number by which a flight must differ from the others."""
SURE: Final = 3.9
"""Deviations by which it must: once in ten thousand by chance. Sound real flights make up to 1.1,
two vehicles 9 and more."""
EQUATIONS_EACH: Final = 2.0
"""Equations per free parameter of a flight that is informative by itself."""


def odd_flight(fit: Fit) -> Iterator[Finding]:
    """Check that every flight of a configuration agrees with the others."""
    found: list[tuple[float, str]] = []
    for configured, c in zip(fit.dataset.configurations, fit.configurations, strict=True):
        if len(configured.flights) < 2 or c.payload_of is not None:
            continue
        alone = dict(_fit_flights_alone(c, fit.estimate, len(configured.flights)))
        for k, own in alone.items():
            others = [numbers for other, numbers in alone.items() if other != k]
            file = Path(configured.flights[k].entry.file).name
            found += [
                (size, f"{c.name}: {file}{words}")
                for size, words in _outlying_numbers(c, own, others)
            ]
    if found:
        size, words = max(found)
        yield doubt(
            "flight-differs",
            f"{words}, {size:.1f} standard deviations apart: its vehicle, load, propellers or "
            "battery differed from those of the other flights; identify it separately, or as a "
            "configuration of its own",
        )


def _fit_flights_alone(
    c: JointConfiguration, fit: BandedEstimate, flights: int
) -> Iterator[tuple[int, Numbers]]:
    """Yield the numbers of each flight by itself, where they are identifiable."""
    begin = fit.estimate.by_name
    free = sum(_is_of(name, c.name) for name in begin)
    for k in range(flights):
        own = c.factors.recording == k
        if own.sum() * len(fit.problem.noisy) < EQUATIONS_EACH * free:
            continue
        one = only(replace(c, response=NOMINAL_RESPONSE), own)
        try:
            alone = joint_estimate([one], [], begin=begin, close=INTERMEDIATE)
            yield k, joint_numbers(alone, [one], {c.name: 0.0})
        except EstimationError:
            continue  # too short or too still to be informative by itself


def _is_of(name: str, configuration: str) -> bool:
    """Return whether a parameter belongs to a flight of a configuration that is fitted alone."""
    owner = name.partition("@")[2]
    return not name.startswith(TRIM) and owner in ("", configuration)


def _outlying_numbers(
    c: JointConfiguration, own: Numbers, others: Sequence[Numbers]
) -> Iterator[tuple[float, str]]:
    """Yield the deviations by which a flight differs from the mean of the others, and a phrase."""
    for name in LOOKED_AT:
        full = name if name == "kt" else f"{name}@{c.name}"
        known = [n.number(full) for n in others if full in n.names]
        # All of `LOOKED_AT` are positive: a value below zero is of a flight that does not show it.
        scales = [
            Measured(value=value, std=half / 1.96)
            for value, half in known
            if np.isfinite(half) and half > 0 and value > 0
        ]
        if full not in own.names or not scales:
            continue
        value, half = own.number(full)
        others_mean = mean_scale(scales)
        mean = others_mean.value
        std = float(np.hypot(half / 1.96, others_mean.std))
        size = abs(value - mean) / std if np.isfinite(std) else 0.0
        if size > SURE and abs(value - mean) > LEAST_SHARE * abs(mean):
            yield size, f" gives {name} = {value:.3g}, the other flights {mean:.3g}"


CHECKS: Final = (odd_flight,)


SUSPICIOUS = 1e-3
"""Probability of chance alone below which a disagreement is said."""
LIKELY = 0.05
"""Probability above which one factor is taken for the whole explanation."""
FINEST = 1e-3
"""Moments are compared no finer than this share of their own size: the equations of a sampled
flight hold no better."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PayloadCheck:
    """A declared payload, and the payload that the flights show.

    - `name`, `bare`: the configuration that carries it, and the one without.
    - `declared`, `flown`, `std`: what each of `MOMENTS` should grow by, what it grows by, and the
      deviation of the difference (tolerances of the payload included) [kg m, kg m^2].
    - `chi2`, `probability`: of the nine differences together, and of chance making them that large.
    - `arm`, `arm_std`: the factor s by which the declared arm is too long.
    - `rest_probability`: the same of what that factor leaves.
    """

    name: str
    bare: str
    declared: Float[np.ndarray, " 9"]
    flown: Float[np.ndarray, " 9"]
    std: Float[np.ndarray, " 9"]
    chi2: float
    probability: float
    arm: float
    arm_std: float
    rest_probability: float

    @property
    def arm_probability(self) -> float:
        """Of chance alone moving the factor of the arm that far from one."""
        return 2.0 * normal_tail(abs(self.arm - 1.0) / self.arm_std)


def known_payloads(fit: Fit) -> Iterator[Finding]:
    """Check that known payloads agree with the flights."""
    mass_std = {c.entry.name: c.entry.mass_std for c in fit.dataset.configurations}
    for check in payload_checks(fit.configurations, mass_std):
        measured = {
            f"payload_chi2@{check.name}": check.chi2,
            f"payload_probability@{check.name}": check.probability,
            f"arm_factor@{check.name}": check.arm,
            f"arm_factor_half_width@{check.name}": 1.96 * check.arm_std,
        }
        yield doubt_or_passed("payload", payload_sentence(check), measured)


def payload_checks(
    configurations: Sequence[JointConfiguration], mass_std: Mapping[str, float]
) -> list[PayloadCheck]:
    """Fit all bodies freely, and check every configuration with a known payload."""
    if all(c.payload_of is None for c in configurations):
        return []
    free = [dataclasses.replace(c, payload=(), payload_of=None) for c in configurations]
    fit = joint_estimate(free, [fit_rows(c.factors, c.model, mass=c.mass) for c in free])
    numbers = joint_numbers(fit, free, mass_std)
    return [_check_payload(c, numbers) for c in configurations if c.payload_of is not None]


def _check_payload(configuration: JointConfiguration, numbers: Numbers) -> PayloadCheck:
    """Check one payload against freely fitted bodies."""
    loaded, bare = (
        [numbers.index(f"{name}@{owner}") for name in MOMENTS]
        for owner in (configuration.name, configuration.payload_of)
    )
    added = added_moments(configuration.payload)
    declared = np.array([added[name] for name in MOMENTS])
    flown = numbers.values[loaded] - numbers.values[bare]
    C = _payload_covariance(configuration, numbers, (loaded, bare))
    inverse = np.linalg.inv(C / np.outer(*[np.sqrt(np.diagonal(C))] * 2))
    std = np.sqrt(np.diagonal(C))
    c, d = declared / std, flown / std
    chi2 = float((d - c) @ inverse @ (d - c))
    information = float(c @ inverse @ c)
    s = float(c @ inverse @ d) / information
    rest = float((d - s * c) @ inverse @ (d - s * c))
    return PayloadCheck(
        name=configuration.name,
        bare=str(configuration.payload_of),
        declared=declared,
        flown=flown,
        std=std,
        chi2=chi2,
        probability=chi_square_tail(chi2, len(d)),
        arm=s,
        arm_std=information**-0.5,
        rest_probability=chi_square_tail(rest, len(d) - 1),
    )


def _payload_covariance(
    configuration: JointConfiguration, numbers: Numbers, places: tuple[list[int], list[int]]
) -> Float[np.ndarray, "9 9"]:
    """Compute the covariance of (B - A) - payload, in which the bodies share the rotors."""
    loaded, bare = places
    both = [*loaded, *bare]
    # What no flight determines has no finite interval: here it is known to ten times itself.
    std = np.minimum(numbers.half_width[both] / 1.96, 10.0 * np.abs(numbers.values[both]))
    G = np.concatenate([np.eye(len(loaded)), -np.eye(len(bare))], axis=1)
    C = G @ (numbers.correlation[np.ix_(both, both)] * np.outer(std, std)) @ G.T
    for _, deviation, effect in tolerances(configuration.payload):
        step = deviation * np.array([effect[name] for name in MOMENTS])
        C = C + np.outer(step, step)
    size = np.maximum(np.abs(numbers.values[loaded]), np.abs(numbers.values[bare]))
    return C + np.diag((FINEST * size) ** 2)


def payload_sentence(check: PayloadCheck) -> str | None:
    """Explain what disagrees; None if nothing does."""
    if min(check.probability, check.arm_probability) > SUSPICIOUS:
        return None
    if check.arm_probability <= SUSPICIOUS and check.rest_probability > LIKELY:
        percent = 100.0 * (check.arm - 1.0)
        times = with_half(check.arm, 1.96 * check.arm_std)
        return (
            f"payload of {check.name}: first moments and inertia grow by {times} times what it "
            f"adds: the arm of the rotors seems declared {abs(percent):.1f} % too "
            f"{'long' if percent > 0 else 'short'}; measure the distances between the motors, and "
            "where the payload hangs"
        )
    worst = int(np.argmax(np.abs(check.flown - check.declared) / check.std))
    name = MOMENTS[worst]
    return (
        f"payload of {check.name}: it should add {check.declared[worst]:.3g} "
        f"{PARAMETERS[name].unit} to the {name} of {check.bare}, the flights say "
        f"{with_half(float(check.flown[worst]), 1.96 * float(check.std[worst]))}: weigh it and "
        "measure its place from the body origin again, or leave payload_of out"
    )


PAYLOAD_CHECKS: Final = (known_payloads,)
