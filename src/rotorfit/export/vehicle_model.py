"""From a result to the vehicle that every target writes, checked once.

A number that the flights do not give is refused, or taken from the user and marked so; inertia that
no body has is refused. What no target asked for and is not known is NaN, which `file_format.text`
never writes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.digits import with_interval
from rotorfit.errors import ExperimentError, MissingNumbersError, OutputError
from rotorfit.export.result_numbers import (
    FULL_COMMAND,
    ROTOR_KT,
    Missing,
    Number,
    air_of,
    numbers_of,
    unit_of,
)
from rotorfit.export.targets import BODY, ROTORS, Speed
from rotorfit.export.vehicle import (
    ExportedRotor,
    VehicleModel,
    impossible_message,
    is_possible,
    projected,
    refuse_signs,
    thickened,
)
from rotorfit.fit.experiment.declared_vehicle import vehicle_of
from rotorfit.fit.experiment.experiment import Experiment, experiment_of_settings
from rotorfit.model.parameters import AIR, COM, INERTIA_COM, inertia_matrix
from rotorfit.model.terms.registry import OPTIONAL
from rotorfit.model.terms.rotors import ROTOR_INERTIA, ROTOR_SPREAD
from rotorfit.results.result import IdentificationResult, is_per_command, owner_of
from rotorfit.results.sound_result import refuse_unsound

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from rotorfit.logs.motor_law import MotorLaw
    from rotorfit.model.vehicle import Vehicle


def vehicle_model(
    result: IdentificationResult,
    *,
    configuration: str | None = None,
    needs: Sequence[str] = (*BODY, *ROTORS),
    assumed: Mapping[str, float] | None = None,
    speed: Speed = "rad/s",
    tilted_needs: Sequence[str] = (),
    project: bool = False,
) -> VehicleModel:
    """Assemble the vehicle of a result, checked; OutputError where nature or the flights lack it.

    `assumed` numbers (SI) replace those of the result; `tilted_needs` are needed where a rotor is
    not upright; `project` replaces inertia that no body has by the nearest that one can have.
    """
    refuse_unsound(result)
    owner = owner_of(result, configuration)
    experiment = _experiment_of(result)
    law = _select_law(result, experiment)
    given = dict(assumed or {})
    _refuse_other_mass(result, owner, given)
    full = _full_speed(result, law, speed)
    numbers = numbers_of(result, owner, assumed=given, full_speed=full)
    vehicle = vehicle_of(experiment.airframe, experiment.identification.source)
    if any(rotor.axis[2] != 1.0 for rotor in vehicle.rotors):
        needs = (*needs, *tilted_needs)
    _refuse_missing(numbers, _list_needed(needs, numbers, vehicle), result=result)
    model = _assemble_model(result, owner, numbers=numbers, vehicle=vehicle, law=law)
    refuse_signs(model)
    if not is_possible(model):
        if not project:
            raise OutputError(impossible_message(model))
        model = projected(model, result)
    return thickened(model)


NOMINAL_SPEED: Final = 1000.0
"""Speed at full command, where any will do [rad/s]: the largest that PX4's Gazebo takes."""


def _select_law(result: IdentificationResult, experiment: Experiment) -> MotorLaw | None:
    """Select the law of the motors: declared, or found between commands and measured speeds."""
    if experiment.motors.law is not None:
        return experiment.motors.law
    found = result.command_law
    return found.law if found is not None and found.known else None


def _full_speed(result: IdentificationResult, law: MotorLaw | None, speed: Speed) -> Number | None:
    """Compute the speed at full command, as far as the motors' law gives it."""
    if any(p.name == "max_speed" for p in result.parameters):
        return None  # a number of the result itself, with an interval
    if law is not None and not is_per_command(result.parameters):
        value, unit, remark = law.full_speed, "rad/s", "the law of [motors] at full command"
    elif speed == "full-command" and is_per_command(result.parameters):
        value, unit = 1.0, FULL_COMMAND
        remark = "as a fraction of its maximum: no law gives it in rad/s"
        if law is None:
            remark = "taken as proportional to the command: no law is known"
    elif speed == "nominal" and is_per_command(result.parameters):
        remark = (
            "nominal, as the log has none; thrust and torque at full command are those of the "
            "flights, and kt and kd are computed with this speed"
        )
        return Number(
            name="max_speed", value=NOMINAL_SPEED, unit="rad/s", origin="assumed", remark=remark
        )
    else:
        return None
    return Number(name="max_speed", value=value, unit=unit, origin="law", remark=remark)


def _experiment_of(result: IdentificationResult) -> Experiment:
    try:
        return experiment_of_settings(result.settings)
    except (ExperimentError, AttributeError, KeyError, TypeError, ValueError) as error:
        raise OutputError(
            f"the result's settings do not describe its vehicle ({error}); identify again"
        ) from error


def _refuse_other_mass(
    result: IdentificationResult, owner: str, assumed: Mapping[str, float]
) -> None:
    """Raise if another mass is assumed than the one that everything was scaled with."""
    mass = result.parameter("mass", owner)
    if "mass" in assumed and mass.value is not None:
        raise OutputError(
            f"mass={assumed['mass']:g} was assumed, but the result was made with {mass.value:g} kg "
            "and every force and inertia with it; identify again with the right mass"
        )


def _list_needed(
    needs: Sequence[str], numbers: Mapping[str, Number | Missing], vehicle: Vehicle
) -> list[str]:
    """Add to the needs of a target those of the geometry of this result."""
    needed = list(dict.fromkeys(needs))
    if vehicle.imu_position is None and set(COM) & set(needed):
        needed += [name for name in ("rotor_center_x", "rotor_center_y") if name in numbers]
    if "motor_lag" in needed and {"motor_lag_up", "motor_lag_down"} <= numbers.keys():
        needed.remove("motor_lag")
        needed += ["motor_lag_up", "motor_lag_down"]
    return needed


def _refuse_missing(
    numbers: Mapping[str, Number | Missing],
    needed: Sequence[str],
    *,
    result: IdentificationResult,
) -> None:
    """Raise if a needed number is not known: which, why, and what would allow the export."""
    gaps = [
        gap
        for name in needed
        if isinstance(gap := numbers.get(name) or _absent_number(name, result), Missing)
    ]
    if not gaps:
        return
    from rotorfit.tools.planning.next_step import next_step  # it simulates: slow to import

    reasons: dict[tuple[str, str], list[str]] = {}
    for gap in gaps:
        reasons.setdefault((gap.verdict, gap.reason), []).append(gap.name)
    explained = "; ".join(
        f"{', '.join(names)} {'is' if len(names) == 1 else 'are'} {verdict} ({reason})"
        for (verdict, reason), names in reasons.items()
    )
    cures = list(dict.fromkeys(gap.cure or gap.name for gap in gaps))
    flown = any(verdict != ABSENT for verdict, _ in reasons) and cures != ["mass"]
    then = next_step(result) if flown else None
    steps = [] if then is None or then.kind == "done" else [then.action]
    steps += ["identify with the weighed mass (--mass KG)"] * ("mass" in cures)
    advice = f"{', then '.join(steps)}; or " if steps else ""
    needed = "and is needed" if len(gaps) == 1 else "and all of these are needed"
    message = f"{explained}, {needed}: {advice}{_explain_supply(cures)}"
    raise MissingNumbersError(" ".join(message.split()), names=cures)


FEW: Final = 3
"""Numbers to supply up to which each is written out as an option."""


def _explain_supply(names: Sequence[str]) -> str:
    """State how to supply numbers with options of the command line."""
    if len(names) > FEW:
        return f"supply {', '.join(names)}, each with --assume NAME=VALUE in SI units"
    flags = " ".join(f"--assume {name}=VALUE" for name in names)
    units = ", ".join(f"{name} in {unit_of(name)}" for name in names)
    return f"supply {'it' if len(names) == 1 else 'them'} with {flags} ({units})"


ABSENT: Final = "not in the result"
_WHY_ABSENT: Final = {
    "motor_lag": "measured rotor speed alone does not show it; log the motor commands, too",
    "max_speed": "no law from command to rotor speed is given",
}


def _absent_number(name: str, result: IdentificationResult) -> Missing:
    measured = experiment_of_settings(result.settings).motors.speed == "measured"
    reason = _WHY_ABSENT.get(name) if measured or name == "max_speed" else None
    return Missing(name=name, verdict=ABSENT, reason=reason or "the flights do not show it")


def _assemble_model(
    result: IdentificationResult,
    owner: str,
    *,
    numbers: Mapping[str, Number | Missing],
    vehicle: Vehicle,
    law: MotorLaw | None,
) -> VehicleModel:
    def value(name: str, otherwise: float = float("nan")) -> float:
        number = numbers.get(name)
        return number.value if isinstance(number, Number) else otherwise

    lag, Jr, full = value("motor_lag"), numbers.get("Jr"), numbers.get("max_speed")
    return VehicleModel(
        name=result.name,
        configuration=owner,
        mass=value("mass"),
        com=np.array([value(name) for name in COM]),
        inertia_com=inertia_matrix(np.array([value(name) for name in INERTIA_COM])),
        rotors=_place_rotors(vehicle, numbers),
        kd=value("kd"),
        Jr=Jr.value if isinstance(Jr, Number) and not _is_no_inertia(Jr) else None,
        lag_up=value("motor_lag_up", lag),
        lag_down=value("motor_lag_down", lag),
        max_speed=value("max_speed"),
        in_commands=isinstance(full, Number) and full.unit == FULL_COMMAND,
        law=law,
        imu=np.array(vehicle.imu_position or (0.0, 0.0, 0.0)),
        numbers=tuple(n for name in _SHOWN if isinstance(n := numbers.get(name), Number)),
        notes=_list_notes(numbers, vehicle, law),
        air=air_of(result, owner, ("rotor_drag", *AIR), found=numbers),
    )


def _is_no_inertia(Jr: Number) -> bool:
    """Test whether a rotor inertia was removed, or came out below zero within its interval."""
    below = Jr.value <= 0.0 and Jr.interval is not None and Jr.interval[1] > 0.0
    return Jr.origin == "removed" or below


_SHOWN: Final = (
    *("mass", *COM, *INERTIA_COM, "kt", *ROTOR_KT, "kd", "Jr", "motor_lag"),
    *("motor_lag_up", "motor_lag_down", "motor_delay", "max_speed"),
    *("rotor_center_x", "rotor_center_y"),
)


def _place_rotors(
    vehicle: Vehicle, numbers: Mapping[str, Number | Missing]
) -> tuple[ExportedRotor, ...]:
    """Place the rotors; where the origin is the IMU, moved together to the centre found."""
    kt = numbers.get("kt")
    mean = kt.value if isinstance(kt, Number) else float("nan")
    shift = np.zeros(3)
    # A rotor declared at p sits at p + rotor_center from the IMU (`model.regressor.rotor_center`:
    # torque (p + t) x thrust). Along z, without effect on upright thrust, it is as declared.
    if vehicle.imu_position is None:
        for i, name in enumerate(("rotor_center_x", "rotor_center_y")):
            center = numbers.get(name)
            shift[i] = center.value if isinstance(center, Number) else 0.0
    out: list[ExportedRotor] = []
    for i, rotor in enumerate(vehicle.rotors):
        own = numbers.get(f"kt_{i + 1}")
        out.append(
            ExportedRotor(
                position=np.array(rotor.position) + shift,
                axis=np.array(rotor.axis),
                spin=1.0 if rotor.spin == "ccw" else -1.0,
                kt=own.value if isinstance(own, Number) else mean,
            )
        )
    return tuple(out)


_TERMS: Final = (
    "motor_delay",
    *(
        n
        for t in OPTIONAL
        if not t.of_sensor and t not in (ROTOR_INERTIA, ROTOR_SPREAD)
        for n in t.names
    ),
)


def terms_left_out(
    result: IdentificationResult, owner: str, *, written: Collection[str] = ()
) -> list[str]:
    """List the known terms that a target is not written with, with half-widths."""
    return [
        f"{p.name} = {with_interval(p.value, p.interval)} {p.unit}"
        f"{'' if p.verdict == 'identified' else f' ({p.verdict})'}"
        for p in result.parameters
        if p.name in _TERMS
        if not (p.name in written and p.interval is not None and p.interval[0] > 0.0)
        if p.configuration in (None, owner) and p.value
    ]


def _list_notes(
    numbers: Mapping[str, Number | Missing], vehicle: Vehicle, law: MotorLaw | None
) -> tuple[str, ...]:
    """List what a reader of the file has to know beyond the numbers."""
    notes: list[str] = []
    if vehicle.imu_position is None:
        notes.append(
            "positions are counted from the IMU (of motion capture: from the tracked point), as "
            "[airframe] gives no imu position; rotor heights are as declared"
        )
    mean = [
        str(i + 1)
        for i in range(len(vehicle.rotors))
        if isinstance(numbers.get(f"kt_{i + 1}"), Missing)
    ]
    if mean:
        notes.append(f"the mean kt is taken for rotors whose own is not known: {', '.join(mean)}")
    if isinstance(numbers.get("Jr"), Missing):
        notes.append("Jr is not known from these flights: left out")
    elif isinstance(Jr := numbers.get("Jr"), Number) and Jr.value < 0.0 and _is_no_inertia(Jr):
        notes.append("Jr is below zero within its interval: left out")
    if law is not None and law.voltage is not None:
        notes.append(f"max_speed holds at {law.voltage.nominal:.3g} V")
    return tuple(notes)
