"""A flight's factors as arrays, and back: to be fitted again beside other flights."""

import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from rotorfit.dataset.dataset import Dataset
from rotorfit.estimation.factors import Factors
from rotorfit.experiment.declared_vehicle import vehicle_of
from rotorfit.experiment.experiment import Experiment
from rotorfit.fit.joint.joint_fit import FittedFactors
from rotorfit.fit.joint.joint_problem import JointConfiguration
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.registry import signals_named
from rotorfit.preprocessing.motors.motor_model import MotorResponse
from rotorfit.reduction.motor_timing import FreeTiming

_FACTORS: Final = ("R", "rows", "segment", "band", "noise", "slopes")


def factor_arrays(fitted: FittedFactors, dataset: Dataset) -> dict[str, np.ndarray]:
    """Return the factors of one flight as arrays by name.

    Parameters
    ----------
    fitted
        Of one configuration with one flight.
    dataset
        The same, for what the signals are.
    """
    (one,) = fitted.configurations
    factors = {name: getattr(one.factors, name) for name in _FACTORS}
    told = {
        "terms": list(fitted.terms),
        "signals": [signals.name for signals in dataset.model.layout.added],
        "timing": None if one.timing is None else _plain_timing(one.timing),
        "mass": one.mass,
        "name": one.name,
        "values": dict(fitted.values),
    }
    given = {"counted": one.counted, "answered": one.answered, "tied": one.tied, **factors}
    arrays = {name: np.asarray(array) for name, array in given.items() if array is not None}
    return {**arrays, "fit": np.frombuffer(json.dumps(told).encode(), dtype=np.uint8)}


def fitted_factors(arrays: Mapping[str, np.ndarray], experiment: Experiment) -> FittedFactors:
    """Return the factors that `factor_arrays` took apart; the vehicle is the experiment's."""
    told = json.loads(arrays["fit"].tobytes())
    vehicle = vehicle_of(experiment.airframe)
    one = JointConfiguration(
        name=told["name"],
        mass=told["mass"],
        factors=Factors(
            R=arrays["R"],
            rows=arrays["rows"],
            segment=arrays["segment"],
            band=arrays["band"],
            noise=arrays.get("noise"),
            slopes=arrays.get("slopes"),
        ),
        model=regressor(vehicle, added=signals_named(told["signals"])),
        vehicle=vehicle,
        counted=arrays.get("counted"),
        answered=arrays.get("answered"),
        tied=arrays.get("tied"),
        timing=None if told["timing"] is None else _timing(told["timing"]),
    )
    return FittedFactors(configurations=(one,), terms=tuple(told["terms"]), values=told["values"])


def _plain_timing(timing: FreeTiming) -> dict[str, object]:
    at = timing.at
    return {
        "at": [at.lag, at.delay, at.lag_down],
        "names": list(timing.names),
        "lag_prior": list(timing.lag_prior),
    }


def _timing(told: Mapping[str, Any]) -> FreeTiming:
    lag, delay, lag_down = told["at"]
    return FreeTiming(
        at=MotorResponse(lag=lag, delay=delay, lag_down=lag_down),
        names=tuple(told["names"]),
        lag_prior=(told["lag_prior"][0], told["lag_prior"][1]),
    )
