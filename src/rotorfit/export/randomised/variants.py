"""From draws of the posterior to vehicles as every target writes them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.errors import OutputError
from rotorfit.export.possible import is_possible
from rotorfit.export.result_numbers import Number
from rotorfit.export.vehicle import VehicleModel
from rotorfit.model.parameters import COM, INERTIA_COM, inertia_matrix
from rotorfit.results.result import IdentificationResult
from rotorfit.results.samples import Samples

DRAWN: Final = ("identified", "weak")
"""Origins of numbers that a draw replaces; given, assumed and computed ones stand."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Variants:
    """Vehicles drawn from the posterior.

    Attributes
    ----------
    nominal
        The estimate itself.
    models
        One for each draw.
    samples
        The draws, in the units of the result.
    """

    nominal: VehicleModel
    models: tuple[VehicleModel, ...]
    samples: Samples


def variants(
    result: IdentificationResult, nominal: VehicleModel, *, count: int, seed: int
) -> Variants:
    """Return vehicles drawn from the posterior of a result.

    Parameters
    ----------
    result
        From which the nominal vehicle was made.
    nominal
        As it is exported; what was assumed in it is the same in every vehicle.
    count, seed
        Of the draws.

    Raises
    ------
    OutputError
        If a draw cannot exist beside what was assumed.
    EstimationError
        If the mass is unknown, or hardly a draw can exist.
    """
    samples = result.samples(count, seed, configuration=nominal.configuration)
    factors = _factors(nominal, samples, result)
    models = tuple(
        _variant(
            nominal,
            {name: factor * float(samples.values[name][i]) for name, factor in factors.items()},
        )
        for i in range(count)
    )
    # Each draw can exist; beside numbers that were assumed it may not.
    impossible = sum(not is_possible(model) for model in models)
    if impossible:
        raise OutputError(
            f"{impossible} of {count} vehicles drawn cannot exist beside what was assumed (no body "
            "has such inertia): assume less, or other values"
        )
    return Variants(nominal=nominal, models=models, samples=samples)


def _factors(
    nominal: VehicleModel, samples: Samples, result: IdentificationResult
) -> dict[str, float]:
    """Return by name what turns a draw into SI: 1, or what undoes a unit per command."""
    raw = {p.name: p for p in result.parameters if p.configuration in (None, samples.configuration)}
    factors: dict[str, float] = {}
    for number in nominal.numbers:
        if number.name not in samples.values or number.origin not in DRAWN:
            continue
        parameter = raw.get(number.name)
        same = parameter is None or parameter.unit == number.unit or not parameter.value
        value = None if parameter is None else parameter.value
        factors[number.name] = 1.0 if same or value is None else number.value / value
    return factors


def _variant(nominal: VehicleModel, drawn: Mapping[str, float]) -> VehicleModel:
    """Return the nominal vehicle with the numbers of one draw in place of its own."""

    def value(name: str, otherwise: float) -> float:
        return drawn.get(name, otherwise)

    own = {n.name: n.value for n in nominal.numbers}
    shift = np.array(
        [
            value(name, own.get(name, 0.0)) - own.get(name, 0.0)
            for name in ("rotor_center_x", "rotor_center_y")
        ]
        + [0.0]
    )
    lag = value("motor_lag", own.get("motor_lag", float("nan")))
    both = "motor_lag" in drawn
    return replace(
        nominal,
        com=np.array([value(name, c) for name, c in zip(COM, nominal.com.tolist(), strict=True)]),
        inertia_com=inertia_matrix(_elements(nominal, drawn)),
        rotors=tuple(
            replace(
                rotor,
                position=rotor.position + shift,
                kt=value(f"kt_{i}", value("kt", rotor.kt) if f"kt_{i}" not in own else rotor.kt),
            )
            for i, rotor in enumerate(nominal.rotors, 1)
        ),
        kd=value("kd", nominal.kd),
        Jr=None if nominal.Jr is None else value("Jr", nominal.Jr),
        lag_up=value("motor_lag_up", lag if both else nominal.lag_up),
        lag_down=value("motor_lag_down", lag if both else nominal.lag_down),
        max_speed=value("max_speed", nominal.max_speed),
        numbers=tuple(_drawn(n, drawn) for n in nominal.numbers),
    )


def _elements(nominal: VehicleModel, drawn: Mapping[str, float]) -> Float[np.ndarray, " 6"]:
    own = {n.name: n.value for n in nominal.numbers}
    return np.array([drawn.get(name, own.get(name, float("nan"))) for name in INERTIA_COM])


def _drawn(number: Number, drawn: Mapping[str, float]) -> Number:
    if number.name not in drawn:
        return number
    return replace(number, value=drawn[number.name], interval=None, remark="drawn")
