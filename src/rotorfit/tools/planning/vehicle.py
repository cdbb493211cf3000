"""A vehicle to plan for: the user's values, and guesses of the others from its geometry.

The guesses, and what they come from:

- propellers of 0.75 times the distance between neighbouring rotors;
- k_t = C_T rho D^4 / (4 pi^2) with C_T = 0.1, if no hover speed is given;
- k_d / k_t = 0.07 D (a torque coefficient of 0.045 over that C_T);
- inertia about the CoM of 0.28, 0.30 and 0.50 times mass and squared arm: frame and motors at the
  arms' ends, battery in the middle (small quadrotors have 0.25 to 0.5, 0.25 to 0.5, 0.45 to 0.8);
- J_r = Izz / 1000, a motor lag of 35 ms, and a CoM a little off and under the rotors' centre.

A factor of two in any of them moves the predictions in percent by much less than that.

Gusts are those under which the estimators were measured (0.1 N and 6, 6, 1.5 mN m at 3 Hz on a
quadrotor of 1.285 kg with arms of 0.2 m), in parts of the weight and of weight times arm, so that
they fit any size. Real flights: a 3-inch quadrotor in a hall 0.13 to 0.33 % of weight times arm in
roll and pitch, 0.06 to 0.15 % in yaw; a Crazyflie by its commands 2 %, as much as motors that
deviate by 3 % from their commands.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import ExperimentError
from rotorfit.fit.experiment.payload import PointMass
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import inertia_about
from rotorfit.simulation import GRAVITY, Truth, with_payload
from rotorfit.simulation.rotors import allocation

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Float

    from rotorfit.estimation.bound import Linearised
    from rotorfit.estimation.factors import Factors
    from rotorfit.model.vehicle import Vehicle

LIGHTEST: Final = 0.01
HEAVIEST: Final = 200.0
"""Masses that are believed [kg]."""
PER_KILOGRAM: Final = 1.0
"""The mass of a vehicle that is not weighed, in whose numbers all is per kilogram [kg]."""
SHORTEST: Final = 0.02
LONGEST: Final = 3.0
"""Arms that are believed [m]."""
PROPELLER: Final = 0.75
THRUST_COEFFICIENT: Final = 0.1
AIR_DENSITY: Final = 1.2
TORQUE_PER_THRUST: Final = 0.07
"""k_d over k_t, in propeller diameters."""
RADII_SQUARED: Final = {"Ixx": 0.28, "Iyy": 0.30, "Izz": 0.50}
"""Inertia about the CoM, in masses times squared arm."""
LAG: Final = 0.035
OFF_CENTER: Final = (0.01, -0.01, -0.05)
"""The CoM from the rotors' centre, in arms."""
COAXIAL: Final = 0.1
"""Rotors nearer than this to each other, in arms, work in each other's wash."""
WEAKEST_CONTROL: Final = 1e-3
"""Smallest singular value of the mixer, relative to the largest."""
PAYLOAD_SHARE: Final = 0.05
"""Each of two payload masses, as a share of the vehicle's."""
PLACE_STD: Final = (2e-3, 0.02)
"""How well the place of a payload is known: 2 mm, on short arms two hundredths of them."""

GUESSABLE: Final = ("Ixx", "Iyy", "Izz", "hover_speed", "kd_over_kt", "Jr", "motor_lag")
"""What a user may know better than the guess; inertia about the CoM, SI."""


@frozen_dataclass
class RoughVehicle:
    """A vehicle as assumed before it is identified; the geometry gave what is in `guessed`."""

    truth: Truth
    vehicle: Vehicle
    guessed: tuple[str, ...]


def rough_vehicle(
    vehicle: Vehicle, *, mass: float | None, known: Mapping[str, float] | None = None
) -> RoughVehicle:
    """Guess the unknown values of a vehicle, by the names of `GUESSABLE`, SI.

    A `mass` of None: not weighed; a vehicle of one kilogram, whatever its size. Raises
    `ExperimentError` where mass or arm cannot be right, or the rotors cannot steer it.
    """
    known = known or {}
    _check_arm(vehicle)
    if mass is not None:
        _check_mass(vehicle, mass)
    mass = PER_KILOGRAM if mass is None else mass
    _check_known(known)
    check_rotors(vehicle)
    arm = vehicle.arm
    diameter = PROPELLER * _nearest_distance(vehicle)
    body = _guess_inertia(mass, arm, known) | dict(known)
    _check_inertia(body)
    kt = _thrust_coefficient(vehicle, mass, diameter, body.get("hover_speed"))
    center = np.mean(vehicle.positions, axis=0) + arm * np.array(OFF_CENTER)
    about_com = np.array([body["Ixx"], body["Iyy"], body["Izz"], 0.0, 0.0, 0.0])
    x, y, z = (mass * center).tolist()
    xx, yy, zz, xy, xz, yz = inertia_about(about_com, mass, center).tolist()
    truth = Truth(
        mass=mass,
        first_moments=(x, y, z),
        inertia=(xx, yy, zz, xy, xz, yz),
        kt=kt,
        kd=kt * body.get("kd_over_kt", TORQUE_PER_THRUST * diameter),
        Jr=body.get("Jr", body["Izz"] / 1000.0),
        motor_lag=body.get("motor_lag", LAG),
    )
    guessed = tuple(name for name in GUESSABLE if name not in known)
    return RoughVehicle(truth=truth, vehicle=vehicle, guessed=guessed)


def check_rotors(vehicle: Vehicle) -> None:
    """Raise an error if no plan can be made for the rotors: coaxial ones, or too few to steer."""
    arm = max(vehicle.arm, 1e-9)
    if _nearest_distance(vehicle) < COAXIAL * arm:
        raise ExperimentError(
            "two rotors sit over each other: a coaxial pair shares its wash, which the simulated "
            "flights of a plan do not have; fly the manoeuvres of docs/plan.md and look at the "
            "intervals of  rotorfit identify"
        )
    thrust = np.cross(vehicle.positions / arm, vehicle.axes)
    drag = 0.05 * vehicle.spins[:, None] * vehicle.axes
    reach = np.linalg.svd(np.hstack([vehicle.axes[:, 2:], thrust - drag]), compute_uv=False)
    if len(reach) < 4 or reach[3] < WEAKEST_CONTROL * reach[0]:
        raise ExperimentError(
            f"these {len(vehicle.rotors)} rotors cannot roll, pitch, yaw and climb "
            "apart: check positions and spins (a tricopter's servo is not simulated)"
        )


def payload_pair(vehicle: Vehicle, mass: float, *, mass_std: float) -> tuple[PointMass, PointMass]:
    """Place two equal masses at opposite ends of one arm, with the tolerances of a careful hand.

    Under the rotors that are furthest from each other: that keeps the CoM where it is and changes
    the inertia most.
    """
    places = vehicle.positions
    distances: Float[np.ndarray, "N N"] = np.hypot(
        places[:, None, 0] - places[None, :, 0], places[:, None, 1] - places[None, :, 1]
    )
    first, second = divmod(int(np.argmax(np.round(distances, 9))), len(places))
    front, back = (
        PointMass(
            mass=mass,
            position=vehicle.rotors[int(i)].position,
            mass_std=mass_std,
            position_std=min(PLACE_STD[0], PLACE_STD[1] * vehicle.arm),
        )
        for i in (first, second)
    )
    return front, back


def payload_rotors(vehicle: Vehicle, payload: tuple[PointMass, ...]) -> tuple[int, ...]:
    """Return the numbers of the rotors, from 1, under which a payload sits."""
    places = [rotor.position for rotor in vehicle.rotors]
    return tuple(places.index(item.position) + 1 for item in payload)


def default_payload(mass: float) -> float:
    """Suggest a mass for each of the two [kg]: a twentieth of the vehicle, two digits."""
    wanted = PAYLOAD_SHARE * mass
    step = 10.0 ** math.floor(math.log10(wanted)) / 2.0
    return round(round(wanted / step) * step, 6)


def loaded(truth: Truth, payload: tuple[PointMass, ...]) -> Truth:
    """Add the payload to a vehicle."""
    for item in payload:
        truth = with_payload(truth, mass=item.mass, position=item.position)
    return truth


def _check_arm(vehicle: Vehicle) -> None:
    if not SHORTEST <= vehicle.arm <= LONGEST:
        raise ExperimentError(
            f"the rotors are {vehicle.arm:g} m from their centre, expected {SHORTEST:g} to "
            f"{LONGEST:g} m; lengths in the airframe file are metres"
        )


def _check_mass(vehicle: Vehicle, mass: float) -> None:
    if not (math.isfinite(mass) and LIGHTEST <= mass <= HEAVIEST):
        raise ExperimentError(
            f"a mass of {mass:g} kg, expected {LIGHTEST:g} to {HEAVIEST:g} kg; weigh the vehicle "
            "as it flies, battery included, and give kilograms"
        )
    load = mass / (math.pi * vehicle.arm**2)
    if not 0.3 <= load <= 300.0:
        raise ExperimentError(
            f"{mass:g} kg on arms of {vehicle.arm:g} m is {load:.3g} kg per square metre of rotor "
            "circle, expected 0.3 to 300; check that the mass is in kilograms and the arm in metres"
        )


def _check_known(known: Mapping[str, float]) -> None:
    for name, value in known.items():
        if name not in GUESSABLE:
            raise ExperimentError(f"no {name!r} to set; known: {', '.join(GUESSABLE)}")
        if not (math.isfinite(value) and value > 0):
            raise ExperimentError(f"{name} = {value:g}, expected more than 0, in SI units")


def _guess_inertia(mass: float, arm: float, known: Mapping[str, float]) -> dict[str, float]:
    """Guess the inertia about the CoM, in proportion to its known elements [kg m^2]."""
    guess = {name: share * mass * arm**2 for name, share in RADII_SQUARED.items()}
    found = [known[name] / guess[name] for name in guess if name in known]
    factor = float(np.mean(found)) if found else 1.0
    return {name: factor * value for name, value in guess.items()}


def _check_inertia(body: Mapping[str, float]) -> None:
    diagonal = [body[name] for name in RADII_SQUARED]
    if 2.0 * max(diagonal) > sum(diagonal):
        shown = ", ".join(f"{name} = {body[name]:.3g}" for name in RADII_SQUARED)
        raise ExperimentError(
            f"no body has the inertia {shown}: the largest is more than the two others together; "
            "give all three in kg m^2 about the centre of mass"
        )


def _nearest_distance(vehicle: Vehicle) -> float:
    """Compute the smallest distance between two rotors, seen from above [m]."""
    places: Float[np.ndarray, "N 2"] = vehicle.positions[:, :2]
    distances = np.linalg.norm(places[:, None] - places[None, :], axis=2)
    return float(distances[~np.eye(len(places), dtype=bool)].min())


def _thrust_coefficient(
    vehicle: Vehicle, mass: float, diameter: float, hover_speed: float | None
) -> float:
    if hover_speed is None:
        return THRUST_COEFFICIENT * AIR_DENSITY * diameter**4 / (4.0 * math.pi**2)
    return mass * GRAVITY / (float(vehicle.axes[:, 2].sum()) * hover_speed**2)


REFERENCE_RATE: Final = 200.0
"""The rate at which noise of a sample is given [Hz]: it is white, and only its density counts."""


@frozen_dataclass
class Assumptions:
    """Levels of noise and disturbance.

    - `gyro_std`, `accel_std`: of a sample at 200 Hz, vibration included [rad/s, m/s^2].
    - `speed_noise`: of a measured rotor speed at 200 Hz, as a share of the hover speed.
    - `speed_error`: of a commanded rotor speed: the motor's deviation from its command, a
      first-order Gauss-Markov process of the gusts' corner, as a share of the hover speed.
    - `force`, `torque`: gusts: each force [weights]; torques about x, y, z [weights times arm].
    - `corner`: of gusts and speed errors [Hz].
    - `mass_step`: the scale's [kg]: mass is known to half of it.
    - `log_rate`: of the log [Hz]; motor data are timed to a fraction of a sample.
    """

    gyro_std: float = 0.02
    accel_std: float = 0.4
    speed_noise: float = 0.005
    speed_error: float = 0.01
    force: float = 0.008
    torque: tuple[float, float, float] = (0.0024, 0.0024, 0.0006)
    corner: float = 3.0
    mass_step: float = 1e-3
    log_rate: float = 200.0


def assumptions_for(mass: float, *, log_rate: float = REFERENCE_RATE) -> Assumptions:
    """Return the assumptions for a vehicle; a light one is weighed on a finer scale."""
    return Assumptions(mass_step=1e-4 if mass < 0.2 else 1e-3, log_rate=log_rate)


def hover_speed(truth: Truth, vehicle: Vehicle) -> float:
    """Return the rotor speed that carries the weight [rad/s]."""
    lift = truth.kt * float(vehicle.axes[:, 2].sum())
    return float(np.sqrt(truth.mass * GRAVITY / lift))


def disturbance_std(
    assumed: Assumptions, truth: Truth, vehicle: Vehicle, *, commanded: bool
) -> Float[np.ndarray, " 6"]:
    """Compute the deviation of the disturbing force [N] and torque [N m]; body axes.

    With commands the motors' errors come in, independent for each rotor.
    """
    weight = truth.mass * GRAVITY
    gusts = weight * np.array([*[assumed.force] * 3, *(vehicle.arm * np.array(assumed.torque))])
    if not commanded:
        return gusts
    per_square = allocation(vehicle, kt=truth.rotor_kt(len(vehicle.rotors)), kd=truth.kd)
    rotors = per_square * (2.0 * assumed.speed_error * hover_speed(truth, vehicle) ** 2)
    return np.hypot(gusts, np.linalg.norm(rotors, axis=1))


def row_variances(
    assumed: Assumptions,
    model: Linearised,
    factors: Factors,
    *,
    disturbance: Float[np.ndarray, " 6"],
    sample_rate: float,
) -> Float[np.ndarray, "b 6"]:
    """Compute the variance of the six accelerations' errors per row of each band.

    A row is the real or the imaginary part of a line scaled to unit window energy: of a process
    with the one-sided density S it has the variance S times the sample rate over four.

    - `assumed`: levels of noise.
    - `model`: how residuals of the equations and noise of the rotors' signals become acceleration.
    - `factors`: of the flight, their `noise` that of the measured rotor speeds.
    - `disturbance`: deviation of force and torque [N, N m].
    - `sample_rate`: of the flight [Hz].
    """
    f = factors.band.mean(axis=1)[:, None]
    white = 0.5 * sample_rate / REFERENCE_RATE
    turn = 2.0 * np.pi * f / REFERENCE_RATE
    average, difference = (4.0 + 2.0 * np.cos(turn)) / 6.0, np.sin(turn) * REFERENCE_RATE
    accel = white * (assumed.accel_std * average) ** 2 * np.ones(3)
    gyro = white * (assumed.gyro_std * difference) ** 2 * np.ones(3)
    spectrum = 0.25 * sample_rate * 2.0 / (np.pi * assumed.corner) / (1 + (f / assumed.corner) ** 2)
    gusts = spectrum * ((model.of_residual * disturbance) ** 2).sum(axis=1)
    return np.hstack([accel, gyro]) + gusts + factors.known_noise @ (model.error**2).T
