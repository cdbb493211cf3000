"""The parameter map of the default estimator, from the free parameters to every configuration's.

Shared are kt, kd, Jr and one spread per rotor or group of rotors; all else each configuration has
for itself, under names that end in ``@`` and its name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rotorfit.estimation.factors import flights_of
from rotorfit.estimation.parameter_map import ParameterMap, parameter_map
from rotorfit.fit.experiment.payload import MOMENTS, PointMass, added_moments, tolerances
from rotorfit.fit.joint.closed_loop import NOMINAL_RESPONSE, ClosedLoopResponse
from rotorfit.fit.joint.trims import UNSEEN, Scatter
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import FIRST_MOMENTS
from rotorfit.model.terms.body import MASS
from rotorfit.model.terms.registry import DEFAULT_TERMS, TERMS
from rotorfit.model.terms.rotors import ROTOR_CENTER

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    import numpy as np
    from jaxtyping import Bool, Float

    from rotorfit.estimation.factors import Factors
    from rotorfit.fit.reduction.motor_timing import FreeTiming
    from rotorfit.model.regressor import Regressor
    from rotorfit.model.terms.term import Move, Term
    from rotorfit.model.vehicle import Vehicle

Free = dict[str, dict[tuple[int, str], float]]
"""The entries of theta that each free parameter moves."""
Products = dict[tuple[int, str], list[tuple[float, str, str]]]
"""The bilinear terms of each entry of theta."""


@frozen_dataclass
class JointConfiguration:
    """One configuration of the joint estimate.

    With `payload_of`, its body is that of the named configuration plus the known `payload`: it has
    no first moments and inertia of its own to estimate. `counted` and `with_response` are those of
    `informative_bands.py`: which errors of each block count, and to which of those of the turns the
    autopilot responds; `response` how far; `error_correlation` (also from there) how much of the
    errors of the turns comes with those of the forces. `reach`: highest frequency at which each
    error counts, by the bandwidth of its sensor [Hz]; None: every one. `timing` is what a fit may
    move of the motors' timing. `scatter`: by how much its flights differ.
    """

    name: str
    mass: float
    factors: Factors
    model: Regressor
    vehicle: Vehicle
    payload: tuple[PointMass, ...] = ()
    payload_of: str | None = None
    counted: Bool[np.ndarray, "b 6"] | None = None
    with_response: Bool[np.ndarray, "b e"] | None = None
    error_correlation: Float[np.ndarray, "6 6"] | None = None
    reach: Float[np.ndarray, "b 6"] | None = None
    timing: FreeTiming | None = None
    response: ClosedLoopResponse = NOMINAL_RESPONSE
    scatter: Scatter = UNSEEN


def joint_map(
    configurations: Sequence[JointConfiguration], *, terms: Collection[str] = DEFAULT_TERMS
) -> ParameterMap:
    """Return the map from the free parameters to theta of every configuration."""
    first = configurations[0]
    used = [
        term
        for term in TERMS
        if (term.when == "always" or term.name in terms) and term.stands_in(first.model.layout)
    ]
    every = range(len(configurations))
    spread = spread_names(first.vehicle) if any(t.owner == "rotor" for t in used) else ()
    free: Free = {
        name: {(c, name): 1.0 for c in every}
        for term in used
        if term.owner == "shared" and not term.moves
        for name in term.parameters
    }
    free |= {name: {} for name in dict.fromkeys(spread)}
    free |= {name: {} for name in (() if first.timing is None else first.timing.names)}
    free |= {name: {} for name in force_delay_names(configurations)}
    given: dict[tuple[int, str], float] = {}
    products: Products = {}
    for c, configuration in enumerate(configurations):
        given[c, "mass"] = configuration.mass
        free |= _body_parameters(c, configuration)
        products |= _spread_products(c, spread)
        for term in (*_own_terms(used, configuration), *_shared_moves(used)):
            own, more = _term_entries(term, c, configuration, free)
            free |= own
            for entry, parts in more.items():
                products[entry] = [*products.get(entry, ()), *parts]
    for c, configuration in enumerate(configurations):
        if configuration.payload_of is not None:
            added = added_moments(configuration.payload)
            given |= {(c, name): value for name, value in added.items()}
            _link_payload(c, configuration, added, free, used)
    return parameter_map(
        first.model.names, free, given, configurations=len(configurations), products=products
    )


def force_delay_names(configurations: Sequence[JointConfiguration]) -> tuple[str, ...]:
    """Return the names of the delays of the forces, of each flight; none where they are in time."""
    timing = configurations[0].timing
    if timing is None or timing.force_std is None:
        return ()
    flights = sum(len(flights_of(c.factors)) for c in configurations)
    return tuple(f"force_delay@{k}" for k in range(flights))


def _body_parameters(c: int, configuration: JointConfiguration) -> Free:
    """Return the moments of one configuration's body, and the tolerances of its payload."""
    at = f"@{configuration.name}"
    free: Free = {}
    if configuration.payload_of is None:
        free |= {f"{name}{at}": {(c, name): 1.0} for name in MOMENTS}
    for name, _, effect in tolerances(configuration.payload):
        free[f"{name}{at}"] = {(c, moment): factor for moment, factor in effect.items()}
    return free


def _own_terms(used: Sequence[Term], configuration: JointConfiguration) -> list[Term]:
    """Return the terms with own parameters of each configuration, besides its body."""
    centre = [ROTOR_CENTER] if configuration.vehicle.imu_position is None else []
    return centre + [t for t in used if t.owner == "configuration" and t.when != "always"]


def _shared_moves(used: Sequence[Term]) -> list[Term]:
    """Return the terms whose parameters are the same in all configurations, and move entries."""
    return [term for term in used if term.owner == "shared" and term.moves]


def _term_entries(
    term: Term, c: int, configuration: JointConfiguration, shared: Collection[str]
) -> tuple[Free, Products]:
    """Return a term's parameters with the entries of theta of one configuration that they move."""
    at = "" if term.owner == "shared" else f"@{configuration.name}"
    free: Free = {f"{name}{at}": {} for name in term.parameters}
    products: Products = {}
    for move in term.every_move:
        own = f"{move.parameter}{at}"
        if move.times is None:
            free[own][c, move.entry] = move.factor
        elif move.times in MASS.parameters:
            free[own][c, move.entry] = configuration.mass * move.factor
        else:
            other = _free_name(move, configuration)
            # What is times a parameter that is not among the `shared` ones of this model is no part
            # of it.
            if "@" not in other and other not in shared:
                continue
            products.setdefault((c, move.entry), []).append((move.factor, other, own))
    return free, products


def _free_name(move: Move, configuration: JointConfiguration) -> str:
    """Return the free parameter that a move is times: shared, or of the body under a payload."""
    body = configuration.payload_of or configuration.name
    return f"{move.times}@{body}" if move.times in MOMENTS else str(move.times)


def spread_names(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the spread of each rotor: its own, or that of the first rotor of its group.

    None where all rotors are of one group, which has nothing to differ from.
    """
    groups = [rotor.group for rotor in vehicle.rotors]
    first = [i if group is None else groups.index(group) for i, group in enumerate(groups)]
    return () if len(set(first)) == 1 else tuple(f"spread_{i + 1}" for i in first)


def _link_payload(
    c: int,
    configuration: JointConfiguration,
    added: Mapping[str, float],
    free: Free,
    used: Sequence[Term],
) -> None:
    """Let the body's parameters move a second configuration too, which is it plus a payload."""
    for name in MOMENTS:
        free[f"{name}@{configuration.payload_of}"][c, name] = 1.0
    # ms x b with ms = ms of the bare body + what the payload adds: the second part is linear.
    for term in _own_terms(used, configuration):
        for move in term.every_move:
            if move.times in FIRST_MOMENTS:
                own = f"{move.parameter}@{configuration.name}"
                free[own][c, move.entry] = move.factor * added[move.times]


def _spread_products(c: int, spread: Sequence[str]) -> Products:
    """Return k_t times the spread of each rotor, which is zero over all rotors."""
    mean = {name: spread.count(name) / len(spread) for name in spread}
    return {
        (c, f"kt_{i}"): [(float(name == own) - share, "kt", name) for name, share in mean.items()]
        for i, own in enumerate(spread, start=1)
    }
