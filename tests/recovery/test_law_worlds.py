"""The study of laws from another flight flies one vehicle twice, at two charges of its battery."""

from benchmarks.law_worlds import LOGGED, flights, report


def test_two_flights_share_the_vehicle_and_not_the_charge():
    first, second = flights(71, 5)
    assert (first.vehicle.kt == second.vehicle.kt).all()
    assert first.motors.full == second.motors.full
    assert first.motors.charge != second.motors.charge
    assert {"rotor", "command"} <= set(first.log.has)
    assert "rotor" not in second.log.has
    assert LOGGED[5 % 4] == "first"
    assert "battery" in first.log.has
    assert "battery" not in second.log.has


def test_intervals_count_by_where_the_voltage_is_logged(assert_wording):
    def row(index, kt):
        numbers = {"kt": (kt, 0.05, "identified")}
        there = {"index": index, "truth": {"kt": 1.0}, "second": {"numbers": numbers}}
        return there | {"voltage": LOGGED[index % 4]}

    text = "\n".join(report([row(0, 1.02), row(3, 0.9), row(7, 0.97)]))
    both, neither = text.split("voltage in first")[0], text.split("voltage in neither")[1]
    assert "1.00 (  1)" in both
    assert "5.0 " in both
    assert "2.0" in both
    assert_wording(both)
    assert "0.50 (  2)" in neither
    assert "5.0 " in neither
    assert "7.4" in neither
    assert_wording(neither)
