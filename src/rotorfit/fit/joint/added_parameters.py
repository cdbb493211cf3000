"""Parameters additional to those of a joint problem, each with a column of its own."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.estimation.parameter_map import ParameterMap, Product
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rotorfit.estimation.banded_problem import BandedProblem
    from rotorfit.model.terms.term import Block


@frozen_dataclass
class Added:
    """A parameter additional to the parameters of a fit.

    - `name`, `entries`: its column of the equations of motion.
    - `times`: the free parameter that it multiplies; None: it stands by itself.
    - `prior`: its deviation about zero before the flight.
    - `begin`: where its estimate begins.
    """

    name: str
    entries: Block
    times: str | None
    prior: float
    begin: float = 0.0


def with_added(
    problem: BandedProblem, added: Sequence[Added], instead_of: Sequence[str] = ()
) -> BandedProblem:
    """Return the problem with more parameters, and without some."""
    mapped = problem.map
    for name in instead_of:
        mapped = mapped.without(name)
    parts, entries, free = mapped.matrix.shape
    own = [one.name for one in added]
    columns = np.zeros((parts, entries + len(own), free + len(own)))
    columns[:, :entries, :free] = mapped.matrix
    products = list(mapped.products)
    for i, one in enumerate(added):
        if one.times is None:
            columns[:, entries + i, free + i] = 1.0
            continue
        first = mapped.names.index(one.times)
        products += [
            Product(configuration=c, entry=entries + i, first=first, second=free + i, factor=1.0)
            for c in range(parts)
        ]
    more = np.array([one.entries for one in added])
    kept = {n: std for n, std in problem.prior_std.items() if n not in instead_of}
    means = {n: mean for n, mean in problem.prior_mean.items() if n not in instead_of}
    return replace(
        problem,
        tensors=tuple(np.concatenate([tensor, more]) for tensor in problem.tensors),
        map=ParameterMap(
            names=(*mapped.names, *own),
            constant=np.pad(mapped.constant, ((0, 0), (0, len(own)))),
            matrix=columns,
            products=tuple(products),
        ),
        prior_mean=means,
        prior_std=kept | {one.name: one.prior for one in added},
    )
