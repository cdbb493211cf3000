"""Whether bodies with and without a known payload differ by it.

A known payload is held against what the flights say of both bodies. It is left out, both bodies are
fitted freely, and what B's moments have beyond A's is compared with what the payload should add.
Everything in the moment rows is relative to the arm of the rotors: an arm that is wrong by a factor
s gives first moments, inertia and k_d that are wrong by s, while the payload was weighed and
measured without it. So a wrong arm shows as one factor.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.digits import with_half
from rotorfit.estimation.distributions import chi_square_tail, normal_tail
from rotorfit.findings import Finding, doubt_or_passed
from rotorfit.fit.alternatives.free_bodies import FreeBodies
from rotorfit.fit.experiment.payload import MOMENTS, added_moments, tolerances
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import COM, INERTIA_COM, PARAMETERS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jaxtyping import Float

    from rotorfit.fit.fit import Fit
    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.fit.joint.joint_problem import JointConfiguration

SUSPICIOUS = 1e-3
"""Probability of chance alone below which a disagreement is said."""
LIKELY = 0.05
"""Probability above which one factor is taken for the whole explanation."""
OF_BODIES: Final = (
    *(*MOMENTS, *COM, *INERTIA_COM),
    *("Ixx_over_kt", "Iyy_over_kt", "Izz_over_kt", "kd_over_Izz", "Jr_over_Izz"),
)
"""Numbers of a body that a wrong payload moves."""
FINEST = 1e-3
"""Moments are compared no finer than this share of their own size: the equations of a sampled
flight hold no better."""


@frozen_dataclass
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
    bodies = fit.record_of(FreeBodies)
    if bodies is None:
        return
    loaded = [c for c in fit.configurations if c.payload_of is not None]
    for check in (check_payload(c, bodies.numbers) for c in loaded):
        measured = {
            f"payload_chi2@{check.name}": check.chi2,
            f"payload_probability@{check.name}": check.probability,
            f"arm_factor@{check.name}": check.arm,
            f"arm_factor_half_width@{check.name}": 1.96 * check.arm_std,
        }
        yield doubt_or_passed(
            "payload",
            payload_sentence(check),
            measured,
            numbers=linked_numbers(check),
            doubtful_because="the flights contradict the declared payload",
            next_step="weigh the payload and measure its place from the body origin again, or "
            "leave payload_of out",
        )


def linked_numbers(check: PayloadCheck) -> tuple[str, ...]:
    """Return the names of the numbers that a payload links: both bodies, and what yaw shows."""
    bodies = (f"{name}@{owner}" for owner in (check.name, check.bare) for name in OF_BODIES)
    return ("kd", "Jr", "kd_over_kt", *bodies)


def check_payload(configuration: JointConfiguration, numbers: Numbers) -> PayloadCheck:
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
        large, long = ("large", "short") if percent < 0 else ("small", "long")
        return (
            f"payload of {check.name}: first moments and inertia grow by {times} times what it "
            f"adds: its mass or its distance from the centre is declared too {large}, or the arm "
            f"of the rotors {abs(percent):.1f} % too {long}; weigh the payload, and measure its "
            "place and the distances between the motors"
        )
    worst = int(np.argmax(np.abs(check.flown - check.declared) / check.std))
    name = MOMENTS[worst]
    return (
        f"payload of {check.name}: it should add {check.declared[worst]:.3g} "
        f"{PARAMETERS[name].unit} to the {name} of {check.bare}, the flights say "
        f"{with_half(float(check.flown[worst]), 1.96 * float(check.std[worst]))}: weigh it and "
        "measure its place from the body origin again, or leave payload_of out"
    )


CHECKS: Final = (known_payloads,)
