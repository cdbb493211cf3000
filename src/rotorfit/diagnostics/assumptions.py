"""What no flight can tell: mass, the rotors' distances, the scale of their speeds, the clock.

Thrown off by a factor all numbers stay consistent, so that they are said beside the result.
"""

from collections.abc import Sequence

import numpy as np

from rotorfit.dataset.dataset import Dataset
from rotorfit.fit.joint.joint_problem import JointConfiguration
from rotorfit.fit.joint.trims import ENOUGH_FLIGHTS, flights_of
from rotorfit.results.result import IdentificationResult

RPM = 60.0 / (2.0 * np.pi)


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
    parts.append(f"Jr and inertia are proportional to the log's clock ({seconds:.1f} s of flight)")
    parts += [
        _shared(c.name, len(flights))
        for c in configurations
        if len(flights := flights_of(c.factors)) >= ENOUGH_FLIGHTS
    ]
    return tuple(parts)


def _shared(configuration: str, flights: int) -> str:
    """Return what stays in the intervals of however many flights, in words."""
    return (
        f"{configuration}: what changes from flight to flight (trim, air, gusts) averages out over "
        f"{flights} flights; what all share does not, and stays in every interval: mass, arms and "
        "the place of the IMU, when the log has the motors' speed, what is not known of the "
        "autopilot's answer to gusts, and what the model lacks in all of them (drag, say)"
    )


def _distances(dataset: Dataset) -> str:
    """Return how far apart the rotors are, front to back and left to right."""
    x, y = np.ptp(dataset.vehicle.positions[:, :2], axis=0).tolist()
    return f"{1e3 * x:.0f} mm front to back, {1e3 * y:.0f} mm left to right"
