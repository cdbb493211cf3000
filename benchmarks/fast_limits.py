"""How well can any function of the state predict the fast flights of NeuroBEM that it has not seen?

After the terms of `fast_flight` a smooth function of velocity, rates and rotor speeds (Gaussian
kernels, ridge) is fitted to what is left of two flights, and predicts the third. Its width and
ridge are those that predict the third flight best, which no user could choose: a lower limit of the
error that a model of the state learns from two flights. `--history` adds the changes of rotor speed
and the state 20 to 200 ms before. That says less of a model: past rates give angular acceleration.

    ROTORFIT_DATA=... python -m benchmarks.fast_limits [--history]
"""

import argparse
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from benchmarks.fast_flight import (
    FLIGHTS,
    FORCE_BAND,
    MODELS,
    MOMENT_BAND,
    RATE,
    Flight,
    filter_below,
    make_columns,
    read_flight,
)
from jaxtyping import Float
from scipy.linalg import solve

COMPONENTS: Final = ("Fx [N]", "Fy [N]", "Fz [N]", "Mx [mN m]", "My [mN m]", "Mz [mN m]")
WIDTHS: Final = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Widths of the kernels, in deviations of the state times the root of its size."""
RIDGES: Final = (0.01, 0.1, 1.0, 10.0)
ROWS: Final = 2500
"""Rows that are learnt from, of 22 000 to 27 000."""
TESTED: Final = 1500
PAST: Final = (0.02, 0.05, 0.1, 0.2)
"""How long before the past state is taken [s]."""


def make_state(flight: Flight, *, history: bool) -> Float[np.ndarray, "n k"]:
    """Return what the error may depend on."""
    state = np.hstack([flight.velocity, flight.rates, flight.speeds])
    if not history:
        return state
    changes = np.gradient(filter_below(flight.speeds, 20.0), 1.0 / RATE, axis=0)
    past = [
        np.vstack([np.repeat(state[:1], rows, axis=0), state[:-rows]])
        for rows in (round(RATE * before) for before in PAST)
    ]
    return np.hstack([state, changes, *past])


def measure_kernels(
    a: Float[np.ndarray, "n k"], b: Float[np.ndarray, "m k"]
) -> Float[np.ndarray, "n m"]:
    """Compute the mean squared differences of states."""
    square = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * a @ b.T
    return square.clip(min=0.0) / a.shape[1]


def predict_flexibly(
    known: tuple[np.ndarray, np.ndarray], tested: tuple[np.ndarray, np.ndarray]
) -> Iterator[float]:
    """Yield the mean square of what each width and ridge leaves of the tested flight."""
    (states, left), (own, error) = known, tested
    near, far = measure_kernels(states, states), measure_kernels(own, states)
    for width in WIDTHS:
        K, across = (np.exp(-0.5 * square / width**2) for square in (near, far))
        for ridge in RIDGES:
            shares = solve(K + ridge * np.eye(len(K)), left, assume_a="pos")
            yield float(((error - across @ shares) ** 2).mean())


def compare_component(flights: list[Flight], k: int, *, history: bool) -> Float[np.ndarray, " 3"]:
    """Return the rms error of a component by the terms, with the function, and of NeuroBEM."""
    rng = np.random.default_rng(k)
    band = FORCE_BAND if k < 3 else MOMENT_BAND
    states = [make_state(flight, history=history) for flight in flights]
    middle, size = np.vstack(states).mean(axis=0), np.vstack(states).std(axis=0)
    states = [filter_below((one - middle) / size, band) for one in states]
    columns = [filter_below(make_columns(f, MODELS[2])[k], band) for f in flights]
    wrench = [np.hstack([f.force, f.moment])[:, k : k + 1] for f in flights]
    felt = [filter_below(one, band)[:, 0] for one in wrench]
    squares: list[list[float]] = []
    for i, flight in enumerate(flights):
        others = [j for j in range(len(flights)) if j != i]
        X, y, Z = (np.concatenate([one[j] for j in others]) for one in (columns, felt, states))
        theta = np.linalg.lstsq(X, y, rcond=None)[0]
        rows = rng.choice(len(y), ROWS, replace=False)
        own = rng.choice(len(felt[i]), TESTED, replace=False)
        error = (felt[i] - columns[i] @ theta)[own]
        known = Z[rows], (y - X @ theta)[rows]
        bem = filter_below(wrench[i] - flight.bem[:, k : k + 1], band)[own]
        every = list(predict_flexibly(known, (states[i][own], error)))
        squares.append([float((error**2).mean()), *every, float((bem**2).mean())])
    rms = np.sqrt(np.mean(squares, axis=0))
    return np.array([rms[0], rms[1:-1].min(), rms[-1]])


def main() -> None:
    """Print the table of rms errors over all flights."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--history", action="store_true")
    history = parser.parse_args().history
    folder = Path(os.environ["ROTORFIT_DATA"]) / "neurobem"
    flights = [read_flight(folder / f"{name}.csv") for name in FLIGHTS]
    print("| component | terms | any function | NeuroBEM | ratio |\n|---|---|---|---|---|")
    for k, name in enumerate(COMPONENTS):
        terms, best, bem = compare_component(flights, k, history=history) * (1.0, 1e3)[k >= 3]
        print(f"| {name} | {terms:.3g} | {best:.3g} | {bem:.3g} | {best / bem:.2f} |", flush=True)


if __name__ == "__main__":
    main()
