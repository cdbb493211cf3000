"""When is only k_d / Izz known? The argument of Six et al. 2020, eq. 23, computed."""

from dataclasses import replace

import numpy as np
import pytest

from rotorfit.estimation.estimate import LinearProblem, problem_rows, scaled_singular
from rotorfit.estimation.factors import stack_factors
from rotorfit.estimation.parameter_map import parameter_map
from rotorfit.fit.reduction.reduce import time_factors
from rotorfit.model.regressor import regressor
from rotorfit.simulation import (
    Scenario,
    Stick,
    Sticks,
    exact_flight_data,
    paper_vehicle,
    simulate_flight,
)

STILL_STICK = Stick(band=(0.2, 1.0), rms=0.0)
FREE = ("kt", "kd", "msx", "msy", "msz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")


def vehicle_a(*, symmetric):
    truth, vehicle = paper_vehicle("A")
    if symmetric:
        truth = replace(
            truth, first_moments=(0.0, 0.0, 0.0), inertia=(0.0182, 0.0182, 0.0288, 0.0, 0.0, 0.0)
        )
    return truth, vehicle


def only(**sticks):
    still = dict.fromkeys(("roll", "pitch", "yaw", "climb"), STILL_STICK)
    return Sticks(**(still | sticks))


ROLL = {"roll": Stick(band=(0.2, 1.3), rms=0.16)}
PITCH = {"pitch": Stick(band=(0.2, 1.1), rms=0.12)}
YAW = {"yaw": Stick(band=(0.1, 0.6), rms=0.35)}


def problem_of(truth, vehicle, flights):
    model = regressor(vehicle)
    parts = [
        time_factors(
            exact_flight_data(
                simulate_flight(truth, vehicle, Scenario(seconds=12.0, sticks=sticks), seed=number),
                vehicle,
            ),
            vehicle,
        )
        for number, sticks in enumerate(flights)
    ]
    # Without the known mass column: what the equations leave open whatever the mass is.
    mapped = parameter_map(
        model.names, {name: {(0, name): 1.0} for name in FREE}, {(0, "mass"): truth.mass}
    )
    return LinearProblem(
        factors=(stack_factors(parts),),
        tensors=(model.tensor,),
        map=mapped,
        weights=np.ones((1, 6)),
    )


ONE_AXIS_AT_A_TIME = (only(**ROLL), only(**PITCH), only(**YAW))
TURNS_WHILE_ROLLING = (only(**ROLL, **PITCH, **YAW),)


# Axes flown one at a time still move each other by 1e-4 rad/s: a hundred times less than this.
ALMOST = 1e-3
SHARE = 0.05  # of a direction, from which a parameter is named in it


def free_directions(problem):
    """Return relative changes of the parameters that the known equations leave free.

    The null space of the observation matrix without its known column, columns scaled to unit
    length: the argument of Six et al. 2020, eq. 23, for any flight and vehicle.
    """
    names = problem.map.names
    svd = scaled_singular(problem_rows(problem)[:, : len(names)], names)
    free = [v / v[np.argmax(np.abs(v))] for v in svd.Vt[svd.s <= ALMOST * svd.s[0]]]
    return [{n: x for n, x in zip(names, v, strict=True) if abs(x) > SHARE} for v in free]


def test_flying_one_axis_at_a_time_leaves_only_kd_and_izz_free():
    problem = problem_of(*vehicle_a(symmetric=True), ONE_AXIS_AT_A_TIME)
    (direction,) = free_directions(problem)
    assert set(direction) == {"kd", "Izz"}
    assert abs(direction["kd"]) == pytest.approx(abs(direction["Izz"]), rel=1e-6)


def test_turning_while_rolling_frees_them_from_each_other():
    problem = problem_of(*vehicle_a(symmetric=True), TURNS_WHILE_ROLLING)
    assert free_directions(problem) == []


def test_so_does_asymmetry():
    problem = problem_of(*vehicle_a(symmetric=False), ONE_AXIS_AT_A_TIME)
    assert free_directions(problem) == []
