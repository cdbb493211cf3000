"""From the runs of a study to its tables, and to the limits that it must keep."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from benchmarks.accuracy.runs import METHODS, ScenarioName, Study, fly
from benchmarks.common import scales, true_values
from jaxtyping import Float

Runs = Sequence[Mapping[str, Any]]
SHARED: Final = ("kt", "kt_1", "kt_2", "kt_3", "kt_4", "kd", "Jr", "motor_lag", "motor_delay")
OWN: Final = (
    *("msx", "msy", "msz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"),
    *("accel_bias_x", "accel_bias_y", "accel_bias_z"),
)
DERIVED: Final = ("motor_lag_total", "kd_over_Izz", "Ixx_com", "Iyy_com", "Izz_com")
REPLICAS: Final = 400
"""Of the bootstrap over runs, for the standard errors of what the limits speak of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """The runs of one method: a row for each run, a column for each number.

    Attributes
    ----------
    names
        ``kt``, ``Ixx@A``.
    error, half_width
        In parts of `scale`; nan where the method gave none.
    bound
        Smallest possible standard deviation for the very flights of each run, in parts of `scale`;
        nan where there is none.
    identified
        Whether the verdict was ``identified``.
    """

    names: tuple[str, ...]
    error: Float[np.ndarray, "r n"]
    half_width: Float[np.ndarray, "r n"]
    bound: Float[np.ndarray, "r n"]
    identified: Float[np.ndarray, "r n"]

    def take(self, rows: Any = slice(None), names: Sequence[str] | None = None) -> "Scored":
        """Return some of the runs, or some of the numbers."""
        columns = [self.names.index(n) for n in (self.names if names is None else names)]
        return Scored(
            names=tuple(self.names[c] for c in columns),
            error=self.error[rows][:, columns],
            half_width=self.half_width[rows][:, columns],
            bound=self.bound[rows][:, columns],
            identified=self.identified[rows][:, columns],
        )

    @property
    def given(self) -> Float[np.ndarray, " n"]:
        """Share of the runs with a number."""
        return np.isfinite(self.error).mean(axis=0)

    @property
    def bias(self) -> Float[np.ndarray, " n"]:
        """Mean error."""
        return _mean(self.error)

    @property
    def std(self) -> Float[np.ndarray, " n"]:
        """Standard deviation of the errors."""
        return np.sqrt(_mean((self.error - self.bias) ** 2))

    @property
    def over_bound(self) -> Float[np.ndarray, " n"]:
        """Root mean square of error over bound, each run with the bound of its own flights."""
        return np.sqrt(_mean((self.error / self.bound) ** 2))

    @property
    def coverage(self) -> Float[np.ndarray, " n"]:
        """Share of the intervals that hold the truth."""
        held = (np.abs(self.error) <= self.half_width).astype(float)
        return _mean(np.where(np.isfinite(self.error), held, np.nan))


def _mean(values: Float[np.ndarray, "r n"]) -> Float[np.ndarray, " n"]:
    """Return the mean over the runs that have a number; nan where none has."""
    there = np.isfinite(values)
    total = np.where(there, values, 0.0).sum(axis=0)
    count = there.sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def truth_and_scale(
    scenario: ScenarioName, study: Study
) -> tuple[dict[str, float], dict[str, float]]:
    """Return what is true and what 100 % is, by name; shared numbers as of the first vehicle."""
    true: dict[str, float] = {}
    scale: dict[str, float] = {}
    example = Study(vehicles=study.vehicles, seconds=10.0, seed=study.seed)
    for name, flight in reversed(fly(0, scenario=scenario, study=example).items()):
        values, sizes = true_values(flight), scales(flight)
        true |= values | {f"{key}@{name}": value for key, value in values.items()}
        scale |= sizes | {f"{key}@{name}": size for key, size in sizes.items()}
    if scenario != "stress":
        # Measured speed: its lag is none, and the delay is that of the log.
        true |= {"motor_lag": 0.0, "motor_delay": 0.0, "motor_lag_total": 0.0}
    return true, scale


def scored(runs: Runs, method: str, *, scenario: ScenarioName, study: Study) -> Scored:
    """Return what a method found in all runs, beside truth and bound."""
    true, scale = truth_and_scale(scenario, study)
    own = [f"{name}@{owner}" for owner in study.vehicles for name in OWN]
    derived = [f"{name}@{owner}" for owner in study.vehicles for name in DERIVED[1:]]
    found = [run["found"].get(method, {}) for run in runs]
    names = [
        name
        for name in (*SHARED, DERIVED[0], *own, *derived)
        if any(row.get(name, [None])[0] is not None for row in found)
    ]

    def table(of: Callable[[Mapping[str, Any], str], float | None]) -> Float[np.ndarray, "r n"]:
        rows = [[of(row, name) for name in names] for row in found]
        return np.array(rows, dtype=float).reshape(len(found), len(names))

    nothing = [None, None, None]
    size = np.array([scale[name] for name in names])
    bound = [[run["bound"].get(name, np.nan) for name in names] for run in runs]
    return Scored(
        names=tuple(names),
        error=(table(lambda r, n: r.get(n, nothing)[0]) - [true[name] for name in names]) / size,
        half_width=table(lambda r, n: r.get(n, nothing)[1]) / size,
        bound=np.array(bound).reshape(len(found), len(names)) / size,
        identified=table(lambda r, n: float(r.get(n, nothing)[2] == "identified")),
    )


def identified_names(result: Scored) -> list[str]:
    """Return the parameters that most runs call identified; derived numbers are none."""
    often = result.identified.mean(axis=0) > 0.5
    return [n for n, yes in zip(result.names, often, strict=True) if yes]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """One limit, and how the study stands to it; passed with two standard errors of grace."""

    what: str
    value: float
    standard_error: float
    low: float = -np.inf
    high: float = np.inf

    @property
    def passed(self) -> bool:
        """Whether the value is inside the limits, two standard errors allowed."""
        grace = 2.0 * self.standard_error
        return self.low - grace <= self.value <= self.high + grace

    def __str__(self) -> str:
        word = "pass" if self.passed else "FAIL"
        low = f"at least {self.low:g}" if np.isfinite(self.low) else ""
        high = f"at most {self.high:g}" if np.isfinite(self.high) else ""
        limits = " and ".join(part for part in (low, high) if part)
        return f"{word}  {self.what}: {self.value:.3f} +- {self.standard_error:.3f} ({limits})"


def limits(result: Scored, scenario: ScenarioName) -> list[Verdict]:
    """Return how the default method stands to the limits of a scenario."""
    names = identified_names(result)
    if not names:
        return [Verdict(what="identified parameters", value=0.0, standard_error=0.0, low=1.0)]
    chosen = result.take(names=names)
    return _stress_limits(chosen) if scenario == "stress" else _noise_limits(chosen)


def _noise_limits(chosen: Scored) -> list[Verdict]:
    # Of the vehicle and its IMU: when its motors act belongs to the log.
    against = chosen.take(names=[n for n in chosen.names if not n.startswith("motor_")])
    return [
        _verdict(against, "RMSE / bound, median", lambda s: np.median(s.over_bound), high=1.15),
        _verdict(against, "RMSE / bound, worst", lambda s: s.over_bound.max(), high=1.35),
        _verdict(chosen, "coverage, mean", lambda s: s.coverage.mean(), low=0.92, high=0.98),
        _verdict(chosen, "coverage, least", lambda s: s.coverage.min(), low=0.88),
    ]


def _stress_limits(chosen: Scored) -> list[Verdict]:
    limited = {"kd": 3.0, "Izz": 3.0, "Ixx": 1.0, "Iyy": 1.0}
    verdicts = [
        _verdict(
            chosen.take(names=[name]),
            f"bias of {name} in %",
            lambda s: 100.0 * s.bias[0],
            low=-limited[name.partition("@")[0]],
            high=limited[name.partition("@")[0]],
        )
        for name in chosen.names
        if name.partition("@")[0] in limited
    ]
    return [*verdicts, _verdict(chosen, "coverage, mean", lambda s: s.coverage.mean(), low=0.93)]


def _verdict(
    result: Scored,
    what: str,
    statistic: Callable[[Scored], float],
    *,
    low: float = -np.inf,
    high: float = np.inf,
) -> Verdict:
    """Return a statistic with its standard error: by bootstrap over the runs."""
    rng = np.random.default_rng(0)
    count = len(result.error)
    replicas = [
        float(statistic(result.take(rng.integers(0, count, count)))) for _ in range(REPLICAS)
    ]
    return Verdict(
        what=what,
        value=float(statistic(result)),
        standard_error=float(np.nanstd(replicas)),
        low=low,
        high=high,
    )


def tables_text(runs: Runs, *, scenario: ScenarioName, study: Study) -> str:
    """Return the tables of one scenario: each method number by number, and a summary."""
    results = {m: scored(runs, m, scenario=scenario, study=study) for m in METHODS}
    names = " + ".join(study.vehicles)
    head = f"{scenario}: {names}, {study.seconds:g} s each, {len(runs)} runs"
    parts = [head, *(_method_text(m, result) for m, result in results.items())]
    return "\n\n".join([*parts, _summary_text(results)])


def _method_text(method: str, result: Scored) -> str:
    head = ("bias %", "std %", "bound %", "rmse/bound", "cover", "half %", "given")
    lines = [f"{method:18s}" + "".join(f"{word:>11s}" for word in head)]
    bound, half = np.sqrt(_mean(result.bound**2)), _mean(result.half_width)
    columns = (100 * result.bias, 100 * result.std, 100 * bound, result.over_bound)
    columns = (*columns, result.coverage, 100 * half, result.given)
    for i, name in enumerate(result.names):
        numbers = (f"{'' if np.isnan(c[i]) else format(c[i], '.3f'):>11s}" for c in columns)
        lines.append(f"  {name:16s}" + "".join(numbers))
    return "\n".join(lines)


def _summary_text(results: Mapping[str, Scored]) -> str:
    """Return one line a method, over the parameters that the default identifies."""
    names = identified_names(results["default"])
    head = ("rmse/bound", "worst", "coverage", "least", "kd bias %", "numbers")
    lines = [f"{'summary':18s}" + "".join(f"{word:>11s}" for word in head)]
    for method, result in results.items():
        chosen = result.take(names=[n for n in names if n in result.names])
        if not chosen.names:
            continue
        ratio, coverage = chosen.over_bound, chosen.coverage
        kd = 100 * chosen.bias[chosen.names.index("kd")] if "kd" in chosen.names else np.nan
        numbers = (np.nanmedian(ratio), np.nanmax(ratio), np.nanmean(coverage), np.nanmin(coverage))
        row = "".join(f"{number:11.3f}" for number in (*numbers, kd))
        lines.append(f"  {method:16s}{row}{len(chosen.names):11d}")
    return "\n".join(lines)
