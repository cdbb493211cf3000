"""Estimate the tilt of the IMU against the rotors, and correct its readings before the fit.

A mean specific force that leans away from z is a turned IMU, a biased one, or the drag of fast
flight where no velocity tells it. Turned readings mix roll and pitch torques into yaw, which drag
does not undo: where the flight is much likelier with its readings turned back, the IMU is turned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.banded import BandedEstimate
from rotorfit.estimation.distributions import student_quantile
from rotorfit.findings import Evidence, Finding, doubt
from rotorfit.fit.experiment.declared_vehicle import with_imu_tilt
from rotorfit.fit.joint.joint_fit import joint_fit
from rotorfit.fit.joint.joint_problem import JointConfiguration, joint_estimate
from rotorfit.fit.joint.term_choice import LEAST_GAIN
from rotorfit.fit.reduction.frequency_bands import STRETCH
from rotorfit.fit.rest_tilt import rest_denies_tilt, rest_sentence
from rotorfit.fit.timing.timed_dataset import TimedDataset, tilt_corrected_flights
from rotorfit.fit.timing.timing_fit import find_timing, timed_again
from rotorfit.flight.imu_tilt import (
    LEAST_TILT,
    ImuTilt,
    force_without_drag,
    mean_force_tilt,
    tilt_phrase,
)
from rotorfit.model.terms.registry import DEFAULT_TERMS

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.fit.experiment.experiment import Experiment
    from rotorfit.flight.flight_data import FlightData

FEWEST_PARTS: Final = 3
"""Whose scatter is informative."""
LEANING: Final = (
    *("kt", "kd", "Jr", "Izz", "kd_over_Izz", "Jr_over_Izz"),
    *("msx", "msy", "com_x", "com_y"),
)
"""Numbers that a lean of unknown cause bends. In wind of 8 and 11 m/s without its velocity (twelve
simulated flights) k_t was 2.0 and 3.0 half-widths off (rms), k_d/I_zz 1.5, the centre of mass 1."""
Fitted = tuple[BandedEstimate, Sequence[JointConfiguration]]


def estimate_imu_tilt(dataset: TimedDataset) -> tuple[ImuTilt, Fitted] | None:
    """Estimate the tilt of the IMU; None if the flights are not far likelier with it.

    With the fit of the flights that are corrected by it.
    """
    tilt = mean_force_tilt([f.prepared.data for f in dataset.flights])
    if dataset.source != "imu" or tilt.angle < LEAST_TILT:
        return None
    level = tilt_corrected_flights(dataset, tilt)
    first, second = joint_fit(dataset), joint_fit(level)
    # Likelihoods compare on the same blocks alone, so on those that count for either.
    gains = [
        likelihood_on(second, level, first[1]) - first[0].log_likelihood,
        second[0].log_likelihood - likelihood_on(first, dataset, second[1]),
    ]
    shown = min(gains) > LEAST_GAIN * len(dataset.configurations)
    return (tilt, second) if shown else None


def likelihood_on(
    fit: Fitted, dataset: TimedDataset, counted: Sequence[JointConfiguration]
) -> float:
    """Compute the log-likelihood of a fit on the informative blocks of another fit."""
    joint = [
        replace(c, factors=factors, model=dataset.model)
        for c, factors in zip(counted, dataset.timed_bands, strict=True)
    ]
    return joint_estimate(joint, [], begin=fit[0].estimate.by_name).log_likelihood


def correct_imu_tilt(
    experiment: Experiment, dataset: TimedDataset
) -> tuple[Experiment, TimedDataset, tuple[Finding, ...]]:
    """Turn the readings into the rotors' axes where the flights show that the IMU is tilted."""
    if experiment.airframe.imu_tilt_deg is not None:
        return experiment, dataset, ()
    estimated, lean = estimate_imu_tilt(dataset), lean_evidence(dataset)
    if estimated is None:
        sentence = lean_sentence(dataset)
        leans = () if sentence is None else (_doubt_lean(sentence, lean),)
        return experiment, dataset, leans
    tilt, corrected = estimated
    rest = rest_denies_tilt([f.prepared.data for f in dataset.flights], tilt)
    if rest is not None:
        return experiment, dataset, (_doubt_lean(rest_sentence(tilt, rest), lean),)
    dataset = tilt_corrected_flights(dataset, tilt).reduced()
    near = dataset.motor_timing
    if near is not None:
        begin = corrected[0].estimate.by_name  # at the timing that was found before
        again = timed_again(dataset, DEFAULT_TERMS, begin=begin)
        timing = find_timing(dataset, near=near) if again is dataset else again.motor_timing
        dataset = replace(dataset, motor_timing=timing)
    found = doubt("imu-tilt", mounting_sentence(tilt), evidence=lean)
    return with_imu_tilt(experiment, tilt), dataset, (found,)


def mounting_sentence(tilt: ImuTilt) -> str:
    """Explain that the IMU is mounted turned, and that its readings are turned back."""
    roll, pitch = np.degrees([tilt.roll, tilt.pitch]).tolist()
    return (
        f"the IMU is mounted {tilt_phrase(tilt)} relative to the plane of the rotors: in flight "
        "the thrust is tilted by that angle in the IMU's axes, and the flight fits far better with "
        "it. rotorfit corrects the readings; measure the mounting, and declare it under [airframe] "
        f"(imu_tilt_deg = [{roll:.1f}, {pitch:.1f}])"
    )


def lean_evidence(dataset: TimedDataset) -> tuple[Evidence, ...]:
    """Estimate the lean of the thrust in the IMU's axes, by the scatter of the flights' parts."""
    flights = [f.prepared.data for f in dataset.flights]
    parts = np.array([part for data in flights for part in _mean_forces(data)])
    half = np.inf
    if len(parts) >= FEWEST_PARTS:
        spread = parts.std(axis=0, ddof=1) / np.sqrt(len(parts))
        t = float(student_quantile(0.975, len(parts) - 1))
        half = t * float(np.linalg.norm(spread[:2] / parts.mean(axis=0)[2]))
    angle = mean_force_tilt(flights).angle
    interval = (angle - half, angle + half) if np.isfinite(half) else None
    return (Evidence(name="imu_lean", value=angle, interval=interval, limit=LEAST_TILT),)


def _mean_forces(data: FlightData) -> Float[np.ndarray, "p 3"]:
    """Return the mean specific force of each stretch of a flight, without drag [m/s^2]."""
    force = force_without_drag(data)
    count = max(round(len(force) / (STRETCH * data.sample_rate)), 1)
    return np.array([rows.mean(axis=0) for rows in np.array_split(force, count)])


def lean_sentence(dataset: TimedDataset) -> str | None:
    """Explain that the thrust leans in the IMU's axes for a cause that the flight does not show.

    None where the parts of the flights lean by so different angles that it may be chance.
    """
    tilt = mean_force_tilt([f.prepared.data for f in dataset.flights])
    if dataset.source != "imu" or tilt.angle < LEAST_TILT:
        return None
    (lean,) = lean_evidence(dataset)
    if lean.interval is not None and lean.interval[0] < LEAST_TILT:
        return None
    roll, pitch = np.degrees([tilt.roll, tilt.pitch]).tolist()
    return (
        f"in flight the thrust is tilted as if the IMU were mounted {tilt_phrase(tilt)} (good "
        "logs: up to 4.5 degrees); the flight does not show whether it is, or whether a biased "
        "accelerometer, wind or drag in fast flight is the cause: fly in still air, or measure the "
        f"mounting and declare it under [airframe] (imu_tilt_deg = [{roll:.1f}, {pitch:.1f}]); "
        "until then do not trust kt, kd, Jr, the inertia about z and the centre of mass"
    )


def _doubt_lean(sentence: str, lean: tuple[Evidence, ...]) -> Finding:
    """Doubt the numbers that depend on the rotors' axis where the thrust leans."""
    return doubt(
        "imu-leans",
        sentence,
        evidence=lean,
        numbers=LEANING,
        doubtful_because="the thrust is tilted in the IMU's axes",
        next_step="measure how the IMU is mounted and give imu_tilt_deg under [airframe]",
    )
