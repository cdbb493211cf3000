"""Commands that explain quick turns alone: the rotor speed or their law is asked for first."""

import pytest

import made_fit
from rotorfit.checks.sensors.log_settings import SPEED_OR_LAW, unlogged_speed
from rotorfit.fit.experiment.experiment import MotorsEntry


def step_asked_for(*, roll, pitch, inertia_std, speed="commanded"):
    """Return the next step for a table's flight with these ratios and deviations of Ixx."""
    flights = made_fit.dataset(made_fit.prepared(), motors=MotorsEntry(speed=speed))
    rho = {"roll@A": roll, "pitch@A": pitch, "yaw@A": 8.0}
    bodies = [made_fit.configuration()]
    std = {"Ixx@A": inertia_std * 0.01, "Iyy@A": 0.012}
    fit = made_fit.fit(
        flights,
        made_fit.no_numbers(excitation=rho),
        bodies=bodies,
        estimate=made_fit.fit_of(bodies, std=std),
    )
    return [one.next_step for one in unlogged_speed(fit)]


def test_quick_turns_alone_ask_for_speed_or_law():
    assert step_asked_for(roll=0.8, pitch=1.1, inertia_std=0.05) == [SPEED_OR_LAW]


@pytest.mark.parametrize(
    "other",
    [
        {"roll": 20.0},  # the pilot's turns are explained
        {"inertia_std": 0.5},  # no turn is: it hovered
        {"speed": "measured"},
    ],
)
def test_any_other_flight_does_not(other):
    assert step_asked_for(**({"roll": 0.8, "pitch": 1.1, "inertia_std": 0.05} | other)) == []
