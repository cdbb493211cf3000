"""From draws of the posterior to vehicles as every target writes them, or to arrays of them."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rotorfit import version
from rotorfit.errors import OutputError
from rotorfit.export.file_format import npz
from rotorfit.export.vehicle import VehicleModel, is_possible, thickened
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import file_name
from rotorfit.model.parameters import COM, INERTIA_COM, inertia_matrix

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rotorfit.results.result import IdentificationResult
    from rotorfit.results.samples import Samples

DRAWN: Final = ("identified", "weak", "doubtful")
"""Origins of numbers that a draw replaces; given, assumed and computed ones stand."""


@frozen_dataclass
class Variants:
    """Vehicles drawn around a nominal one, and the draws in the units of the result."""

    nominal: VehicleModel
    models: tuple[VehicleModel, ...]
    samples: Samples


def variants(
    result: IdentificationResult, nominal: VehicleModel, *, count: int, seed: int
) -> Variants:
    """Draw vehicles from the posterior of a result; what is assumed in `nominal` is so in all.

    OutputError if a draw cannot exist alongside what was assumed, EstimationError if the mass is
    unknown or hardly a draw can exist.
    """
    samples = result.samples(count, seed, configuration=nominal.configuration)
    factors = _unit_factors(nominal, samples, result)
    models = tuple(
        _make_variant(
            nominal,
            {name: factor * float(samples.values[name][i]) for name, factor in factors.items()},
        )
        for i in range(count)
    )
    # Each draw can exist; beside numbers that were assumed it may not.
    impossible = sum(not is_possible(model) for model in models)
    if impossible:
        raise OutputError(
            f"{impossible} of {count} vehicles drawn cannot exist with what was assumed (no body "
            "has such inertia): assume less, or other values"
        )
    return Variants(nominal=nominal, models=tuple(map(thickened, models)), samples=samples)


def _unit_factors(
    nominal: VehicleModel, samples: Samples, result: IdentificationResult
) -> dict[str, float]:
    """Compute by name what turns a draw into SI: 1, or the conversion of a unit per command."""
    raw = {p.name: p for p in result.parameters if p.configuration in (None, samples.configuration)}
    factors: dict[str, float] = {}
    for number in nominal.numbers:
        if number.name in samples.values and number.origin in DRAWN:
            p = raw.get(number.name)
            if p is None or p.unit == number.unit or not p.value:
                factors[number.name] = 1.0
            else:
                factors[number.name] = number.value / p.value
    return factors


def _make_variant(nominal: VehicleModel, drawn: Mapping[str, float]) -> VehicleModel:
    """Replace the numbers of the nominal vehicle by those of one draw."""
    old = {n.name: n.value for n in nominal.numbers}
    new = {**old, **drawn}
    shift = [new.get(c, 0.0) - old.get(c, 0.0) for c in ("rotor_center_x", "rotor_center_y")]
    if "motor_lag" in drawn:
        drawn = dict.fromkeys(("motor_lag_up", "motor_lag_down"), drawn["motor_lag"]) | dict(drawn)
    return replace(
        nominal,
        com=np.array([drawn.get(n, c) for n, c in zip(COM, nominal.com.tolist(), strict=True)]),
        inertia_com=inertia_matrix(np.array([new.get(n, np.nan) for n in INERTIA_COM])),
        rotors=tuple(
            replace(
                rotor,
                position=rotor.position + np.array([*shift, 0.0]),
                kt=drawn.get(
                    f"kt_{i}", rotor.kt if f"kt_{i}" in old else drawn.get("kt", rotor.kt)
                ),
            )
            for i, rotor in enumerate(nominal.rotors, 1)
        ),
        kd=drawn.get("kd", nominal.kd),
        Jr=None if nominal.Jr is None else drawn.get("Jr", nominal.Jr),
        lag_up=drawn.get("motor_lag_up", nominal.lag_up),
        lag_down=drawn.get("motor_lag_down", nominal.lag_down),
        max_speed=drawn.get("max_speed", nominal.max_speed),
        numbers=tuple(
            replace(n, value=drawn[n.name], interval=None, remark="drawn") if n.name in drawn else n
            for n in nominal.numbers
        ),
    )


SCHEMA: Final = 1
UNITS: Final = {
    "mass": "kg",
    "com": "m from the origin",
    "inertia_com": "kg m^2 about the CoM, tensor",
    "kt": "N s^2/rad^2, each rotor",
    "kd": "N m s^2/rad^2",
    "Jr": "kg m^2",
    "motor_lag": "s, of rising and of falling speed",
    "max_speed": "rad/s",
    "rotor_position": "m from the origin",
    "rotor_axis": "unit vectors of thrust",
    "rotor_spin": "+1 counter-clockwise seen from above, -1 clockwise",
}
"""The arrays, first index the vehicle (`rotor_axis` and `rotor_spin` are the same for all)."""


def refuse_suffix(suffix: str) -> None:
    """Raise if samples are not written with this suffix."""
    if suffix not in (".npz", ".json"):
        raise OutputError(
            f"samples are written as .npz or .json, not {suffix or 'a file without suffix'}; "
            "for one file of a simulator each: --to mujoco --samples N -o FOLDER"
        )


def write_samples(found: Variants, result: IdentificationResult, *, suffix: str) -> bytes:
    """Write drawn vehicles of a result as the suffix asks: ``.npz`` or ``.json``."""
    arrays = _stack_arrays(found)
    about = _describe_arrays(found, result, tuple(arrays))
    if suffix == ".json":
        values = {name: array.tolist() for name, array in arrays.items()}
        return (json.dumps({**about, "values": values}, allow_nan=False) + "\n").encode()
    return npz({"about": np.array(json.dumps(about)), **arrays})


def _describe_arrays(
    found: Variants, result: IdentificationResult, names: tuple[str, ...]
) -> dict[str, Any]:
    """Describe the arrays of these names, and where they are from."""
    samples = found.samples
    return {
        "schema": SCHEMA,
        "rotorfit": version.__version__,
        "name": result.name,
        "configuration": samples.configuration,
        "axes": "FLU",
        "count": len(found.models),
        "seed": samples.seed,
        "rejected": samples.rejected,
        "reasons": dict(samples.reasons),
        "units": {name: UNITS[name] for name in names},
        "flights": [
            {"file": file_name(flight.file), "sha256": flight.sha256} for flight in result.flights
        ],
        "notes": list(found.nominal.notes),
    }


def _stack_arrays(found: Variants) -> dict[str, np.ndarray]:
    """Stack the vehicles as arrays, without what is not known of any."""
    models = found.models
    arrays = {
        "mass": np.array([m.mass for m in models]),
        "com": np.array([m.com for m in models]),
        "inertia_com": np.array([m.inertia_com for m in models]),
        "kt": np.array([[rotor.kt for rotor in m.rotors] for m in models]),
        "kd": np.array([m.kd for m in models]),
        "Jr": np.array([np.nan if m.Jr is None else m.Jr for m in models]),
        "motor_lag": np.array([[m.lag_up, m.lag_down] for m in models]),
        "max_speed": np.array([m.max_speed for m in models]),
        "rotor_position": np.array([[rotor.position for rotor in m.rotors] for m in models]),
        "rotor_axis": np.array([rotor.axis for rotor in models[0].rotors]),
        "rotor_spin": np.array([rotor.spin for rotor in models[0].rotors]),
    }
    return {name: array for name, array in arrays.items() if np.isfinite(array).all()}
