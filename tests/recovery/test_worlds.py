"""The engine of `benchmarks.worlds` obeys mechanics, and a slice of its worlds goes through."""

import dataclasses
import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from benchmarks.worlds.engine import Batch, Record, fly
from benchmarks.worlds.hazards import CAUSES, HAZARDS, NAMED, chances
from benchmarks.worlds.pilot import STEP
from benchmarks.worlds.sensing import experiment_text, measured_places, table, truth, write_world
from benchmarks.worlds.study import Study, read_rows, row_of, rows_of, run
from benchmarks.worlds.tables import is_doubted, is_seen, kind_of, report
from benchmarks.worlds.world import GRAVITY, World, draw_world

CALM: dict[str, float] = {}
SLICE = Study(seed=20261123, chance=chances(None), seconds=6.0)


def _with_flight(world: World, manoeuvre: str, **motors: float) -> World:
    flight = dataclasses.replace(world.flight, manoeuvre=manoeuvre, ground_start=True, lands=False)
    return dataclasses.replace(
        world, flight=flight, motors=dataclasses.replace(world.motors, **motors)
    )


def _quiet(world: World) -> World:
    sensors = dataclasses.replace(world.sensors, white=np.zeros(6))
    return dataclasses.replace(world, sensors=sensors)


def test_a_thrown_body_without_motors_keeps_momentum_and_energy() -> None:
    worlds = [
        _with_flight(draw_world(3, i, CALM, 4.0), "throw", idle=0.0, full=1e-6) for i in range(3)
    ]
    batch = Batch(worlds)
    spins: list[np.ndarray] = []
    energies: list[np.ndarray] = []
    for k in range(4000):
        batch.step(k)
        momentum = np.einsum("ijw,jw->iw", batch.inertia, batch.w)
        spins.append(np.einsum("ijw,jw->iw", batch.R, momentum))
        motion = 0.5 * batch.mass * (batch.v**2).sum(axis=0)
        energies.append(
            motion + 0.5 * (batch.w * momentum).sum(axis=0) + batch.mass * GRAVITY * batch.z
        )
    flown = slice(2001, None)
    spun, energy = np.array(spins[flown]), np.array(energies[flown])
    size = np.linalg.norm(spun[0], axis=0)
    assert (size > 0.0).all()
    assert np.abs(spun - spun[0]).max() < 1e-4 * size.min()
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-4
    assert batch.v[2] == pytest.approx(np.array(batch.thrown_at[3]) - GRAVITY * 2.0, abs=0.02)


@pytest.fixture(scope="module")
def flights() -> list[tuple[World, Record]]:
    """Three hovers, then three lively flights, without any hazard or noise."""
    hovers = [_with_flight(draw_world(4, i, CALM, 9.0), "hover") for i in range(3)]
    lively = [_with_flight(draw_world(6, i, CALM, 9.0), "lively") for i in (1, 4)]
    spun = _with_flight(draw_world(5, 2, CALM, 9.0), "lively")
    spun = dataclasses.replace(spun, vehicle=dataclasses.replace(spun.vehicle, Jr=1e-5))
    worlds = [_quiet(world) for world in (*hovers, *lively, spun)]
    return list(zip(worlds, fly(worlds), strict=True))


def test_rotors_carry_the_weight_and_rest_reads_one_g(
    flights: list[tuple[World, Record]],
) -> None:
    for world, record in flights[:3]:
        assert (record.airborne[:1000] == 0).all()
        assert record.accel[:1000] == pytest.approx(np.tile([0, 0, GRAVITY], (1000, 1)), abs=1e-5)
        thrust = (record.speed[6000:] ** 2 @ world.vehicle.kt) * record.up[6000:]
        climbed = (record.velocity[-1, 2] - record.velocity[6000, 2]) / (3.0 * GRAVITY)
        ratio = thrust.mean() / (world.vehicle.mass * GRAVITY) - climbed
        assert ratio == pytest.approx(1.0, abs=1e-3)


def test_momentum_of_body_and_rotors_changes_by_the_torques(
    flights: list[tuple[World, Record]],
) -> None:
    """Integrate the torques of the recorded speeds: what Euler's equation says of the rates."""
    world, record = flights[-1]
    v, rows = world.vehicle, slice(5000, 5200)
    rates, speed = record.rates[rows], record.speed[rows]
    spun = v.Jr * (v.spins * speed).sum(axis=1)[:, None] * [0.0, 0.0, 1.0]
    momentum = rates @ v.inertia + spun
    square = speed**2
    torque = (square * v.kt) @ np.cross(v.places - v.com, v.axes)
    torque[:, 2] -= square @ (v.spins * v.kd)
    change = torque - np.cross(rates, momentum)
    between = 0.5 * (change[1:] + change[:-1]) * STEP
    steps = np.diff(momentum, axis=0)
    size = np.abs(steps).sum(axis=0).max()
    assert np.abs(between.sum(axis=0) - steps.sum(axis=0)).max() < 1e-3 * size


def test_without_hazards_the_truth_is_found(
    flights: list[tuple[World, Record]], tmp_path: Path
) -> None:
    for world, record in flights[3:5]:
        row = row_of(world, record, tmp_path)
        for name in ("kt", "Ixx_com", "Iyy_com"):
            value, _, _ = row["numbers"][name]
            assert value == pytest.approx(truth(world)[name], rel=0.01), (world.index, name)


def test_a_world_is_the_same_alone_and_in_a_batch(tmp_path: Path) -> None:
    worlds = [draw_world(7, i, chances(None), 3.0) for i in range(3)]
    together = fly(worlds)
    (alone,) = fly(worlds[1:2])
    first, second = table(worlds[1], together[1]), table(worlds[1], alone)
    assert list(first) == list(second)
    for name, values in first.items():
        assert np.allclose(values, second[name], rtol=1e-4, atol=1e-3), name
    again = draw_world(7, 1, chances(None), 3.0)
    assert again.hazards == worlds[1].hazards
    assert experiment_text(again, "x.csv") == experiment_text(worlds[1], "x.csv")
    assert write_world(again, alone, tmp_path).read_text() == experiment_text(again, "w1.csv")


def test_a_longer_flight_next_to_it_changes_no_world() -> None:
    """Ground, wall and sag follow its own flight."""
    chance = chances(("ground_effect=1", "wall=1", "sag=1"))
    short, long = draw_world(7, 1, chance, 3.0), draw_world(7, 2, chance, 4.0)
    beside, alone = fly([short, long])[0], fly([short])[0]
    for name, values in table(short, alone).items():
        assert np.allclose(values, table(short, beside)[name], rtol=1e-4, atol=1e-3), name


def test_every_hazard_changes_its_world() -> None:
    plain = [draw_world(8, i, CALM, 5.0) for i in range(2)]
    for hazard in HAZARDS:
        spoilt = [draw_world(8, i, {hazard.name: 1.0}, 5.0) for i in range(2)]
        assert all(w.hazards == {hazard.name} for w in spoilt)
        assert any(_drawn(a) != _drawn(b) for a, b in zip(plain, spoilt, strict=True)), hazard.name


def _drawn(world: World) -> str:
    return repr(dataclasses.replace(world, hazards=frozenset()))


def test_a_scale_of_the_gyro_is_seen_by_a_velocity_alone() -> None:
    row = {"hazards": ["gyro_scale"], "has": ["gyro", "accel", "rotor"], "numbers": {}}
    assert kind_of(row | {"gyro": []}) == "invisible"
    row["has"] = [*row["has"], "vel"]
    assert kind_of(row | {"gyro": [(0.02, 0.05), (-0.01, 0.01), (-0.01, 0.02)]}) == "ruin"
    assert kind_of(row | {"gyro": [(0.02, 0.05), (-0.01, 0.01), (-0.09, 0.02)]}) == "invisible"
    assert kind_of({"hazards": ["gyro_scale"], "has": ["vel"], "refused": "flight"}) == "ruin"


def test_causes_are_hazards() -> None:
    assert {name for causes in CAUSES.values() for name in causes} <= set(NAMED)
    assert 3.5 < sum(chances(None).values()) < 6.0


def test_a_slice_of_worlds_goes_through() -> None:
    rows = list(rows_of(SLICE, range(16)))
    assert [row["index"] for row in rows] == list(range(16))
    for row in rows:
        assert "traceback" not in row, row["traceback"]
        assert row.get("lost") or "refused" in row or row["numbers"]
        for value, half, _ in row.get("numbers", {}).values():
            assert math.isfinite(value) and math.isfinite(half) and half >= 0.0
    assert sum(bool(row.get("lost")) for row in rows) <= 3
    lines = report(json.loads(json.dumps(rows)), rows)
    assert lines[0].startswith("now: 16 worlds")
    assert any("--only" in line for line in lines) or not any(
        kind_of(row) == "sound" for row in rows
    )


@pytest.mark.slow
def test_a_broken_off_study_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "worlds.jsonl"
    study = Study(seed=9, chance=CALM, seconds=6.0)
    path.write_text('{"index": 0, "seed": 9, "hazards": [], "died": true}\n{"index": 1, "se')
    assert [row["index"] for row in read_rows(path)] == [0]
    done = list(run(study, [1, 2], path, workers=1, time_limit=60.0, batch=2))
    assert sorted(row["index"] for row in done) == [1, 2]
    assert [row["index"] for row in read_rows(path)] == [0, 1, 2]


@pytest.mark.slow
def test_a_world_that_hangs_is_written_down(tmp_path: Path) -> None:
    path = tmp_path / "worlds.jsonl"
    study = Study(seed=9, chance=CALM, seconds=60.0)
    done = list(run(study, [1], path, workers=1, time_limit=-4.0, batch=1))
    assert [row.get("died") for row in done] == [True]


def test_every_experiment_file_is_valid() -> None:
    for i in range(60):
        world = draw_world(10, i, chances(None, invisible=True), 5.0)
        declared = tomllib.loads(experiment_text(world, "x.csv"))
        assert declared["configuration"][0]["mass"] > 0.0
        assert 0.0 < declared["motors"].get("law", {}).get("power", {}).get("exponent", 0.5) <= 1.2
    hazards = {"mass_scale": 1.0, "law_wrong": 1.0, "sag": 1.0}
    for i in range(20):
        tomllib.loads(experiment_text(draw_world(11, i, hazards, 5.0), "x.csv"))


@pytest.mark.parametrize(
    ("sides", "shown"), [(None, False), ([0.8, 1.6], False), ([0.97, 1.05], True), ([0, 1], False)]
)
def test_wrong_sides_that_no_log_shows_are_counted_separately(
    sides: list[float] | None, shown: bool
) -> None:
    number = {"numbers": {"kt": (1.0, 0.1, "identified")}, "truth": {"kt": 1.05}, "findings": []}
    row = {"index": 0, "seed": 1, "hazards": ["wrong_sides"], "sides": sides, **number}
    row |= {"layout": "plus", "mass": 1.0, "manoeuvre": "calm", "driven": "measured", "rate": 200}
    assert is_seen(row) is shown
    (line,) = (one for one in report([row]) if "now wrong_sides" in one)
    left, _, right = line.partition("|")
    assert "1.00 (   1)" in (left if shown else right)


def test_a_doubt_counts_for_a_mistake_that_can_be_its_cause() -> None:
    row = {"findings": [("weak-direction", "doubt", ""), ("lever-arms", "note", "")]}
    assert not is_doubted(row, "wrong_sides")
    row["findings"].append(("lever-arms", "doubt", ""))
    assert is_doubted(row, "wrong_sides")
    assert not is_doubted(row, "wrong_spins")


def test_what_no_log_can_show_is_named_and_counted_by_itself(assert_wording) -> None:
    invisible = {h.name for h in HAZARDS if h.kind == "invisible"}
    assert invisible == {"mass_scale", "arm_scale", "clock_scale"}
    assert not invisible & {*chances(None)}
    assert invisible < {*chances(None, invisible=True)}
    number = {"numbers": {"kt": (1.0, 0.1, "identified")}, "truth": {"kt": 1.5}, "findings": []}
    row = {"index": 0, "seed": 1, "hazards": ["arm_scale", "drag"], "layout": "plus", "mass": 1.0}
    row |= {"manoeuvre": "calm", "driven": "measured", "rate": 200, **number}
    assert kind_of(row) == "invisible"
    lines = report([row])
    (apart,) = (line for line in lines if "(apart): 1 worlds," in line)
    assert apart.endswith("identified  0.00 (   1)")
    assert_wording(lines)
    assert not any(line.startswith(("kt ", "drag ", "(all)")) and "0.00" in line for line in lines)


def test_sides_are_measured_with_a_ruler():
    """To half a percent and a millimetre each; a sum of both sides as a share is right."""
    off = []
    for index in range(200):
        world = draw_world(12, index, {}, 6.0)
        sides = np.ptp(world.vehicle.places[:, :2], axis=0)
        x, y = np.ptp(measured_places(world)[:, :2], axis=0) / sides - 1.0
        assert x == pytest.approx(-y)
        off.append(x / np.hypot(0.005, 0.5e-3 * np.linalg.norm(1.0 / sides)))
    assert np.std(off) == pytest.approx(1.0, abs=0.15)
    assert abs(np.mean(off)) < 0.25
