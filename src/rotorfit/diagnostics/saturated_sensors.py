"""A gyro or an accelerometer that reached the end of its range in flight."""

from pathlib import Path
from typing import Final

from rotorfit.dataset.dataset import Dataset, LoadedFlight

LEAST_SHARE: Final = 1e-3
"""Of the flight that must be cut off: real flights without a fault have none."""


def saturated_sensors(dataset: Dataset) -> str | None:
    """Return that a sensor's end cut off part of a flight, in words; of the worst flight."""
    if dataset.source != "imu":
        return None
    found = [said for c in dataset.configurations for f in c.flights for said in _cut_off(f)]
    return max(found)[1] if found else None


def _cut_off(flight: LoadedFlight) -> list[tuple[float, str]]:
    """Return the share of the flight that each sensor's end cut off, and what is to be said."""
    file = Path(flight.entry.file).name
    found: list[tuple[float, str]] = []
    for name, unit in (("gyro", "rad/s"), ("accel", "m/s^2")):
        cut = flight.recorded.saturation[name]
        if cut.share > LEAST_SHARE:
            sensor = "gyro" if name == "gyro" else "accelerometer"
            words = (
                f"{file}: the {sensor} is at the end of its range ({cut.largest:.3g} {unit}) for "
                f"{100 * cut.share:.1f} % of the flight: what is faster or harder is cut off, and "
                "inertia or thrust comes out wrong; set a wider range, or fly more gently"
            )
            found.append((cut.share, words))
    return found
