"""What a result should doubt about itself: every check that needs the fit, its flights, or both."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

from rotorfit.dataset.dataset import Dataset
from rotorfit.diagnostics.body_size import refuse_impossible_size, unusual_density
from rotorfit.diagnostics.changed_rotor import changed_in_flight, unlike_rotor
from rotorfit.diagnostics.consistency_checks import (
    accelerometer_against_gravity,
    hover_thrusts,
    hovers_differ,
    steady_yaw_torque,
    thrust_against_weight,
    thrust_sags,
    without_mean,
)
from rotorfit.diagnostics.early_motors import early_motors, late_speeds
from rotorfit.diagnostics.flights_agree import odd_flight
from rotorfit.diagnostics.imu_clocks import accelerometer_delay
from rotorfit.diagnostics.lever_arms import lever_doubt
from rotorfit.diagnostics.payload import payload_checks, payload_sentence
from rotorfit.diagnostics.residual_peaks import peak_sentence, residual_peaks
from rotorfit.diagnostics.rotor_size import unusual_loading
from rotorfit.diagnostics.saturated_sensors import saturated_sensors
from rotorfit.diagnostics.spins import refuse_wrong_spins
from rotorfit.estimation.banded import BandedEstimate
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.joint.joint_problem import JointConfiguration
from rotorfit.results.parameter_tables import Tables
from rotorfit.results.physical_inertia import (
    possible_sentence,
    smallest_second_moment,
    without_impossible,
)
from rotorfit.results.weak_directions import (
    body_directions,
    condition_number,
    weak_sentence,
)

Doubt = tuple[str | None, Mapping[str, float]]
"""A sentence where something is to be doubted, and the numbers behind it in any case."""


def diagnose(
    tables: Tables,
    dataset: Dataset,
    numbers: Numbers,
    *,
    fit: BandedEstimate,
    joint: Sequence[JointConfiguration],
) -> Tables:
    """Return the tables with the doubts of all checks, impossible inertia taken back.

    Parameters
    ----------
    tables
        Of the estimate.
    dataset
        The flights.
    numbers
        Of the estimate, with their final intervals.
    fit, joint
        The fit, and its configurations.

    Raises
    ------
    FrameError
        If no vehicle with the declared spins and arms flies like that, or one with another ratio
        of arms far likelier does.
    """
    refuse_wrong_spins(dataset, joint, numbers)
    refuse_impossible_size(dataset, joint, numbers)
    doubts: list[Doubt] = [
        lever_doubt(dataset, fit, numbers),
        *_doubts_of_body(tables, fit, numbers, joint, dataset),
        *_doubts_of_flight(dataset, fit, numbers, joint),
    ]
    doubts.append((odd_flight(dataset.configurations, joint, fit), {}))
    doubts.append((changed_in_flight(dataset.configurations), {}))
    doubts.append(steady_yaw_torque(dataset.configurations, joint, numbers))
    doubts += _doubts_of_payload(dataset, joint)
    moments = {c.name: smallest_second_moment(numbers, c.name) for c in joint}
    impossible = [name for name, moment in moments.items() if moment.impossible]
    tables = without_impossible(tables, impossible)
    return dataclasses.replace(
        tables,
        warnings=(*tables.warnings, *(words for words, _ in doubts if words is not None)),
        diagnostics={**tables.diagnostics, **{k: v for _, d in doubts for k, v in d.items()}},
    )


def _doubts_of_body(
    tables: Tables,
    fit: BandedEstimate,
    numbers: Numbers,
    joint: Sequence[JointConfiguration],
    dataset: Dataset,
) -> Iterator[Doubt]:
    """Yield what the numbers themselves say: can the body exist, what hangs together."""
    directions = body_directions(fit.estimate)
    doubtful = {p.full_name for p in tables.parameters if p.verdict not in ("identified", "given")}
    diagnostics = {"condition_bodies": condition_number(directions)}
    yield weak_sentence(directions, doubtful), diagnostics
    if all(c.entry.mass != "unknown" for c in dataset.configurations):
        yield unusual_density(joint, numbers), {}
        yield unusual_loading(dataset), {}
    yield unlike_rotor(numbers, dataset.vehicle), {}
    lost = {p.full_name for p in tables.parameters if p.value is None}
    for configuration in joint:
        name = configuration.name
        moment = smallest_second_moment(numbers, name)
        # What is not reported needs no doubt.
        shown = not lost & {f"{axis}@{name}" for axis in ("Ixx", "Iyy", "Izz")}
        words = possible_sentence(moment, name) if shown else None
        yield words, {f"smallest_second_moment@{name}": moment.share}


def _doubts_of_flight(
    dataset: Dataset, fit: BandedEstimate, numbers: Numbers, joint: Sequence[JointConfiguration]
) -> Iterator[Doubt]:
    """Yield what the flights say against the fit."""
    yield without_mean(fit, numbers)
    yield early_motors(dataset), {}
    yield late_speeds(dataset), {}
    yield accelerometer_delay(dataset), {}
    yield saturated_sensors(dataset), {}
    yield from _doubts_of_thrust(dataset, numbers)
    for peak in residual_peaks(dataset, fit, joint):
        yield peak_sentence(peak), {f"residual_peak@{peak.configuration}": peak.ratio}


def _doubts_of_thrust(dataset: Dataset, numbers: Numbers) -> Iterator[Doubt]:
    """Yield what holds the vehicle up against its weight."""
    if dataset.source == "imu":
        yield accelerometer_against_gravity(dataset.configurations)
    if all(c.entry.mass != "unknown" for c in dataset.configurations):
        found = hover_thrusts(dataset.configurations, numbers, dataset.vehicle)
        yield thrust_against_weight(found, numbers)
        yield hovers_differ(found)
        yield thrust_sags(found, commanded=dataset.motors.speed == "commanded")


def _doubts_of_payload(dataset: Dataset, joint: Sequence[JointConfiguration]) -> Iterator[Doubt]:
    """Yield whether known payloads agree with the flights."""
    mass_std = {c.entry.name: c.entry.mass_std for c in dataset.configurations}
    for check in payload_checks(joint, mass_std):
        yield (
            payload_sentence(check),
            {
                f"payload_chi2@{check.name}": check.chi2,
                f"payload_probability@{check.name}": check.probability,
                f"arm_factor@{check.name}": check.arm,
                f"arm_factor_half_width@{check.name}": 1.96 * check.arm_std,
            },
        )
