from dataclasses import replace

import numpy as np
import pytest

from rotorfit.errors import ExperimentError
from rotorfit.simulation.experiments import paper_vehicle, variant
from rotorfit.simulation.sensors import PERFECT, TYPICAL


def test_paper_vehicle_b_is_table_2_within_its_scatter():
    p = paper_vehicle("B").truth.parameters()
    assert p["mass"] == pytest.approx(1.452)
    found = [p[name] for name in ("msx", "msy", "msz", "Ixx", "Iyy", "Izz", "Ixz", "Iyz")]
    expected = [0.0420, -0.0187, -0.0130, 0.0250, 0.0360, 0.0528, 1.4e-3, -5.7e-4]
    assert found == pytest.approx(expected, rel=0.01)


def test_parameters_have_the_names_of_results():
    truth = replace(paper_vehicle("A").truth, Jr=2e-5, motor_delay=0.01, rotor_drag=1e-4)
    p = truth.parameters()
    assert list(p)[:7] == ["kt", "kd", "Jr", "mass", "msx", "msy", "msz"]
    assert list(p)[7:13] == ["Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"]
    assert (p["kt"], p["Jr"], p["motor_lag"], p["motor_delay"]) == (3.63e-6, 2e-5, 0.04, 0.01)
    assert (p["Ixy"], p["Ixz"], p["Iyz"], p["rotor_drag"]) == (0.5e-4, 1e-4, -1e-4, 1e-4)
    p = replace(truth, inflow=1e-4, wake_moment=(2e-3, 3e-3), propeller=0.2).parameters()
    assert (p["inflow"], p["wake_moment_x"], p["wake_moment_y"]) == (1e-4, 2e-3, 3e-3)


def test_what_depends_on_induced_velocity_needs_the_propellers():
    for air in ({"inflow": 1e-4}, {"wake_moment": (1e-3, 0.0)}):
        with pytest.raises(ExperimentError, match="diameter of the propellers"):
            replace(paper_vehicle("A").truth, **air)


def test_inertia_about_the_centre_of_mass_by_hand():
    p = replace(
        paper_vehicle("A").truth,
        mass=2.0,
        first_moments=(0.02, 0.04, -0.06),  # c = (.01, .02, -.03)
        inertia=(0.02, 0.03, 0.04, 1e-4, 2e-4, 3e-4),
    ).parameters()
    found = [p[f"{name}_com"] for name in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")]
    # I - m (c.c 1 - c c^T): off-diagonals gain m c_i c_j
    expected = [
        *(0.02 - 2 * 13e-4, 0.03 - 2 * 10e-4, 0.04 - 2 * 5e-4),
        *(1e-4 + 2 * 2e-4, 2e-4 - 2 * 3e-4, 3e-4 - 2 * 6e-4),
    ]
    assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": 0.0}, "mass > 0"),
        ({"inertia": (1e-5, 0.02, 0.03, 0.0, 0.0, 0.0)}, "not positive definite"),
        ({"motor_lag": -0.1}, "cannot be negative"),
        ({"motor_lag": 0.0, "Jr": 2e-5}, "give a motor lag > 0"),
    ],
)
def test_impossible_vehicles_are_refused(change, message):
    with pytest.raises(ExperimentError, match=message):
        replace(paper_vehicle("A").truth, **change)


def test_variants_grow_from_clean_to_real():
    simulated = paper_vehicle("A")
    assert variant(simulated, "clean")[0] == simulated
    (lagging, _), sensors = variant(simulated, "lag")
    assert (lagging.motor_lag, lagging.motor_delay, sensors) == (0.04, 0.01, PERFECT)
    assert variant(simulated, "noisy") == (simulated, TYPICAL)
    (disturbed, _), _ = variant(simulated, "disturbed")
    assert disturbed.disturbance_torque_std == (6e-3, 6e-3, 1.5e-3)
    (real, _), sensors = variant(simulated, "real")
    assert (real.Jr, np.mean(real.kt_spread)) == (2e-5, pytest.approx(1.0))
    assert sensors.accel_bias == (0.1, 0.1, 0.1)
