"""Drawn vehicles as arrays: NumPy's npz, or JSON."""

import io
import json
from typing import Any, Final

import numpy as np

from rotorfit import version
from rotorfit.errors import OutputError
from rotorfit.export.variants import Variants
from rotorfit.logs.files import file_name
from rotorfit.results.result import IdentificationResult

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
    arrays = _arrays(found)
    about = _about(found, result, tuple(arrays))
    if suffix == ".json":
        values = {name: array.tolist() for name, array in arrays.items()}
        return (json.dumps({**about, "values": values}, allow_nan=False) + "\n").encode()
    room = io.BytesIO()
    np.savez(room, allow_pickle=False, about=np.array(json.dumps(about)), **arrays)
    return room.getvalue()


def _about(found: Variants, result: IdentificationResult, names: tuple[str, ...]) -> dict[str, Any]:
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


def _arrays(found: Variants) -> dict[str, np.ndarray]:
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
