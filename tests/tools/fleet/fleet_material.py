"""Flights of a fleet as their records, drawn from numbers that are known."""

from collections.abc import Callable
from functools import cache

import numpy as np

from rotorfit.tools.fleet.records import KT_WEIGHT, FlightRecord
from rotorfit.tools.fleet.statistics import FleetStatistics, fleet_statistics

KT = 4e-6
STD = {KT_WEIGHT: 0.001 * KT, "kt_1": 0.006 * KT, "kt_2": 0.006 * KT, "com_x": 3e-4, "kd": 2e-9}
LEVEL = {KT_WEIGHT: KT, "kt_1": 1.02 * KT, "kt_2": 0.98 * KT, "com_x": 0.008, "kd": 6e-8}
DAY = 86400.0
START = 1.77e9


def a_record(
    values: dict[str, float],
    *,
    vehicle: str = "V01",
    file: str = "log1.ulg",
    std: dict[str, float] = STD,
    verdicts: dict[str, str] | None = None,
    started: float | None = None,
    configuration: str = "A",
    mass: float | None = 1.4,
    air_density: float | None = None,
) -> FlightRecord:
    names = tuple(values)
    value = np.array([values[name] for name in names])
    deviation = np.array([std[name] for name in names])
    return FlightRecord(
        file=file,
        sha256=f"{vehicle}{file}",
        vehicle=vehicle,
        configuration=configuration,
        mass=mass,
        started=started,
        seconds_used=40.0,
        names=names,
        values=value,
        std=deviation,
        low=value - 1.96 * deviation,
        high=value + 1.96 * deviation,
        verdicts=tuple((verdicts or {}).get(name, "identified") for name in names),
        compared=(),
        covariance=np.zeros((0, 0)),
        air_density=air_density,
    )


def a_fleet(
    planted: Callable[[int, int, dict[str, float]], None] = lambda vehicle, flight, values: None,
    *,
    vehicles: int = 8,
    flights: int = 12,
    seed: int = 0,
) -> list[FlightRecord]:
    """Vehicles that differ by half a percent and .3 mm, each flown every other day.

    `planted` changes the true numbers of a flight (vehicle and flight counted from 0).
    """
    rng = np.random.default_rng(seed)
    out: list[FlightRecord] = []
    for v in range(vehicles):
        own = {
            name: level + (3e-4 if name == "com_x" else 0.005 * level) * rng.standard_normal()
            for name, level in LEVEL.items()
        }
        for f in range(flights):
            values = dict(own)
            planted(v, f, values)
            seen = {n: x + STD[n] * rng.standard_normal() for n, x in values.items()}
            out.append(
                a_record(
                    seen,
                    vehicle=f"V{v + 1:02d}",
                    file=f"V{v + 1:02d}/log{f + 1}.ulg",
                    started=START + 2 * DAY * f,
                )
            )
    return out


def worn_shifted_other(vehicle: int, flight: int, values: dict[str, float]) -> None:
    """A propeller of the second wears from flight 5 on; the battery of the fifth moves with
    flight 8; the seventh has other propellers."""
    if vehicle == 1:
        lost = 0.015 * max(flight - 3, 0)
        values["kt_2"] *= 1.0 - lost
        values[KT_WEIGHT] *= 1.0 - 0.5 * lost
    if vehicle == 4 and flight >= 7:
        values["com_x"] += 5e-3
    if vehicle == 6:
        for name in (KT_WEIGHT, "kt_1", "kt_2", "kd"):
            values[name] *= 1.08


@cache
def planted_fleet() -> tuple[list[FlightRecord], FleetStatistics]:
    """The fleet of `worn_shifted_other`; two files of tests look at it."""
    records = a_fleet(worn_shifted_other)
    return records, fleet_statistics(records)
