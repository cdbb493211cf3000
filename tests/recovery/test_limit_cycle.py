"""Rate gains that are too high: the motors go from end to end, and are called what they are."""

from dataclasses import replace

import pytest

import flown
from rotorfit.simulation import Scenario, simulate_flight, variant
from rotorfit.simulation.controller import Gains
from rotorfit.simulation.experiment_files import IMU_AND_COMMAND, write_flight_table

DELAY = 0.02
HELD = ("kt", "kd", "Ixx_com", "Iyy_com", "Izz_com")


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """Fly a hexarotor by commands whose rate loop is unstable, and one that is not."""
    folder, found = tmp_path_factory.mktemp("limit-cycle"), {}
    for gain in (25.0, 120.0):
        (truth, vehicle), sensors = variant(flown.simulated_vehicle("hexa-x"), "real")
        scenario = Scenario(
            seconds=40.0,
            sensors=sensors,
            thrust_to_weight=2.0,
            gains=Gains(rate=(gain, gain, 3.0), damping=(0.0, 0.0, 0.0)),
            physics_rate=200.0,
        )
        flight = simulate_flight(replace(truth, motor_delay=DELAY), vehicle, scenario, seed=1)
        log = folder / f"{gain:.0f}.csv"
        write_flight_table(flight, log, channels=IMU_AND_COMMAND)
        path = flown.experiment_file(
            folder / f"{gain:.0f}.toml",
            flight.vehicle,
            [log],
            mass=flight.truth.mass,
            extra='[motors]\nspeed = "commanded"\n'
            f"law = {{ linear = [0.0, {flight.max_speed!r}] }}\n",
        )
        found[gain] = flight, flown.quietly_identified(path)
    return found


def said(result):
    return [one for one in result.findings if one.kind == "motors-at-limits" and one.sentence]


def test_a_limit_cycle_is_named_and_no_cause_is_invented(flights):
    _, result = flights[120.0]
    [one] = said(result)
    assert "% at the lowest command" in one.sentence
    assert "lower the rate gains" in one.sentence
    assert one.diagnostics["share_at_limits"] > 0.5
    for invented in ("FRAME_CLASS", "turned", "loose part", "does not hold"):
        assert not any(invented in words for words in result.warnings)
    assert said(flights[25.0][1]) == []


def test_intervals_hold_though_motors_are_at_their_limits(flights):
    flight, result = flights[120.0]
    inertia = flight.truth.com_inertia.diagonal()
    true = dict(zip(HELD, (flight.truth.kt, flight.truth.kd, *inertia), strict=True))
    numbers = {one.name: one for one in (*result.parameters, *result.derived)}
    for name in HELD:
        low, high = numbers[name].interval
        assert low <= true[name] <= high, name
        assert numbers[name].value == pytest.approx(true[name], rel=0.04), name
    # What the ends of the commands leave open is in them.
    assert high - low > 0.04 * true["Izz_com"]
