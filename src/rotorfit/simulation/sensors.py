"""The sensors and their errors, and the flight as simulated and as they logged it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.filters import first_order_recursion
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.simulation.body import rotation, times

if TYPE_CHECKING:
    from jaxtyping import Bool, Float
    from scipy.spatial.transform import Rotation

    from rotorfit.model.vehicle import Vehicle
    from rotorfit.simulation.truth import Truth


@frozen_dataclass
class Sensors:
    """Errors of the sensors: white noise, constant bias, and the smallest step of the log.

    - `gyro_std`, `accel_std`, `rotor_speed_std`: deviation of the noise [rad/s, m/s^2, rad/s].
    - `gyro_bias`, `accel_bias`: constant, body axes [rad/s, m/s^2].
    - `gyro_resolution`, `accel_resolution`, `rotor_speed_resolution`: smallest step; 0 for none
      [rad/s, m/s^2, rad/s].
    - `accel_cutoff`: of a Butterworth low-pass of second order, through which the accelerometer and
      its noise go before they are logged [Hz]; 0: none.
    - `velocity_std`, `velocity_bandwidth`: deviation of each component of the logged velocity's
      error, world axes [m/s], and its corner frequency [Hz]: it drifts as an estimator's does.
    - `position_std`, `attitude_std`: noise of each component of the motion-capture pose [m, rad].
    - `pose_rate`: frames of the motion capture [Hz]; 0: one with every sample of the log.
    - `pose_delay`: how much later than it was a pose stands in the log [s].
    """

    gyro_std: float = 0.0
    accel_std: float = 0.0
    rotor_speed_std: float = 0.0
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accel_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyro_resolution: float = 0.0
    accel_resolution: float = 0.0
    rotor_speed_resolution: float = 0.0
    accel_cutoff: float = 0.0
    velocity_std: float = 0.0
    velocity_bandwidth: float = 0.1
    position_std: float = 0.0
    attitude_std: float = 0.0
    pose_rate: float = 0.0
    pose_delay: float = 0.0


PERFECT: Final = Sensors()
"""No errors."""

TYPICAL: Final = Sensors(gyro_std=0.02, accel_std=0.4, rotor_speed_std=5.0)
"""White noise of a small multirotor at 200 Hz, vibration included."""


def measured(
    exact: Float[np.ndarray, "n k"],
    *,
    std: float,
    rng: np.random.Generator,
    bias: tuple[float, ...] = (0.0,),
    resolution: float = 0.0,
) -> Float[np.ndarray, "n k"]:
    """Log a quantity as a sensor: bias and noise added, then rounded to its steps."""
    values = exact + np.array(bias) + std * rng.normal(size=exact.shape)
    return rounded(values, resolution)


def rounded(values: Float[np.ndarray, "n k"], resolution: float) -> Float[np.ndarray, "n k"]:
    """Round to steps; 0: not at all."""
    return np.round(values / resolution) * resolution if resolution > 0 else values


def low_passed(
    values: Float[np.ndarray, "n k"], *, cutoff: float, sample_rate: float
) -> Float[np.ndarray, "n k"]:
    """Filter by a Butterworth low-pass of second order, at rest at the first row; 0 Hz: not."""
    if cutoff == 0.0:
        return values
    # 1 / (1 + sqrt(2) s + s^2) by the bilinear transform, s = (1 - 1/z) / (1 + 1/z) / k.
    k = float(np.tan(np.pi * cutoff / sample_rate))
    whole = 1.0 + 2.0**0.5 * k + k * k
    own, last, before = (
        k * k / whole,
        2.0 * (1.0 - k * k) / whole,
        (2.0**0.5 * k - 1.0 - k * k) / whole,
    )
    x = np.concatenate([values[:1], values[:1], values])
    y = x.copy()
    for n in range(2, len(x)):
        y[n] = own * (x[n] + 2.0 * x[n - 1] + x[n - 2]) + last * y[n - 1] + before * y[n - 2]
    return y[2:]


def at_place(
    specific_force: Float[np.ndarray, "n 3"],
    angular_velocity: Float[np.ndarray, "n 3"],
    angular_acceleration: Float[np.ndarray, "n 3"],
    *,
    position: tuple[float, float, float],
) -> Float[np.ndarray, "n 3"]:
    """Compute the specific force at a place [m] of the body: a + dw x r + w x (w x r)."""
    w, r = angular_velocity, np.array(position)
    return specific_force + np.cross(angular_acceleration, r) + np.cross(w, np.cross(w, r))


def gauss_markov(
    std: Float[np.ndarray, " k"],
    *,
    bandwidth: float,
    samples: int,
    sample_rate: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "n k"]:
    """Generate a stationary first-order Gauss-Markov process with a corner frequency [Hz]."""
    keep = float(np.exp(-2 * np.pi * bandwidth / sample_rate))
    noise = rng.normal(size=(samples, std.size))
    noise[1:] *= np.sqrt(1 - keep**2)
    process: Float[np.ndarray, "n k"] = first_order_recursion(noise, keep)
    return process * std


@frozen_dataclass
class SimulatedFlight:
    """A flight with known truth, at the sample instants.

    All exact quantities belong to one instant and satisfy the equations of motion to rounding.
    A command switches at the sample instant (later by the motor delay), and with it the rotor
    acceleration and, where rotors have inertia, the angular acceleration and the specific force:
    the values given are the limits from the right, under the new command.

    - `truth`, `vehicle`: what flew.
    - `sensors`: what measured it.
    - `sample_rate`: samples per second [Hz].
    - `time`: from the first sample [s].
    - `attitude_wxyz`: rotation of body (FLU) to world (z up) as a unit quaternion.
    - `position`: of the body origin, world axes [m].
    - `velocity`: of the body origin, world axes [m/s].
    - `specific_force`: acceleration minus gravity at the body origin, body axes [m/s^2].
    - `specific_force_imu`: the same at the accelerometer's place.
    - `angular_velocity`, `angular_acceleration`: body axes [rad/s, rad/s^2].
    - `rotor_speed`, `rotor_acceleration`: magnitude [rad/s], and its time derivative [rad/s^2].
    - `commanded_speed`: set at this sample and held until the next [rad/s].
    - `reference`: body rates that the attitude loop asked the rate loop for [rad/s].
    - `max_speed`: the speed that a full command asks for [rad/s].
    - `external_wrench`: force and torque about the body origin that neither rotors nor gravity
      exert: drag, disturbance, and the ground's reaction, body axes [N, N m].
    - `airborne`: False while the vehicle stands on the ground.
    - `gyro`, `accel`, `rotor_speed_measured`: as logged: body axes [rad/s], at the accelerometer's
      place [m/s^2], and [rad/s].
    - `velocity_measured`: velocity over ground as logged, body axes [m/s].
    - `pose_time`: when each frame of the motion capture was logged [s].
    - `position_measured`, `attitude_wxyz_measured`: as logged by motion capture, at `pose_time`.
    """

    truth: Truth
    vehicle: Vehicle
    sensors: Sensors
    sample_rate: float
    time: Float[np.ndarray, " n"]
    attitude_wxyz: Float[np.ndarray, "n 4"]
    position: Float[np.ndarray, "n 3"]
    velocity: Float[np.ndarray, "n 3"]
    specific_force: Float[np.ndarray, "n 3"]
    specific_force_imu: Float[np.ndarray, "n 3"]
    angular_velocity: Float[np.ndarray, "n 3"]
    angular_acceleration: Float[np.ndarray, "n 3"]
    rotor_speed: Float[np.ndarray, "n N"]
    rotor_acceleration: Float[np.ndarray, "n N"]
    commanded_speed: Float[np.ndarray, "n N"]
    reference: Float[np.ndarray, "n 3"]
    max_speed: float
    external_wrench: Float[np.ndarray, "n 6"]
    airborne: Bool[np.ndarray, " n"]
    gyro: Float[np.ndarray, "n 3"]
    accel: Float[np.ndarray, "n 3"]
    rotor_speed_measured: Float[np.ndarray, "n N"]
    velocity_measured: Float[np.ndarray, "n 3"]
    pose_time: Float[np.ndarray, " p"]
    position_measured: Float[np.ndarray, "p 3"]
    attitude_wxyz_measured: Float[np.ndarray, "p 4"]

    @property
    def command(self) -> Float[np.ndarray, "n N"]:
        """Commanded motor output, 0 (stopped) to 1 (full speed)."""
        return self.commanded_speed / self.max_speed

    @property
    def rotation_body_to_world(self) -> Rotation:
        """Attitude at each sample."""
        return from_wxyz(self.attitude_wxyz)

    @property
    def velocity_body(self) -> Float[np.ndarray, "n 3"]:
        """Velocity of the body origin, body axes [m/s]."""
        w, x, y, z = self.attitude_wxyz.T
        return np.column_stack(times(rotation((w, -x, -y, -z)), tuple(self.velocity.T)))


def measure(flight: SimulatedFlight, sensors: Sensors, *, seed: int) -> SimulatedFlight:
    """Measure the same flight by other sensors or with other noise."""
    from scipy.spatial.transform import Rotation  # slow to import

    rngs = _seed_generators(seed)
    s, place = sensors, flight.vehicle.imu_position or (0.0, 0.0, 0.0)
    a, w = flight.specific_force, flight.angular_velocity
    force = at_place(a, w, flight.angular_acceleration, position=place)
    felt = low_passed(
        measured(force, std=s.accel_std, rng=rngs[1], bias=s.accel_bias),
        cutoff=s.accel_cutoff,
        sample_rate=flight.sample_rate,
    )
    pose_time, place_seen, attitude_seen = _mocap_frames(flight, s)
    tilt = Rotation.from_rotvec(s.attitude_std * rngs[4].normal(size=place_seen.shape))
    return replace(
        flight,
        sensors=sensors,
        specific_force_imu=force,
        gyro=measured(
            w, std=s.gyro_std, rng=rngs[0], bias=s.gyro_bias, resolution=s.gyro_resolution
        ),
        accel=rounded(felt, s.accel_resolution),
        rotor_speed_measured=np.abs(
            measured(
                flight.rotor_speed,
                std=s.rotor_speed_std,
                rng=rngs[2],
                resolution=s.rotor_speed_resolution,
            )
        ),
        velocity_measured=_estimated_velocity(flight, s, rngs[5]),
        pose_time=pose_time,
        position_measured=measured(place_seen, std=s.position_std, rng=rngs[3]),
        attitude_wxyz_measured=to_wxyz(attitude_seen * tilt),
    )


def gyro_noise(sensors: Sensors, samples: int, *, seed: int) -> Float[np.ndarray, "n 3"]:
    """Generate the noise that `measure` will add to the gyro of a flight [rad/s]."""
    return sensors.gyro_std * _seed_generators(seed)[0].normal(size=(samples, 3))


def _seed_generators(seed: int) -> list[np.random.Generator]:
    """Seed a generator for each of gyro, accelerometer, rotors, position, attitude, velocity."""
    return np.random.default_rng(seed).spawn(6)


def _estimated_velocity(
    flight: SimulatedFlight, sensors: Sensors, rng: np.random.Generator
) -> Float[np.ndarray, "n 3"]:
    """Return the velocity over ground with the drifting error of an estimate, body axes [m/s]."""
    error = gauss_markov(
        np.full(3, sensors.velocity_std),
        bandwidth=sensors.velocity_bandwidth,
        samples=len(flight.time),
        sample_rate=flight.sample_rate,
        rng=rng,
    )
    return flight.rotation_body_to_world.inv().apply(flight.velocity + error)


def _mocap_frames(
    flight: SimulatedFlight, sensors: Sensors
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, "p 3"], Rotation]:
    """Find the times at which motion capture frames are logged, and the exact pose they show."""
    if sensors.pose_rate == 0 and sensors.pose_delay == 0:
        return flight.time, flight.position, flight.rotation_body_to_world
    last = float(flight.time[-1])
    time = flight.time
    if sensors.pose_rate > 0:
        time = np.arange(int(last * sensors.pose_rate + 1e-9) + 1) / sensors.pose_rate
    pose = np.concatenate([flight.position, flight.attitude_wxyz], axis=1)
    # The attitude of a simulation turns without jumps of sign.
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(flight.time, pose, k=5)
    # Before the flight begins, its first pose.
    seen = spline(np.clip(time - sensors.pose_delay, 0.0, last))
    return time, seen[:, :3], from_wxyz(seen[:, 3:])


def from_wxyz(attitude_wxyz: Float[np.ndarray, "n 4"]) -> Rotation:
    """Convert quaternions with the scalar first to rotations."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(np.roll(attitude_wxyz, -1, axis=1))


def to_wxyz(rotations: Rotation) -> Float[np.ndarray, "n 4"]:
    """Convert rotations to quaternions with the scalar first and not negative."""
    wxyz = np.roll(rotations.as_quat(), 1, axis=1)
    return np.where(wxyz[:, :1] < 0, -wxyz, wxyz)
