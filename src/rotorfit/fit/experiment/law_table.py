"""The law of ``[motors]`` in the experiment file: rotor speed over command."""

from __future__ import annotations

import math
from dataclasses import asdict
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from rotorfit.fit.experiment.strict_tables import Finite, Positive, Strict
from rotorfit.flight.motors.motor_model import full_speed_of, speeds
from rotorfit.logs.speed_law import (
    Curve,
    PolynomialLaw,
    PowerLaw,
    SpeedLaw,
    SquareRootLaw,
    TableLaw,
    VoltageFactor,
)

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.logs.flight_log import LoggedMotors

Share = Annotated[Finite, Field(ge=0, le=1)]
Row = tuple[Share, Annotated[Finite, Field(ge=0)]]

BENT_ROWS = 201
"""Of the table that a bent law becomes."""
CURVES = ("linear", "polynomial", "table", "sqrt", "power")


class SqrtEntry(Strict):
    """PX4's and ArduPilot's model: relative thrust f u^2 + (1 - f) u, and the speed its root.

    u goes from 0 at the command `start` to 1 at `end`.
    """

    full_speed: Positive
    thr_mdl_fac: Share
    start: Share = 0.0
    end: Share = 1.0

    @model_validator(mode="after")
    def _check_rise(self) -> SqrtEntry:
        if not self.end > self.start:
            raise ValueError(f"end = {self.end:g} is not over start = {self.start:g}")
        return self


class PowerEntry(Strict):
    """Speed full_speed (offset + (1 - offset) u)^exponent, as rotorfit finds it from flights."""

    full_speed: Positive
    offset: Annotated[Finite, Field(gt=-1, lt=1)] = 0.0
    exponent: Annotated[Finite, Field(gt=0, le=3)]


class VoltageEntry(Strict):
    """Factor (V / nominal)^exponent of the speed, V being the log's battery voltage [V].

    `exponent_std`: its deviation. `missing_std`: deviation of the speed, as a share, of a flight
    whose log has no voltage; without it such a log is refused.
    """

    nominal: Positive
    exponent: Annotated[Finite, Field(gt=0, le=3)] = 1.0
    exponent_std: Annotated[Finite, Field(ge=0)] = 0.0
    missing_std: Share | None = None


class LawEntry(Strict):
    """Rotor speed over command [rad/s]: exactly one curve, and the battery's share.

    `speed_std`, `slope_std`: deviation of the speed in hover, and of how steeply it grows with the
    command there, as shares of them; `usual_speed`: the speed at which they hold [rad/s], if not
    that of the flight. `exact`: it is that of simulated motors: no flight is asked whether it is
    right. `stated`: it is a setting of the firmware, which nobody need have measured.
    """

    linear: tuple[Finite, Positive] | None = None
    polynomial: tuple[Finite, ...] | None = Field(default=None, min_length=2, max_length=6)
    table: tuple[Row, ...] | None = Field(default=None, min_length=2)
    sqrt: SqrtEntry | None = None
    power: PowerEntry | None = None
    voltage: VoltageEntry | None = None
    speed_std: Share = 0.0
    slope_std: Share = 0.0
    usual_speed: Positive | None = None
    exact: bool = False
    stated: bool = False

    @model_validator(mode="after")
    def _one_curve(self) -> LawEntry:
        given = [name for name in CURVES if getattr(self, name) is not None]
        if len(given) != 1:
            found = f"{' and '.join(given)} are given" if given else "none is given"
            raise ValueError(
                "give exactly one of linear = [offset, slope], polynomial = [c0, c1, ...], "
                "table = [[command, speed], ...], sqrt = { full_speed = , thr_mdl_fac = } and "
                "power = { full_speed = , offset = , exponent = }; "
                f"{found}"
            )
        if self.table is not None:
            _refuse_falling(self.table)
        return self

    @property
    def is_relative(self) -> bool:
        """Whether rotor speed is in parts of its largest: the law ends at 1."""
        return math.isclose(full_speed_of(speed_law_of(self)), 1.0)


def law_entry_of(logged: LoggedMotors) -> LawEntry:
    """Convert a law from an autopilot's parameters to its entry."""
    law = logged.law
    voltage = law.voltage
    factor = None
    if voltage is not None:
        factor = VoltageEntry(nominal=voltage.nominal, exponent=voltage.exponent)
    match law.curve:
        case SquareRootLaw():
            curve: dict[str, Any] = {"sqrt": SqrtEntry(**asdict(law.curve))}
        case PolynomialLaw(coefficients):
            curve = {"polynomial": coefficients}
        case _:
            raise TypeError(f"no entry for {law.curve}")
    return LawEntry(**curve, voltage=factor, exact=logged.exact, stated=not logged.exact)


def bent(law: LawEntry, power: float, *, anchor: float) -> LawEntry:
    """Return a law with another power of a law's speed, which is the same at a speed `anchor`."""
    if power == 1.0:
        return law
    voltage = law.voltage
    if voltage is not None:
        voltage = voltage.model_copy(
            update={
                "exponent": power * voltage.exponent,
                "exponent_std": power * voltage.exponent_std,
                "missing_std": voltage.missing_std and power * voltage.missing_std,
            }
        )
    if law.power is not None:
        full = float(bent_speed(np.array([law.power.full_speed]), power, anchor=anchor)[0])
        curve = {"full_speed": full, "exponent": power * law.power.exponent}
        own = law.power.model_copy(update=curve)
        return law.model_copy(update={"power": own, "voltage": voltage})
    command = np.linspace(0.0, 1.0, BENT_ROWS)
    rising = np.maximum.accumulate(speeds(speed_law_of(law), command))
    speed = bent_speed(rising, power, anchor=anchor)
    turning = np.flatnonzero(np.diff(speed) > 0.0)
    rows = tuple((float(command[i]), float(speed[i])) for i in (*turning, turning[-1] + 1))
    return LawEntry(table=rows, voltage=voltage, speed_std=law.speed_std, stated=law.stated)


def bent_speed(
    speed: Float[np.ndarray, "..."], power: float, *, anchor: float
) -> Float[np.ndarray, "..."]:
    """Return a power of speeds, at least 0, which is the same at a speed `anchor`."""
    return anchor * (np.maximum(speed, 0.0) / anchor) ** power


def _refuse_falling(table: tuple[tuple[float, float], ...]) -> None:
    for (command, speed), (next_command, next_speed) in pairwise(table):
        if not (next_command > command and next_speed > speed):
            raise ValueError(
                f"table goes from [{command:g}, {speed:g}] to [{next_command:g}, {next_speed:g}]; "
                "command and speed must both rise from row to row"
            )


def speed_law_of(entry: LawEntry) -> SpeedLaw:
    """Convert an entry to its law."""
    voltage = entry.voltage
    factor = None
    if voltage is not None:
        optional = voltage.missing_std is not None
        factor = VoltageFactor(voltage.nominal, voltage.exponent, optional=optional)
    return SpeedLaw(curve=_curve_of(entry), voltage=factor)


def _curve_of(entry: LawEntry) -> Curve:
    if entry.table is not None:
        commands, speeds = zip(*entry.table, strict=True)
        return TableLaw(commands, speeds)
    if entry.sqrt is not None:
        sqrt = entry.sqrt
        return SquareRootLaw(sqrt.full_speed, sqrt.thr_mdl_fac, sqrt.start, sqrt.end)
    if entry.power is not None:
        return PowerLaw(entry.power.full_speed, entry.power.offset, entry.power.exponent)
    return PolynomialLaw(entry.linear or entry.polynomial or ())
