"""The tables of a result from the estimate row by row (``method = "ols"``)."""

from collections.abc import Mapping

import numpy as np

from rotorfit.experiment.experiment import ConfigurationEntry, MotorsEntry
from rotorfit.fit.excitation import LEAST_EXCITATION
from rotorfit.fit.motor_timing import MotorTiming
from rotorfit.fit.row_fits import ROWS, RowFits
from rotorfit.fit.row_parameters import Quantities, number_scale
from rotorfit.model.parameters import DERIVED, PARAMETERS, SHARED, ParameterInfo, full_name
from rotorfit.model.vehicle import Vehicle
from rotorfit.results.parameter_tables import (
    ORIGIN_IS_IMU,
    RATIOS,
    ROW_ORDER,
    SHARED_DERIVED,
    Tables,
    given_parameter,
    motor_parameters,
    unit_of,
)
from rotorfit.results.result import Derived, Parameter
from rotorfit.results.verdicts import ADVICE, Judgement, judge, motion_for


def row_tables(
    quantities: Quantities,
    fits: RowFits,
    entry: ConfigurationEntry,
    *,
    vehicle: Vehicle,
    motors: MotorsEntry,
    timing: MotorTiming | None,
) -> Tables:
    """Return the tables of the row by row estimate."""
    judged = _judgements(quantities, fits, entry, vehicle)
    parameters = [
        *_row_parameters(quantities, judged, entry),
        *motor_parameters(motors, timing),
        given_parameter("mass", entry.mass, entry.mass_std, entry),
    ]
    parameters.sort(key=lambda p: ROW_ORDER.index(p.name))
    known = [p.name for p in parameters if p.value is not None and p.name in quantities.names]
    index = [quantities.index(name) for name in known]
    std = quantities.half_width[index] / 1.96
    return Tables(
        parameters=tuple(parameters),
        derived=_row_derived(quantities, judged, entry),
        covariance_names=tuple(full_name(name, entry.name) for name in known),
        covariance=quantities.correlation[np.ix_(index, index)] * np.outer(std, std),
        settings={"noise": "per phase and band", "band": "0 to 30 Hz", "stretch": "20 s"},
        warnings=_row_warnings(fits, vehicle),
        diagnostics={
            **{f"excitation_{axis}": value for axis, value in fits.excitation.items()},
            **{f"condition_{row}": fits.fits[row].estimate.condition_number for row in ROWS},
        },
    )


def _judgements(
    quantities: Quantities, fits: RowFits, entry: ConfigurationEntry, vehicle: Vehicle
) -> dict[str, Judgement]:
    """Return the verdict on every number."""
    values = dict(zip(quantities.names, quantities.values.tolist(), strict=True))
    mass = 1.0 if entry.mass == "unknown" else entry.mass
    judged: dict[str, Judgement] = {}
    for name, value, half in zip(
        quantities.names, quantities.values.tolist(), quantities.half_width.tolist(), strict=True
    ):
        axis = motion_for(name)
        judged[name] = judge(
            value,
            half,
            scale=number_scale(name, values, mass=mass, arm=vehicle.arm),
            axis=axis,
            excitation=fits.excitation.get(axis),
        )
    return judged


def _row_parameters(
    quantities: Quantities, judged: Mapping[str, Judgement], entry: ConfigurationEntry
) -> list[Parameter]:
    parameters: list[Parameter] = []
    for name, info in PARAMETERS.items():
        if name in quantities.names:
            parameters.append(_number_parameter(name, quantities, judged[name], entry))
        elif name in RATIOS:
            ratio, partner = RATIOS[name]
            parameters.append(_ratio_parameter(name, info, partner, judged[ratio], entry))
    return parameters


def _number_parameter(
    name: str, quantities: Quantities, judgement: Judgement, entry: ConfigurationEntry
) -> Parameter:
    i = quantities.index(name)
    value, half = float(quantities.values[i]), float(quantities.half_width[i])
    known = judgement.verdict != "not-identified"
    return Parameter(
        name=name,
        configuration=None if name in SHARED else entry.name,
        value=value if known else None,
        std=half / 1.96 if known else None,
        interval=(value - half, value + half) if known else None,
        unit=unit_of(PARAMETERS[name], entry),
        verdict=judgement.verdict,
        reason=judgement.reason,
        advice=judgement.advice,
    )


def _ratio_parameter(
    name: str,
    info: ParameterInfo,
    partner: str,
    ratio: Judgement,
    entry: ConfigurationEntry,
) -> Parameter:
    """Return a parameter of the yaw row, which fixes it only relative to its partner."""
    fixed = ratio.verdict != "not-identified"
    return Parameter(
        name=name,
        configuration=None if name in SHARED else entry.name,
        value=None,
        std=None,
        interval=None,
        unit=unit_of(info, entry),
        verdict="ratio-only" if fixed else "not-identified",
        partner=partner if fixed else None,
        reason="the yaw equation gives only ratios to Izz" if fixed else ratio.reason,
        advice=ADVICE["scale"] if fixed else ratio.advice,
    )


def _row_derived(
    quantities: Quantities, judged: Mapping[str, Judgement], entry: ConfigurationEntry
) -> tuple[Derived, ...]:
    return tuple(_derived(name, info, quantities, judged, entry) for name, info in DERIVED.items())


def _derived(
    name: str,
    info: ParameterInfo,
    quantities: Quantities,
    judged: Mapping[str, Judgement],
    entry: ConfigurationEntry,
) -> Derived:
    known = name in quantities.names and judged[name].verdict != "not-identified"
    value = half = 0.0
    if known:
        i = quantities.index(name)
        value, half = float(quantities.values[i]), float(quantities.half_width[i])
    return Derived(
        name=name,
        configuration=None if name in SHARED_DERIVED else entry.name,
        value=value if known else None,
        std=half / 1.96 if known else None,
        interval=(value - half, value + half) if known else None,
        unit=unit_of(info, entry),
    )


def _row_warnings(fits: RowFits, vehicle: Vehicle) -> tuple[str, ...]:
    doubts: list[str] = []
    for axis, rho in fits.excitation.items():
        if LEAST_EXCITATION <= rho < 2.0 * LEAST_EXCITATION:
            doubts.append(
                f"{axis}: the rotors explain only {rho:.1f} times what they do not; {ADVICE[axis]}"
            )
    if vehicle.imu_position is None:
        doubts.append(ORIGIN_IS_IMU)
    return tuple(doubts)
