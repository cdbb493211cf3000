"""One run of the study: fly, identify by every method, and the bound of the same flights."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from benchmarks.accuracy.bound import flights_bound
from benchmarks.accuracy.rivals import rival_estimates
from benchmarks.common import identify_flights, named_vehicle

from rotorfit.estimation.estimate import Estimate
from rotorfit.results.result import IdentificationResult
from rotorfit.simulation import GRAVITY, Scenario, SimulatedFlight, simulate_flight, variant
from rotorfit.simulation.experiment_files import IMU_AND_COMMAND, IMU_AND_SPEED

ScenarioName = Literal["S1", "S2b", "stress"]
Numbers = dict[str, list[Any]]
"""By name, as ``Ixx@A``: value, half-width of the interval and verdict; nulls where withheld."""
KINDS: Final = {"S1": "noisy", "S2b": "disturbed", "stress": "real"}
"""Sensor noise; and a disturbing wrench; and all that a real vehicle has, from commands only."""
METHODS: Final = ("default", "paper", "ols", "tls-ns")
FULL_SPEED: Final = 1450.0
"""Rotor speed at full command, of every configuration [rad/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """What is flown in every run.

    Attributes
    ----------
    vehicles
        Configurations of the paper, fitted together.
    seconds
        Of each flight [s].
    seed
        Of the whole study; run k of a scenario is the same whatever else is run.
    steered_by_gyro
        Whether the autopilots answer the noise of their gyros, as real ones do.
    """

    vehicles: tuple[str, ...] = ("A", "B")
    seconds: float = 75.0
    seed: int = 1
    steered_by_gyro: bool = False


def one_run(number: int, *, scenario: ScenarioName, study: Study) -> dict[str, Any]:
    """Return what each method finds in one run, the bound, and the seconds that it took."""
    start = time.process_time()
    flights = fly(number, scenario=scenario, study=study)
    flown = time.process_time()
    commanded = scenario == "stress"
    found = identified(flights, commanded=commanded)
    done = time.process_time()
    found |= {
        name: _estimate_numbers(estimate)
        for name, estimate in rival_estimates(flights, commanded=commanded).items()
    }
    bound = flights_bound(flights, commanded=commanded)
    spent = {"simulate": flown - start, "identify": done - flown}
    spent["compare"] = time.process_time() - done
    return {"found": found, "bound": dict(bound.std), "cpu": spent}


def fly(number: int, *, scenario: ScenarioName, study: Study) -> dict[str, SimulatedFlight]:
    """Return the flights of one run, one of each configuration, in the air from first to last."""
    place = list(KINDS).index(scenario)
    sequence = np.random.SeedSequence([study.seed, place, number])
    seeds = sequence.generate_state(len(study.vehicles)).tolist()
    return {
        name: _fly_one(name, KINDS[scenario], study, seed=seed)
        for name, seed in zip(study.vehicles, seeds, strict=True)
    }


def _fly_one(name: str, kind: Any, study: Study, *, seed: int) -> SimulatedFlight:
    (truth, known), sensors = variant(named_vehicle(name), kind)
    lift = truth.kt * float(known.axes[:, 2].sum()) * FULL_SPEED**2
    scenario = Scenario(
        seconds=study.seconds,
        sensors=sensors,
        thrust_to_weight=lift / (truth.mass * GRAVITY),
        gyro_noise_in_loop=study.steered_by_gyro,
    )
    return simulate_flight(truth, known, scenario, seed=seed)


def identified(flights: Mapping[str, SimulatedFlight], *, commanded: bool) -> dict[str, Numbers]:
    """Return what the default and the paper's preset find, through files as a user would."""
    motors = ""
    if commanded:
        full = next(iter(flights.values())).max_speed
        motors = f'[motors]\nspeed = "commanded"\nlaw = {{ linear = [0.0, {full!r}] }}\n'
    settings = (motors, f'{motors}[identification]\npreset = "paper"\n')
    channels = IMU_AND_COMMAND if commanded else IMU_AND_SPEED
    results = identify_flights(flights, settings, channels=channels)
    return {
        name: _result_numbers(result)
        for name, result in zip(("default", "paper"), results, strict=True)
    }


def _result_numbers(result: IdentificationResult | None) -> Numbers:
    if result is None:
        return {}
    rows: Numbers = {}
    for p in result.parameters:
        half = None if p.interval is None else 0.5 * (p.interval[1] - p.interval[0])
        rows[_full(p.name, p.configuration)] = [p.value, half, p.verdict]
    for d in result.derived:
        half = None if d.interval is None else 0.5 * (d.interval[1] - d.interval[0])
        rows[_full(d.name, d.configuration)] = [d.value, half, "derived"]
    return rows


def _full(name: str, configuration: str | None) -> str:
    return name if configuration is None else f"{name}@{configuration}"


def _estimate_numbers(estimate: Estimate | None) -> Numbers:
    if estimate is None:
        return {}
    columns: Sequence[list[float]] = (estimate.values.tolist(), (1.96 * estimate.std).tolist())
    return {
        name: [value, half, "identified"]
        for name, value, half in zip(estimate.names, *columns, strict=True)
    }
