"""Whether nature has such a vehicle, and the nearest one that it has."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from rotorfit.errors import EstimationError, OutputError
from rotorfit.export.assumptions import unit_of
from rotorfit.export.result_numbers import Number
from rotorfit.export.vehicle import BODY, VehicleModel
from rotorfit.model.parameters import (
    COM,
    FIRST_MOMENTS,
    INERTIA,
    INERTIA_COM,
    inertia_about,
    inertia_matrix,
)
from rotorfit.results.physical_inertia import project_to_physical, second_moments
from rotorfit.results.result import IdentificationResult


def is_possible(model: VehicleModel) -> bool:
    """Return whether a body can have the inertia; NaN is none that would be written."""
    if not np.isfinite(model.inertia_com).all():
        return True
    size = float(np.abs(model.inertia_com).max())
    return float(np.linalg.eigvalsh(second_moments(model.inertia_com))[0]) >= -1e-9 * size


def impossible_words(model: VehicleModel) -> str:
    """Return why an inertia is refused, and what to do."""
    moments = ", ".join(f"{m:.4g}" for m in np.linalg.eigvalsh(model.inertia_com))
    return (
        f"no body has this inertia about its CoM: the principal moments {moments} kg m^2 break the "
        "triangle inequality (each is at most the sum of the others); fly what the report advises, "
        "pass --assume Izz_com=VALUE, or --project to export the nearest inertia that a body can "
        "have"
    )


def refuse_signs(model: VehicleModel) -> None:
    """Raise if a coefficient that is above zero in nature is not."""
    named = [
        ("mass", model.mass),
        ("kt", model.kt),
        ("kd", model.kd),
        ("max_speed", model.max_speed),
    ]
    named += [(f"kt_{i + 1}", rotor.kt) for i, rotor in enumerate(model.rotors)]
    named += [("Jr", 1.0 if model.Jr is None else model.Jr)]
    for name, value in (("motor_lag_up", model.lag_up), ("motor_lag_down", model.lag_down)):
        if value < 0.0:
            raise OutputError(
                f"{name} is {value:.3g} s, and no motor answers before its command; pass --assume "
                "motor_lag=VALUE"
            )
    for name, value in named:
        if value <= 0.0:
            raise OutputError(
                f"{name} is {value:.3g} {unit_of(name)}, and nature has it above 0; check spins "
                f"and axes, fly what the report advises, or pass --assume {name}=VALUE"
            )


def projected(model: VehicleModel, result: IdentificationResult) -> VehicleModel:
    """Return the model with the nearest body that there can be, and its distance in the notes."""
    assumed = [n.name for n in model.numbers if n.name in BODY and n.origin in _NOT_MEASURED]
    if assumed:
        raise OutputError(
            f"--project moves what the flights measured by their covariance, but {assumed[0]} is "
            "not from them; change the assumed values until the triangle inequality holds"
        )
    try:
        nearest = project_to_physical(result, model.configuration)
    except EstimationError as error:
        raise OutputError(f"no nearest inertia was found: {error}") from error
    com = np.array([nearest.values[name] for name in FIRST_MOMENTS]) / model.mass
    origin = np.array([nearest.values[name] for name in INERTIA])
    about = dict(zip(INERTIA_COM, inertia_about(origin, -model.mass, com).tolist(), strict=True))
    moved = dict(zip(COM, com.tolist(), strict=True)) | about
    return replace(
        model,
        com=com,
        inertia_com=inertia_matrix(np.array(list(about.values()))),
        numbers=tuple(_moved(n, moved) for n in model.numbers),
        notes=(
            *model.notes,
            "inertia and CoM PROJECTED to the nearest that a body can have, "
            f"{nearest.distance:.2g} standard deviations from the estimate",
        ),
    )


_NOT_MEASURED: Final = ("assumed", "from-ratio", "removed")


def _moved(number: Number, moved: Mapping[str, float]) -> Number:
    """Return a number where the projection put it."""
    if number.name not in moved:
        return number
    remark = f"projected from {number.value:.6g}"
    return replace(number, value=moved[number.name], interval=None, origin="weak", remark=remark)
