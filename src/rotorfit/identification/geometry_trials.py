"""The same flights with a geometry that could as well be: arms and the place of the IMU.

Both are measured with a tape before the flight and taken for exact by the fit: what an error of
them shifts, each number shows when everything is fitted once more.
"""

from collections.abc import Iterator
from dataclasses import replace

from rotorfit.identification.flights import Flown
from rotorfit.model.regressor import regressor
from rotorfit.model.vehicle import Rotor, Vehicle


def other_geometries(flown: Flown) -> Iterator[Flown]:
    """Yield the flights with each measured length off by its standard deviation, if it has one.

    Parameters
    ----------
    flown
        With the deviations in its vehicle.
    """
    vehicle = flown.vehicle
    others: list[Vehicle] = []
    if vehicle.arm_std > 0.0:
        others.append(longer_arms(vehicle, vehicle.arm_std))
    if vehicle.imu_position is not None and vehicle.imu_position_std > 0.0:
        others += [moved_imu(vehicle, axis, vehicle.imu_position_std) for axis in range(3)]
    for other in others:
        yield replace(flown, vehicle=other, model=regressor(other, velocity=flown.velocity))


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
