"""Test the response of every axis by the reference of pilot or mission."""

from collections.abc import Iterator, Mapping
from typing import Final

from rotorfit.diagnostics.instruments.instrument import Instrumented, instrumented
from rotorfit.diagnostics.instruments.reference_lines import ReferenceLines, reference_lines
from rotorfit.findings import Evidence, Finding, doubt_or_passed
from rotorfit.fit.fit import Fit
from rotorfit.fit.intervals.joint_numbers import AXES
from rotorfit.fit.intervals.numbers import Numbers

INFORMATIVE: Final = 0.2
"""Half-width of the ratio, beyond which the reference is not informative."""
UNLIKELY: Final = 1e-3
"""Probability by chance of what is called a contradiction."""
RESPONSES: Final = {"roll": "Ixx_over_kt", "pitch": "Iyy_over_kt", "yaw": "kd_over_Izz"}
"""The number that goes with the response of each axis."""


def compare_with_reference(fit: Fit) -> Iterator[Finding]:
    """Compare the response of every axis with that to the pilot's or the mission's reference."""
    for name, lines in reference_lines(fit):
        found = {} if lines is None else axis_responses(lines)
        yield from response_findings(name, found, fit.numbers)


def response_findings(
    configuration: str, found: Mapping[str, Instrumented], numbers: Numbers
) -> Iterator[Finding]:
    """Yield what the responses of a configuration say of its numbers, by axis."""
    informative = {axis: one for axis, one in found.items() if one.half_width < INFORMATIVE}
    count = Evidence(name=f"reference_axes@{configuration}", value=float(len(informative)))
    yield Finding(kind="reference", severity="passed", evidence=(count,))
    for axis, one in found.items():
        number = f"{RESPONSES[axis]}@{configuration}"
        contradicts = axis in informative and one.contradicts(UNLIKELY)
        sentence = _sentence(configuration, axis, one)
        yield doubt_or_passed(
            "reference-response",
            sentence if contradicts and _matters(one, numbers, number) else None,
            {
                f"reference_{axis}@{configuration}": one.ratio,
                f"reference_{axis}_half_width@{configuration}": one.half_width,
            },
            numbers=(number,),
        )


def axis_responses(lines: ReferenceLines) -> dict[str, Instrumented]:
    """Estimate the response about each axis that the reference moves."""
    found: dict[str, Instrumented] = {}
    for k, axis in enumerate(AXES):
        own = lines.excited[:, k]
        one = instrumented(
            lines.reference[own, k],
            lines.predicted[own, k],
            lines.error[own, k],
            block=lines.block[own],
        )
        if one is not None:
            found[axis] = one
    return found


def _matters(one: Instrumented, numbers: Numbers, name: str) -> bool:
    """Return whether the number would move by more than half of its interval's half-width."""
    value, half = numbers.number(name)
    return 2.0 * abs(one.ratio - 1.0) * abs(value) > half


def _sentence(name: str, axis: str, one: Instrumented) -> str:
    numbers = "kd / Izz and Jr / Izz" if axis == "yaw" else f"kt / I{'xy'[axis == 'pitch'] * 2}"
    return (
        f"{name}: the response in {axis} ({numbers}), measured by the commanded rates alone, is "
        f"{one.ratio:.3f} +- {one.half_width:.3f} times that of the fit: the autopilot responded "
        "to gusts differently than assumed, or the logged commands are not what moved the "
        "vehicle; fly again in calm air with larger, quicker sticks"
    )


CHECKS: Final = (compare_with_reference,)
