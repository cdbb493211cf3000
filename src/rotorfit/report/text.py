"""A result on one screen: what is known, how well, and what to do about the rest."""

import math

from rotorfit.identification.result import Derived, IdentificationResult, Parameter

ROTOR_PARAMETERS = ("kt", "kd", "Jr", "motor_lag", "motor_delay")
ROTOR_DERIVED = ("kd_over_kt", "kd_over_Izz", "Jr_over_Izz", "hover_speed")
BODY_DERIVED = (
    *("com_x", "com_y", "com_z"),
    *("Ixx_com", "Iyy_com", "Izz_com", "Ixy_com", "Ixz_com", "Iyz_com"),
)
BODY_PARAMETERS = ("mass",)
PAPER_BODY = ("msx", "msy", "msz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
WIDTH = 100


def result_text(result: IdentificationResult) -> str:
    """Return a result as text for a terminal."""
    lines = [_title(result), ""]
    lines += ["Rotors", *_rotor_lines(result), ""]
    for configuration in _configurations(result):
        lines += [f"Body, configuration {configuration}", *_body_lines(result, configuration), ""]
    doubts = _doubts(result)
    if doubts:
        lines += ["To know", *doubts]
    return "\n".join(lines).rstrip() + "\n"


def _title(result: IdentificationResult) -> str:
    seconds = sum(flight.seconds_used for flight in result.flights)
    count = len(result.flights)
    flights = "1 flight" if count == 1 else f"{count} flights"
    return f"{result.name}: {flights}, {seconds:.1f} s in the air, method {result.method}"


def _configurations(result: IdentificationResult) -> list[str]:
    names = [p.configuration for p in result.parameters if p.configuration is not None]
    return list(dict.fromkeys(names))


def _rotor_lines(result: IdentificationResult) -> list[str]:
    parameters = [p for p in result.parameters if p.name in ROTOR_PARAMETERS]
    derived = [d for d in result.derived if d.name in ROTOR_DERIVED and d.value is not None]
    return [_line(p, p.verdict, _partner(p)) for p in parameters] + [
        _line(d, "", "") for d in derived
    ]


def _body_lines(result: IdentificationResult, configuration: str) -> list[str]:
    parameters = {p.name: p for p in result.parameters if p.configuration == configuration}
    derived = {d.name: d for d in result.derived if d.configuration == configuration}
    lines = [_line(parameters[n], parameters[n].verdict, "") for n in BODY_PARAMETERS]
    if not derived:
        return lines + [
            _line(parameters[n], parameters[n].verdict, "") for n in PAPER_BODY if n in parameters
        ]
    for name in BODY_DERIVED:
        twin = parameters.get(_twin(name))
        verdict = "" if twin is None else twin.verdict
        shown = verdict if derived[name].value is None or verdict == "weak" else "identified"
        lines.append(_line(derived[name], shown, "" if twin is None else _partner(twin)))
    return lines


def _twin(derived: str) -> str:
    """Return the parameter whose verdict speaks for a derived number."""
    return derived.replace("com_", "ms") if derived.startswith("com_") else derived[:-4]


def _partner(parameter: Parameter) -> str:
    return f" with {parameter.partner}" if parameter.partner else ""


def _line(number: Parameter | Derived, verdict: str, tail: str) -> str:
    shown = with_interval(number.value, number.interval)
    unit = "" if number.unit == "1" else number.unit
    return f"  {number.name:<15} {shown:>24}  {unit:<14} {verdict}{tail}".rstrip()


def with_interval(value: float | None, interval: tuple[float, float] | None) -> str:
    """Return a value and half of its interval, digits cut to two of the half-width.

    Examples
    --------
    >>> with_interval(2.656e-7, (2.604e-7, 2.708e-7))
    '(2.656 +- 0.052)e-07'
    """
    if value is None:
        return "-"
    if interval is None:
        return f"{value:.6g}"
    half = 0.5 * (interval[1] - interval[0])
    largest = max(abs(value), half)
    if largest == 0:
        return "0"
    exponent = math.floor(math.log10(largest))
    plain = -3 <= exponent <= 4
    scale = 1.0 if plain else 10.0**exponent
    digits = _digits(half / scale) if half > 0 else 6
    body = f"{value / scale:.{digits}f} +- {half / scale:.{digits}f}"
    return body if plain else f"({body})e{exponent:+03d}"


def _digits(half: float) -> int:
    """Return the decimals that show two digits of a half-width."""
    return min(max(1 - math.floor(math.log10(half)), 0), 12)


def _doubts(result: IdentificationResult) -> list[str]:
    """Return reasons, advice and warnings, each once, wrapped."""
    words: list[str] = []
    for advice, names in _by_advice(result).items():
        words.append(f"{', '.join(names)}: {advice}")
    words += result.warnings
    for flight in result.flights:
        name = flight.file.replace("\\", "/").rsplit("/", maxsplit=1)[-1]
        words += [f"{name}: {doubt}" for doubt in flight.warnings]
    return [line for text in dict.fromkeys(words) for line in _wrapped(text)]


def _by_advice(result: IdentificationResult) -> dict[str, list[str]]:
    """Return the parameters that are not well known, by what to do about them."""
    groups: dict[str, list[str]] = {}
    for p in result.parameters:
        if p.advice is not None and p.verdict in ("ratio-only", "not-identified"):
            reason = f"{p.reason}; " if p.reason else ""
            groups.setdefault(f"{reason}{p.advice}", []).append(p.name)
    return groups


def _wrapped(text: str) -> list[str]:
    import textwrap

    return textwrap.wrap(text, WIDTH, initial_indent="  - ", subsequent_indent="    ")
