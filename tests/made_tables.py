"""Tables of a result out of a made-up result, and back."""

from dataclasses import fields, replace

from rotorfit.results.assemble import mark_doubtful
from rotorfit.results.result import IdentificationResult
from rotorfit.results.tables import ResultTables

SHARED = [field.name for field in fields(ResultTables) if field.name != "used"]


def tables_of(result: IdentificationResult) -> ResultTables:
    """Return the tables that a result would have been made of."""
    return ResultTables(used={}, **{name: getattr(result, name) for name in SHARED})


def made_result(tables: ResultTables) -> IdentificationResult:
    """Return a result of no experiment with these tables."""
    return IdentificationResult(
        name="made",
        method="banded",
        settings={},
        versions={},
        **{name: getattr(tables, name) for name in SHARED},
    )


def judged(result: IdentificationResult) -> IdentificationResult:
    """Return a made-up result with the numbers marked that its findings doubt."""
    tables = mark_doubtful(tables_of(result))
    return replace(result, parameters=tables.parameters, derived=tables.derived)
