"""The scene of a vehicle to draw: rotors, IMU, centre of mass, payloads, in metres.

Everything is in body axes FLU, from the point that the rotor positions are measured from.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from pydantic import ValidationError

from rotorfit.digits import known
from rotorfit.errors import RotorfitError
from rotorfit.fit.experiment.airframe_table import AirframeEntry
from rotorfit.fit.experiment.declared_vehicle import vehicle_of
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.report.parameters import half_width
from rotorfit.results.result import IdentificationResult, configuration_names

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.model.vehicle import Vehicle

Point = tuple[float, float, float]


@frozen_dataclass
class Payload:
    """A known mass [kg] at a place [m]."""

    mass: float
    position: Point


@frozen_dataclass
class Body:
    """Centre of mass (None in unknown directions), its covariance [m^2], and payloads."""

    configuration: str
    com: tuple[float | None, float | None, float | None]
    covariance: Float[np.ndarray, "3 3"]
    payloads: tuple[Payload, ...]


@frozen_dataclass
class Scene:
    """The whole drawing in metres."""

    vehicle: Vehicle
    bodies: tuple[Body, ...]
    imu: Point
    imu_label: str

    @property
    def center(self) -> Point:
        """Mean of the rotor positions."""
        x, y, z = self.vehicle.positions.mean(axis=0).tolist()
        return (x, y, z)


def scene_of(result: IdentificationResult) -> Scene | None:
    """Collect what there is to draw, None if the settings do not describe a vehicle."""
    airframe = _read_airframe(result.settings)
    if airframe is None:
        return None
    vehicle = vehicle_of(airframe)
    shift = _origin_shift(result, vehicle)
    return Scene(
        vehicle=vehicle,
        bodies=tuple(
            _scene_body(result, name, shift, flip=airframe.axes == "FRD")
            for name in configuration_names(result)
        ),
        imu=vehicle.imu_position or shift,
        imu_label=_origin_label(result.settings, vehicle),
    )


def _read_airframe(settings: Mapping[str, Any]) -> AirframeEntry | None:
    """Read the airframe of the settings, None if they do not describe one."""
    described = settings.get("airframe")
    if not isinstance(described, Mapping):
        return None
    table = dict(cast("Mapping[str, Any]", described))
    if table.get("rotors"):
        table.pop("order", None)  # the resolved default of a key that belongs to layouts
    try:
        airframe = AirframeEntry.model_validate(table)
        vehicle_of(airframe)
    except (ValidationError, RotorfitError):
        return None
    return airframe


def _origin_label(settings: Mapping[str, Any], vehicle: Vehicle) -> str:
    """Name what stands at `Scene.imu`."""
    identification = cast("Mapping[str, Any]", settings.get("identification") or {})
    if vehicle.imu_position is not None:
        return "IMU as given"
    if identification.get("source") == "mocap":
        return "origin of the motion capture"
    return "IMU (the origin; its place among the rotors is estimated)"


def _origin_shift(result: IdentificationResult, vehicle: Vehicle) -> Point:
    """Locate the result's origin, the IMU where its place is not known, among the rotors [m]."""
    if vehicle.imu_position is not None:
        return (0.0, 0.0, 0.0)
    values = {p.name: known(p.value) for p in result.parameters}
    x, y = values.get("rotor_center_x"), values.get("rotor_center_y")
    return (-(x or 0.0), -(y or 0.0), 0.0)


def _scene_body(result: IdentificationResult, name: str, shift: Point, *, flip: bool) -> Body:
    found = [_com_coordinate(result, name, axis) for axis in "xyz"]
    x, y, z = (
        None if value is None else value + s for (value, _), s in zip(found, shift, strict=True)
    )
    std = np.array([(half or 0.0) / 1.96 for _, half in found])
    return Body(
        configuration=name,
        com=(x, y, z),
        covariance=_com_correlation(result, name) * np.outer(std, std),
        payloads=_read_payloads(result.settings, name, flip=flip),
    )


def _com_coordinate(
    result: IdentificationResult, configuration: str, axis: str
) -> tuple[float | None, float | None]:
    """Compute one coordinate of the centre of mass and half of its interval."""
    derived = {d.name: d for d in result.derived if d.configuration == configuration}
    if f"com_{axis}" in derived:
        number = derived[f"com_{axis}"]
        return known(number.value), half_width(number)
    own = {p.name: p for p in result.parameters if p.configuration == configuration}
    moment, mass = own.get(f"ms{axis}"), own.get("mass")
    value = None if moment is None else known(moment.value)
    if moment is not None and moment.verdict == "removed":
        value = 0.0  # taken out of the model as unessential
    kilograms = None if mass is None else known(mass.value)
    if moment is None or value is None or not kilograms:
        return None, None
    half = half_width(moment)
    return value / kilograms, None if half is None else half / kilograms


def _com_correlation(result: IdentificationResult, configuration: str) -> Float[np.ndarray, "3 3"]:
    """Correlate the centre of mass as its first moments are, where that is known."""
    names = [f"ms{axis}@{configuration}" for axis in "xyz"]
    out = np.eye(3)
    for i, a in enumerate(names):
        for j, b in enumerate(names):
            if i != j and a in result.covariance_names and b in result.covariance_names:
                p, q = result.covariance_names.index(a), result.covariance_names.index(b)
                scale = float(np.sqrt(result.covariance[p, p] * result.covariance[q, q]))
                value = float(result.covariance[p, q]) / scale if scale > 0 else 0.0
                out[i, j] = np.clip(value, -1.0, 1.0) if np.isfinite(value) else 0.0
    return out


def _read_payloads(
    settings: Mapping[str, Any], configuration: str, *, flip: bool
) -> tuple[Payload, ...]:
    """Read the payloads of a configuration, where the settings have them in a known form."""
    out: list[Payload] = []
    for entry in cast("list[Any]", settings.get("configuration") or []):
        if not isinstance(entry, Mapping):
            continue
        table = cast("Mapping[str, Any]", entry)
        if table.get("name") != configuration:
            continue
        for item in cast("list[Any]", table.get("payload") or []):
            x, y, z = (float(c) for c in item["position"])
            place = (x, -y, -z) if flip else (x, y, z)
            out.append(Payload(mass=float(item["mass"]), position=place))
    return tuple(out)
