"""The law of ``[motors]`` in the experiment file: rotor speed over command."""

from __future__ import annotations

from dataclasses import asdict
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, model_validator
from pydantic_core import core_schema

from rotorfit.fit.experiment.strict_tables import Finite, Positive, Strict
from rotorfit.logs.motor_law import (
    Curve,
    MotorLaw,
    PolynomialCurve,
    PowerCurve,
    SquareRootCurve,
    TableCurve,
    VoltageFactor,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from pydantic import GetCoreSchemaHandler
    from pydantic_core import CoreSchema

Share = Annotated[Finite, Field(ge=0, le=1)]
Row = tuple[Share, Annotated[Finite, Field(ge=0)]]

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
    """The battery's share: a `VoltageFactor`."""

    nominal: Positive
    exponent: Annotated[Finite, Field(gt=0, le=3)] = 1.0
    exponent_std: Annotated[Finite, Field(ge=0)] = 0.0
    missing_std: Share | None = None


class LawTable(Strict):
    """A `MotorLaw` as the file has it: exactly one curve, the battery's share, deviations."""

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
    def _one_curve(self) -> LawTable:
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


def _refuse_falling(table: tuple[tuple[float, float], ...]) -> None:
    for (command, speed), (next_command, next_speed) in pairwise(table):
        if not (next_command > command and next_speed > speed):
            raise ValueError(
                f"table goes from [{command:g}, {speed:g}] to [{next_command:g}, {next_speed:g}]; "
                "command and speed must both rise from row to row"
            )


def _convert_to_law(table: LawTable) -> MotorLaw:
    voltage = None if table.voltage is None else VoltageFactor(**table.voltage.model_dump())
    known = table.model_dump(exclude={*CURVES, "voltage"})
    return MotorLaw(curve=_curve_of(table), voltage=voltage, **known)


def _curve_of(table: LawTable) -> Curve:
    if table.table is not None:
        commands, speeds = zip(*table.table, strict=True)
        return TableCurve(commands, speeds)
    if table.sqrt is not None:
        return SquareRootCurve(**table.sqrt.model_dump())
    if table.power is not None:
        return PowerCurve(**table.power.model_dump())
    return PolynomialCurve(table.linear or table.polynomial or ())


def table_of_law(law: MotorLaw) -> dict[str, Any]:
    """Write a law as a table of the experiment file, without what is unknown."""
    match law.curve:
        case SquareRootCurve():
            curve: dict[str, Any] = {"sqrt": asdict(law.curve)}
        case PowerCurve():
            curve = {"power": asdict(law.curve)}
        case TableCurve(commands, speeds):
            curve = {"table": [list(row) for row in zip(commands, speeds, strict=True)]}
        case PolynomialCurve(coefficients):
            is_linear = len(coefficients) == 2 and coefficients[1] > 0.0
            curve = {"linear" if is_linear else "polynomial": list(coefficients)}
    known = {name: value for name, value in asdict(law).items() if name != "curve"}
    if law.voltage is not None:
        known["voltage"] = _without_none(asdict(law.voltage))
    return curve | _without_none(known)


def _without_none(table: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in table.items() if value is not None}


class LawSchema:
    """How a file's table becomes a `MotorLaw`, and a `MotorLaw` a table, for pydantic."""

    @staticmethod
    def __get_pydantic_core_schema__(_: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Validate what is no law by `LawTable`: its places are those that messages name."""

        def convert(given: Any, validate: Callable[[Any], LawTable]) -> MotorLaw:
            return given if isinstance(given, MotorLaw) else _convert_to_law(validate(given))

        return core_schema.no_info_wrap_validator_function(
            convert,
            handler.generate_schema(LawTable),
            serialization=core_schema.plain_serializer_function_ser_schema(table_of_law),
        )


DeclaredLaw = Annotated[MotorLaw, LawSchema]
"""The law of ``[motors]``."""
