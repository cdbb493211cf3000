"""How the IMU sits in the vehicle, in words."""

import numpy as np

from rotorfit.flight.mounting import ImuTilt


def mounting_sentence(tilt: ImuTilt) -> str:
    """Return that the IMU is mounted turned, and what was done about it."""
    roll, pitch = np.degrees([tilt.roll, tilt.pitch]).tolist()
    parts = [
        f"{abs(angle):.1f} degrees {words[angle > 0]}"
        for angle, words in (
            (pitch, ("nose down", "nose up")),
            (roll, ("left side down", "right side down")),
        )
        if abs(angle) >= 1.0
    ]
    return (
        f"the IMU is mounted {' and '.join(parts)} against the plane of the rotors: in flight the "
        "thrust leans by that in its axes, and the flight is far likelier so. Its readings are "
        "turned back; measure the mounting, and declare it under [airframe] "
        f"(imu_tilt_deg = [{roll:.1f}, {pitch:.1f}])"
    )
