"""Assemble the tables of a result from an estimate, its flights and its findings.

Mass, the rotors' distances, the scale of their speeds, of the gyro and of the clock: thrown off by
a factor, all numbers stay consistent; the place of the IMU is that of the centre of mass. No flight
shows it, nor the tilts of the rotors' axes, so that these are said beside the result.
"""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.checks.sensors.sensor_faults import lowpass_sentence
from rotorfit.checks.verdicts.judge import judged_derived
from rotorfit.checks.verdicts.parameters import RATIOS
from rotorfit.estimation.factors import flights_of
from rotorfit.findings import Finding, diagnostics_of, note
from rotorfit.fit.joint.trims import ENOUGH_FLIGHTS
from rotorfit.flight.motors.motor_model import ThrustCurve
from rotorfit.logs.flight_log import SITL, simulated_sentence
from rotorfit.logs.motor_law import SquareRootCurve
from rotorfit.results.result import Derived, FlightRecord, Parameter
from rotorfit.results.tables import ResultTables

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.fit.dataset.dataset import Dataset, LoadedFlight
    from rotorfit.fit.experiment.experiment import MotorsEntry
    from rotorfit.fit.joint.joint_problem import JointConfiguration
    from rotorfit.fit.timing.timed_dataset import TimedDataset
    from rotorfit.model.vehicle import Vehicle

LEAST_TILT: Final = 1e-3
"""Sine of a declared tilt of a rotor's axis that is worth words."""
FLYABLE = ("weak", "ratio-only", "not-identified")
"""Verdicts that more flying might better."""


def assemble_tables(
    dataset: Dataset,
    *,
    parameters: tuple[Parameter, ...],
    derived: tuple[Derived, ...],
    covariance_names: tuple[str, ...],
    covariance: Float[np.ndarray, "p p"],
    used: Mapping[str, object],
    diagnostics: Mapping[str, float],
    findings: tuple[Finding, ...] = (),
) -> ResultTables:
    """Assemble the tables of a result; `used` are the settings that the estimator chose."""
    return ResultTables(
        parameters=parameters,
        derived=derived,
        flights=tuple(
            _flight_record(flight, configured.entry.name)
            for configured in dataset.configurations
            for flight in configured.flights
        ),
        covariance_names=covariance_names,
        covariance=covariance,
        used=used,
        findings=findings,
        diagnostics=diagnostics,
    )


def _flight_record(flight: LoadedFlight, configuration: str) -> FlightRecord:
    recorded, zero = flight.recorded, flight.recorded.start
    return FlightRecord(
        file=flight.entry.written,
        sha256=flight.log.sha256,
        configuration=configuration,
        seconds_used=recorded.seconds,
        samples_used=recorded.samples,
        used=tuple((start - zero, end - zero) for start, end in recorded.spans),
        cuts=tuple((c.start - zero, c.end - zero, c.reason) for c in flight.prepared.cuts),
        findings=(*flight.log.findings, *flight.prepared.findings),
    )


def with_diagnosis(tables: ResultTables, findings: Sequence[Finding]) -> ResultTables:
    """Add findings to the tables, and withhold the numbers that they disprove."""
    tables = dataclasses.replace(
        tables.found(*findings),
        diagnostics={**tables.diagnostics, **diagnostics_of(findings)},
    )
    for finding in findings:
        if finding.withheld_because is not None:
            tables = withheld(tables, finding)
    return tables


def withheld(tables: ResultTables, finding: Finding) -> ResultTables:
    """Withhold the numbers of a finding; those known as a ratio get that verdict."""
    ratios = {(d.name, d.configuration) for d in tables.derived if d.value is not None}
    parameters = tuple(
        _without_value(p, ratios, finding) if finding.is_about(p.full_name) else p
        for p in tables.parameters
    )
    derived = tuple(
        dataclasses.replace(
            d,
            value=None,
            std=None,
            interval=None,
            reason=finding.withheld_because,
            interval_terms=(),
        )
        if finding.is_about(d.full_name)
        else d
        for d in tables.derived
    )
    known = {p.full_name for p in parameters if p.value is not None}
    keep = [i for i, name in enumerate(tables.covariance_names) if name in known]
    return dataclasses.replace(
        tables,
        parameters=parameters,
        derived=derived,
        covariance_names=tuple(tables.covariance_names[i] for i in keep),
        covariance=tables.covariance[np.ix_(keep, keep)],
    )


def _without_value(
    parameter: Parameter, ratios: Collection[tuple[str, str | None]], finding: Finding
) -> Parameter:
    """Return a parameter without its value, as a ratio where (name, configuration) is known."""
    if parameter.verdict in ("given", "removed"):
        return parameter
    ratio, partner = RATIOS.get(parameter.name, ("", None))
    owners = {owner for name, owner in ratios if name == ratio}
    own = owners if parameter.configuration is None else owners & {parameter.configuration}
    return dataclasses.replace(
        parameter,
        value=None,
        std=None,
        interval=None,
        verdict="ratio-only" if own else "not-identified",
        partner=partner if own else None,
        reason=finding.withheld_because,
        advice=finding.next_step,
        asks=None if finding.next_step is None else "other",
        interval_terms=(),
    )


def mark_doubtful(tables: ResultTables) -> ResultTables:
    """Judge the derived numbers, and mark the numbers that a finding doubts as doubtful."""
    disowning = [one for one in tables.every_finding if one.doubtful_because is not None]
    useless = [one for one in tables.findings if one.useless_because is not None]
    parameters = tuple(
        # Numbers for which flying is useless get the finding's next step in place of a manoeuvre.
        _advised_first(_judged_again(p, disowning), useless)
        for p in tables.parameters
    )
    derived = (_derived_again(d, disowning) for d in judged_derived(parameters, tables.derived))
    return dataclasses.replace(tables, parameters=parameters, derived=tuple(derived))


def _advised_first(parameter: Parameter, useless: Sequence[Finding]) -> Parameter:
    """Return a parameter with the step without which no flying helps it."""
    about = next((one for one in useless if one.is_about(parameter.full_name)), None)
    if about is None or parameter.verdict not in FLYABLE:
        return parameter
    reason = parameter.reason if parameter.verdict == "weak" else about.useless_because
    asks = None if about.next_step is None else "other"
    return dataclasses.replace(parameter, reason=reason, advice=about.next_step, asks=asks)


def _judged_again(parameter: Parameter, disowning: Sequence[Finding]) -> Parameter:
    """Mark a parameter as doubtful where one of the findings is about it."""
    about = [one for one in disowning if one.is_about(parameter.full_name)]
    if not about or parameter.verdict not in ("identified", "weak"):
        return parameter
    steps = [one.next_step for one in about if one.next_step]
    return dataclasses.replace(
        parameter,
        verdict="doubtful",
        reason=_why_doubtful(about),
        advice=steps[0] if steps else parameter.advice,
        asks="other" if steps else parameter.asks,
    )


def _derived_again(derived: Derived, disowning: Sequence[Finding]) -> Derived:
    about = [one for one in disowning if one.is_about(derived.full_name)]
    if not about or derived.verdict not in ("identified", "weak"):
        return derived
    return dataclasses.replace(derived, verdict="doubtful", reason=_why_doubtful(about))


def _why_doubtful(about: Sequence[Finding]) -> str:
    reasons = " and ".join(dict.fromkeys(str(one.doubtful_because) for one in about))
    return f"may be outside its interval, because {reasons}"


RPM = 60.0 / (2.0 * np.pi)


def with_assumptions(
    tables: ResultTables, dataset: Dataset, configurations: Sequence[JointConfiguration]
) -> ResultTables:
    """Add the assumptions of the numbers to the settings; see `assumptions`."""
    rests_on = list(assumptions(tables, dataset, configurations))
    return replace(tables, used={**tables.used, "hangs_on": rests_on})


def assumptions(
    tables: ResultTables, dataset: Dataset, configurations: Sequence[JointConfiguration]
) -> tuple[str, ...]:
    """List the declared quantities that the numbers are proportional to, a sentence for each.

    `configurations`: of the joint fit; empty for methods without one.
    """
    masses = [f"{c.mass:g} kg" for c in dataset.configurations if c.entry.mass != "unknown"]
    parts = [
        f"kd, Jr and inertia are proportional to the rotors' distances ({_rotor_spacing(dataset)})"
    ]
    if masses:
        parts.insert(
            0, f"kt, kd, Jr and inertia are proportional to the mass ({', '.join(masses)})"
        )
    hover = next((d.value for d in tables.derived if d.name == "hover_speed"), None)
    if hover is not None and (dataset.motors.speed == "measured" or dataset.speeds_commanded):
        parts.append(
            "kt and kd are proportional to the inverse square of rotor speed (hover at "
            f"{hover:.0f} rad/s, {RPM * hover:.0f} rpm)"
        )
    elif hover is not None and not dataset.motors.law_is_relative:
        parts.append(
            "kt and kd are proportional to the inverse square of the speeds that the motors' law "
            f"gives (hover at {hover:.0f} rad/s, {RPM * hover:.0f} rpm): that of the same motors, "
            "propellers and battery"
        )
    parts += _rotor_tilts(dataset.vehicle, tables.derived)
    seconds = sum(f.recorded.seconds for f in dataset.flights)
    clock = f"Jr and inertia are proportional to the log's clock ({seconds:.1f} s of flight)"
    if dataset.source == "imu":
        clock += ", inertia to the inverse of the gyro's scale, kd/Izz and Jr/Izz to that scale"
    parts.append(clock)
    parts.append(_imu_place(dataset))
    parts += [
        _shared_uncertainty(c.name, len(flights))
        for c in configurations
        if len(flights := flights_of(c.factors)) >= ENOUGH_FLIGHTS
    ]
    return tuple(parts)


def _shared_uncertainty(configuration: str, flights: int) -> str:
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
        point = "tracked point" if dataset.source == "mocap" else "IMU"
        return f"com_x, com_y, com_z and the inertia at the origin are about the {point}"
    x, y, z = (1e3 * length for length in place)
    return (
        f"the centre of mass is as good as the declared place of the IMU ({x:.0f}, {y:.0f}, "
        f"{z:.0f} mm): an IMU 1 mm higher moves com_z by 1 mm, one 1 mm further forward or left "
        "com_x or com_y by up to 1 mm"
    )


def _rotor_tilts(vehicle: Vehicle, derived: Sequence[Derived]) -> tuple[str, ...]:
    """Describe how far declared tilts of the rotors' axes move thrust and drag torque, if any."""
    sideways, up = np.hypot(*vehicle.axes[:, :2].T), vehicle.axes[:, 2]
    if sideways.max() < LEAST_TILT:
        return ()
    # The slope of an axis (sin t h, cos t) by its tilt t from upright towards h.
    towards = vehicle.axes[:, :2] / np.maximum(sideways, LEAST_TILT)[:, None]
    slope = np.column_stack([towards * up[:, None], -sideways])
    torque = float(np.mean(vehicle.spins * np.cross(vehicle.positions, slope)[:, 2]))
    degree = np.radians(1.0)
    moved = abs(degree * torque)
    ratio = next((d.value for d in derived if d.name == "kd_over_kt"), None)
    share = f" ({100.0 * moved / abs(ratio):.0f} % of it)" if ratio else ""
    thrust = 100.0 * degree * float(sideways.sum() / up.sum())
    return (
        f"kt and kd are as good as the declared axes of the rotors: one degree more of tilt in "
        f"each moves kd/kt by {moved:.2g} m{share}, and kt by {thrust:.2g} %",
    )


def _rotor_spacing(dataset: Dataset) -> str:
    """Describe the distances between the rotors, front to back and left to right."""
    x, y = np.ptp(dataset.vehicle.positions[:, :2], axis=0).tolist()
    return f"{1e3 * x:.0f} mm front to back, {1e3 * y:.0f} mm left to right"


def log_metadata(declared: MotorsEntry, dataset: TimedDataset) -> tuple[Finding, ...]:
    """Note the settings taken from the logs, and which logs a simulator wrote."""
    flights = dataset.flights
    simulated = [simulated_sentence(f.log.simulator) for f in flights if f.log.simulator]
    yaw = [_yaw_of_sitl(f) for f in flights if f.log.simulator == SITL]
    logged, law = flights[0].log.motors, ""
    if logged is not None and declared.law is None and dataset.motors.law is not None:
        battery = ""
        if dataset.motors.law.voltage is not None:
            battery = f", at {dataset.motors.law.voltage.nominal:g} V"
        law = f"the law from command to rotor speed is the one in the log ({logged.words}{battery})"
        if not logged.law.exact:
            law += "; a law under [motors] replaces it"
    every = [*simulated, *yaw, lowpass_sentence(dataset) or "", law]
    return tuple(note("log-metadata", sentence) for sentence in dict.fromkeys(every) if sentence)


def _yaw_of_sitl(flight: LoadedFlight) -> str:
    """Explain by how much SITL's yaw torque changes more than one proportional to squared speed."""
    logged, used = flight.log.motors, flight.motors.law
    if logged is None or used is None or not isinstance(logged.law.curve, SquareRootCurve):
        return ""
    curve = ThrustCurve(factor=logged.law.curve.thr_mdl_fac, error=0.0)
    full = used.full_speed
    thrust = float((flight.prepared.motor_channel**2).mean()) / full**2
    c, f = curve.command(thrust), curve.factor
    # With thrust T = (1 - f) c + f c^2 of a command c, and torque proportional to c T, the torque
    # changes with T by c + T / T', where the mean is c.
    more = 1.0 + thrust / (c * (1.0 - f + 2.0 * f * c))
    return (
        f"its yaw torque changes {more:.2f} times as much as a torque proportional to thrust "
        f"would: kd, kd/kt and kd/Izz describe changes about hover, {more:.2f} times "
        "their values in hover"
    )
