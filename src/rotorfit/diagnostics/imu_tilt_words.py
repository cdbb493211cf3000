"""How the IMU sits in the vehicle, in words."""

import numpy as np

from rotorfit.dataset.dataset import Dataset
from rotorfit.preprocessing.imu_tilt import LEAST_TILT, ImuTilt, mean_force_tilt, tilt_phrase


def mounting_sentence(tilt: ImuTilt) -> str:
    """Return that the IMU is mounted turned, and what was done about it."""
    roll, pitch = np.degrees([tilt.roll, tilt.pitch]).tolist()
    return (
        f"the IMU is mounted {tilt_phrase(tilt)} relative to the plane of the rotors: in flight "
        "the thrust is tilted by that angle in the IMU's axes, and the flight fits far better with "
        "it. The readings are turned back; measure the mounting, and declare it under [airframe] "
        f"(imu_tilt_deg = [{roll:.1f}, {pitch:.1f}])"
    )


def lean_sentence(dataset: Dataset) -> tuple[str, ...]:
    """Return that the thrust leans in the IMU's axes and nothing tells why, in words."""
    tilt = mean_force_tilt([f.prepared.data for c in dataset.configurations for f in c.flights])
    if dataset.source != "imu" or tilt.angle < LEAST_TILT:
        return ()
    roll, pitch = np.degrees([tilt.roll, tilt.pitch]).tolist()
    return (
        f"in flight the thrust is tilted as if the IMU were mounted {tilt_phrase(tilt)} (good "
        "logs: up to 4.5 degrees); the flight does not show whether it is, or whether a biased "
        "accelerometer or drag in fast flight is the cause: measure the mounting and declare it "
        f"under [airframe] (imu_tilt_deg = [{roll:.1f}, {pitch:.1f}]); until then do not trust "
        "kd, Jr and the inertia about z",
    )
