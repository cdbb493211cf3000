"""The tables of a result on their way to it: `finished_result` makes the result of them, once.

Estimators tabulate their numbers, then units, the motors' law, the numbers of flight, assumptions
and verdicts follow, each as tables made of tables. A finished result is not rewritten.
"""

from __future__ import annotations

import dataclasses
import platform
from dataclasses import field
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from rotorfit import version
from rotorfit.fit.dataset.load import resolved_method
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.results.result import Derived, FlightRecord, IdentificationResult, Parameter

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Float

    from rotorfit.checks.verdicts.judge import Asks
    from rotorfit.findings import Finding
    from rotorfit.fit.experiment.experiment import Experiment
    from rotorfit.results.command_law import CommandLaw


@frozen_dataclass
class ResultTables:
    """What a result will hold, before its last check.

    - `parameters`, `derived`: the numbers so far.
    - `flights`: what was used of each.
    - `covariance_names`, `covariance`: of the parameters that have a value and are not given.
    - `used`: settings that the estimator chose.
    - `findings`: of the flights, the fit and its checks.
    - `diagnostics`: the numbers behind the findings.
    - `command_law`: from command to speed, where a log has both.
    """

    parameters: tuple[Parameter, ...]
    derived: tuple[Derived, ...]
    flights: tuple[FlightRecord, ...]
    covariance_names: tuple[str, ...]
    covariance: Float[np.ndarray, "p p"]
    used: Mapping[str, object]
    findings: tuple[Finding, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=dict[str, float])
    command_law: CommandLaw | None = None

    @property
    def every_finding(self) -> tuple[Finding, ...]:
        """The findings, and those of the single flights."""
        return (*self.findings, *(one for flight in self.flights for one in flight.findings))

    def found(self, *findings: Finding) -> ResultTables:
        """Return the tables with further findings."""
        return dataclasses.replace(self, findings=(*self.findings, *findings))


@frozen_dataclass
class Advice:
    """What simulated flights of its vehicle say of a result.

    - `by_number`: what to do for each number that is missing, and what that asks for.
    - `findings`: the manoeuvre that sharpens most, where one does.
    """

    by_number: Mapping[str, tuple[str, Asks]]
    findings: tuple[Finding, ...] = ()


def finished_result(
    experiment: Experiment,
    tables: ResultTables,
    *,
    validation: tuple[Mapping[str, Any], ...] = (),
    advice: Advice | None = None,
) -> IdentificationResult:
    """Make the result of an experiment from its tables.

    `validation` and `advice` are made with the result of the same tables without them.
    """
    resolved = experiment.model_dump(mode="json", exclude_none=True)
    return IdentificationResult(
        name=experiment.name,
        method=resolved_method(experiment),
        parameters=_advised_parameters(tables, advice),
        derived=tables.derived,
        flights=tables.flights,
        covariance_names=tables.covariance_names,
        covariance=tables.covariance,
        settings={**resolved, "used": dict(tables.used)},
        versions={
            "rotorfit": version.__version__,
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "python": platform.python_version(),
        },
        findings=(*tables.findings, *(() if advice is None else advice.findings)),
        diagnostics=tables.diagnostics,
        command_law=tables.command_law,
        validation=validation,
    )


def _advised_parameters(tables: ResultTables, advice: Advice | None) -> tuple[Parameter, ...]:
    """Return the parameters with what their vehicle was simulated to need."""
    if advice is None:
        return tables.parameters
    parameters: list[Parameter] = []
    for p in tables.parameters:
        words, asks = advice.by_number.get(p.full_name, (p.advice, p.asks))
        parameters.append(dataclasses.replace(p, advice=words, asks=asks))
    return tuple(parameters)
