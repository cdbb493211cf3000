"""The three estimators, each from what was flown to the tables of a result."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from rotorfit.dataset.dataset import Dataset
from rotorfit.diagnostics.consistency_checks import hover_thrusts, thrust_against_weight
from rotorfit.diagnostics.coupling import uncoupled_fit, without_yaw_scale
from rotorfit.diagnostics.diagnose import diagnose
from rotorfit.diagnostics.estimated_velocity import velocity_estimated, with_velocity_errors
from rotorfit.diagnostics.filtered_imu import with_filter_faults
from rotorfit.diagnostics.instruments.reference_test import compare_with_reference
from rotorfit.diagnostics.weight import contradiction, missed, swallowed, vagueness
from rotorfit.errors import ExperimentError, UnsettledError
from rotorfit.estimation.banded import BandedEstimate
from rotorfit.experiment.experiment import Experiment
from rotorfit.experiment.model_terms import DEFAULT_TERMS, Term
from rotorfit.fit.intervals.joint_numbers import joint_numbers, physical
from rotorfit.fit.intervals.kt_from_weight import WeighedThrust, absorbed_weight, kt_from_weight
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.intervals.other_settings import widened
from rotorfit.fit.joint.closed_loop import NOMINAL_RESPONSE
from rotorfit.fit.joint.joint_fit import FittedFactors, joint_fit
from rotorfit.fit.joint.joint_problem import JointConfiguration, at_values, joint_estimate
from rotorfit.fit.joint.term_choice import chosen
from rotorfit.fit.rows.paper_fit import PaperSettings, paper_estimate
from rotorfit.fit.rows.row_fits import RowFits, fit_rows
from rotorfit.fit.rows.row_parameters import row_numbers
from rotorfit.fit.timing.timing_fit import timed_again
from rotorfit.results.joint_tables import joint_tables
from rotorfit.results.paper_tables import paper_tables
from rotorfit.results.parameter_tables import Tables, with_timing_total
from rotorfit.results.row_tables import row_tables

FEWER_TERMS: Final[tuple[tuple[Term, ...], ...]] = (
    (),
    ("rotor_drag",),
    ("rotor_drag", "twist"),
    ("rotor_drag", "twist", "rotor_inertia"),
    ("rotor_drag", "twist", "rotor_inertia", "rotor_spread"),
    ("rotor_drag", "twist", "rotor_inertia", "rotor_spread", "climb_drag"),
)
"""What is left out of the model, in this order, where a fit does not settle: what flights tell
least first."""


def resolved_method(experiment: Experiment) -> str:
    """Return the method of an experiment; the preset of the paper brings its own.

    Raises
    ------
    ExperimentError
        If the method cannot take what the experiment has.
    """
    given = experiment.identification
    method = "tls" if given.preset == "paper" else given.method
    if method == "ols" and len(experiment.configuration) > 1:
        names = ", ".join(entry.name for entry in experiment.configuration)
        raise ExperimentError(
            f'method = "ols" takes one configuration, not {len(experiment.configuration)} '
            f'({names}); use "banded" or "tls", or leave one [[configuration]] in the file'
        )
    return method


def joint_result(experiment: Experiment, dataset: Dataset) -> Tables:
    """Return the tables of the joint likelihood of all equations and configurations."""
    wanted = experiment.identification.terms
    fit, joint, present, unsettled = _settled(dataset, wanted)

    def refit(terms: Sequence[Term], at: BandedEstimate) -> BandedEstimate:
        return _refitted(joint, terms, at)

    choice, fit = chosen(wanted, fit, joint, refit=refit, present=present)
    terms = choice.terms
    if set(terms) - set(present):
        dataset = timed_again(dataset, terms)
        fit, joint = joint_fit(dataset, terms=terms, begin=_unmoved(dataset, fit))
    numbers = _joint_numbers(dataset, fit, joint)
    uncoupled = uncoupled_fit(dataset, fit, numbers, terms=terms)
    if uncoupled is not None:
        dataset, fit, joint = uncoupled.dataset, uncoupled.fit, uncoupled.joint
        numbers = _joint_numbers(dataset, fit, joint)
    numbers = _joint_widened(dataset, fit, numbers, joint, terms=terms)
    fit, joint, numbers, doubts = _by_weight(dataset, fit, joint, numbers, terms=terms)
    numbers = with_filter_faults(with_velocity_errors(numbers, dataset), dataset)
    tables = joint_tables(
        numbers,
        fit,
        joint,
        [c.entry for c in dataset.configurations],
        motors=experiment.motors,
        timing=dataset.motor_timing,
    )
    tables = replace(
        tables,
        warnings=(*tables.warnings, *unsettled, *choice.sentences, *doubts),
        settings={**tables.settings, **choice.settings, **_response_setting(joint)},
    )
    kept = FittedFactors(
        configurations=tuple(joint), terms=tuple(terms), values=fit.estimate.by_name
    )
    tables = with_timing_total(replace(tables, factors=kept), dataset.motor_timing)
    tables = diagnose(tables, dataset, numbers, fit=fit, joint=joint)
    tables = compare_with_reference(tables, dataset, numbers, fit=fit, joint=joint)
    return tables if uncoupled is None else without_yaw_scale(tables, uncoupled.gain)


def _response_setting(
    joint: Sequence[JointConfiguration],
) -> dict[str, dict[str, tuple[float, ...]]]:
    """Return the autopilot's answer beyond the usual one, where the flights tell it."""
    answer = joint[0].answer
    if answer == NOMINAL_RESPONSE:
        return {}
    return {"autopilot_answer": {"beyond_usual": answer.beyond, "half_width": answer.open}}


def _unmoved(dataset: Dataset, fit: BandedEstimate) -> dict[str, float]:
    """Return where a fit ended, but for the timing, at which the signals are made anew."""
    free, ended = dataset.free_timing, fit.estimate.by_name
    return ended if free is None else free.without_times(ended)


def _by_weight(
    dataset: Dataset,
    fit: BandedEstimate,
    joint: list[JointConfiguration],
    numbers: Numbers,
    *,
    terms: Sequence[Term],
) -> tuple[BandedEstimate, list[JointConfiguration], Numbers, tuple[str, ...]]:
    """Return the fit with k_t from the weight where that contradicts it or is surer, in words.

    Otherwise what was given, and no words.
    """
    weighed = kt_from_weight(dataset.configurations, dataset.vehicle)
    found = _kt_of(numbers)
    biased = absorbed_weight(dataset, numbers)
    if weighed is None:
        return fit, joint, numbers, ()
    contradicts = weighed.contradicts(*found)
    surer = weighed.is_surer_than(*found, timed=dataset.timing_identifiable)
    if not (contradicts or surer or biased is not None):
        return fit, joint, *_reaching_weight(dataset, fit, numbers, terms=terms)
    fit, joint = joint_fit(dataset, weighed=weighed, terms=terms)
    anchored = _joint_numbers(dataset, fit, joint)
    anchored = _joint_widened(dataset, fit, anchored, joint, weighed=weighed, terms=terms)
    anchored = _as_sure_as_weight(dataset, fit, anchored, joint, weighed=weighed, terms=terms)
    if contradicts:
        words = contradiction(weighed, found[0], dataset.motors, dataset.source)
        return fit, joint, _holding_both(anchored, numbers), (words,)
    if surer or biased is None:
        return fit, joint, _reaching(anchored, numbers), (vagueness(weighed, *found),)
    words = swallowed(
        biased, weighed, found[0], dataset.source, estimated=velocity_estimated(dataset)
    )
    return fit, joint, _holding_both(anchored, numbers), (words,)


def _reaching_weight(
    dataset: Dataset, fit: BandedEstimate, numbers: Numbers, *, terms: Sequence[Term]
) -> tuple[Numbers, tuple[str, ...]]:
    """Return the numbers with intervals that reach k_t by the weight, where they surely miss it.

    What little the model lacks (thrust in climb and descent is no straight line) is then in them.
    """
    if any(c.entry.mass == "unknown" for c in dataset.configurations):
        return numbers, ()
    found = hover_thrusts(dataset.configurations, numbers, dataset.vehicle)
    doubt, told = thrust_against_weight(found, numbers)
    if doubt is None:
        return numbers, ()
    kt, ratio = _kt_of(numbers)[0], told["thrust_over_weight"]
    held = WeighedThrust(kt=kt / ratio, std=0.0)
    begin = {**fit.estimate.by_name, "kt": held.kt}
    try:
        at_weight = _joint_numbers(
            dataset, *joint_fit(dataset, weighed=held, terms=terms, begin=begin)
        )
    except UnsettledError:
        return numbers, ()
    apart = np.abs(numbers.values - at_weight.values)
    return replace(numbers, half_width=numbers.half_width + apart), (missed(ratio, kt),)


def _settled(
    dataset: Dataset, wanted: Sequence[Term] | None
) -> tuple[BandedEstimate, list[JointConfiguration], tuple[Term, ...], tuple[str, ...]]:
    """Return the fit with all default terms, or the most of them with which it settles, in words.

    Terms that the user asks for are kept, and a fit that does not settle with them is refused.
    """
    if wanted is not None:
        return *joint_fit(dataset, terms=wanted, begin=dataset.reached), tuple(wanted), ()
    usual: list[Term] = [
        t for t in DEFAULT_TERMS if t != "climb_drag" or dataset.velocity == "climb"
    ]
    for dropped in FEWER_TERMS:
        terms: tuple[Term, ...] = tuple(t for t in usual if t not in dropped)
        try:
            fit, joint = joint_fit(dataset, terms=terms, begin=dataset.reached)
        except UnsettledError:
            if dropped == FEWER_TERMS[-1]:
                raise
            continue
        words = (
            f"the flights hardly determine all parameters: the fit settles only without "
            f"{' and '.join(dropped)}, which are left out; fly more motion about every axis",
        )
        return fit, joint, terms, words if dropped else ()
    raise UnsettledError("no terms to try")


def _kt_of(numbers: Numbers) -> tuple[float, float]:
    """Return value and standard deviation of k_t."""
    value, half = numbers.number("kt")
    return value, half / 1.96


def _as_sure_as_weight(
    dataset: Dataset,
    fit: BandedEstimate,
    numbers: Numbers,
    joint: Sequence[JointConfiguration],
    *,
    weighed: WeighedThrust,
    terms: Sequence[Term],
) -> Numbers:
    """Return the numbers of a fit held at the weight's k_t with what is open of that."""
    off = replace(weighed, kt=weighed.kt + weighed.std)
    begin = {**fit.estimate.by_name, "kt": off.kt}
    moved = _shift(dataset, fit, numbers, joint, weighed=off, terms=terms, begin=begin)
    return replace(numbers, half_width=np.hypot(numbers.half_width, 1.96 * moved))


def _holding_both(numbers: Numbers, other: Numbers) -> Numbers:
    """Return the numbers with intervals that hold those of another model, too."""
    apart = np.abs(numbers.values - other.values)
    return replace(numbers, half_width=np.maximum(numbers.half_width, apart + other.half_width))


def _reaching(numbers: Numbers, other: Numbers) -> Numbers:
    """Return the numbers with intervals that reach the values of a vaguer model, too."""
    apart = np.abs(numbers.values - other.values)
    return replace(numbers, half_width=np.maximum(numbers.half_width, apart))


def _refitted(
    joint: Sequence[JointConfiguration], terms: Sequence[Term], fit: BandedEstimate
) -> BandedEstimate:
    """Return the fit with other terms, begun where another one ended."""
    return joint_estimate(joint, [], terms=terms, begin=fit.estimate.by_name)


def _joint_numbers(
    dataset: Dataset, fit: BandedEstimate, joint: list[JointConfiguration]
) -> Numbers:
    return joint_numbers(
        fit, joint, {c.entry.name: c.entry.mass_std for c in dataset.configurations}
    )


def _numbers_at(
    reached: Mapping[str, float], fit: BandedEstimate, joint: Sequence[JointConfiguration]
) -> Float[np.ndarray, " q"]:
    """Return the numbers of a fit at other values of its free parameters."""
    phi = at_values(fit.problem, reached, fit.estimate.values)
    return np.array(list(physical(phi, fit.problem.map, joint).values()))


def _joint_widened(
    dataset: Dataset,
    fit: BandedEstimate,
    numbers: Numbers,
    joint: Sequence[JointConfiguration],
    *,
    weighed: WeighedThrust | None = None,
    terms: Sequence[Term],
) -> Numbers:
    """Return the intervals widened by what settings shift that could as well be others."""

    def shift(other: Dataset, top: float) -> Float[np.ndarray, " q"]:
        return _shift(other, fit, numbers, joint, weighed=weighed, terms=terms, top=top)

    timed = dataset.free_timing is not None
    half = widened(numbers.half_width, dataset, shift, timed=timed)
    return dataclasses.replace(numbers, half_width=half)


def _shift(
    other: Dataset,
    fit: BandedEstimate,
    numbers: Numbers,
    joint: Sequence[JointConfiguration],
    *,
    begin: Mapping[str, float] | None = None,
    **settings: Any,
) -> Float[np.ndarray, " q"]:
    """Return how far another fit, begun where one ended unless told, is from its numbers."""
    begin = fit.estimate.by_name if begin is None else begin
    try:
        fitted = joint_fit(other, begin=begin, **settings)
    except UnsettledError as error:
        # It wanders off from the numbers: by so much at least they are open.
        return _numbers_at(error.reached, fit, joint) - numbers.values
    return _numbers_at(fitted[0].estimate.by_name, *fitted) - numbers.values


def row_result(experiment: Experiment, dataset: Dataset) -> Tables:
    """Return the tables of the estimate row by row."""
    configured = next(iter(dataset.configurations))
    fits = _rows_at(dataset)
    numbers = _row_numbers(dataset, fits)

    def shift(other: Dataset, top: float) -> Float[np.ndarray, " q"]:
        return _row_numbers(other, _rows_at(other, top=top)).values - numbers.values

    half = widened(numbers.half_width, dataset, shift, timed=False)

    tables = row_tables(
        dataclasses.replace(numbers, half_width=half),
        fits,
        configured.entry,
        vehicle=dataset.vehicle,
        motors=experiment.motors,
        timing=dataset.motor_timing,
    )
    return with_timing_total(tables, dataset.motor_timing)


def _rows_at(dataset: Dataset, *, top: float = np.inf) -> RowFits:
    factors = dataset.bands(dataset.timing)[0]
    factors = factors.select(factors.band[:, 0] < top)
    return fit_rows(factors, dataset.model, mass=dataset.configurations[0].mass)


def _row_numbers(dataset: Dataset, fits: RowFits) -> Numbers:
    configured = dataset.configurations[0]
    return row_numbers(
        fits, dataset.vehicle, mass=configured.mass, mass_std=configured.entry.mass_std
    )


def paper_result(experiment: Experiment, dataset: Dataset) -> Tables:
    """Return the tables of total least squares, the paper's way."""
    settings = _paper_settings(experiment)
    tables = paper_tables(paper_estimate(dataset, settings=settings), dataset, settings=settings)
    return with_timing_total(tables, dataset.motor_timing)


def _paper_settings(experiment: Experiment) -> PaperSettings:
    """Return the paper's settings with what the experiment overrides."""
    given = experiment.identification
    default = PaperSettings()
    keep_all = given.preset is None and given.r_sigma is None
    return PaperSettings(
        cutoff=given.cutoff or default.cutoff,
        r_sigma=None if keep_all else given.r_sigma or default.r_sigma,
    )


ESTIMATES: Final[dict[str, Callable[[Experiment, Dataset], Tables]]] = {
    "banded": joint_result,
    "ols": row_result,
    "tls": paper_result,
}
"""The estimators by the names of ``method``."""
