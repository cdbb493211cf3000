"""State which law from command to rotor speed was taken, and what it leaves open.

The steps of `fit/motors/` find the law and widen the intervals by it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rotorfit.checks.verdicts.judge import WEAK
from rotorfit.digits import short, with_half
from rotorfit.findings import Evidence, Finding, note
from rotorfit.fit.motors.commanded_speeds import LawError, speed_powers
from rotorfit.fit.motors.law_from_thrust import STATED_STD, LawFromThrust
from rotorfit.fit.timing.timed_fit import LEAST_GAIN
from rotorfit.model.parameters import EVERY

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rotorfit.fit.fit import Fit
    from rotorfit.fit.intervals.numbers import Numbers

FOUND: Final = "law-found"
STATED: Final = "law-stated"
CONTRADICTED: Final = "law-contradicted"
AGAIN: Final = "measure the law under [motors] again, or log the rotor speed"
OF_SPEED: Final = tuple(name for name, info in EVERY.items() if info.speed_power)
"""What goes with speeds in rad/s: a law with a wrong slope does not give them."""
OF_STATED: Final = (
    *OF_SPEED,
    *("thrust_to_weight", "max_thrust", "thrust_to_weight_loaded", "max_thrust_loaded"),
    *("Ixx", "Iyy", "Izz", "Ixx_com", "Iyy_com", "Izz_com"),
)
"""What rests on the growth of thrust with the command."""
WRONG_SPEEDS: Final = "the motors' law is wrong, and no one knows the rotor speed in hover"
WRONG_SETTINGS: Final = "the flight contradicts the settings for the motors' law"
FARTHEST: Final = 2.0
"""Largest factor between the growth of thrust that settings state and that of a flight: between
thrust in proportion to the command and to its square."""
SETTLE: Final = (
    "hover with a known payload, too (a second configuration), or measure thrust over command on a "
    "stand and give law under [motors]"
)
GIVE: Final = "log the rotor speed, or measure thrust over command and give law under [motors]"
LAW_OPEN = "law-open"
LAW_FIRST = "find the motors' law first (by a thrust stand, or by rotor speed in the log)"
LAW: Final = "law-uncertain"
LAG_ON_THRUST: Final = "lag-on-thrust"


def law_by_flight(fit: Fit) -> Iterator[Finding]:
    """State which law was taken, where the flight or the firmware gives it."""
    law = fit.record_of(LawFromThrust)
    if law is not None and (law.from_flight or law.is_stated):
        yield law_finding(law)


def law_finding(law: LawFromThrust) -> Finding:
    """State which law was taken, and from where."""
    if law.is_stated:
        return _stated_law(law)
    return _contradicted_law(law) if law.given is not None else _missing_law(law)


def _contradicted_law(law: LawFromThrust) -> Finding:
    """State by how much a law that is given is wrong."""
    off = law.exponent.value - 1.0
    surely = abs(off) > 1.96 * law.exponent.std
    speeds_lost = surely and law.given is not None and not law.given.is_relative
    return Finding(
        kind=CONTRADICTED,
        severity="doubt" if surely else "note",
        sentence=(
            "weight and changes of thrust show that thrust grows "
            f"{with_half(100 * abs(off), 196 * law.exponent.std)} % "
            f"{'less' if off < 0 else 'more'} with the command than the motors' law says: "
            "thrust is taken as the flight shows it, and the intervals cover what that leaves "
            f"open, up to full command; for narrower ones {AGAIN}"
        ),
        numbers=OF_SPEED if speeds_lost else (),
        doubtful_because=WRONG_SPEEDS if speeds_lost else None,
        next_step=AGAIN,
        evidence=_law_evidence(law),
    )


def _stated_law(law: LawFromThrust) -> Finding:
    """State how far settings of the firmware leave the thrust at full command open."""
    shown = "the flight does not show whether they are right"
    if not 1.0 / FARTHEST < law.exponent.value < FARTHEST:
        return _absurd_law(law)
    if law.from_flight:
        off, half = law.exponent.value - 1.0, 196.0 * law.exponent.std
        way = "less" if off < 0.0 else "more"
        shown = f"in this flight thrust grows {with_half(100.0 * abs(off), half)} % {way}"
    elif law.exponent.std < 0.5 * STATED_STD:
        shown = "the flight agrees with them about hover"
    return Finding(
        kind=STATED,
        severity="note",
        sentence=stated_sentence(law.setting, 1.96 * law.thrust_std, shown=shown),
        numbers=("thrust_to_weight", "max_thrust"),
        next_step=SETTLE,
        evidence=_law_evidence(law),
    )


def _absurd_law(law: LawFromThrust) -> Finding:
    """State that no motors differ from the settings as much as the flight seems to."""
    off = law.exponent.value - 1.0
    return Finding(
        kind=CONTRADICTED,
        severity="doubt",
        sentence=(
            f"thrust seems to grow {100.0 * abs(off):.0f} % {'less' if off < 0.0 else 'more'} with "
            f"the command than the settings say ({law.setting}), more than motors ever differ from "
            "them: the settings are not those of this flight, or a sensor or the commands are "
            f"wrong; do not trust what rests on thrust before this is found. To settle it, {SETTLE}"
        ),
        numbers=OF_STATED,
        doubtful_because=WRONG_SETTINGS,
        next_step=SETTLE,
        evidence=_law_evidence(law),
    )


def _missing_law(law: LawFromThrust) -> Finding:
    power, half = 2.0 * law.exponent.value, 2.0 * 1.96 * law.exponent.std
    shown = (
        "this flight does not show it either: as motors usually do, thrust is taken to grow"
        if law.flown is None
        else "weight and changes of thrust show that thrust grows"
    )
    return Finding(
        kind=FOUND,
        severity="note",
        sentence=(
            f"no law from command to rotor speed is given; {shown} with the command to the "
            f"power of {with_half(power, half)} (2: speed in proportion to the command). "
            f"The intervals cover what that leaves open; for narrower ones {GIVE}"
        ),
        next_step=GIVE,
        evidence=_law_evidence(law),
    )


def _law_evidence(law: LawFromThrust) -> tuple[Evidence, ...]:
    numbers = {"law_exponent": law.exponent, "law_exponent_flown": law.flown}
    return tuple(
        Evidence(name=name, value=one.value, interval=one.interval)
        for name, one in numbers.items()
        if one is not None
    )


def stated_sentence(setting: str, half_width: float, *, shown: str) -> str:
    """State that thrust over command is by settings, and what they leave open, as a share."""
    return (
        f"full thrust and thrust to weight are open by {100.0 * half_width:.0f} %: they rest on "
        f"settings that are seldom measured ({setting}), and {shown}. To settle it, {SETTLE}"
    )


def uncertain_law(fit: Fit) -> Iterator[Finding]:
    """Note what a law that is given leaves open of the numbers."""
    found, law = fit.record_of(LawError), fit.dataset.motors.law
    if found is None or law is None:
        return
    if not fit.dataset.law_found and not law.stated:
        yield from _note_law_uncertainty(fit.numbers, found.speed_std)
    yield from open_law(found.widths, found.reach)


def _note_law_uncertainty(numbers: Numbers, std: float) -> Iterator[Finding]:
    """Explain the uncertainty of the law's speeds."""
    if not std:
        return
    yield Finding(
        kind=LAW,
        severity="note",
        sentence=(
            f"the law under [motors] gives the rotor speeds to +-{short(196 * std)} %: the "
            "interval of Jr includes as much, those of kt and kd twice as much; log the rotor "
            "speed, or the battery's voltage, for a law that depends on it"
        ),
        numbers=tuple(
            name for name, power in zip(numbers.names, speed_powers(numbers), strict=True) if power
        ),
        evidence=(Evidence(name="law_speed_std", value=std),),
    )


def open_law(widths: Mapping[str, float], reach: float) -> Iterator[Finding]:
    """Note of which inertia the law leaves more open than all else does: no flying sharpens it.

    `widths`: half-width of each moment, `reach`: half of the 95 % interval that the law leaves, as
    shares.
    """
    open_ones = [name for name, width in widths.items() if law_decides(reach, width)]
    if open_ones:
        because = f"the law from command to rotor speed leaves {100 * reach:.0f} % of it open"
        yield note(
            LAW_OPEN, "", numbers=tuple(open_ones), next_step=LAW_FIRST, useless_because=because
        )


def law_decides(reach: float, width: float) -> bool:
    """Test whether what the law leaves open is the larger part of a half-width, both as shares."""
    # Or the law makes the number weak by itself, however it is flown.
    return reach > WEAK or reach**2 > 0.5 * width**2


def lag_on_thrust(fit: Fit) -> Iterator[Finding]:
    """State that the motors' lag acts on their thrust, where the flights have shown it."""
    gain = fit.dataset.lag_gain
    if gain > 0.0:
        yield note(
            LAG_ON_THRUST,
            "the flight shows that the motors' lag acts on their thrust, as in many simulators, "
            'and not on their speed; if you know better, set lag_on = "speed" under [motors]',
            evidence=(Evidence(name="lag_on_thrust_gain", value=gain, limit=LEAST_GAIN),),
        )


FLIGHT_CHECKS: Final = (law_by_flight,)
CHECKS: Final = (uncertain_law, lag_on_thrust)
