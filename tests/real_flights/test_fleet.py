"""Real logs of mixed formats as a fleet: each log has a row or a reason; added weights show."""

import csv
import re

import numpy as np
import pytest

from rotorfit.logs import read_log
from rotorfit.tools.fleet.findings import findings
from rotorfit.tools.fleet.listing import Defaults, listed_logs
from rotorfit.tools.fleet.run import Workers, read_fleet, types_of
from rotorfit.tools.fleet.statistics import fleet_statistics

AIRFRAME = """[airframe]
layout = "quad-x"
arm = 0.046
order = "crazyflie"
[motors]
speed = "commanded"
"""
CRAZYPAD = re.compile(r"__(?P<configuration>normal_flight|add_weight_\w+?)__(?P<vehicle>E\d)_log")
# Cheap ones: identified, a slow hover, never armed, no motors, columns of other names.
MIXED = {
    "tudelft-indiflight/LOG00340.BFL": "0.428",
    "px4-ulog/quadrotor_local.ulg": "unknown",
    "px4-ulog/sample_appended_multiple.ulg": "unknown",
    "optitrack-airgarage/20240824_00_08_07.csv": "unknown",
    "nanobench-crazyflie/B8_star_fast_rep1.csv": "0.027",
    "crazypad/motor_data__normal_flight__E9_log00": "0.03",
}
INDIFLIGHT = """[airframe]
rotors = [
  { position = [-0.0455, -0.0635, 0.0], spin = "cw" },
  { position = [0.0455, -0.0635, 0.0], spin = "ccw" },
  { position = [-0.0455, 0.0635, 0.0], spin = "ccw" },
  { position = [0.0455, 0.0635, 0.0], spin = "cw" },
]
[motors]
speed = "measured"
"""


@pytest.fixture
def airframe(tmp_path):
    path = tmp_path / "crazyflie.toml"
    path.write_text(AIRFRAME, encoding="utf-8")
    return path


@pytest.mark.flights
@pytest.mark.parametrize(
    ("vehicle", "loaded", "forward", "left"),
    [("E8", "add_weight_W1_near_M4", True, True), ("E9", "add_weight_W1_near_M3", False, True)],
)
def test_flights_with_added_weights_stand_out(
    flight_data_dir, tmp_path, airframe, vehicle, loaded, forward, left, assert_wording
):
    """M3 is rear left, M4 front left; the scatter between flights of one loading is the measure."""
    defaults = Defaults(mass=0.03, airframe=airframe, vehicle_of=CRAZYPAD)
    logs = listed_logs(flight_data_dir / "crazypad", defaults)
    fleet = read_fleet(logs, tmp_path / "cache", Workers(count=0))
    assert len(fleet.records) == len(fleet.refused) == 11
    assert all(record.refused for record in fleet.records)
    found = findings(fleet_statistics(fleet.records), fleet.records)
    place = {
        condition: np.array(
            [
                [r.value("thrust_center_x"), r.value("thrust_center_y")]
                for r in fleet.records
                if (r.vehicle, r.configuration) == (vehicle, condition)
            ]
        )
        for condition in ("normal_flight", loaded)
    }
    shift = place[loaded].mean(axis=0) - place["normal_flight"].mean(axis=0)
    assert (shift > 0).tolist() == [forward, left]
    # To the left every flight with the weight lies beyond every flight without.
    assert place[loaded][:, 1].min() > place["normal_flight"][:, 1].max() + 3e-4
    # And the fleet says so, with nothing else; of E9 to the left alone: 0.7 mm back are too few.
    (sentence,) = (f.sentence for f in found if f.vehicle == ["E8", "E9"].index(vehicle))
    assert f"as {loaded}, against" in sentence
    assert_wording(sentence)
    assert " mm to the left (" in sentence
    assert (" mm forward (" in sentence) == forward


@pytest.mark.flights
def test_every_log_of_a_mixed_fleet_has_a_row_or_a_reason(flight_data_dir, tmp_path, airframe):
    (tmp_path / "racer.toml").write_text(INDIFLIGHT, encoding="utf-8")
    table = tmp_path / "logs.csv"
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["file", "mass", "airframe"])
        for name, mass in MIXED.items():
            kind = "racer.toml" if name.endswith("BFL") else "crazyflie.toml"
            writer.writerow([flight_data_dir / name, mass, kind])
    fleet = read_fleet(listed_logs(table, Defaults()), tmp_path / "cache", Workers(count=0))
    identified = [r for r in fleet.records if not r.refused]
    names = [r.file.rsplit("/", 1)[1] for r in identified]
    assert sorted(names) == ["LOG00340.BFL", "quadrotor_local.ulg"]
    throw, hover = (identified[names.index(name)] for name in sorted(names))
    assert throw.started is not None
    assert throw.value("kt") == pytest.approx(2.69e-7, rel=0.05)
    assert np.isnan(hover.value("Ixx_com@A"))
    reasons = {f.file.rsplit("/", 1)[1]: f.refusal.sentence for f in fleet.refused}
    assert len(reasons) == len(MIXED) - 2
    assert "the motors never turn" in reasons["sample_appended_multiple.ulg"]
    assert "no rotation rates" in reasons["20240824_00_08_07.csv"]
    assert "no column 'time'" in reasons["B8_star_fast_rep1.csv"]
    by_hardware = {r.vehicle for r in fleet.records if r.file.endswith(".ulg")}
    assert by_hardware <= {"0006000000003535323734325116003d0021", "0035002B3434511732343031"}
    assert {one.name for one in types_of(fleet)} == {"racer", "crazyflie"}


@pytest.mark.flights
def test_a_log_shows_whose_it_is_and_in_what_air(flight_data_dir):
    ardupilot = read_log(flight_data_dir / "ardupilot-dronekit" / "log171.bin").circumstances
    assert ardupilot.hardware == "004A002F 33345119 32383433"
    assert ardupilot.started is None  # it never saw a satellite
    assert ardupilot.air_density == pytest.approx(1.096, abs=1e-3)
    assert ardupilot.air_temperature == pytest.approx(302.3, abs=0.1)
    betaflight = read_log(flight_data_dir / "betaflight" / "LOG00037.BFL").circumstances
    assert betaflight.started == pytest.approx(1643814293.139)  # 2 February 2022
    assert betaflight.air_density is None
