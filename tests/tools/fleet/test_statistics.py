"""What was planted in a fleet is found, dated and said; nothing else is."""

import re
from dataclasses import replace

import numpy as np
import pytest
from fleet_material import KT, LEVEL, STD, a_fleet, a_record, planted_fleet
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorfit.tools.fleet.compared import REFERENCE_DENSITY, in_order, number_tables
from rotorfit.tools.fleet.findings import findings
from rotorfit.tools.fleet.records import KT_WEIGHT
from rotorfit.tools.fleet.statistics import fleet_statistics


@pytest.fixture(scope="module")
def planted():
    return planted_fleet()


def test_a_quiet_fleet_is_quiet():
    records = a_fleet(seed=1)
    assert findings(fleet_statistics(records), records) == []


def test_planted_changes_are_found_and_dated(planted, assert_text, assert_wording):
    records, statistics = planted
    found = findings(statistics, records)
    seen = [(statistics.vehicles[f.vehicle], f.kind, f.numbers[0]) for f in found]
    assert seen == [
        ("V02", "change", "kt_2"),
        ("V05", "change", "com_x"),
        ("V07", "apart", seen[2][2]),
    ]
    worn, shifted, other = found
    assert "rotor 2 falls" in worn.sentence
    assert "by 1." in worn.sentence
    assert_wording(worn.sentence)
    assert "flight 5 of 12" in worn.sentence
    assert "(log5.ulg, 10 February 2026)" in worn.sentence
    assert "propeller 2" in worn.next_step
    assert_wording(worn.next_step)
    assert shifted.sentence.startswith("Centre of mass moved ")
    assert " mm forward (" in shifted.sentence
    assert "with flight 8 of 12" in shifted.sentence
    assert_text(shifted.next_step)
    assert set(other.numbers) == {KT_WEIGHT, "kt_1", "kt_2", "kd"}
    assert "another propeller?" in other.next_step


def test_sizes_hold_what_was_planted(planted):
    _, statistics = planted
    worn = statistics.number("kt_2").changes[1][0]
    assert worn.kind == "ramp"
    assert worn.low <= -0.015 * 0.98 * KT <= worn.high
    shifted = statistics.number("com_x").changes[4][0]
    assert (shifted.kind, shifted.first) == ("step", 7)
    assert shifted.low <= 5e-3 <= shifted.high


def test_levels_are_before_a_change_and_now_after_it(planted):
    _, statistics = planted
    number = statistics.number("com_x")
    assert number.level[4] == pytest.approx(LEVEL["com_x"], abs=1.2e-3)
    assert number.now[4] - number.level[4] == pytest.approx(5e-3, abs=5e-4)
    assert number.now[3] == number.level[3]


@given(
    vehicles=st.integers(1, 5),
    flights=st.integers(1, 9),
    seed=st.integers(0, 10**6),
    wild=st.sampled_from([0.0, 0.01, 0.1]),
    kind=st.sampled_from(["step", "ramp", "once"]),
)
@settings(max_examples=15, deadline=None)
def test_levels_lie_among_the_flights(vehicles, flights, seed, wild, kind):
    """Whatever the flights scatter and whatever changed, and with correlated numbers, too."""
    rng = np.random.default_rng(seed)
    first, size = rng.integers(0, flights), rng.standard_normal(vehicles)
    shape = {"step": lambda f: f >= first, "ramp": lambda f: f, "once": lambda f: f == first}[kind]

    def planted(vehicle, flight, values):
        for name in values:
            values[name] *= 1.0 + wild * (size[vehicle] * shape(flight) + rng.standard_normal())

    bare = a_fleet(planted, vehicles=vehicles, flights=flights, seed=seed)
    records = [with_yaw_numbers(record, rng) for record in bare]
    for number in fleet_statistics(records).numbers:
        for place in range(len(number.vehicles)):
            own = number.values[number.vehicle_of_row == place]
            assert np.isnan(number.level[place]) or own.min() <= number.level[place] <= own.max()
            assert np.isnan(number.now[place]) or own.min() <= number.now[place] <= own.max()


def with_yaw_numbers(record, rng):
    """Give a record the numbers of the yaw equation, their errors correlated."""
    names, level = ("kd", "Jr", "Izz_com"), np.array([record.value("kd"), 2e-5, 0.04])
    root = level[:, None] * rng.uniform(-0.03, 0.03, (3, 3))
    covariance = root @ root.T + np.diag((0.001 * level) ** 2)
    values = level + np.linalg.cholesky(covariance) @ rng.standard_normal(3)
    std = dict(zip(names, np.sqrt(np.diag(covariance)), strict=True))
    plain = {n: record.value(n) for n in record.names}
    made = a_record(
        plain | dict(zip(names, values.tolist(), strict=True)),
        vehicle=record.vehicle,
        file=record.file,
        std=STD | std,
        started=record.started,
    )
    return replace(made, compared=names, covariance=covariance)


def a_series(*, size, at, flights=23, scatter=0.01):
    """One vehicle whose k_t by the weight steps by a share of itself."""
    rng = np.random.default_rng(3)
    moved = np.where(np.arange(flights) >= at, 1.0 + size, 1.0)
    values = KT * (moved + scatter * rng.standard_normal(flights))
    return [
        a_record({KT_WEIGHT: value}, file=f"log{f}.ulg", std={KT_WEIGHT: 1.2 * scatter * KT})
        for f, value in enumerate(values)
    ]


def test_a_step_after_three_flights_is_found():
    """Twenty-three flights of one vehicle, of which the first three were before a change."""
    number = fleet_statistics(a_series(size=-0.07, at=3)).number(KT_WEIGHT)
    (change,) = number.changes[0]
    assert (change.kind, change.earliest, change.first, change.latest) == ("step", 3, 3, 3)
    assert change.low < -0.07 * KT < change.high
    assert number.level[0] == pytest.approx(KT, rel=0.01)
    assert number.now[0] == pytest.approx(0.93 * KT, rel=0.005)
    assert number.within < 0.015 * KT  # what the step explains is no scatter


def test_a_step_within_the_scatter_is_not_said():
    number = fleet_statistics(a_series(size=-0.01, at=3)).number(KT_WEIGHT)
    assert number.changes == ((),)
    assert number.level == number.now == pytest.approx(number.values.mean(), rel=0.002)


def test_an_outlier_is_not_part_of_the_type(planted):
    _, statistics = planted
    number = statistics.number("kd")
    assert np.flatnonzero(number.outlying).tolist() == [6]
    assert np.isnan(number.shrunk[6])
    assert number.mean == pytest.approx(LEVEL["kd"], rel=0.012)


def test_order_of_records_does_not_matter(planted):
    records, statistics = planted
    mixed = [records[i] for i in np.random.default_rng(3).permutation(len(records))]
    again = fleet_statistics(mixed)
    assert again.number("kd").level == pytest.approx(statistics.number("kd").level, rel=1e-6)
    assert again.number("com_x").changes[4][0].first == 7


def test_files_without_a_date_are_in_order_of_their_numbers():
    names = ["log10.ulg", "log9.ulg", "log1.ulg"]
    records = [a_record(LEVEL, file=name) for name in names]
    assert in_order(records) == [2, 1, 0]


def test_the_density_of_the_air_is_taken_out():
    """Weather of ten percent, all of it in k_t: nothing changed."""
    quiet = a_fleet(seed=2, vehicles=6)
    rng = np.random.default_rng(5)
    seen = []
    for record in quiet:
        density = REFERENCE_DENSITY * (1.0 + 0.05 * rng.standard_normal())
        share = density / REFERENCE_DENSITY
        values = {n: record.value(n) * (1.0 if n == "com_x" else share) for n in record.names}
        seen.append(
            a_record(
                values,
                vehicle=record.vehicle,
                file=record.file,
                started=record.started,
                air_density=density,
            )
        )
    number = fleet_statistics(seen).number(KT_WEIGHT)
    assert number.weather == "taken out"
    assert number.within < 0.002 * KT
    bare = fleet_statistics(quiet).number(KT_WEIGHT)
    assert bare.weather == "in it"


def test_weather_that_is_in_it_is_said(assert_wording):
    def drop(vehicle, flight, values):
        if vehicle == 2 and flight >= 6:
            values[KT_WEIGHT] *= 0.9

    records = a_fleet(drop)
    (found,) = findings(fleet_statistics(records), records)
    assert_wording(found.next_step)


def test_given_and_unknown_numbers_are_not_compared():
    verdicts = {"kd": "given", "kt_1": "not-identified", "kt_2": "ratio-only"}
    records = [a_record(LEVEL, file=f"{i}.ulg", verdicts=verdicts) for i in range(3)]
    assert {name for table in number_tables(records) for name in table.names} == {
        KT_WEIGHT,
        "com_x",
    }


def test_ratios_are_compared_where_their_parts_are_unknown():
    ratio = {"kd_over_kt": 0.015, "kt": KT, "kd": 6e-8}
    std = STD | {"kd_over_kt": 1e-4, "kt": 1e-8}
    verdicts = {"kd": "ratio-only", "kt": "ratio-only"}
    parts = [a_record(ratio, file=f"{i}.ulg", std=std) for i in range(3)]
    ratios = [a_record(ratio, file=f"{i}.ulg", std=std, verdicts=verdicts) for i in range(3)]
    assert "kd_over_kt" not in {t.names[0] for t in number_tables(parts)}
    assert {t.names[0] for t in number_tables(ratios)} == {"kd_over_kt"}


def test_bodies_are_compared_within_a_configuration():
    records = [
        a_record(LEVEL, file=f"{c}{i}.ulg", configuration=c) for c in ("A", "B") for i in range(2)
    ]
    keys = {(t.names[0], t.configuration): len(t.rows) for t in number_tables(records)}
    assert keys["com_x", "A"] == keys["com_x", "B"] == 2
    assert keys[KT_WEIGHT, None] == 4


def loaded_fleet(offset):
    """Half of the flights with a load that moves the CoM of all vehicles but the first."""

    def planted(vehicle, flight, values):
        values["com_x"] += offset * (flight % 2) * (vehicle > 0)

    records = a_fleet(planted, vehicles=4, flights=9)
    return [
        replace(r, configuration="camera" if i % 9 % 2 else "bare") for i, r in enumerate(records)
    ]


def test_what_a_load_does_to_each_vehicle_is_said():
    records = loaded_fleet(4e-3)
    found = findings(fleet_statistics(records), records)
    assert [(f.kind, f.vehicle) for f in found] == [("loading", 1), ("loading", 2), ("loading", 3)]
    assert re.fullmatch(
        r"Loaded as camera, against bare: centre of mass [34]\.\d mm forward \(3\.\d to 4\.\d\)\.",
        found[0].sentence,
    )
    loading = fleet_statistics(records).loadings[0]
    assert loading.low < 4e-3 < loading.high
    assert loading.high - loading.low < 1.2e-3


def test_a_load_that_does_nothing_is_not_said():
    records = loaded_fleet(0.0)
    assert findings(fleet_statistics(records), records) == []


def test_one_vehicle_of_a_few_flights():
    records = a_fleet(vehicles=1, flights=3)
    statistics = fleet_statistics(records)
    number = statistics.number("kd")
    assert findings(statistics, records) == []
    assert np.isfinite(number.level).all()
    assert np.isnan(number.shrunk).all()


def test_no_flights_at_all():
    assert fleet_statistics([]).numbers == ()


def test_one_strange_flight_is_named_alone(assert_wording):
    def loaded(vehicle, flight, values):
        if (vehicle, flight) == (3, 7):
            values["com_x"] += 8e-3

    records = a_fleet(loaded)
    (found,) = findings(fleet_statistics(records), records)
    assert "mm forward" in found.sentence
    assert "flight 8 of 12" in found.sentence
    assert "(log8.ulg, 16 February 2026)" in found.sentence
    assert_wording(found.sentence)
    assert "another payload" in found.next_step


def test_means_over_a_flight_count_by_their_scatter():
    """k_t by the weight states ten times the deviation that it has: 1.5 % of wear is seen."""

    def worn(vehicle, flight, values):
        if vehicle == 3:
            values[KT_WEIGHT] *= 1.0 - 0.015 * flight / 11

    shy = [
        a_record(
            {name: record.value(name) for name in record.names},
            vehicle=record.vehicle,
            file=record.file,
            std=STD | {KT_WEIGHT: 10 * STD[KT_WEIGHT]},
        )
        for record in a_fleet(worn)
    ]
    number = fleet_statistics(shy).number(KT_WEIGHT)
    (change,) = number.changes[3]
    assert change.low < -0.015 / 11 * number.level[3] < change.high
    assert not any(c for v, c in enumerate(number.changes) if v != 3)
