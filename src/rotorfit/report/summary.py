"""The top of the page: what is known and what is not, in plain sentences."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from rotorfit.formatting.digits import known, number_of
from rotorfit.report.number_words import (
    VERDICT_MEANING,
    half_width,
    percent,
    percent_words,
    title_of,
    unit_words,
)
from rotorfit.results.result import Derived, IdentificationResult, Parameter, configuration_names
from rotorfit.results.verdicts import WEAK, body_verdict, twin_of

SUBJECTS = {
    "kt": "thrust coefficient",
    "kd": "drag torque coefficient",
    "Jr": "rotor inertia",
    "motor_lag": "motor lag",
    "motor_delay": "motor delay",
    "Ixx_com": "roll inertia",
    "Iyy_com": "pitch inertia",
    "Izz_com": "yaw inertia",
    "Ixx": "roll inertia",
    "Iyy": "pitch inertia",
    "Izz": "yaw inertia",
    "mass": "mass",
}
DIRECTIONS = {
    "com_x": ("in front of", "behind"),
    "com_y": ("left of", "right of"),
    "com_z": ("above", "below"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One sentence: a subject, what is known of it, and what to do where it is not."""

    verdict: str
    subject: str
    words: str
    advice: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """Findings on the rotors and on each configuration, and how many verdicts of each kind."""

    groups: tuple[tuple[str, tuple[Finding, ...]], ...]
    counts: tuple[tuple[str, int, str], ...]


def summary_of(result: IdentificationResult) -> Summary:
    """Summarise a result in plain sentences."""
    shared = [p for p in result.parameters if p.configuration is None]
    # The paper's sigmas do not hold: what is said to be known is said to be so by its formula.
    source = ", by the paper's formula" if result.method == "tls" else ""
    groups = [("Rotors", _merged(_of_rotors(shared, result.derived)))]
    names = configuration_names(result)
    for name in names:
        title = "Body" if len(names) == 1 else f"Body, configuration {name}"
        groups.append((title, _merged(_body(result, name))))
    verdicts = [p.verdict for p in result.parameters]
    counts = tuple(
        (word, verdicts.count(word), meaning)
        for word, meaning in VERDICT_MEANING.items()
        if word in verdicts
    )
    return Summary(
        groups=tuple((title, _sourced(found, source)) for title, found in groups if found),
        counts=counts,
    )


def _sourced(findings: tuple[Finding, ...], source: str) -> tuple[Finding, ...]:
    """Add to the findings whose formula made their percentages."""
    return tuple(
        replace(f, words=f.words + source) if f.verdict in ("identified", "weak") else f
        for f in findings
    )


def _of_rotors(shared: list[Parameter], derived: Sequence[Derived]) -> list[Finding]:
    """Describe the rotors; single ones together where all are known."""
    single = [p for p in shared if p.name.startswith("kt_") and p.verdict == "identified"]
    shares = [share for p in single if (share := percent(p)) is not None]
    if len(shares) < 2:
        return [_finding(p, p, derived) for p in shared]
    each = Finding(
        verdict="identified",
        subject="Each rotor's own thrust",
        words=f"{', '.join(_number(p) for p in single)}: "
        f"known to {percent_words(max(shares))} or better",
    )
    findings = [_finding(p, p, derived) for p in shared if p not in single]
    return [*findings[:1], each, *findings[1:]]


def _merged(findings: list[Finding]) -> tuple[Finding, ...]:
    """Join findings that say and advise the same."""
    groups: dict[tuple[str, str, str | None], list[str]] = {}
    for i, f in enumerate(findings):
        key = (f.verdict, f.words if f.advice else f"{f.words}\0{i}", f.advice)
        groups.setdefault(key, []).append(f.subject)
    return tuple(
        Finding(
            verdict=verdict,
            subject=" and ".join([names[0], *(n[0].lower() + n[1:] for n in names[1:])]),
            words=words.split("\0")[0],
            advice=advice,
        )
        for (verdict, words, advice), names in groups.items()
    )


def _body(result: IdentificationResult, configuration: str) -> list[Finding]:
    parameters = {p.name: p for p in result.parameters if p.configuration == configuration}
    derived = {d.name: d for d in result.derived if d.configuration == configuration}
    findings = [_finding(p, p) for n, p in parameters.items() if n == "mass"]
    if all(name in derived for name in DIRECTIONS):
        findings.append(_com(derived, parameters))
    for name in ("Ixx_com", "Iyy_com", "Izz_com"):
        twin = parameters.get(twin_of(name))
        if twin is not None:
            findings.append(_finding(derived.get(name, twin), twin))
    return findings


def _finding(
    number: Parameter | Derived, twin: Parameter, ratios: Sequence[Derived] = ()
) -> Finding:
    """Describe one number; `twin` is the parameter with its verdict, `ratios` are derived."""
    verdict = body_verdict(number, twin) if isinstance(number, Derived) else twin.verdict
    subject = SUBJECTS.get(number.name, title_of(number.name))
    return Finding(
        verdict=verdict,
        subject=subject[0].upper() + subject[1:],
        words=_words(number, verdict, twin, ratios),
        advice=None if verdict in ("identified", "given", "removed") else twin.advice,
    )


def _words(
    number: Parameter | Derived, verdict: str, twin: Parameter, ratios: Sequence[Derived]
) -> str:
    if verdict == "given":
        return f"given, {_number(number)}"
    if verdict == "ratio-only":
        other = SUBJECTS.get(twin.partner or "", title_of(twin.partner or "other parameters"))
        return f"known only as a ratio to the {other}{_ratio(twin, ratios)}"
    if verdict == "removed":
        return "left out as unessential"
    if verdict not in ("identified", "weak", "doubtful"):
        return "not known"
    share, shown = percent(number), _number(number)
    if share is None:
        return shown
    if verdict == "doubtful":
        return f"{shown}, which {twin.reason}" if twin.reason else shown
    narrow = share <= 100.0 * WEAK
    if verdict == "weak" and narrow and number is twin and twin.reason:
        return f"{shown}: {twin.reason}"
    if verdict == "weak" and share <= 100.0:
        return f"{shown}: known only to {percent_words(share)}"
    # Judged by a size that matters, not by its value: no percentage of that.
    return f"{shown}: known to {percent_words(share)}" if narrow else shown


def _number(number: Parameter | Derived) -> str:
    shown = number_of(number.value, number.interval)
    return f"{shown or ''} {unit_words(number.unit)}".strip()


def _ratio(number: Parameter, ratios: Sequence[Derived]) -> str:
    """Write the ratio itself, of each configuration that has one."""
    name = f"{number.name}_over_{number.partner}"
    found = [d for d in ratios if d.name == name and known(d.value) is not None]
    values = [_number(d) + (f" ({d.configuration})" if len(found) > 1 else "") for d in found]
    return f": {', '.join(values)}" if values else ""


def _com(derived: dict[str, Derived], parameters: dict[str, Parameter]) -> Finding:
    """Describe where the centre of mass is, in millimetres and directions."""
    verdicts = [body_verdict(derived[n], parameters.get(twin_of(n))) for n in DIRECTIONS]
    origin = "IMU" if "rotor_center_x" in parameters else "origin"
    words: list[str] = []
    for name, (positive, negative) in DIRECTIONS.items():
        value, half = known(derived[name].value), half_width(derived[name])
        if value is None:
            words.append(f"not known how far {positive} or {negative}")
        else:
            margin = "" if half is None else f" ± {_mm(half)}"
            words.append(f"{_mm(abs(value))}{margin} mm {positive if value >= 0 else negative}")
    order = (
        *("not-identified", "ratio-only", "removed"),
        *("doubtful", "weak", "identified", "given"),
    )
    worst = min(verdicts, key=order.index)
    advice = [
        p.advice for n in DIRECTIONS if (p := parameters.get(twin_of(n))) is not None and p.advice
    ]
    return Finding(
        verdict=worst,
        subject="Centre of mass",
        words=f"{', '.join(words)} the {origin}",
        advice="; ".join(dict.fromkeys(advice)) if worst != "identified" and advice else None,
    )


def _mm(metres: float) -> str:
    return f"{1e3 * metres:.1f}"
