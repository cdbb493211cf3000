"""What the numbers rest on: what was declared, and what logs say of vehicle and motors.

Mass, the rotors' distances, the scale of their speeds, of the gyro and of the clock: thrown off by
a factor, all numbers stay consistent; the place of the IMU is that of the centre of mass. No flight
shows it, so that these are said beside the result.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorfit.dataset.dataset import Dataset, LoadedFlight
from rotorfit.diagnostics.sensors.sensor_faults import lowpass_sentence
from rotorfit.experiment.experiment import MotorsEntry
from rotorfit.findings import Finding, note
from rotorfit.fit.joint.joint_problem import JointConfiguration
from rotorfit.fit.joint.trims import ENOUGH_FLIGHTS, flights_of
from rotorfit.logs.flight_log import SITL, simulated_sentence
from rotorfit.preprocessing.motors.thrust_curve import ThrustCurve
from rotorfit.results.result import IdentificationResult

RPM = 60.0 / (2.0 * np.pi)


def with_assumptions(
    result: IdentificationResult, dataset: Dataset, configurations: Sequence[JointConfiguration]
) -> IdentificationResult:
    """Add what the numbers rest on to the settings of a result; see `assumptions`."""
    rests_on = list(assumptions(result, dataset, configurations))
    used = {**result.settings["used"], "hangs_on": rests_on}
    return replace(result, settings={**result.settings, "used": used})


def assumptions(
    result: IdentificationResult, dataset: Dataset, configurations: Sequence[JointConfiguration]
) -> tuple[str, ...]:
    """List what the numbers are proportional to among what was declared, a sentence for each.

    `configurations`: of the joint fit; empty for methods without one.
    """
    masses = [f"{c.mass:g} kg" for c in dataset.configurations if c.entry.mass != "unknown"]
    parts = [
        f"kd, Jr and inertia are proportional to the rotors' distances ({_distances(dataset)})"
    ]
    if masses:
        parts.insert(
            0, f"kt, kd, Jr and inertia are proportional to the mass ({', '.join(masses)})"
        )
    hover = next((d.value for d in result.derived if d.name == "hover_speed"), None)
    if hover is not None and (dataset.motors.speed == "measured" or dataset.speeds_commanded):
        parts.append(
            "kt and kd are proportional to the inverse square of rotor speed (hover at "
            f"{hover:.0f} rad/s, {RPM * hover:.0f} rpm)"
        )
    seconds = sum(f.recorded.seconds for c in dataset.configurations for f in c.flights)
    clock = f"Jr and inertia are proportional to the log's clock ({seconds:.1f} s of flight)"
    scale = ", and inertia to the inverse of the gyro's scale" if dataset.source == "imu" else ""
    parts.append(f"{clock}{scale}")
    parts.append(_imu_place(dataset))
    parts += [
        _shared(c.name, len(flights))
        for c in configurations
        if len(flights := flights_of(c.factors)) >= ENOUGH_FLIGHTS
    ]
    return tuple(parts)


def _shared(configuration: str, flights: int) -> str:
    """Describe the uncertainty that no number of flights averages out."""
    return (
        f"{configuration}: {flights} flights average out what changes between them (trim, air, "
        "gusts), but not what they share, which stays in every interval: mass, arms, place of the "
        "IMU, time stamps of the motor data, the autopilot's response to gusts, and effects that "
        "the model lacks (drag, say)"
    )


def _imu_place(dataset: Dataset) -> str:
    """Describe the numbers that depend on the place of the IMU, and on its height."""
    place = dataset.vehicle.imu_position
    if place is None or dataset.source == "mocap":
        return "com_x, com_y, com_z and inertia at the origin are counted from the origin"
    x, y, z = (1e3 * length for length in place)
    return (
        f"the centre of mass is as good as the declared place of the IMU ({x:.0f}, {y:.0f}, "
        f"{z:.0f} mm): an IMU 1 mm higher moves com_z by 1 mm, one 1 mm further forward or left "
        "com_x or com_y by up to 1 mm"
    )


def _distances(dataset: Dataset) -> str:
    """Return how far apart the rotors are, front to back and left to right."""
    x, y = np.ptp(dataset.vehicle.positions[:, :2], axis=0).tolist()
    return f"{1e3 * x:.0f} mm front to back, {1e3 * y:.0f} mm left to right"


def log_metadata(declared: MotorsEntry, dataset: Dataset) -> tuple[Finding, ...]:
    """Note what was taken from the logs, and which of them a simulator flew."""
    flights = [flight for c in dataset.configurations for flight in c.flights]
    simulated = [simulated_sentence(f.log.simulator) for f in flights if f.log.simulator]
    yaw = [_yaw_of_sitl(f) for f in flights if f.log.simulator == SITL]
    logged, law = flights[0].log.motors, ""
    if logged is not None and declared.law is None and dataset.motors.law is not None:
        battery = ""
        if dataset.motors.law.voltage is not None:
            battery = f", at {dataset.motors.law.voltage.nominal:g} V"
        law = (
            f"the law from command to rotor speed is the one in the log ({logged.words}{battery}): "
            "only as good as these settings; a law under [motors] replaces it"
        )
    every = [*simulated, *yaw, lowpass_sentence(dataset) or "", law]
    return tuple(note("log-metadata", sentence) for sentence in dict.fromkeys(every) if sentence)


def _yaw_of_sitl(flight: LoadedFlight) -> str:
    """Explain by how much SITL's yaw torque changes more than one proportional to squared speed.

    With thrust T = (1 - f) c + f c^2 of a command c, and torque proportional to c T, the torque
    changes with T by c + T / T', where the mean is c.
    """
    law = flight.motors.law
    if law is None or law.sqrt is None:
        return ""
    curve = ThrustCurve(factor=law.sqrt.thr_mdl_fac, error=0.0)
    thrust = float((flight.prepared.motor_channel**2).mean()) / law.sqrt.full_speed**2
    c, f = curve.command(thrust), curve.factor
    more = 1.0 + thrust / (c * (1.0 - f + 2.0 * f * c))
    return (
        f"its yaw torque changes {more:.2f} times as much as a torque proportional to thrust "
        f"would: kd, kd/kt and kd/Izz describe changes about hover, {more:.2f} times "
        "their values in hover"
    )
