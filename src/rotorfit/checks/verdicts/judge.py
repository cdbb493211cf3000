"""Judge the numbers of a result: how well each is known, why not better, and what to fly next."""

from __future__ import annotations

from dataclasses import replace
from math import floor, inf, isfinite
from typing import TYPE_CHECKING, Final, Literal

from rotorfit.fit.intervals.numbers import LEAST_EXCITATION, moments_of_product
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import COM, EVERY, INERTIA_COM
from rotorfit.model.terms.body import product_scale
from rotorfit.model.terms.rotors import MOST_ROTORS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rotorfit.fit.intervals.interval_terms import NumberTerm
    from rotorfit.model.terms.term import Motion
    from rotorfit.simulation.pilot import Manoeuvre

Asks = Literal["flight", "nothing", "other"]
"""What an advice comes to: a manoeuvre, no manoeuvre that would help, or other things first."""
Verdict = Literal[
    "identified", "weak", "doubtful", "ratio-only", "not-identified", "given", "removed"
]


@frozen_dataclass
class Parameter:
    """One parameter of the model, with its estimate, verdict and advice.

    Attributes
    ----------
    name, configuration, unit
        `configuration` is None for what all configurations share.
    value, std, interval
        SI; None if the flight does not give them. The interval is 95 %.
    verdict
        ``identified``, ``weak`` (interval wide), ``doubtful`` (may be outside its interval, as a
        finding says), ``ratio-only`` (only together with the parameter `partner`),
        ``not-identified``, ``given``, ``removed`` (an unessential parameter).
    partner
        Named under ``with`` in the file.
    reason, advice
        Why the verdict is not better, and what to fly or measure next.
    asks
        What the advice comes to: a ``flight`` that a plan simulates, ``nothing`` (no such flight
        helps), or ``other`` things first; None without advice, and in older results.
    interval_terms
        What makes up the interval, in the order in which `combined_half_width` combines it to half
        of the interval; empty without an interval, and in older results.
    """

    name: str
    configuration: str | None
    value: float | None
    std: float | None
    interval: tuple[float, float] | None
    unit: str
    verdict: Verdict
    partner: str | None = None
    reason: str | None = None
    advice: str | None = None
    asks: Asks | None = None
    interval_terms: tuple[NumberTerm, ...] = ()

    @property
    def full_name(self) -> str:
        """Its name among those of all configurations, such as ``Ixx@A``."""
        return f"{self.name}@{self.configuration}" if self.configuration else self.name


@frozen_dataclass
class Derived:
    """A number computed from the parameters.

    Attributes
    ----------
    name, configuration, unit
        `configuration` is None for what all configurations share.
    value, std, interval
        SI; None if the parameters do not give it. The interval is 95 %.
    verdict, reason, interval_terms
        As of a `Parameter`; doubtful where a number is that it depends on.
    """

    name: str
    configuration: str | None
    value: float | None
    std: float | None
    interval: tuple[float, float] | None
    unit: str
    verdict: Verdict | None = None
    reason: str | None = None
    interval_terms: tuple[NumberTerm, ...] = ()

    @property
    def full_name(self) -> str:
        """Its name among those of all configurations, such as ``com_x@A``."""
        return f"{self.name}@{self.configuration}" if self.configuration else self.name


WEAK = 0.25
"""Half-width of the interval, relative to value or scale, over which a parameter is weak."""
HOPELESS = 1.0
"""The same, over which it is not identified."""
HOPELESS_YAW = 0.5
"""The same where little but disturbances moves yaw: their bias is one-sided."""

FLOWN: Final[Mapping[Manoeuvre, str]] = {
    "hover": "hover, hands off",
    "roll": "roll briskly: 20 s of quick left-right rolls, one or two a second",
    "pitch": "pitch briskly: 20 s of quick nods forward and back, one or two a second",
    "yaw": "yaw left and right, 20 s",
    "climb": "climb and sink: 20 s of gentle thrust steps",
    "sticks": "move all sticks at once, 20 s",
    "doublets": "kick and counter-kick roll, pitch and yaw, with pauses, 20 s",
    "wiggles": "wiggle roll and pitch quickly, once or twice a second, in slow turns, for 20 s",
    "turns": "yaw while rolling: fly 20 s of alternating turns",
}
"""What a pilot is asked to fly, in the words of results and of plans."""

ADVISED: Final[Mapping[str, Manoeuvre]] = {
    "roll": "roll",
    "pitch": "pitch",
    "yaw": "turns",
    "force": "climb",
    "place": "turns",
    "height": "wiggles",
}
"""The manoeuvre that shows most of a motion."""

ADVICE: Final[Mapping[str, str]] = {
    **{motion: FLOWN[manoeuvre] for motion, manoeuvre in ADVISED.items()},
    "air": "fly fast to and fro along every axis, 20 s",
    "scale": "measure Izz (bifilar pendulum), or identify with method banded: the yaw equation "
    "alone gives only ratios",
}


@frozen_dataclass
class Judgement:
    """A verdict with its reason and advice, and what that asks for."""

    verdict: Verdict
    reason: str | None = None
    advice: str | None = None
    asks: Asks | None = None


def motion_for(name: str) -> Motion:
    """Return the motion that determines a number: a key of `ADVICE`."""
    return EVERY[name].motion if name in EVERY else "force"


def little_excited(axes: str, rho: float) -> str:
    """Explain a number by too little motion about axes that the motors explain."""
    return f"the motors explain too little of the motion in {axes} ({ratio_words(rho)})"


def ratio_words(rho: float) -> str:
    """Write a ratio that is too small, rounded down, with the ratio that is needed."""
    shown = "under 0.1" if rho < 0.1 else f"{floor(10.0 * rho) / 10.0:.1f}"
    return f"signal-to-noise {shown}, need {LEAST_EXCITATION:.0f}"


def judge(
    value: float,
    half_width: float,
    *,
    scale: float,
    axis: str,
    excitation: float | None = None,
) -> Judgement:
    """Judge one number: its verdict, reason and advice.

    One of yaw is refused sooner below `LEAST_EXCITATION`: yaw is what the rotors move least, and
    there the autopilot's response to disturbances biases its ratios to zero.

    Parameters
    ----------
    value, half_width
        The estimate and half of its 95 % interval, in one unit.
    scale
        A size of the number that matters even where the number itself is near zero.
    axis
        Which motion determines it: a key of `ADVICE`.
    excitation
        rho of that axis; None if it does not apply.
    """
    size = max(abs(value), scale)
    relative = half_width / size if size > 0.0 else inf
    if relative <= WEAK:
        return Judgement(verdict="identified")
    little = excitation is not None and excitation < LEAST_EXCITATION
    hopeless = not relative <= (HOPELESS_YAW if little and axis == "yaw" else HOPELESS)
    reason = _width_words(relative, small=abs(value) < scale)
    if hopeless:
        reason = "these flights do not tell it from zero"
    if little:
        reason = little_excited(axis, excitation or 0.0)
    return Judgement(
        verdict="not-identified" if hopeless else "weak",
        reason=reason,
        advice=ADVICE[axis],
        asks=_what_motion_asks(axis),
    )


def _what_motion_asks(motion: str) -> Asks:
    return "flight" if motion in ADVISED else "other"


WIDTHS: Final = ("known only to", "near zero, and known")


def _width_words(relative: float, *, small: bool) -> str:
    """State how wide an interval is, of a `small` number over what matters."""
    if small:
        times = f"{relative / WEAK:.1f}"
        wide = "a little" if times == "1.0" else f"{times} times"
        return f"near zero, and known {wide} less well than wanted"
    return f"known only to +-{100 * relative:.0f} %"


def is_width(reason: str | None) -> bool:
    """Return whether a reason of `judge` says no more than the interval does."""
    return reason is not None and reason.startswith(WIDTHS)


def twin_of(name: str) -> str:
    """Return the parameter at the origin whose verdict speaks for a number about the CoM."""
    return name.replace("com_", "ms") if name.startswith("com_") else name.removesuffix("_com")


def body_verdict(
    derived: Derived, twin: Parameter | None, kin: Mapping[str, Derived] | None = None
) -> Verdict:
    """Judge a number about the CoM: by its own interval, else its twin's.

    `twin`: the parameter at the origin, by `twin_of`; None if the result has none. `kin`: all
    derived numbers of its body by name, by which products of inertia are measured.
    """
    verdict = None if twin is None else twin.verdict
    if _finite_or_none(derived.value) is None:
        return verdict if verdict in ("ratio-only", "removed") else "not-identified"
    if verdict == "doubtful":
        return verdict
    relative = relative_width(derived, kin or {})
    if relative is None or verdict == "given":
        return verdict if verdict in ("weak", "given") else "identified"
    if relative <= WEAK:
        return "identified"
    # Where a moment is not known, the estimate had a better idea of what matters than the value.
    measured = twin is not None and _inertia_size(derived, kin or {}) is None
    return "identified" if measured and verdict == "identified" else "weak"


def body_reason(
    derived: Derived, verdict: Verdict, twin: Parameter | None, kin: Mapping[str, Derived]
) -> str | None:
    """Explain why a number about the CoM has its verdict: by its own width, else as its twin."""
    if twin is None or verdict == "identified":
        return None
    relative = relative_width(derived, kin) if verdict == "weak" else None
    if relative is None or (twin.verdict == "weak" and not is_width(twin.reason)):
        return twin.reason
    small = abs(_finite_or_none(derived.value) or 0.0) < (_inertia_size(derived, kin) or 0.0)
    return _width_words(relative, small=small)


def body_advice(name: str, verdict: Verdict, twin: Parameter) -> str | None:
    """State what to do for a number about the CoM: as for its twin, else by its motion."""
    # What was simulated for the vehicle is kept with the twin, whatever the twin's own verdict.
    return ADVICE[motion_for(name)] if _is_own(verdict, twin) else twin.advice


def body_asks(name: str, verdict: Verdict, twin: Parameter) -> Asks | None:
    """State what `body_advice` asks for."""
    return _what_motion_asks(motion_for(name)) if _is_own(verdict, twin) else twin.asks


def _is_own(verdict: Verdict, twin: Parameter) -> bool:
    return verdict != twin.verdict and twin.advice is None


DEPENDS: Final[Mapping[str, tuple[str, ...]]] = {
    "hover_speed": ("kt",),
    "kd_over_kt": ("kd", "kt"),
    **{f"{name}_over_kt": (name, "kt") for name in ("Ixx", "Iyy", "Izz")},
    "max_thrust": ("kt", "max_speed"),
    "thrust_to_weight": ("kt", "max_speed"),
    "max_thrust_loaded": ("kt", "max_speed"),
    "thrust_to_weight_loaded": ("kt", "max_speed"),
    "hover_throttle": ("kt", "max_speed"),
    "motor_imbalance": tuple(f"kt_{i}" for i in range(1, MOST_ROTORS + 1)),
}
"""Parameters whose doubts a derived number shares. Ratios to Izz and lag plus delay are known
better than their parts: they have the doubts of findings about them."""


def judged_derived(
    parameters: Sequence[Parameter], derived: Sequence[Derived]
) -> tuple[Derived, ...]:
    """Judge derived numbers by their intervals, and by the verdicts of what they depend on."""
    return tuple(
        _about_com(d, parameters, derived)
        if d.name in (*COM, *INERTIA_COM)
        else _of_parts(d, parameters)
        for d in derived
    )


def _about_com(
    number: Derived, parameters: Sequence[Parameter], derived: Sequence[Derived]
) -> Derived:
    twins = (p for p in parameters if p.configuration == number.configuration)
    twin = next((p for p in twins if p.name == twin_of(number.name)), None)
    kin = {d.name: d for d in derived if d.configuration == number.configuration}
    verdict = body_verdict(number, twin, kin)
    return replace(number, verdict=verdict, reason=body_reason(number, verdict, twin, kin))


def _of_parts(number: Derived, parameters: Sequence[Parameter]) -> Derived:
    value, names = _finite_or_none(number.value), DEPENDS.get(number.name, ())
    if value is None:
        return replace(number, verdict="not-identified")
    parts = [
        p for p in parameters if p.name in names and p.configuration in (None, number.configuration)
    ]
    for verdict in ("not-identified", "doubtful"):
        worse = next((p for p in parts if p.verdict == verdict), None)
        if worse is not None:
            return replace(number, verdict=verdict, reason=worse.reason)
    low, high = number.interval or (value, value)
    wide = high - low > 2.0 * WEAK * abs(value)
    return replace(number, verdict=number.verdict or ("weak" if wide else "identified"))


def relative_width(derived: Derived, kin: Mapping[str, Derived]) -> float | None:
    """Return the half-width of an inertia about the CoM over its relevant size.

    None where only the twin's verdict counts. See `body_verdict`.
    """
    value, interval = _finite_or_none(derived.value), derived.interval
    if value is None or interval is None or derived.name not in INERTIA_COM:
        return None
    size = max(abs(value), _inertia_size(derived, kin) or 0.0)
    return 0.5 * (interval[1] - interval[0]) / size if size else None


def _inertia_size(derived: Derived, kin: Mapping[str, Derived]) -> float | None:
    """Return the size of an inertia that matters; None for a product without its two moments."""
    if derived.name in INERTIA_COM[:3]:
        return 0.0
    moments = [kin.get(f"{name}_com") for name in moments_of_product(derived.name)]
    known = [
        value for d in moments if d is not None and (value := _finite_or_none(d.value)) is not None
    ]
    return product_scale(known[0], known[1]) if len(known) == 2 else None


def _finite_or_none(number: float | None) -> float | None:
    return number if number is not None and isfinite(number) else None
