"""The saved interval terms reproduce every half-width by the rule that the documentation states."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from benchmarks.worlds.engine import fly
from benchmarks.worlds.hazards import chances
from benchmarks.worlds.sensing import write_world
from benchmarks.worlds.world import draw_world

import flown
from made_tables import made_result, tables_of
from rotorfit.errors import OutputError, RotorfitError
from rotorfit.findings import Finding
from rotorfit.fit.intervals.interval_terms import TERM_KINDS
from rotorfit.results.assemble import withheld
from rotorfit.results.result import IdentificationResult
from rotorfit.results.sound_result import refuse_unsound


def documented_half_width(terms):
    """Return the half-width of a number by docs/budget.md: in order, in squares or linearly."""
    half = 0.0
    for term in terms:
        if TERM_KINDS[term["name"]].rule == "linear":
            half += term["half_width"]
        else:
            half = (half**2 + term["half_width"] ** 2) ** 0.5
    return half


def check_rule(result):
    """Check the rule on every number of a saved result; return how many it has."""
    plain = json.loads(result.to_json())
    count = 0
    for number in (*plain["parameters"], *plain["derived"]):
        if number["interval"] is None:
            assert number["interval_terms"] == [], number["name"]
            continue
        count += 1
        expected = pytest.approx(1.96 * number["std"], rel=1e-12)
        assert documented_half_width(number["interval_terms"]) == expected, number["name"]
    return count


@pytest.fixture(scope="module")
def flight():
    return flown.simulated("quad-x", "real", seed=8, seconds=12.0, ground_seconds=2.0)


@pytest.fixture(scope="module")
def joint(flight, tmp_path_factory):
    """Identify a flight whose lengths and mass have tolerances."""
    folder = tmp_path_factory.mktemp("joint")
    vehicle = replace(
        flight.vehicle, arm_std=0.002, imu_position=(0.0, 0.0, 0.0), imu_position_std=0.001
    )
    return flown.identified(folder, [flight], vehicle=vehicle)


@pytest.mark.parametrize("method", ["ols", "tls"])
def test_the_rule_holds_for_every_estimator(flight, tmp_path, method):
    extra = f'[identification]\nmethod = "{method}"\n'
    assert check_rule(flown.identified(tmp_path, [flight], extra=extra)) >= 5


@pytest.mark.slow
def test_the_rule_holds_in_random_worlds(tmp_path):
    worlds = [draw_world(20261128, i, chances(None), 8.0) for i in range(40)]
    checked = 0
    for world, record in zip(worlds, fly(worlds), strict=True):
        path = write_world(world, record, tmp_path)
        try:
            checked += check_rule(flown.quietly_identified(path)) > 0
        except RotorfitError:
            continue
    assert checked >= 20


@pytest.mark.parametrize("name", ["w3", "w21", "w28"])
def test_the_rule_holds_in_stored_worlds(flight_data_dir, name):
    path = flight_data_dir / "mujoco-worlds" / f"{name}.toml"
    if not path.is_file():
        pytest.skip("no stored worlds here")
    assert check_rule(flown.quietly_identified(path)) > 20


def test_the_rule_holds_for_a_real_flight(flight_data_dir, tmp_path):
    log = flight_data_dir / "tudelft-indiflight" / "LOG00271.BFL"
    if not log.is_file():
        pytest.skip("no real flights here")
    cinerat = Path(__file__).parents[2] / "examples" / "cinerat.toml"
    path = tmp_path / "throw.toml"
    text = cinerat.read_text(encoding="utf-8")
    path.write_text(f'{text}\n[[configuration]]\nmass = 0.428\nflights = ["{log}"]\n')
    assert check_rule(flown.quietly_identified(path)) > 40


def test_declared_tolerances_are_terms_of_their_own(joint):
    assert check_rule(joint) >= 10
    terms = {t.name: t for t in joint.parameter("Ixx").interval_terms}
    assert {"noise", "arm lengths", "IMU position"} <= terms.keys()
    assert terms["arm lengths"].source == "declared tolerance"
    # Longer arms by a share s make roll inertia larger by about s; twice the deviation counts.
    ratio = terms["arm lengths"].half_width / joint.parameter("Ixx").value
    assert ratio == pytest.approx(2.0 * 0.002 / 0.25, rel=0.25)


def test_terms_come_back_and_older_files_have_none(joint, tmp_path):
    path = tmp_path / "result.json"
    joint.save(path)
    again = IdentificationResult.load(path)
    assert again.parameters == joint.parameters
    assert again.derived == joint.derived
    plain = json.loads(path.read_text(encoding="utf-8"))
    plain["schema"] = 1
    for number in (*plain["parameters"], *plain["derived"]):
        del number["interval_terms"]
    path.write_text(json.dumps(plain), encoding="utf-8")
    older = IdentificationResult.load(path)
    assert older.parameter("Ixx").interval == joint.parameter("Ixx").interval
    assert older.parameter("Ixx").interval_terms == ()


def test_a_number_that_is_withheld_has_no_terms(joint):
    finding = Finding(
        kind="made-up", severity="doubt", numbers=("Ixx", "Ixx_com"), withheld_because="made up"
    )
    without = made_result(withheld(tables_of(joint), finding))
    assert without.parameter("Ixx").interval_terms == ()
    assert without.derived_value("Ixx_com").interval_terms == ()


def test_a_term_that_is_no_half_width_is_refused(joint):
    kt = joint.parameter("kt")
    wrong = replace(kt.interval_terms[0], half_width=-1.0)
    changed = replace(
        joint,
        parameters=tuple(
            replace(p, interval_terms=(wrong,)) if p is kt else p for p in joint.parameters
        ),
    )
    with pytest.raises(OutputError, match="interval term"):
        refuse_unsound(changed)
