"""Is the IMU mounted turned against the rotors? Told by the likelihood of the flight itself.

A mean specific force that leans away from z is a turned IMU, a biased one, or the drag of fast
flight. Turned readings mix roll and pitch torques into yaw, which drag does not undo: where the
flight is much likelier with its readings turned back, the IMU is turned.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

from rotorfit.dataset.dataset import Dataset, levelled_flights
from rotorfit.estimation.banded import BandedEstimate
from rotorfit.fit.joint.joint_problem import JointConfiguration, joint_estimate
from rotorfit.fit.joint.term_choice import LEAST_GAIN
from rotorfit.preprocessing.imu_tilt import LEAST_TILT, ImuTilt, mean_force_tilt

Fitted = tuple[BandedEstimate, Sequence[JointConfiguration]]


def estimate_imu_tilt(dataset: Dataset, fitted: Callable[[Dataset], Fitted]) -> ImuTilt | None:
    """Return how the IMU is mounted, where the flights ask for it; else None.

    Parameters
    ----------
    dataset
        With the IMU's readings as recorded, and the timing of the motors.
    fitted
        The fit of flights, and its configurations with what counts.
    """
    tilt = mean_force_tilt([f.prepared.data for c in dataset.configurations for f in c.flights])
    if dataset.source != "imu" or tilt.angle < LEAST_TILT:
        return None
    level = levelled_flights(dataset, tilt)
    first, second = fitted(dataset), fitted(level)
    # Likelihoods compare on the same blocks alone, so on those that count for either.
    gains = [
        likelihood_on(second, level, first[1]) - first[0].log_likelihood,
        second[0].log_likelihood - likelihood_on(first, dataset, second[1]),
    ]
    return tilt if min(gains) > LEAST_GAIN * len(dataset.configurations) else None


def likelihood_on(fit: Fitted, dataset: Dataset, counted: Sequence[JointConfiguration]) -> float:
    """Return the log-likelihood of flights where the blocks of another fit count.

    Parameters
    ----------
    fit
        Of the flights.
    dataset
        The flights.
    counted
        The other fit's configurations.
    """
    joint = [
        replace(c, factors=factors, model=dataset.model)
        for c, factors in zip(counted, dataset.timed_bands, strict=True)
    ]
    return joint_estimate(joint, [], begin=fit[0].estimate.by_name).log_likelihood
