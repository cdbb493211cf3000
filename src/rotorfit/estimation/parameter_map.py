"""The parameter map phi -> theta(phi): every constraint of an identification in one place.

Each configuration has its own theta (all parameters of the model, in the tensor's order); phi is
what the estimator is free to choose. A weighed mass is the constant, a removed parameter has no
column, a coefficient shared by two configurations is one phi for two thetas, and what is known to
be a combination (say Iyy - Ixx) is one column with several entries. It is affine nearly always;
the exceptions are products of two phi (an accelerometer bias times a first moment, a thrust
coefficient times a displacement of the rotors).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Bool, Float, Int


@frozen_dataclass
class Product:
    """A term factor * phi[first] * phi[second] of one entry of one configuration's theta."""

    configuration: int
    entry: int
    first: int
    second: int
    factor: float


@dataclass(frozen=True, kw_only=True)
class ParameterMap:
    """The map theta_c = constant_c + matrix_c phi + products, one row c per configuration.

    - `names`: of the free parameters phi.
    - `constant`: theta at phi = 0.
    - `matrix`: d theta / d phi there.
    - `products`: the bilinear terms; none in an affine map.
    """

    names: tuple[str, ...]
    constant: Float[np.ndarray, "c p"]
    matrix: Float[np.ndarray, "c p f"]
    products: tuple[Product, ...] = ()

    def theta(self, phi: Float[np.ndarray, " f"]) -> Float[np.ndarray, "c p"]:
        """Return the parameters of each configuration at `phi`."""
        theta = self.constant + self.matrix @ phi
        (c, entry, first, second), factor = self._product_places
        np.add.at(theta, (c, entry), factor * phi[first] * phi[second])
        return theta

    def jacobian(self, phi: Float[np.ndarray, " f"]) -> Float[np.ndarray, "c p f"]:
        """Return d theta / d phi at `phi`."""
        jacobian = self.matrix.copy()
        (c, entry, first, second), factor = self._product_places
        np.add.at(jacobian, (c, entry, first), factor * phi[second])
        np.add.at(jacobian, (c, entry, second), factor * phi[first])
        return jacobian

    @cached_property
    def moves(self) -> Bool[np.ndarray, "c f"]:
        """Which free parameters move theta of each configuration at all."""
        moves = np.asarray(self.matrix.any(axis=1))
        (c, _, first, second), _ = self._product_places
        moves[c, first] = moves[c, second] = True
        return moves

    @cached_property
    def _product_places(self) -> tuple[Int[np.ndarray, "4 n"], Float[np.ndarray, " n"]]:
        """Configuration, entry, first and second of every product, and its factor."""
        places = [(t.configuration, t.entry, t.first, t.second) for t in self.products]
        factors = [t.factor for t in self.products]
        return np.array(places, dtype=np.int64).reshape(-1, 4).T, np.array(factors, dtype=float)

    def without(self, name: str) -> ParameterMap:
        """Return the map with the free parameter `name` removed (held at zero)."""
        return self.fixed(name, 0.0)

    def fixed(self, name: str, value: float) -> ParameterMap:
        """Return the map with the free parameter `name` held at `value`."""
        column = self._column_of(name)
        keep = [i for i in range(len(self.names)) if i != column]
        place = {old: new for new, old in enumerate(keep)}
        constant = self.constant + self.matrix[:, :, column] * value
        matrix = self.matrix[:, :, keep]
        products: list[Product] = []
        for t in self.products:
            if column not in (t.first, t.second):
                moved = {"first": place[t.first], "second": place[t.second]}
                products.append(replace(t, **moved))
            elif t.first == t.second:
                constant[t.configuration, t.entry] += t.factor * value**2
            else:
                other = t.second if t.first == column else t.first
                matrix[t.configuration, t.entry, place[other]] += t.factor * value
        return ParameterMap(
            names=tuple(self.names[i] for i in keep),
            constant=constant,
            matrix=matrix,
            products=tuple(products),
        )

    def _column_of(self, name: str) -> int:
        if name not in self.names:
            raise EstimationError(
                f"no free parameter {name!r}; the map has {', '.join(self.names)}"
            )
        return self.names.index(name)


def parameter_map(
    theta_names: Sequence[str],
    free: Mapping[str, Mapping[tuple[int, str], float]],
    given: Mapping[tuple[int, str], float],
    *,
    configurations: int = 1,
    products: Mapping[tuple[int, str], Sequence[tuple[float, str, str]]] | None = None,
) -> ParameterMap:
    """Return the map in which each free parameter moves the named entries of theta.

    Parameters
    ----------
    theta_names
        The parameters of the model, in the tensor's order.
    free
        For each free parameter the entries of theta that it moves, as
        ``{(configuration, name): factor}``.
    given
        The entries of theta that are known, with their values; all others rest at zero.
    configurations
        How many there are.
    products
        For each entry of theta its bilinear terms ``(factor, free name, free name)``.

    Raises
    ------
    EstimationError
        If an entry names no parameter of the model.
    """
    index = {name: i for i, name in enumerate(theta_names)}
    constant = np.zeros((configurations, len(index)))
    matrix = np.zeros((configurations, len(index), len(free)))
    for (c, name), value in given.items():
        constant[c, _entry_of(index, name)] = value
    for f, moves in enumerate(free.values()):
        for (c, name), factor in moves.items():
            matrix[c, _entry_of(index, name), f] = factor
    place = {name: i for i, name in enumerate(free)}
    terms = [
        Product(
            configuration=c,
            entry=_entry_of(index, name),
            first=_entry_of(place, first),
            second=_entry_of(place, second),
            factor=factor,
        )
        for (c, name), parts in (products or {}).items()
        for factor, first, second in parts
    ]
    return ParameterMap(names=tuple(free), constant=constant, matrix=matrix, products=tuple(terms))


def _entry_of(index: Mapping[str, int], name: str) -> int:
    if name not in index:
        raise EstimationError(f"the model has no parameter {name!r}; it has {', '.join(index)}")
    return index[name]
