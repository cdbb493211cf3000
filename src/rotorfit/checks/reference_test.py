r"""Test the response of every axis by the reference of pilot or mission, an instrumental variable.

The rotors make the angular acceleration u by the model, and y = beta u + e is measured, with beta =
1 where the model is right. An autopilot responds to disturbances e by the rotors, so that u holds
some of them and least squares,

.. math:: \beta_{LS} = 1 + \sum w \Re(\bar u e) \Big/ \sum w |u|^2,

is biased. What pilot or mission asked for, r, knows nothing of e. In each block of lines
(frequency band of a stretch) u follows c r, with c a gain and a phase of the loop, and

.. math:: \beta = 1 + \sum w \Re(\bar{\hat u} e) \Big/ \sum w \Re(\bar{\hat u} u), \qquad
    \hat u_i = c_{-i} r_i,

has no bias: two-stage least squares (Soderstrom and Stoica, System Identification, 1989, chapter 8;
IDIM-IV of Janot, Vandanjon and Gautier, IEEE Trans. Control Systems Technology 22(1), 2014). c_{-i}
is found without the line i, or its own e would come back through it (JIVE1 of Angrist, Imbens and
Krueger, J. Applied Econometrics 14, 1999): c_{-i} r_i = (c r_i - h_i u_i) / (1 - h_i) with h_i =
|r_i|^2 / sum |r|^2. w is one over the mean square of e in the block.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.digits import with_half
from rotorfit.estimation.banded_problem import solved
from rotorfit.estimation.distributions import normal_quantile, student_quantile
from rotorfit.findings import Evidence, Finding, doubt_or_passed
from rotorfit.fit.intervals.numbers import AXES, Numbers
from rotorfit.fit.joint.joint_problem import NOISY, TURN_ERRORS, JointConfiguration, theta_of
from rotorfit.fit.reduction.frequency_bands import banded_data
from rotorfit.fit.reduction.reduce import banded_lines
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.signals import signal_matrix

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from jaxtyping import Bool, Complex, Float, Int

    from rotorfit.fit.dataset.dataset import ConfigurationData
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.timing.timed_dataset import TimedDataset
    from rotorfit.flight.flight_data import FlightData

PASSED_ON: Final = 0.5
"""Share of the bias of least squares that a reference may still have: the rates that an attitude
loop asks for respond to disturbances too. On simulated flights in gusts a fifth to a third is
left, and nothing with the pilot's sticks themselves."""
LEAST_FREE: Final = 0.25
"""Least variance of a difference, as a share of the instrument's own (Hausman)."""
FEWEST_LINES: Final = 20
MOST_LEVERAGE: Final = 0.9
"""Leverage of a line in its block, above which the gain is unidentifiable without it."""
EXACT: Final = 1e-12
"""Least power of the errors, over that of the prediction: a simulation may have none."""
_TINY: Final = 1e-200


@frozen_dataclass
class Instrumented:
    """The response of an axis over the model's.

    - `ratio`: by the instrument.
    - `plain`: by least squares, biased by the autopilot's response.
    - `std`: of the ratio, by chance: the larger of what single lines and whole blocks show.
    - `difference_std`: of what the ratio differs from that of an efficient estimate by chance.
    - `of_blocks`, `degrees`: the share of `std` that whole blocks show, and their effective number.
    """

    ratio: float
    plain: float
    std: float
    difference_std: float
    of_blocks: float = 0.0
    degrees: float = np.inf

    def _reach_of_chance(self, unlikely: float) -> float:
        """Compute the deviations that chance reaches with this probability."""
        by_lines = -normal_quantile(0.5 * unlikely)
        by_blocks = -float(student_quantile(0.5 * unlikely, self.degrees))
        return max(by_lines, self.of_blocks * by_blocks)

    @property
    def passed_on(self) -> float:
        """The largest share of the bias that an attitude loop puts into the reference."""
        return PASSED_ON * abs(self.plain - self.ratio)

    @property
    def half_width(self) -> float:
        """Of the ratio's 95 % interval."""
        return float(np.hypot(self._reach_of_chance(0.05) * self.std, self.passed_on))

    def contradicts(self, unlikely: float) -> bool:
        """Return whether the ratio differs from 1 beyond chance (Durbin, Wu, Hausman).

        `unlikely`: probability by chance, under which it does.
        """
        beyond = abs(self.ratio - 1.0) - self.passed_on
        return beyond > self._reach_of_chance(unlikely) * self.difference_std


def instrumented(
    reference: Complex[np.ndarray, " l"],
    predicted: Complex[np.ndarray, " l"],
    error: Complex[np.ndarray, " l"],
    *,
    block: Int[np.ndarray, " l"],
) -> Instrumented | None:
    """Estimate the response by an instrument; None if the reference is too weak.

    `reference`: lines of the reference, in any unit; `predicted`, `error`: of the response that
    the model predicts and of the rest of what was measured [rad/s^2]; `block`: of each line.
    """
    power = _sum_by_block(np.abs(reference) ** 2, block)
    h = np.abs(reference) ** 2 / np.maximum(power, _TINY)
    usable = (power > 0.0) & (h < MOST_LEVERAGE)
    reference, predicted, error, h = (x[usable] for x in (reference, predicted, error, h))
    block = block[usable]
    if len(block) < FEWEST_LINES:
        return None
    c = _sum_by_block(reference.conj() * predicted, block) / power[usable]
    follows = (c * reference - h * predicted) / (1.0 - h)
    count = _sum_by_block(np.ones(len(block)), block)
    power = np.abs(error) ** 2 + EXACT * np.abs(predicted) ** 2
    w = count / np.maximum(_sum_by_block(power, block), _TINY)
    informative_power = float(w @ np.real(follows.conj() * predicted))
    if not informative_power > 0.0:
        return None
    off = float(w @ np.real(follows.conj() * error)) / informative_power
    plain = w * np.abs(predicted) ** 2
    bias = float(w @ np.real(predicted.conj() * error)) / float(plain.sum())
    asked = w * np.real(follows.conj() * (error - off * predicted)) / informative_power
    formal = 0.5 * float(w @ np.abs(follows) ** 2) / informative_power**2
    of_blocks = _of_blocks(asked, block)
    variance = max(formal, float((asked**2).sum()), of_blocks)
    left = max(variance - 0.5 / float(plain.sum()), LEAST_FREE * variance)
    return Instrumented(
        ratio=1.0 + off,
        plain=1.0 + bias,
        std=variance**0.5,
        difference_std=left**0.5,
        of_blocks=float(np.sqrt(of_blocks / variance)) if variance > 0.0 else 0.0,
        degrees=_count_effective_blocks(w * np.abs(follows) ** 2, block),
    )


def _sum_by_block(values: np.ndarray, block: Int[np.ndarray, " l"]) -> np.ndarray:
    total = np.zeros(int(block.max(initial=-1)) + 1, dtype=values.dtype)
    np.add.at(total, block, values)
    return total[block]


def _count_effective_blocks(
    information: Float[np.ndarray, " l"], block: Int[np.ndarray, " l"]
) -> float:
    """Count the effective blocks, by the information of each line."""
    shares = np.bincount(block, weights=information)
    return float(shares.sum() ** 2 / (shares**2).sum())


def _of_blocks(asked: Float[np.ndarray, " l"], block: Int[np.ndarray, " l"]) -> float:
    """Compute the variance by the scatter of whole blocks, whose lines are correlated."""
    sums = np.bincount(block, weights=asked)
    count = len(np.unique(block))
    return float((sums**2).sum()) * count / max(count - 1, 1)


@frozen_dataclass
class ReferenceLines:
    """Lines about x, y and z, of all bands of a fit in order.

    - `reference`: time derivative of the angular velocity that was asked for [rad/s^2].
    - `predicted`: what the rotors make of it by the fit [rad/s^2].
    - `error`: what was measured, less all that the fit has [rad/s^2].
    - `block`: of a stretch and a frequency band.
    - `excited`: in which blocks a pilot moves the axis.
    """

    reference: Complex[np.ndarray, "l 3"]
    predicted: Complex[np.ndarray, "l 3"]
    error: Complex[np.ndarray, "l 3"]
    block: Int[np.ndarray, " l"]
    excited: Bool[np.ndarray, "l 3"]


def reference_lines(fit: Fit) -> Iterator[tuple[str, ReferenceLines | None]]:
    """Yield the lines of each configuration; None if its logs have no reference."""
    dataset, estimate = fit.dataset, fit.estimate
    theta = theta_of(estimate.problem.map, estimate.estimate.values, fit.configurations)
    for k, (configured, c) in enumerate(
        zip(dataset.configurations, fit.configurations, strict=True)
    ):
        G, _ = solved(c.model.tensor, theta[k], estimate.problem.noisy)
        turns = [NOISY.index(name) for name in TURN_ERRORS]
        yield c.name, _reference_lines(configured, c, dataset, G[turns])


def _reference_lines(
    configured: ConfigurationData,
    c: JointConfiguration,
    dataset: TimedDataset,
    G: Float[np.ndarray, "3 z"],
) -> ReferenceLines | None:
    """Compute the lines of one configuration; `G` maps its signals to errors."""
    logged = any(f.prepared.data.reference is not None for f in configured.flights)
    if c.with_response is None or not logged:
        return None
    rows: list[Complex[np.ndarray, "l 9"]] = []
    blocks: list[Int[np.ndarray, " l"]] = []
    first = 0
    for flight in configured.flights:
        data, plan = banded_data(flight.prepared, dataset.timing)

        def columns(start: int, stop: int, data: FlightData = data) -> Float[np.ndarray, "n 9"]:
            return _reference_columns(data, c, G, (start, stop))

        for lines, bands, frequency in banded_lines(data, columns, plan=plan):
            lines[:, :3] *= 2j * np.pi * frequency[:, None]
            for k, (a, b) in enumerate(bands, start=first):
                rows.append(lines[a:b])
                blocks.append(np.full(b - a, k))
            first += len(bands)
    every, block = np.concatenate(rows), np.concatenate(blocks)
    moving = c.factors.band[:, 0] > 0.0
    return ReferenceLines(
        reference=every[:, :3],
        predicted=every[:, 3:6],
        error=every[:, 6:],
        block=block,
        excited=(c.with_response & moving[:, None])[block],
    )


def _reference_columns(
    data: FlightData,
    c: JointConfiguration,
    G: Float[np.ndarray, "3 z"],
    rows: tuple[int, int],
) -> Float[np.ndarray, "n 9"]:
    """Compute reference, prediction and error in some rows; zeros if there is no reference."""
    Z = signal_matrix(data, c.vehicle, *rows, added=c.model.layout.added)
    made = np.array([name.startswith(("O2_", "dH")) for name in c.model.layout.names])
    asked = np.zeros((len(Z), 3))
    if data.reference is not None and np.isfinite(data.reference[slice(*rows)]).all():
        asked = data.reference[slice(*rows)]
    return np.concatenate([asked, -Z[:, made] @ G[:, made].T, Z @ G.T], axis=1)


INFORMATIVE: Final = 0.2
"""Half-width of the ratio, beyond which the reference is not informative."""
UNLIKELY: Final = 1e-3
"""Probability by chance of what is called a contradiction."""
RESPONSES: Final = {"roll": "Ixx_over_kt", "pitch": "Iyy_over_kt", "yaw": "kd_over_Izz"}
"""The number that goes with the response of each axis."""


def compare_with_reference(fit: Fit) -> Iterator[Finding]:
    """Compare every axis' response to the rotors with its response to the reference."""
    for name, lines in reference_lines(fit):
        found = {} if lines is None else axis_responses(lines)
        yield from response_findings(name, found, fit.numbers)


def response_findings(
    configuration: str, found: Mapping[str, Instrumented], numbers: Numbers
) -> Iterator[Finding]:
    """Yield the findings of a configuration's responses on its numbers, by axis."""
    informative = {axis: one for axis, one in found.items() if one.half_width < INFORMATIVE}
    count = Evidence(name=f"reference_axes@{configuration}", value=float(len(informative)))
    yield Finding(kind="reference", severity="passed", evidence=(count,))
    for axis, one in found.items():
        number = f"{RESPONSES[axis]}@{configuration}"
        contradicts = axis in informative and one.contradicts(UNLIKELY)
        sentence = _explain_reference(configuration, axis, one)
        yield doubt_or_passed(
            "reference-response",
            sentence if contradicts and _matters_for(one, numbers, number) else None,
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


def _matters_for(one: Instrumented, numbers: Numbers, name: str) -> bool:
    """Return whether the number would move by more than half of its interval's half-width."""
    value, half = numbers.number(name)
    return 2.0 * abs(one.ratio - 1.0) * abs(value) > half


def _explain_reference(name: str, axis: str, one: Instrumented) -> str:
    numbers = "kd / Izz and Jr / Izz" if axis == "yaw" else f"kt / I{'xy'[axis == 'pitch'] * 2}"
    return (
        f"{name}: the response in {axis} ({numbers}), measured by the commanded rates alone, is "
        f"{with_half(one.ratio, one.half_width)} times that of the fit: the autopilot responded "
        "to gusts differently than assumed, or the logged commands are not what moved the "
        "vehicle; fly again in calm air with larger, quicker sticks"
    )


CHECKS: Final = (compare_with_reference,)
