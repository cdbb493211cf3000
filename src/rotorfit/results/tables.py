"""The tables of a result on their way to it: `finished_result` makes the result of them, once.

Estimators tabulate their numbers, then units, the motors' law, the numbers of flight, assumptions
and verdicts follow, each as tables made of tables. A finished result is not rewritten.
"""

from __future__ import annotations

import dataclasses
import platform
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import scipy

from rotorfit import version
from rotorfit.fit.dataset.load import resolved_method
from rotorfit.results.result import Derived, FlightRecord, IdentificationResult, Parameter

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Float

    from rotorfit.findings import Finding
    from rotorfit.fit.experiment.experiment import Experiment
    from rotorfit.results.command_law import CommandLaw


@dataclass(frozen=True, slots=True, kw_only=True)
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


def finished_result(experiment: Experiment, tables: ResultTables) -> IdentificationResult:
    """Make the result of an experiment from its tables."""
    resolved = experiment.model_dump(mode="json", exclude_none=True)
    return IdentificationResult(
        name=experiment.name,
        method=resolved_method(experiment),
        parameters=tables.parameters,
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
        findings=tables.findings,
        diagnostics=tables.diagnostics,
        command_law=tables.command_law,
    )
