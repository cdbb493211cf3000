"""What no flight can tell: the mass, the rotors' distances and the scale of their speeds.

Thrown off by a factor all numbers stay consistent, so that they are said beside the result.
"""

import numpy as np

from rotorfit.fit.flights import Flown
from rotorfit.results.parameter_tables import Tables

RPM = 60.0 / (2.0 * np.pi)


def what_numbers_hang_on(tables: Tables, flown: Flown) -> str:
    """Return the sentence that names what was declared, and what is in proportion to it."""
    masses = [f"{c.mass:g} kg" for c in flown.configurations if c.entry.mass != "unknown"]
    distances = f"to the rotors' distances ({_distances(flown)})"
    if masses:
        parts = [
            f"kt, kd, Jr and inertia are proportional to the mass ({', '.join(masses)})",
            f"kd, Jr and inertia {distances}",
        ]
    else:
        parts = [f"kd, Jr and inertia are proportional {distances}"]
    hover = next((d.value for d in tables.derived if d.name == "hover_speed"), None)
    if hover is not None and (flown.motors.speed == "measured" or flown.speeds_commanded):
        parts.append(
            f"kt and kd to the inverse square of rotor speed (hover at {hover:.0f} rad/s, "
            f"{RPM * hover:.0f} rpm)"
        )
    return f"no flight tells these, see that they are right: {'; '.join(parts)}"


def _distances(flown: Flown) -> str:
    """Return how far apart the rotors are, front to back and left to right."""
    x, y = np.ptp(flown.vehicle.positions[:, :2], axis=0).tolist()
    return f"{1e3 * x:.0f} mm front to back, {1e3 * y:.0f} mm left to right"
