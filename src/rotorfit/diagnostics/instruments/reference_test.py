"""The pilot as witness: what was asked for against the estimate, in numbers and words."""

import dataclasses
from collections.abc import Sequence
from typing import Final

from rotorfit.dataset.dataset import Dataset
from rotorfit.diagnostics.instruments.instrument import Instrumented, instrumented
from rotorfit.diagnostics.instruments.reference_lines import ReferenceLines, reference_lines
from rotorfit.estimation.banded import BandedEstimate
from rotorfit.fit.intervals.joint_numbers import AXES
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.joint.joint_problem import JointConfiguration
from rotorfit.results.parameter_tables import Tables

TELLING: Final = 0.2
"""Half-width of the ratio, beyond which the reference tells nothing."""
UNLIKELY: Final = 1e-3
"""Probability by chance of what is called a contradiction."""
RESPONSES: Final = {"roll": "Ixx_over_kt", "pitch": "Iyy_over_kt", "yaw": "kd_over_Izz"}
"""The number that goes with the response of each axis."""


def compare_with_reference(
    tables: Tables,
    dataset: Dataset,
    numbers: Numbers,
    *,
    fit: BandedEstimate,
    joint: Sequence[JointConfiguration],
) -> Tables:
    """Return the tables with what the pilot's or the mission's reference says of them.

    Parameters
    ----------
    tables
        Of the estimate.
    dataset
        The flights.
    numbers
        Of the estimate, with their final intervals.
    fit, joint
        The fit, and its configurations.
    """
    diagnostics: dict[str, float] = {}
    doubts: list[str] = []
    for name, lines in reference_lines(dataset, fit, joint):
        found = {} if lines is None else _axes(lines)
        told = {axis: one for axis, one in found.items() if one.half_width < TELLING}
        diagnostics[f"reference_axes@{name}"] = float(len(told))
        for axis, one in found.items():
            diagnostics[f"reference_{axis}@{name}"] = one.ratio
            diagnostics[f"reference_{axis}_half_width@{name}"] = one.half_width
        doubts += [
            _sentence(name, axis, one)
            for axis, one in told.items()
            if one.contradicts(UNLIKELY) and _matters(one, numbers, f"{RESPONSES[axis]}@{name}")
        ]
    return dataclasses.replace(
        tables,
        warnings=(*tables.warnings, *doubts),
        diagnostics={**tables.diagnostics, **diagnostics},
    )


def _axes(lines: ReferenceLines) -> dict[str, Instrumented]:
    """Return the response about each axis that the reference tells of."""
    found: dict[str, Instrumented] = {}
    for k, axis in enumerate(AXES):
        own = lines.dataset[:, k]
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
        f"{name}: by what was asked for the response in {axis} ({numbers}) is {one.ratio:.3f} +- "
        f"{one.half_width:.3f} times that of the fit: the autopilot responded to gusts "
        "differently than assumed, or what was asked for is not what moved the vehicle; fly "
        "again in calm air with "
        "larger, quicker sticks"
    )
