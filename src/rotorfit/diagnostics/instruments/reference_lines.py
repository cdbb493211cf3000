"""Spectral lines of a flight that an instrument needs: reference, prediction and error."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from rotorfit.dataset.dataset import ConfigurationData
from rotorfit.estimation.banded_problem import solved
from rotorfit.fit.fit import Fit
from rotorfit.fit.joint.joint_problem import NOISY, TURN_ERRORS, JointConfiguration, theta_of
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.model.signals import signal_matrix
from rotorfit.preprocessing.flight_data import FlightData
from rotorfit.reduction.frequency_bands import banded_data
from rotorfit.reduction.reduce import banded_lines


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceLines:
    """Lines about x, y and z, those of all bands that a fit has, one after the other.

    Attributes
    ----------
    reference
        Time derivative of the angular velocity that was asked for [rad/s^2].
    predicted
        What the rotors make of it by the fit [rad/s^2].
    error
        What was measured, less all that the fit has [rad/s^2].
    block
        Of a stretch and a frequency band.
    excited
        In which blocks a pilot moves the axis.
    """

    reference: Complex[np.ndarray, "l 3"]
    predicted: Complex[np.ndarray, "l 3"]
    error: Complex[np.ndarray, "l 3"]
    block: Int[np.ndarray, " l"]
    excited: Bool[np.ndarray, "l 3"]


def reference_lines(fit: Fit) -> Iterator[tuple[str, ReferenceLines | None]]:
    """Yield the lines of each configuration; None where its logs have no reference."""
    dataset, estimate = fit.dataset, fit.estimate
    theta = theta_of(estimate.problem.map, estimate.estimate.values, fit.configurations)
    for k, (configured, c) in enumerate(
        zip(dataset.configurations, fit.configurations, strict=True)
    ):
        G, _ = solved(c.model.tensor, theta[k], estimate.problem.noisy)
        turns = [NOISY.index(name) for name in TURN_ERRORS]
        yield c.name, _lines(configured, c, dataset, G[turns])


def _lines(
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
            return _columns(data, c, G, (start, stop))

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


def _columns(
    data: FlightData,
    c: JointConfiguration,
    G: Float[np.ndarray, "3 z"],
    rows: tuple[int, int],
) -> Float[np.ndarray, "n 9"]:
    """Compute reference, prediction and error in some rows; zeros where there is no reference."""
    Z = signal_matrix(data, c.vehicle, *rows, added=c.model.layout.added)
    made = np.array([name.startswith(("O2_", "dH")) for name in c.model.layout.names])
    asked = np.zeros((len(Z), 3))
    if data.reference is not None and np.isfinite(data.reference[slice(*rows)]).all():
        asked = data.reference[slice(*rows)]
    return np.concatenate([asked, -Z[:, made] @ G[:, made].T, Z @ G.T], axis=1)
