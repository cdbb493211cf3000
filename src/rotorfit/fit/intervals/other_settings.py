"""Settings that could as well be others, and how far they move each number.

Timing of the motors, the range of the frequencies, and the geometry, which is measured with a tape
before the flight and taken for exact by the fit: what an error of each shifts, the numbers show
when everything is fitted once more.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.model.regressor import regressor
from rotorfit.model.vehicle import Rotor, Vehicle
from rotorfit.reduction.frequency_bands import EDGES

Shift = Callable[[TimedDataset, float], Float[np.ndarray, " q"]]
"""How far each number moves with other flights, or at another timing of theirs, and with the bands
that begin under an edge [Hz]."""


def widened(
    half_width: Float[np.ndarray, " q"], dataset: TimedDataset, shift: Shift, *, timed: bool
) -> Float[np.ndarray, " q"]:
    """Return the half-width with twice the rms shift of every group of trials.

    Parameters
    ----------
    half_width
        Of each number, of chance and of what is always allowed for.
    dataset
        What was fitted.
    shift
        How far each number moves.
    timed
        Whether what the flights leave open of the motors' timing is in the half-width already.
    """
    groups = [[(dataset, 0.5 * EDGES[-1])]]
    groups += [] if timed else [[(other, np.inf) for other in g] for g in _other_timings(dataset)]
    groups += [[(other, np.inf)] for other in other_geometries(dataset)]
    squares = [np.mean([shift(*trial) ** 2 for trial in group], axis=0) for group in groups]
    return np.sqrt(half_width**2 + 4.0 * np.sum(squares, axis=0))


def _other_timings(dataset: TimedDataset) -> list[list[TimedDataset]]:
    """Return the flights at other timings, in groups that are independent of each other.

    The motors off both ways, by half a sample or by a deviation of what the flights tell of lag
    plus delay; lag taken for delay, by a deviation of the split.
    """
    found = dataset.motor_timing
    if found is None:
        return []
    half = 0.5 / dataset.configurations[0].flights[0].recorded.sample_rate
    step, at = max(half, found.total_std), found.response
    groups = [[dataset.at(replace(at, delay=at.delay + move)) for move in (-step, step)]]
    if found.lag_std is not None and found.delay_std is not None:
        lag, delay = at.lag + found.lag_std, at.delay - found.lag_std
        groups.append([dataset.at(replace(at, lag=lag, delay=delay))])
    return groups


def other_geometries(dataset: TimedDataset) -> Iterator[TimedDataset]:
    """Yield the flights with each measured length off by its standard deviation, if it has one.

    Parameters
    ----------
    dataset
        With the deviations in its vehicle.
    """
    vehicle = dataset.vehicle
    others: list[Vehicle] = []
    if vehicle.arm_std > 0.0:
        others.append(longer_arms(vehicle, vehicle.arm_std))
    if vehicle.imu_position is not None and vehicle.imu_position_std > 0.0:
        others += [moved_imu(vehicle, axis, vehicle.imu_position_std) for axis in range(3)]
    for other in others:
        yield replace(
            dataset, vehicle=other, model=regressor(other, added=dataset.model.layout.added)
        )


def longer_arms(vehicle: Vehicle, length: float) -> Vehicle:
    """Return the vehicle with all arms longer by one share, on average by a length [m]."""
    share = length / vehicle.arm
    centre = vehicle.positions.mean(axis=0)

    def moved(rotor: Rotor) -> Rotor:
        x, y, z = rotor.position
        place = (x + share * (x - float(centre[0])), y + share * (y - float(centre[1])), z)
        return replace(rotor, position=place)

    return replace(vehicle, rotors=tuple(moved(rotor) for rotor in vehicle.rotors))


def moved_imu(vehicle: Vehicle, axis: int, length: float) -> Vehicle:
    """Return the vehicle with its IMU moved along an axis by a length [m]."""
    place = list(vehicle.imu_position or (0.0, 0.0, 0.0))
    place[axis] += length
    return replace(vehicle, imu_position=(place[0], place[1], place[2]))
