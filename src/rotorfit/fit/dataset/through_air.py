"""Take the wind that a flight shows off its velocity."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from rotorfit.findings import Evidence, Finding, note
from rotorfit.fit.dataset.wind import LEAST_WIND, Wind, estimate_wind

if TYPE_CHECKING:
    from rotorfit.fit.dataset.dataset import LoadedFlight


def through_air(flight: LoadedFlight) -> LoadedFlight:
    """Return a flight with its velocity through the air, where it shows a wind."""
    data = flight.prepared.data
    wind = estimate_wind(data)
    if wind is None or data.velocity is None or data.world_axes is None:
        return flight
    x, y = wind.velocity
    moving = data.velocity - x * data.world_axes[:, :3] - y * data.world_axes[:, 3:]
    prepared = dataclasses.replace(
        flight.prepared,
        data=dataclasses.replace(data, velocity=moving),
        findings=(*flight.prepared.findings, describe_wind(wind, flight.entry.written)),
    )
    return dataclasses.replace(flight, prepared=prepared, wind=wind)


def describe_wind(wind: Wind, written: str) -> Finding:
    """Explain that a flight shows a steady wind, which is taken off its velocity."""
    half = 1.96 * wind.std
    return note(
        "wind",
        f"a steady wind of {wind.speed:.1f} +- {half:.1f} m/s is taken off the velocity: the air's "
        "forces go by the velocity through the air",
        flights=(written,),
        evidence=(
            Evidence(
                name="wind_speed",
                value=wind.speed,
                interval=(max(wind.speed - half, 0.0), wind.speed + half),
                limit=LEAST_WIND,
            ),
        ),
    )
