"""How the IMU sits in the vehicle, in words."""

import numpy as np

from rotorfit.fit.flights import Flown
from rotorfit.flight.mounting import LEAST_LEAN, ImuTilt, lean, lean_words


def mounting_sentence(tilt: ImuTilt) -> str:
    """Return that the IMU is mounted turned, and what was done about it."""
    roll, pitch = np.degrees([tilt.roll, tilt.pitch]).tolist()
    return (
        f"the IMU is mounted {lean_words(tilt)} against the plane of the rotors: in flight the "
        "thrust leans by that in its axes, and the flight is far likelier so. Its readings are "
        "turned back; measure the mounting, and declare it under [airframe] "
        f"(imu_tilt_deg = [{roll:.1f}, {pitch:.1f}])"
    )


def lean_sentence(flown: Flown) -> tuple[str, ...]:
    """Return that the thrust leans in the IMU's axes and nothing tells why, in words."""
    tilt = lean([f.prepared.data for c in flown.configurations for f in c.flights])
    if flown.source != "imu" or tilt.angle < LEAST_LEAN:
        return ()
    roll, pitch = np.degrees([tilt.roll, tilt.pitch]).tolist()
    return (
        f"in flight the thrust leans as if the IMU were mounted {lean_words(tilt)} (sound logs: "
        "up to 4.5 degrees), and the flight does not tell whether it is, or the accelerometer is "
        "biased, or drag of fast flight leans it: measure the mounting and declare it under "
        f"[airframe] (imu_tilt_deg = [{roll:.1f}, {pitch:.1f}]); until then trust neither kd, Jr "
        "nor the inertia about z",
    )
