from dataclasses import replace

import pytest

from rotorfit.simulation import (
    Scenario,
    SimulatedFlight,
    layout_vehicle,
    paper_vehicle,
    simulate_flight,
)


@pytest.fixture(scope="module", autouse=True)
def one_step_a_sample() -> None:
    """Integrate as many steps as a user's flights have."""


@pytest.fixture(scope="session")
def paper_flight() -> SimulatedFlight:
    """Vehicle B on the default flight of 75 s, nothing disturbed."""
    return simulate_flight(*paper_vehicle("B"), Scenario(), seed=1)


@pytest.fixture(scope="session")
def rough_flight() -> SimulatedFlight:
    """Six tilted rotors with inertia, unequal, with drag, delay and disturbances; IMU off O."""
    truth, vehicle = layout_vehicle("hexa-tilted")
    truth = replace(
        truth,
        Jr=2e-5,
        kt_spread=(1.02, 0.98, 1.01, 0.99, 1.03, 0.97),
        motor_delay=0.012,
        drag=(0.2, 0.3, 0.1),
        rotor_drag=1e-4,
        disturbance_force_std=(0.1, 0.2, 0.3),
        disturbance_torque_std=(0.01, 0.02, 0.005),
    )
    return simulate_flight(truth, vehicle, Scenario(seconds=10.0), seed=2)


@pytest.fixture(scope="session")
def ground_flight() -> SimulatedFlight:
    """Vehicle B from the ground and back."""
    return simulate_flight(*paper_vehicle("B"), Scenario(seconds=10.0, ground_seconds=3.0), seed=3)
