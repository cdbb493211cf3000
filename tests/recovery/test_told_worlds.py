"""The study compares each interval with that of an estimator told of the hazard."""

import tomllib
from typing import Any

import numpy as np
import pytest
from benchmarks.worlds.hazards import NAMED
from benchmarks.worlds.sensing import experiment_text, truth
from benchmarks.worlds.study import Study, rows_of
from benchmarks.worlds.told import SAID, ratios, tell, told_table
from benchmarks.worlds.world import World, draw_world

from rotorfit.flight.imu_tilt import ImuTilt


def _world(*hazards: str, driven: str | None = None) -> World:
    """Return the first world with these hazards and this kind of motor data."""
    worlds = (draw_world(12, i, dict.fromkeys(hazards, 1.0), 6.0) for i in range(40))
    return next(w for w in worlds if driven in (None, w.log.driven))


def _declared(world: World, hazard: str) -> dict[str, Any]:
    said = tell(world, hazard)
    assert said is not None
    return tomllib.loads(experiment_text(said[1], "x.csv"))


def test_what_is_said_of_a_hazard_is_true_of_the_world() -> None:
    world = _world("tilted_motors", "lag_unlike", "command_delay", driven="commanded")
    axes = [rotor["axis"] for rotor in _declared(world, "tilted_motors")["airframe"]["rotors"]]
    assert np.allclose(axes, world.vehicle.axes)
    motors = _declared(world, "lag_unlike")["motors"]
    assert (motors["lag"], motors["lag_down"]) == (world.motors.lag_up, world.motors.lag_down)
    assert _declared(world, "command_delay")["motors"]["delay"] == truth(world)["motor_delay"]
    tilted = _world("tilted_imu")
    roll, pitch = np.radians(_declared(tilted, "tilted_imu")["airframe"]["imu_tilt_deg"])
    mounted = ImuTilt(roll=roll, pitch=pitch).rotation_imu_to_body
    assert mounted == pytest.approx(tilted.sensors.turn, abs=1e-9)
    on_thrust = _declared(_world("lag_on_thrust", driven="commanded"), "lag_on_thrust")
    assert on_thrust["motors"]["lag_on"] == "thrust"
    assert "delay" not in on_thrust["motors"]


def test_wrong_declarations_are_reported_the_right_way() -> None:
    right = tomllib.loads(experiment_text(draw_world(12, 0, {}, 6.0), "x.csv"))["airframe"]
    for hazard in ("wrong_sides", "wrong_order", "wrong_spins", "arm_scale"):
        wrong = draw_world(12, 0, {hazard: 1.0}, 6.0)
        assert tomllib.loads(experiment_text(wrong, "x.csv"))["airframe"] != right, hazard
        assert _declared(wrong, hazard)["airframe"] == right, hazard


def test_a_hazard_that_no_file_can_say_is_flown_without() -> None:
    assert set(SAID) < set(NAMED)
    assert tell(_world("gusts"), "gusts") is None
    assert tell(_world("lag_unlike", driven="measured"), "lag_unlike") is None
    row = next(rows_of(Study(seed=12, chance={"noise": 1.0}, seconds=8.0, told=True), [0]))
    words, numbers = row["told"]["noise"]
    assert words == "flown without"
    assert row["numbers"]["kt"][1] > 1.05 * numbers["kt"][1]


def test_half_widths_are_compared_where_both_are_given() -> None:
    numbers = {
        "kt": (1.0, 0.3, "identified"), "kd": (1.0, 0.4, "weak"), "Jr": (1.0, 9.0, "not-identified")
    }  # fmt: skip
    told = {
        "kt": (1.1, 0.2, "identified"), "kd": (1.1, 0.1, "identified"), "Jr": (1.0, 1.0, "weak")
    }  # fmt: skip
    row = {"numbers": numbers, "told": {"drag": ("velocity", told)}}
    found = {name: ratio for _, _, name, ratio in ratios([row, {"refused": "x"}])}
    assert found == pytest.approx({"kt": 1.5, "kd": 4.0})
    lines = told_table([row] * 3)
    assert lines[-1].split() == ["drag", "velocity", "2.75", "(6,", "4.00)", "1.50", "4.00"]
    assert told_table([{"numbers": numbers}]) == []
