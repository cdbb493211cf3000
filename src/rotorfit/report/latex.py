"""The table of a paper: every number with its interval, in LaTeX."""

from typing import Final

from rotorfit.formatting.digits import Number, number_of
from rotorfit.report.number_words import TITLES
from rotorfit.report.parameters import COM_FIRST
from rotorfit.results.result import (
    Derived,
    IdentificationResult,
    Parameter,
    configuration_names,
    verdict_of,
)

ROTORS: Final = ("kt", "kd", "Jr", "motor_lag", "motor_lag_up", "motor_lag_down", "motor_delay")
SYMBOLS: Final = {
    "kt": "k_t",
    "kd": "k_d",
    "Jr": "J_r",
    "motor_lag": r"\tau",
    "motor_lag_up": r"\tau_\uparrow",
    "motor_lag_down": r"\tau_\downarrow",
    "motor_delay": "T",
    "mass": "m",
    **{f"com_{a}": f"c_{a}" for a in "xyz"},
    **{f"I{a}{b}_com": f"I_{{{a}{b}}}" for a in "xyz" for b in "xyz"},
}
MARKS: Final = {"weak": r"$^{w}$", "doubtful": r"$^{d}$", "given": r"$^{g}$"}


def latex_table(result: IdentificationResult) -> str:
    r"""Return a result as a LaTeX table for a paper; it needs the package booktabs.

    One column a configuration; rotors first, then mass, centre of mass and the inertia about it.
    What the flights do not determine is a dash; weak, doubtful and given numbers are marked, and
    the caption says so.

    Parameters
    ----------
    result
        What `identify` returned, or `IdentificationResult.load`.
    """
    owners = configuration_names(result)
    found = {(e.name, e.configuration): e for e in (*result.parameters, *result.derived)}
    verdicts = {(n, o): verdict_of(result, e) for (n, o), e in found.items()}
    rows: list[str] = []
    for name in (*ROTORS, "mass", *COM_FIRST):
        own = [None] if name in ROTORS else owners
        entries = [found.get((name, owner)) for owner in own]
        if not any(entries):
            continue
        cells = [_cell(e, verdicts.get((name, o), "")) for e, o in zip(entries, own, strict=True)]
        if own == [None]:
            cells = [rf"\multicolumn{{{len(owners)}}}{{c}}{{{cells[0]}}}"]
        unit = next(e.unit for e in entries if e is not None)
        title = TITLES.get(name, name)
        rows.append(rf"{title} & ${SYMBOLS[name]}$ & {' & '.join(cells)} & {_unit(unit)} \\")
    heads = " & ".join(_escaped(name) for name in owners)
    return (
        "\\begin{table}\n\\centering\n"
        + rf"\caption{{{_caption(result)}}}"
        + f"\n\\begin{{tabular}}{{ll{'r' * len(owners)}l}}\n\\toprule\n"
        + rf"Parameter & Symbol & {heads} & Unit \\"
        + "\n\\midrule\n"
        + "\n".join(rows)
        + "\n\\bottomrule\n\\end{tabular}\n\\end{table}\n"
    )


def _caption(result: IdentificationResult) -> str:
    seconds = sum(flight.seconds_used for flight in result.flights)
    count = len(result.flights)
    return (
        f"{_escaped(result.name)}: identified from {count} flight{'' if count == 1 else 's'}, "
        f"{seconds:.0f} s in the air; $\\pm$ is half of the 95\\,\\% interval; "
        "$^{w}$ weak, $^{d}$ doubtful, $^{g}$ given; --: not determined."
    )


def _cell(entry: Parameter | Derived | None, verdict: str) -> str:
    number = None if entry is None else number_of(entry.value, entry.interval)
    return "--" if number is None else f"${_digits(number)}${MARKS.get(verdict, '')}"


def _digits(number: Number) -> str:
    body = number.value
    if number.low:
        body += f"\\ ({number.low}\\ \\text{{to}}\\ {number.high})"
    elif number.half:
        body += f" \\pm {number.half}"
    if number.exponent:
        body = f"({body})" if number.half else body
        body += f" \\times 10^{{{number.exponent}}}"
    return body.replace("−", "-")


def _unit(unit: str) -> str:
    """Write a unit upright, powers raised: ``N s^2/rad^2``."""
    plain = "" if unit == "1" else unit
    return f"$\\mathrm{{{plain.replace(' ', chr(92) + ',')}}}$" if plain else ""


def _escaped(words: str) -> str:
    """Escape a name for LaTeX."""
    special = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    return "".join(special.get(c, f"\\{c}" if c in "&%$#_{}" else c) for c in words)
