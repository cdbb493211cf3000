"""Vehicles of known truth: the two of Six et al. 2020, and other rotor layouts for tests."""

from dataclasses import replace
from math import cos, pi, sin
from typing import Final, Literal, NamedTuple

import numpy as np

from rotorfit.model.vehicle import Rotor, Spin, Vehicle
from rotorfit.simulation.sensors import PERFECT, TYPICAL, Sensors
from rotorfit.simulation.truth import Truth, with_payload

Layout = Literal["quad-x", "hexa-x", "octo", "x8", "hexa-tilted"]
Variant = Literal["clean", "lag", "noisy", "disturbed", "real"]

PAPER_ARM: Final = 0.20


class SimulatedVehicle(NamedTuple):
    """A vehicle to simulate.

    Attributes
    ----------
    truth
        What it really is.
    vehicle
        What is known of it: where its rotors and its IMU are.
    """

    truth: Truth
    vehicle: Vehicle


def paper_vehicle(configuration: Literal["A", "B"]) -> SimulatedVehicle:
    """Build the quadrotor of Six et al. 2020, Tables I and II.

    Rotors 1, 2 at y = -d, +d turn counter-clockwise, 3, 4 at x = +d, -d clockwise. B is A with
    0.125 kg on +x and 0.042 kg on -y, as far out as the moments of Table II ask for.
    """
    d = PAPER_ARM
    places: tuple[tuple[tuple[float, float, float], Spin], ...] = (
        ((0.0, -d, 0.0), "ccw"),
        ((0.0, d, 0.0), "ccw"),
        ((d, 0.0, 0.0), "cw"),
        ((-d, 0.0, 0.0), "cw"),
    )
    rotors = tuple(Rotor(position=position, spin=spin) for position, spin in places)
    truth = Truth(
        mass=1.285,
        first_moments=(-4.5e-3, -1.9e-3, -8.3e-3),
        inertia=(0.0182, 0.0186, 0.0288, 0.5e-4, 1e-4, -1e-4),
        kt=3.63e-6,
        kd=5.11e-8,
    )
    if configuration == "B":
        for mass, position in PAPER_PAYLOAD:
            truth = with_payload(truth, mass=mass, position=position)
    return SimulatedVehicle(truth, Vehicle(rotors=rotors, imu_position=(0.0, 0.0, 0.0)))


PAPER_PAYLOAD: Final = ((0.125, (0.372, 0.0, -0.028)), (0.042, (0.0, -0.40, -0.028)))
"""Mass [kg] and position from the body origin [m] of what B carries beyond A."""


def layout_vehicle(layout: Layout) -> SimulatedVehicle:
    """Build a vehicle of another rotor layout; its IMU is off the body origin.

    ``"x8"`` has four coaxial pairs; ``"hexa-tilted"`` has its rotors turned by 20 degrees about
    their arms, to alternate sides, so that it can push sideways.
    """
    rotors = _ROTORS[layout]
    N = len(rotors)
    truth = Truth(
        mass=0.35 * N,
        first_moments=(3e-3 * N, -2e-3 * N, -4e-3 * N),
        inertia=(6e-3 * N, 7e-3 * N, 1.1e-2 * N, 5e-5 * N, -8e-5 * N, 6e-5 * N),
        kt=4e-6,
        kd=6e-8,
    )
    return SimulatedVehicle(truth, Vehicle(rotors=rotors, imu_position=(0.02, -0.01, 0.03)))


def variant(simulated: SimulatedVehicle, name: Variant) -> tuple[SimulatedVehicle, Sensors]:
    """Give a vehicle and its sensors the imperfections of a study.

    ``"clean"``: none. ``"lag"``: 10 ms until a command acts, for studies of logs that hold commands
    only. ``"noisy"``: white sensor noise. ``"disturbed"``: noisy with a disturbing wrench.
    ``"real"``: disturbed with rotor inertia, drag, unequal rotors, and an accelerometer bias.
    """
    truth, vehicle = simulated
    if name == "clean":
        return simulated, PERFECT
    if name == "lag":
        return SimulatedVehicle(replace(truth, motor_delay=0.01), vehicle), PERFECT
    if name == "noisy":
        return simulated, TYPICAL
    truth = replace(
        truth,
        disturbance_force_std=(0.1, 0.1, 0.1),
        disturbance_torque_std=(6e-3, 6e-3, 1.5e-3),
    )
    if name == "disturbed":
        return SimulatedVehicle(truth, vehicle), TYPICAL
    spread = np.resize([1.02, 0.98, 1.01, 0.99], len(vehicle.rotors))
    truth = replace(truth, Jr=2e-5, drag=(0.2, 0.2, 0.2), kt_spread=tuple(spread.tolist()))
    return SimulatedVehicle(truth, vehicle), replace(TYPICAL, accel_bias=(0.1, 0.1, 0.1))


def _ring(
    angles: list[float], *, height: float = 0.0, first: Spin = "ccw", tilt: float = 0.0
) -> tuple[Rotor, ...]:
    """Place rotors at angles from x [rad] on a circle of 0.25 m, spins and tilts alternating."""
    spins: tuple[Spin, Spin] = ("ccw", "cw") if first == "ccw" else ("cw", "ccw")
    rotors: list[Rotor] = []
    for number, angle in enumerate(angles):
        c, s = cos(angle), sin(angle)
        lean = tilt if number % 2 == 0 else -tilt
        axis = (sin(lean) * s, -sin(lean) * c, cos(lean))  # turned about the arm (c, s, 0)
        place = (0.25 * c, 0.25 * s, height)
        rotors.append(Rotor(position=place, spin=spins[number % 2], axis=axis))
    return tuple(rotors)


def _even(number: int, start: float) -> list[float]:
    """Divide the circle evenly [rad]."""
    return [start + 2 * pi * i / number for i in range(number)]


_ROTORS: Final[dict[Layout, tuple[Rotor, ...]]] = {
    "quad-x": _ring(_even(4, pi / 4)),
    "hexa-x": _ring(_even(6, pi / 6)),
    "octo": _ring(_even(8, pi / 8)),
    "x8": _ring(_even(4, pi / 4), height=0.03) + _ring(_even(4, pi / 4), height=-0.03, first="cw"),
    "hexa-tilted": _ring(_even(6, pi / 6), tilt=pi / 9),
}
