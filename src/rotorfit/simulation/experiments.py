"""Whole experiments to simulate: what flies in which configuration, and what its log holds.

What the scenarios are:

``paper``
    The experiment of Six et al. 2020, IV: vehicles A and B of Tables I and II, B being A with
    0.125 kg on +x and 0.042 kg on -y. Printed there: masses, k_t, k_d, first moments and moments
    of inertia, the payload's masses, 200 Hz, 60 to 90 s of manual flight inside 6 x 4 x 4 m, motion
    capture late by 5 ms or more, k_w = 2 for B. Not printed, and chosen here: arm 0.20 m; payload
    at 0.372 m and 0.40 m and 28 mm under the origin, which gives B's tables within their scatter;
    products of inertia 0.5e-4, 1e-4 and -1e-4 kg m^2; J_r = 2e-5 kg m^2 (an 8" propeller with its
    bell) in the variant ``real``; the motors' law `LAW`; lag 40 ms and delay 10 ms.
``single``
    One quad-x, its IMU off the body origin.
``hexa``
    One hexa-x, its IMU off the body origin.
``payload-pair``
    The quad-x as A; as B with 0.1 kg at both ends of one arm: the centre of mass stays.

Each configuration flies once for the fit and once for validation, from the ground and back.
"""

from __future__ import annotations

from dataclasses import replace
from math import cos, pi, sin
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

import numpy as np

from rotorfit.errors import ExperimentError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.vehicle import Rotor, Spin, Vehicle
from rotorfit.simulation.flight import Scenario, simulate_flight
from rotorfit.simulation.sensors import PERFECT, TYPICAL, Sensors, SimulatedFlight
from rotorfit.simulation.truth import GRAVITY, Truth, with_payload

if TYPE_CHECKING:
    from collections.abc import Callable

    from jaxtyping import Float

Layout = Literal["quad-x", "hexa-x", "octo", "x8", "hexa-tilted"]
Variant = Literal["clean", "lag", "noisy", "disturbed", "real"]

PAPER_ARM: Final = 0.20


class SimulatedVehicle(NamedTuple):
    """A vehicle to simulate.

    - `truth`: what it really is.
    - `vehicle`: what is known of it: where its rotors and its IMU are.
    """

    truth: Truth
    vehicle: Vehicle


def paper_vehicle(configuration: Literal["A", "B"]) -> SimulatedVehicle:
    """Build the quadrotor of Six et al. 2020, Tables I and II."""
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
    # B is A with 0.125 kg on +x and 0.042 kg on -y, as far out as the moments of Table II ask for.
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


def _place_on_ring(
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


def _divide_circle(number: int, start: float) -> list[float]:
    """Divide the circle evenly [rad]."""
    return [start + 2 * pi * i / number for i in range(number)]


_ROTORS: Final[dict[Layout, tuple[Rotor, ...]]] = {
    "quad-x": _place_on_ring(_divide_circle(4, pi / 4)),
    "hexa-x": _place_on_ring(_divide_circle(6, pi / 6)),
    "octo": _place_on_ring(_divide_circle(8, pi / 8)),
    "x8": _place_on_ring(_divide_circle(4, pi / 4), height=0.03)
    + _place_on_ring(_divide_circle(4, pi / 4), height=-0.03, first="cw"),
    "hexa-tilted": _place_on_ring(_divide_circle(6, pi / 6), tilt=pi / 9),
}


ScenarioName = Literal["paper", "single", "hexa", "payload-pair"]
Quality = Literal["clean", "lag", "noisy", "real"]

SECONDS: Final = 75.0
LEAST_SECONDS: Final = 15.0
GROUND_SECONDS: Final = 2.0
LAW: Final = (0.0, 1900.0, -450.0)
"""Rotor speed over command (0 to 1) as a polynomial, lowest power first [rad/s]."""
FULL_SPEED: Final = sum(LAW)
GYRO_BIAS: Final = (0.012, -0.008, 0.006)
ACCEL_BIAS: Final = (0.06, -0.04, 0.08)
POSE_RATE: Final = 100.0
POSE_DELAY: Final = 0.008
POSITION_STD: Final = 3e-4
ATTITUDE_STD: Final = 1e-3
"""Motion capture: frames per second, how late they are [s], and their noise [m, rad]."""
BATTERY_VOLTS: Final = (16.6, 15.2)
"""Voltages at the beginning and at the end of a flight [V]."""
LAW_VOLTS: Final = 16.0
"""Voltage at which the motors' law was measured [V]."""
PAIR_MASS: Final = 0.1
PAIR_ANGLE: Final = pi / 4


@frozen_dataclass
class FlownConfiguration:
    """One configuration of a simulated experiment.

    - `name`: its name; flights are named after it.
    - `simulated`: what flies, and what is known of it.
    - `sensors`: what measures it.
    - `weight`: the paper's k_w.
    """

    name: str
    simulated: SimulatedVehicle
    sensors: Sensors
    weight: float = 1.0


@frozen_dataclass
class ExperimentPlan:
    """A simulated experiment, before it is flown.

    - `scenario`, `quality`, `seed`, `seconds`: as asked for; seconds between take-off and landing
      of each flight [s].
    - `configurations`: each is flown once for the fit and once for validation.
    """

    scenario: ScenarioName
    quality: Quality
    seed: int
    seconds: float
    configurations: tuple[FlownConfiguration, ...]

    @property
    def states_lag(self) -> bool:
        """Whether the experiment says what the motors' lag and delay are."""
        return self.quality in ("clean", "lag")

    @property
    def lag_of_log(self) -> tuple[float, float]:
        """Lag and delay between the logged command and the rotor speed [s]."""
        truth = self.configurations[0].simulated.truth
        return (0.0, 0.0) if self.quality == "clean" else (truth.motor_lag, truth.motor_delay)

    @property
    def measures_speed(self) -> bool:
        """Whether the log has rotor speeds; else the commands have to do."""
        return self.quality == "real"


class PlannedFlight(NamedTuple):
    """One flight: its file, who flies, and the seed of sticks, air and noise."""

    file: str
    configuration: FlownConfiguration
    seed: int


def plan_experiment(
    scenario: ScenarioName, quality: Quality, *, seed: int, seconds: float = SECONDS
) -> ExperimentPlan:
    """Plan the flights of a scenario.

    Parameters
    ----------
    scenario
        See the module.
    quality
        ``"clean"``: the log has the command that holds each motor at its present speed, as speed
        controllers report it, and sensors are perfect. ``"lag"``: it has the autopilot's command,
        which acts with 40 ms of lag after 10 ms of delay, both stated in the experiment.
        ``"noisy"``: and noise and bias of all sensors, motion capture late by 8 ms, and nothing is
        said of the lag, as nobody knows it who has only a log. ``"real"``: and
        gusts, drag, rotor inertia, unequal rotors and a battery that sags under the law, so that
        rotor speed is measured.
    seed
        The same seed gives the same files.
    seconds
        Of each flight between take-off and landing [s].

    Raises
    ------
    ExperimentError
        If the flights would be too short to identify anything.
    """
    if not LEAST_SECONDS <= seconds <= 1000.0:
        raise ExperimentError(
            f"flights of {seconds:g} s: simulate between {LEAST_SECONDS:g} and 1000 s"
        )
    return ExperimentPlan(
        scenario=scenario,
        quality=quality,
        seed=seed,
        seconds=seconds,
        configurations=tuple(
            _with_quality(configuration, quality) for configuration in _VEHICLES[scenario]()
        ),
    )


def planned_flights(plan: ExperimentPlan) -> list[PlannedFlight]:
    """Plan the flights of an experiment: of each configuration one to fit, one to validate."""
    each = [(c, number) for c in plan.configurations for number in (1, 2)]
    seeds = np.random.SeedSequence(plan.seed).generate_state(len(each)).tolist()
    return [
        PlannedFlight(f"{configuration.name}{number}.csv", configuration, seed)
        for (configuration, number), seed in zip(each, seeds, strict=True)
    ]


def fly(plan: ExperimentPlan, flight: PlannedFlight) -> SimulatedFlight:
    """Simulate one flight of an experiment."""
    truth, vehicle = flight.configuration.simulated
    lift = truth.kt * float(vehicle.axes[:, 2].sum()) * FULL_SPEED**2
    scenario = Scenario(
        seconds=plan.seconds,
        ground_seconds=GROUND_SECONDS,
        sensors=flight.configuration.sensors,
        thrust_to_weight=lift / (truth.mass * GRAVITY),
    )
    return simulate_flight(truth, vehicle, scenario, seed=flight.seed)


def battery_volts(flight: SimulatedFlight) -> Float[np.ndarray, " n"]:
    """Compute the voltage of a battery that empties evenly [V]."""
    return np.linspace(*BATTERY_VOLTS, len(flight.time))


def command_of(
    speed: Float[np.ndarray, "n N"], volts: Float[np.ndarray, " n"] | float = LAW_VOLTS
) -> Float[np.ndarray, "n N"]:
    """Invert `LAW`: command (0 to 1) for a speed [rad/s], larger where the voltage [V] is less."""
    _, c1, c2 = LAW
    asked = speed * (LAW_VOLTS / np.broadcast_to(volts, len(speed)))[:, None]
    return np.minimum(2.0 * asked / (c1 + np.sqrt(c1**2 + 4.0 * c2 * asked)), 1.0)


def _with_quality(configuration: FlownConfiguration, quality: Quality) -> FlownConfiguration:
    """Add the imperfections of a variant to a configuration."""
    simulated, camera = configuration.simulated, replace(PERFECT, pose_rate=POSE_RATE)
    if quality == "clean":
        return replace(configuration, sensors=camera)
    if quality == "lag":
        return replace(configuration, simulated=variant(simulated, "lag")[0], sensors=camera)
    (truth, vehicle), sensors = variant(simulated, quality)
    delayed = SimulatedVehicle(replace(truth, motor_delay=0.01), vehicle)
    biased = replace(
        sensors,
        gyro_bias=GYRO_BIAS,
        accel_bias=ACCEL_BIAS,
        pose_rate=POSE_RATE,
        pose_delay=POSE_DELAY,
        position_std=POSITION_STD,
        attitude_std=ATTITUDE_STD,
    )
    return replace(configuration, simulated=delayed, sensors=biased)


def _paper_configurations() -> tuple[FlownConfiguration, ...]:
    return (
        FlownConfiguration(name="A", simulated=paper_vehicle("A"), sensors=PERFECT),
        FlownConfiguration(name="B", simulated=paper_vehicle("B"), sensors=PERFECT, weight=2.0),
    )


def _single_configuration(layout: Layout) -> tuple[FlownConfiguration, ...]:
    return (FlownConfiguration(name="A", simulated=layout_vehicle(layout), sensors=PERFECT),)


def _payload_pair() -> tuple[FlownConfiguration, ...]:
    simulated = layout_vehicle("quad-x")
    truth = simulated.truth
    arm = simulated.vehicle.arm
    for end in (1.0, -1.0):
        place = (end * arm * cos(PAIR_ANGLE), end * arm * sin(PAIR_ANGLE), 0.0)
        truth = with_payload(truth, mass=PAIR_MASS, position=place)
    loaded = SimulatedVehicle(truth, simulated.vehicle)
    return (
        FlownConfiguration(name="A", simulated=simulated, sensors=PERFECT),
        FlownConfiguration(name="B", simulated=loaded, sensors=PERFECT),
    )


_VEHICLES: Final[dict[ScenarioName, Callable[[], tuple[FlownConfiguration, ...]]]] = {
    "paper": _paper_configurations,
    "single": lambda: _single_configuration("quad-x"),
    "hexa": lambda: _single_configuration("hexa-x"),
    "payload-pair": _payload_pair,
}
