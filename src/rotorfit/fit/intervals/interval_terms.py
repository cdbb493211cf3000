"""The contributions to a 95 % interval as data, and the one rule that combines them.

Every step that finds an error appends an `IntervalTerm`; none edits a total. The half-width of a
number is computed from the list by `combined_half_width`:

1. Terms are taken in the order in which they were appended.
2. A term in **quadrature** is independent of all terms before it: h becomes sqrt(h^2 + t^2), the
   law of propagation of uncertainty without covariances (JCGM 100:2008, 5.1.2).
3. A **linear** term is the largest error of a known sign (a low-pass always weakens, errors of a
   velocity always make drag too small): h becomes h + t. Such an error does not average out against
   the others (JCGM 100:2008, F.2.4.5, an uncorrected bias).

Estimates of one and the same error are no list of terms: of the formal deviation and the scatter
between blocks, phases and flights the largest is the term "noise". A step that stretches the whole
half-width h by a factor s appends h sqrt(s^2 - 1), which in quadrature gives h s.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from jaxtyping import Float

Rule = Literal["quadrature", "linear"]
"""How a term joins those before it."""
Remedy = Literal["fly", "measure", "declare", "log", "repair", "none"]
"""What shrinks a term: a flight, a ruler or scale, the motors' law, a log setting, the vehicle."""


@frozen_dataclass
class TermKind:
    """What is known of all interval terms of one name.

    - `remedy`: what shrinks it, and `action` in the words of a pilot; an empty `action` of remedy
      ``fly`` is the manoeuvre that the number itself asks for.
    - `rule`: how it joins the terms before it.
    """

    remedy: Remedy
    action: str = ""
    rule: Rule = "quadrature"


TERM_KINDS: Final[Mapping[str, TermKind]] = {
    "noise": TermKind(remedy="fly"),
    "prior": TermKind(remedy="fly"),
    "autopilot response": TermKind(remedy="fly"),
    "motor lag": TermKind(
        remedy="log", action="log motor commands or rotor speed faster, with the gyro unfiltered"
    ),
    "gusts and drag": TermKind(remedy="fly", action="fly in still air, indoors if possible"),
    "shared by all flights": TermKind(remedy="none", action="nothing: it is the model's own error"),
    "little motion": TermKind(remedy="fly"),
    "air at speed": TermKind(
        remedy="fly", action="fly slower than 5 m/s, for what is not of the air itself"
    ),
    "drag of the frame": TermKind(
        remedy="fly", action="fly at speed with a payload, too, and climb and descend there"
    ),
    "moments of the wakes": TermKind(
        remedy="fly", action="fly faster, to and fro, or slower than 2 m/s"
    ),
    "motor lean": TermKind(remedy="repair", action="mount the motors straight"),
    "IMU size": TermKind(remedy="none", action="nothing: the IMU is no point"),
    "motor tilt": TermKind(remedy="none", action="identify with the default method (banded)"),
    "weight": TermKind(remedy="measure", action="weigh the vehicle on a better scale"),
    "inertia not flown": TermKind(remedy="fly", action="roll and pitch briskly, 20 s each"),
    "little roll and pitch": TermKind(remedy="fly", action="roll and pitch briskly, 20 s each"),
    "yaw scale": TermKind(remedy="fly", action="yaw while rolling: fly 20 s of alternating turns"),
    "frequency range": TermKind(remedy="fly"),
    "arm lengths": TermKind(remedy="measure", action="measure the arms with a ruler or calipers"),
    "IMU position": TermKind(remedy="measure", action="measure the place of the IMU with a ruler"),
    "IMU mounting": TermKind(
        remedy="measure", action="measure how the IMU sits: the board against the motors' plane"
    ),
    "CoM height": TermKind(
        remedy="measure", action="measure the place of the IMU, and log the raw accelerometer"
    ),
    "choice of bands": TermKind(remedy="fly"),
    "thrust by weight": TermKind(
        remedy="fly", action="hover for 10 s, hands off, and climb and sink gently for 20 s"
    ),
    "changing noise": TermKind(remedy="fly", action="fly in calm air, not through your own wash"),
    "motors at their limits": TermKind(remedy="fly", action="fly more gently"),
    "motor law": TermKind(
        remedy="declare", action="log the rotor speed, or measure the motors' law on a stand"
    ),
    "velocity errors": TermKind(
        remedy="log", action="log a velocity by motion capture or RTK GPS", rule="linear"
    ),
    "gyro filter": TermKind(
        remedy="log", action="log the IMU raw, before its low-pass", rule="linear"
    ),
    "gyro scale": TermKind(remedy="measure", action="calibrate the gyro on a turntable"),
    "thrust changes in flight": TermKind(
        remedy="fly", action="fly higher than 2 m, on a fresh battery, without a tether"
    ),
    "late accelerometer": TermKind(
        remedy="log", action="log the accelerometer unfiltered, by the gyro's clock"
    ),
    "sensor response": TermKind(
        remedy="repair", action="mount the IMU stiffly, and log it before its filters"
    ),
    "frame sides": TermKind(
        remedy="measure", action="measure the distances between the motors, front and side"
    ),
    "rotor speed scale": TermKind(
        remedy="repair", action="check the rotor that differs: its propeller, and its speed's scale"
    ),
    "earlier flights": TermKind(remedy="fly"),
    "timing of the motors": TermKind(
        remedy="fly", action="roll briskly: 20 s of quick left-right rolls, one or two a second"
    ),
    "battery sag": TermKind(
        remedy="log", action="log the battery's voltage during a burst of full throttle"
    ),
    "full speed": TermKind(
        remedy="declare", action="log commands and rotor speed up to full throttle"
    ),
}
"""Every interval term by its name. A new term needs its row here and a step that appends it."""


@frozen_dataclass
class IntervalTerm:
    """One contribution to the 95 % intervals of a fit.

    - `name`: a key of `TERM_KINDS`.
    - `half_width`: of each number, in its unit; 0 if it does not apply.
    - `source`: what measured it.
    """

    name: str
    half_width: Float[np.ndarray, " q"]
    source: str


@frozen_dataclass
class NumberTerm:
    """One contribution to the 95 % interval of one number.

    - `name`: of the contribution: ``noise``, ``motor lag``, ``arm lengths`` ...
    - `half_width`: in the unit of the number.
    - `source`: what measured it: the scatter of blocks, a declared tolerance ...
    """

    name: str
    half_width: float
    source: str


def combined_half_width(terms: Iterable[IntervalTerm], count: int) -> Float[np.ndarray, " q"]:
    """Combine the interval terms of `count` numbers by the rule of this module."""
    half = np.zeros(count)
    for term in terms:
        half = joined(half, term.half_width, TERM_KINDS[term.name].rule)
    return half


def half_width_of_number(terms: Iterable[NumberTerm]) -> float:
    """Combine the interval terms of one number by the rule of this module."""
    half = np.zeros(1)
    for term in terms:
        # A name that a later version wrote adds in quadrature, as nearly all do.
        kind = TERM_KINDS.get(term.name)
        rule: Rule = "quadrature" if kind is None else kind.rule
        half = joined(half, np.array([term.half_width]), rule)
    return float(half[0])


def joined(
    half: Float[np.ndarray, " q"], term: Float[np.ndarray, " q"], rule: Rule
) -> Float[np.ndarray, " q"]:
    """Add one term to the half-widths by the terms before it."""
    return half + term if rule == "linear" else np.hypot(half, term)


def stretch_term(
    half: Float[np.ndarray, " q"], factor: Float[np.ndarray, " q"]
) -> Float[np.ndarray, " q"]:
    """Compute the term in quadrature that stretches half-widths by factors of at least 1."""
    term = np.where(np.isinf(factor), np.inf, 0.0)
    grows = (factor > 1.0) & np.isfinite(factor)
    s = factor[grows]
    # (s - 1) (s + 1) keeps the digits of s^2 - 1 where s is near 1.
    term[grows] = half[grows] * np.sqrt((s - 1.0) * (s + 1.0))
    return term


def terms_of_number(terms: Iterable[IntervalTerm], place: int) -> tuple[NumberTerm, ...]:
    """Select the terms of the number at a place, those that contribute nothing left out."""
    return tuple(
        NumberTerm(name=term.name, half_width=float(term.half_width[place]), source=term.source)
        for term in terms
        if term.half_width[place] != 0.0
    )


def scale_terms(terms: Iterable[NumberTerm], factor: float) -> tuple[NumberTerm, ...]:
    """Scale the terms of a number to those of another in proportion to it, and its half-width."""
    return tuple(
        NumberTerm(name=t.name, half_width=factor * t.half_width, source=t.source) for t in terms
    )
