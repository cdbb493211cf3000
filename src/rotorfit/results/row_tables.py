"""The tables of a result from the estimate row by row (``method = "ols"``)."""

from collections.abc import Mapping

from rotorfit.experiment.experiment import ConfigurationEntry, MotorsEntry
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.rows.row_fits import ROWS, RowFits
from rotorfit.fit.rows.row_parameters import number_scale
from rotorfit.model.parameters import DERIVED, PARAMETERS, SHARED, full_name
from rotorfit.model.vehicle import Vehicle
from rotorfit.reduction.motor_timing import MotorTiming
from rotorfit.results.parameter_tables import (
    RATIOS,
    ROW_ORDER,
    SHARED_DERIVED,
    Tables,
    excitation_warnings,
    given_parameter,
    judgements,
    motor_parameters,
    number_derived,
    number_parameter,
    unit_of,
)
from rotorfit.results.result import Parameter
from rotorfit.results.verdicts import ADVICE, Judgement


def row_tables(
    numbers: Numbers,
    fits: RowFits,
    entry: ConfigurationEntry,
    *,
    vehicle: Vehicle,
    motors: MotorsEntry,
    timing: MotorTiming | None,
) -> Tables:
    """Return the tables of the row by row estimate."""
    mass = 1.0 if entry.mass == "unknown" else entry.mass
    judged = judgements(
        numbers, lambda name: number_scale(numbers, name, mass=mass, arm=vehicle.arm)
    )
    parameters = [
        *_row_parameters(numbers, judged, entry),
        *motor_parameters(motors, timing),
        given_parameter("mass", entry.mass, entry.mass_std, entry),
    ]
    parameters.sort(key=lambda p: ROW_ORDER.index(p.name))
    known = [p.name for p in parameters if p.value is not None and p.name in numbers.names]
    return Tables(
        parameters=tuple(parameters),
        derived=tuple(
            number_derived(
                name,
                numbers,
                judged,
                owner=None if name in SHARED_DERIVED else entry.name,
                entry=entry,
            )
            for name in DERIVED
        ),
        covariance_names=tuple(full_name(name, entry.name) for name in known),
        covariance=numbers.covariance(known),
        settings={"noise": "per phase and band", "band": "0 to 30 Hz", "stretch": "20 s"},
        warnings=excitation_warnings(numbers, vehicle),
        diagnostics={
            **{f"excitation_{axis}": value for axis, value in fits.excitation.items()},
            **{f"condition_{row}": fits.fits[row].estimate.condition_number for row in ROWS},
        },
    )


def _row_parameters(
    numbers: Numbers, judged: Mapping[str, Judgement], entry: ConfigurationEntry
) -> list[Parameter]:
    parameters: list[Parameter] = []
    for name in PARAMETERS:
        owner = None if name in SHARED else entry.name
        if name in numbers.names:
            found = number_parameter(name, numbers, judged[name], owner=owner, entry=entry)
            parameters.append(found)
        elif name in RATIOS:
            ratio, partner = RATIOS[name]
            parameters.append(_ratio_parameter(name, partner, judged[ratio], owner, entry))
    return parameters


def _ratio_parameter(
    name: str, partner: str, ratio: Judgement, owner: str | None, entry: ConfigurationEntry
) -> Parameter:
    """Return a parameter of the yaw row, which fixes it only relative to its partner."""
    fixed = ratio.verdict != "not-identified"
    return Parameter(
        name=name,
        configuration=owner,
        value=None,
        std=None,
        interval=None,
        unit=unit_of(PARAMETERS[name], entry),
        verdict="ratio-only" if fixed else "not-identified",
        partner=partner if fixed else None,
        reason="the yaw equation gives only ratios to Izz" if fixed else ratio.reason,
        advice=ADVICE["scale"] if fixed else ratio.advice,
    )
