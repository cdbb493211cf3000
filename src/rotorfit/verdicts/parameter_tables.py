"""The parameters and derived numbers of a result, with verdicts, from what an estimator gave."""

from collections.abc import Callable, Iterable, Mapping

from rotorfit.experiment.experiment import ConfigurationEntry, MotorsEntry
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.model.parameters import DERIVED, PARAMETERS
from rotorfit.model.terms.term import ParameterInfo
from rotorfit.reduction.motor_timing import MotorTiming, is_time_identifiable
from rotorfit.verdicts.judge import ADVICE, WEAK, Judgement, judge, motion_for
from rotorfit.verdicts.numbers import Derived, Parameter

SHARED_DERIVED = ("kd_over_kt", "motor_lag_total")
TIME_SCALE = 0.008
"""A motor delay of this size matters [s]: known to a quarter of it, it is identified."""
RATIOS = {
    "kd": ("kd_over_Izz", "Izz"),
    "Jr": ("Jr_over_Izz", "Izz"),
    "Izz": ("kd_over_Izz", "kd"),
}
"""The ratio that the yaw equation gives even where the number alone is lost, and with whom."""


def unit_of(info: ParameterInfo, entry: ConfigurationEntry) -> str:
    """Return the unit, per kilogram where the mass is unknown."""
    return f"{info.unit} per kg" if entry.mass == "unknown" and info.mass_power else info.unit


def judgements(numbers: Numbers, scale_of: Callable[[str], float]) -> dict[str, Judgement]:
    """Judge every number with its final interval.

    `scale_of`: from a number's name to a size of it that matters.
    """
    return {
        name: judge(
            *numbers.number(name),
            scale=scale_of(name),
            axis=motion_for(name.partition("@")[0]),
            excitation=numbers.rho(name),
        )
        for name in numbers.names
    }


def number_parameter(
    name: str,
    numbers: Numbers,
    judgement: Judgement,
    *,
    owner: str | None,
    entry: ConfigurationEntry,
) -> Parameter:
    """Tabulate one parameter with its verdict, and its value where that says that there is one.

    `owner`: the configuration it belongs to; None for what all share. `entry`: by which its unit
    goes.
    """
    known = judgement.verdict != "not-identified"
    base = name.partition("@")[0]
    value, half = numbers.number(name)
    return Parameter(
        name=base,
        configuration=owner,
        value=value if known else None,
        std=half / 1.96 if known else None,
        interval=(value - half, value + half) if known else None,
        unit=unit_of(PARAMETERS[base], entry),
        verdict=judgement.verdict,
        reason=judgement.reason,
        advice=judgement.advice,
    )


def number_derived(
    name: str,
    numbers: Numbers,
    judged: Mapping[str, Judgement],
    *,
    owner: str | None,
    entry: ConfigurationEntry,
) -> Derived:
    """Return one derived number; null where the flights do not give it. See `number_parameter`."""
    known = name in numbers.names and judged[name].verdict != "not-identified"
    base = name.partition("@")[0]
    value, half = numbers.number(name) if known else (0.0, 0.0)
    return Derived(
        name=base,
        configuration=owner,
        value=value if known else None,
        std=half / 1.96 if known else None,
        interval=(value - half, value + half) if known else None,
        unit=unit_of(DERIVED[base], entry),
        verdict=judged[name].verdict if name in numbers.names else "not-identified",
        reason=judged[name].reason if name in numbers.names else None,
    )


def motor_parameters(motors: MotorsEntry, timing: MotorTiming | None) -> list[Parameter]:
    """Return lag and delay, given or found; rising and falling apart where they differ."""
    found: dict[str, tuple[float, float]] = {}
    if timing is not None:
        response = timing.response
        if timing.lag_std is not None:
            found["motor_lag"] = (response.mean_lag, timing.lag_std)
        if timing.lag_std is not None and response.lag_down is not None:
            found["motor_lag_up"] = (response.lag, timing.lag_std)
            found["motor_lag_down"] = (response.lag_down, timing.lag_std)
        if timing.delay_std is not None:
            found["motor_delay"] = (response.delay, timing.delay_std)
    declared = {
        "motor_lag": motors.lag if motors.lag_down is None else None,
        "motor_lag_up": None if motors.lag_down is None else motors.lag,
        "motor_lag_down": motors.lag_down,
        "motor_delay": motors.delay,
    }
    given = [
        _given_time(name, value)
        for name, value in declared.items()
        if value is not None and name not in found
    ]
    return [*given, *(found_time(name, *number) for name, number in found.items())]


def _given_time(name: str, value: float) -> Parameter:
    return Parameter(
        name=name,
        configuration=None,
        value=value,
        std=None,
        interval=None,
        unit="s",
        verdict="given",
    )


def found_time(name: str, value: float, std: float) -> Parameter:
    """Return a time that the flights gave; sharp to a quarter of the time scale that matters."""
    half = 1.96 * std
    sharp, known = half <= WEAK * max(abs(value), TIME_SCALE), is_time_identifiable(value, std)
    # No rotor follows before its command; a delay is negative where motors are recorded late.
    low = value - half if name.endswith("_delay") else max(value - half, 0.0)
    return Parameter(
        name=name,
        configuration=None,
        value=value if known else None,
        std=std if known else None,
        interval=(low, value + half) if known else None,
        unit="s",
        verdict=("identified" if sharp else "weak") if known else "not-identified",
        reason=None if sharp else f"known only to +-{1e3 * half:.1f} ms",
        advice=None if sharp else ADVICE["roll"],
    )


def with_timing_total(
    derived: Iterable[Derived], timing: MotorTiming | None
) -> tuple[Derived, ...]:
    """Add lag plus delay of commands, which is sharper than either alone."""
    if timing is None or timing.response.mean_lag == 0.0:
        return tuple(derived)
    value, half = timing.response.mean_lag + timing.response.delay, 1.96 * timing.total_std
    total = Derived(
        name="motor_lag_total",
        configuration=None,
        value=value if timing.identifiable else None,
        std=timing.total_std if timing.identifiable else None,
        interval=(value - half, value + half) if timing.identifiable else None,
        unit="s",
    )
    return (total, *(d for d in derived if d.name != total.name))


def given_parameter(
    name: str, value: float | str, std: float, entry: ConfigurationEntry
) -> Parameter:
    """Return a parameter that the user gave, or left unknown."""
    known = isinstance(value, float)
    return Parameter(
        name=name,
        configuration=entry.name,
        value=value if known else None,
        std=std if known and std > 0 else None,
        interval=(value - 1.96 * std, value + 1.96 * std) if known and std > 0 else None,
        unit=PARAMETERS[name].unit,
        verdict="given" if known else "not-identified",
        reason=None if known else "everything scales with the mass",
        advice=None if known else "weigh the vehicle as it flies, battery included",
    )
