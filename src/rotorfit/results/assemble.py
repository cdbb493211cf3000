"""Assemble a result from an estimate, its flights and its findings."""

import dataclasses
import platform
from collections.abc import Collection, Mapping, Sequence

import numpy as np
import scipy
from jaxtyping import Float

from rotorfit import version
from rotorfit.dataset.dataset import Dataset, LoadedFlight
from rotorfit.dataset.load import resolved_method
from rotorfit.experiment.experiment import Experiment
from rotorfit.findings import Finding, diagnostics_of
from rotorfit.results.result import Derived, FlightRecord, IdentificationResult, Parameter
from rotorfit.verdicts.judge import judged_derived
from rotorfit.verdicts.parameter_tables import RATIOS

FLYABLE = ("weak", "ratio-only", "not-identified")
"""Verdicts that more flying might better."""


def assembled(
    experiment: Experiment,
    dataset: Dataset,
    *,
    parameters: tuple[Parameter, ...],
    derived: tuple[Derived, ...],
    covariance_names: tuple[str, ...],
    covariance: Float[np.ndarray, "p p"],
    used: Mapping[str, object],
    diagnostics: Mapping[str, float],
    findings: tuple[Finding, ...] = (),
) -> IdentificationResult:
    """Assemble a result; `used` are the settings that the estimator chose."""
    resolved = experiment.model_dump(mode="json", exclude_none=True)
    return IdentificationResult(
        name=experiment.name,
        method=resolved_method(experiment),
        parameters=parameters,
        derived=derived,
        flights=tuple(
            _record(flight, configured.entry.name)
            for configured in dataset.configurations
            for flight in configured.flights
        ),
        covariance_names=covariance_names,
        covariance=covariance,
        settings={**resolved, "used": dict(used)},
        versions={
            "rotorfit": version.__version__,
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "python": platform.python_version(),
        },
        findings=findings,
        diagnostics=diagnostics,
    )


def _record(flight: LoadedFlight, configuration: str) -> FlightRecord:
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


def with_diagnosis(
    result: IdentificationResult, findings: Sequence[Finding]
) -> IdentificationResult:
    """Add findings to a result, and withhold the numbers that they disprove."""
    result = dataclasses.replace(
        result.found(*findings),
        diagnostics={**result.diagnostics, **diagnostics_of(findings)},
    )
    for finding in findings:
        if finding.withheld_because is not None:
            result = withheld(result, finding)
    return result


def withheld(result: IdentificationResult, finding: Finding) -> IdentificationResult:
    """Withhold the numbers of a finding; those known as a ratio get that verdict."""
    ratios = {(d.name, d.configuration) for d in result.derived if d.value is not None}
    parameters = tuple(
        _without_value(p, ratios, finding) if finding.is_about(p.full_name) else p
        for p in result.parameters
    )
    derived = tuple(
        dataclasses.replace(d, value=None, std=None, interval=None, reason=finding.withheld_because)
        if finding.is_about(d.full_name)
        else d
        for d in result.derived
    )
    known = {p.full_name for p in parameters if p.value is not None}
    keep = [i for i, name in enumerate(result.covariance_names) if name in known]
    return dataclasses.replace(
        result,
        parameters=parameters,
        derived=derived,
        covariance_names=tuple(result.covariance_names[i] for i in keep),
        covariance=result.covariance[np.ix_(keep, keep)],
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
    )


def mark_doubtful(result: IdentificationResult) -> IdentificationResult:
    """Judge the derived numbers, and call doubtful what a finding says not to trust.

    Numbers for which flying is useless get the finding's next step in place of a manoeuvre.
    """
    disowning = [one for one in result.findings if one.doubtful_because is not None]
    useless = [one for one in result.findings if one.useless_because is not None]
    parameters = tuple(
        _advised_first(_judged_again(p, disowning), useless) for p in result.parameters
    )
    derived = (_derived_again(d, disowning) for d in judged_derived(parameters, result.derived))
    return dataclasses.replace(result, parameters=parameters, derived=tuple(derived))


def _advised_first(parameter: Parameter, useless: Sequence[Finding]) -> Parameter:
    """Return a parameter with the step without which no flying helps it."""
    about = next((one for one in useless if one.is_about(parameter.full_name)), None)
    if about is None or parameter.verdict not in FLYABLE:
        return parameter
    reason = parameter.reason if parameter.verdict == "weak" else about.useless_because
    return dataclasses.replace(parameter, reason=reason, advice=about.next_step)


def _judged_again(parameter: Parameter, disowning: Sequence[Finding]) -> Parameter:
    """Return a parameter as doubtful where one of the findings is about it."""
    about = [one for one in disowning if one.is_about(parameter.full_name)]
    if not about or parameter.verdict not in ("identified", "weak"):
        return parameter
    steps = [one.next_step for one in about if one.next_step]
    return dataclasses.replace(
        parameter,
        verdict="doubtful",
        reason=_why_doubtful(about),
        advice=steps[0] if steps else parameter.advice,
    )


def _derived_again(derived: Derived, disowning: Sequence[Finding]) -> Derived:
    about = [one for one in disowning if one.is_about(derived.full_name)]
    if not about or derived.verdict not in ("identified", "weak"):
        return derived
    return dataclasses.replace(derived, verdict="doubtful", reason=_why_doubtful(about))


def _why_doubtful(about: Sequence[Finding]) -> str:
    reasons = " and ".join(dict.fromkeys(str(one.doubtful_because) for one in about))
    return f"may be outside its interval, because {reasons}"
