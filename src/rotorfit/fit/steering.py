"""Which errors tell of the vehicle, and in which the autopilot answers.

Bands in which no pilot moves an axis do not count for it (`frequency_bands.py`). In the others the
autopilot still answers disturbances, and by how much is known well enough: wholly, up to the
frequencies that a pilot uses (`rotorfit.estimation.feedback`). Where rotor speeds are commands,
bands in which the thrust does not follow them do not count for it: motors are no first-order lag
further up, and many quiet lines of no thrust at all would outvote those that tell of k_t.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from rotorfit.bands.frequency_bands import (
    counted_bands,
    flown_bands,
    followed_bands,
)
from rotorfit.estimation.banded import error_power
from rotorfit.experiment.model_terms import DEFAULT_TERMS, Term
from rotorfit.fit.joint_equations import (
    ANSWERED,
    NOISY,
    JointConfiguration,
    at_values,
    joint_problem,
)

THRUST: Final = NOISY.index("az")
TURNS: Final = tuple(NOISY.index(name) for name in ("dwx", "dwy", "dwz"))


def steered(
    configurations: Sequence[JointConfiguration],
    values: Mapping[str, float],
    *,
    commanded: bool,
    known_kt: tuple[float, float] | None = None,
    terms: Collection[Term] = DEFAULT_TERMS,
) -> list[JointConfiguration]:
    """Return the configurations with what counts and what is answered.

    Parameters
    ----------
    configurations
        With their factors per stretch and band.
    values
        Free parameters by name, near enough to tell the pilot's motion from disturbances.
    commanded
        Whether the rotor speeds are commands.
    known_kt, terms
        As for `joint_estimate`.
    """
    problem = joint_problem(configurations, known_kt=known_kt, terms=terms)
    phi = at_values(problem, values, np.zeros(len(problem.map.names)))
    signal, residual = error_power(problem, phi)
    ends = np.cumsum([len(c.factors) for c in configurations])[:-1]
    parts = zip(configurations, np.split(signal, ends), np.split(residual, ends), strict=True)
    return [_with_counted(*part, commanded=commanded) for part in parts]


def _with_counted(
    configuration: JointConfiguration,
    signal: Float[np.ndarray, "b 6"],
    residual: Float[np.ndarray, "b 6"],
    *,
    commanded: bool,
) -> JointConfiguration:
    factors, turns = configuration.factors, list(TURNS)
    flown = np.zeros_like(signal, dtype=bool)
    if commanded:
        flown[:, THRUST] = _followed(configuration)
    flown[:, turns] = flown_bands(factors, signal[:, turns], residual[:, turns])
    answered = flown[:, [NOISY.index(name) for name in ANSWERED]]
    return replace(configuration, counted=counted_bands(factors, flown), answered=answered)


def _followed(configuration: JointConfiguration) -> Bool[np.ndarray, " b"]:
    """Return in which blocks the vehicle accelerates upwards as its rotors' squared speeds do."""
    factors, index = configuration.factors, configuration.model.layout.index
    squares = [index(f"O2_{i}") for i in range(1, len(configuration.vehicle.rotors) + 1)]
    made = factors.R[:, :, squares] @ configuration.vehicle.axes[:, 2]
    return followed_bands(factors, factors.R[:, :, index("az")], made)
