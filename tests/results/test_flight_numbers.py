"""Throttle in hover, thrust over weight, largest thrust, imbalance: numbers that a pilot asks."""

from dataclasses import replace

import numpy as np
import pytest

from made_tables import made_result
from rotorfit.checks.verdicts.judge import Derived, Parameter
from rotorfit.findings import doubt
from rotorfit.fit.experiment.experiment import MotorsEntry
from rotorfit.logs.motor_law import MotorLaw, SquareRootCurve
from rotorfit.model.parameters import DERIVED, OF_FLIGHT, PARAMETERS
from rotorfit.results.assemble import mark_doubtful
from rotorfit.results.command_units import NO_COMMANDS, NO_MASS, with_flight_numbers
from rotorfit.results.result import IdentificationResult
from rotorfit.results.sound_result import refuse_unsound
from rotorfit.results.tables import ResultTables

MASS, KT, FULL = 0.5, 2e-6, 1500.0
HOVER = (MASS * 9.80665 / 4 / KT) ** 0.5
ROTORS = {"kt_1": 2.1e-6, "kt_2": 2e-6, "kt_3": 2e-6, "kt_4": 1.9e-6}
MEASURED = MotorsEntry(speed="measured")
BY_LAW = MotorsEntry(speed="commanded", law=MotorLaw(curve=SquareRootCurve(FULL, 0.4)))


def number(kind, name, value, half, *, owner=None, unit=None, **more):
    return kind(
        name=name,
        configuration=owner,
        value=value,
        std=half / 1.96,
        interval=(value - half, value + half),
        unit=unit or (PARAMETERS | DERIVED)[name].unit,
        **more,
    )


def tables_of(*, full: bool = False, kt_unit: str | None = None, hover=HOVER, **verdicts):
    """A quadrotor whose coefficients have no correlation, each known to 1e-8 (95 %)."""
    known = [("kt", KT, 2e-8), *((n, v, 1e-8) for n, v in ROTORS.items())]
    if full:
        known.append(("max_speed", FULL, 30.0))
    parameters = [
        number(Parameter, n, v, h, verdict=verdicts.get(n, "identified")) for n, v, h in known
    ]
    if kt_unit is not None:
        parameters[0] = replace(parameters[0], unit=kt_unit)
    mass = number(Parameter, "mass", MASS, 0.001, owner="A", verdict="given")
    names = tuple(p.name for p in parameters)
    return ResultTables(
        parameters=(*parameters, mass),
        derived=(number(Derived, "hover_speed", hover, 0.005 * hover, owner="A"),),
        flights=(),
        covariance_names=names,
        covariance=np.diag([p.std**2 for p in parameters]),
        used={},
    )


def derived(tables) -> dict[str, Derived]:
    return {d.name: d for d in mark_doubtful(tables).derived}


def test_thrust_at_a_measured_full_speed():
    found = derived(with_flight_numbers(tables_of(full=True), BY_LAW))
    assert found["max_thrust"].value == pytest.approx(KT * FULL**2)
    low, high = found["max_thrust"].interval
    assert (high - low) / 2 / found["max_thrust"].value == pytest.approx(np.hypot(0.01, 0.04))
    ratio = found["thrust_to_weight"]
    assert ratio.value == pytest.approx(4 * KT * FULL**2 / (MASS * 9.80665))
    assert ratio.interval[1] / ratio.value - 1 == pytest.approx(2 * np.hypot(0.005, 0.02))
    assert {found[name].verdict for name in OF_FLIGHT[2:4]} == {"identified"}


def test_throttle_is_the_command_whose_thrust_is_the_weight():
    throttle = derived(with_flight_numbers(tables_of(), BY_LAW))["hover_throttle"]
    u = throttle.value
    assert FULL**2 * (0.4 * u**2 + 0.6 * u) == pytest.approx(HOVER**2, rel=1e-4)
    assert throttle.interval[0] < u < throttle.interval[1] < 1.04 * u


def test_a_command_in_place_of_a_speed_is_the_throttle():
    per_command = tables_of(kt_unit="N per squared command", hover=0.4)
    found = derived(with_flight_numbers(per_command, MotorsEntry(speed="commanded")))
    assert found["hover_throttle"].value == pytest.approx(0.4)
    assert found["thrust_to_weight"].value == pytest.approx(1 / 0.16)


def test_imbalance_is_the_strongest_less_the_weakest():
    found = derived(with_flight_numbers(tables_of(), MEASURED))["motor_imbalance"]
    assert found.value == pytest.approx(0.1)
    assert found.interval[1] - found.value == pytest.approx(2**0.5 * 1e-8 / 2e-6)


def test_what_is_not_known_says_what_to_log():
    found = derived(with_flight_numbers(tables_of(), MEASURED))
    for name in ("max_thrust", "thrust_to_weight", "hover_throttle"):
        assert (found[name].value, found[name].verdict) == (None, "not-identified")
        assert found[name].reason == NO_COMMANDS
    per_kilogram = tables_of(kt_unit="N s^2/rad^2 per kg")
    assert derived(with_flight_numbers(per_kilogram, BY_LAW))["max_thrust"].reason == NO_MASS


@pytest.mark.parametrize(
    ("doubted", "doubtful"),
    [
        # Each rotor's own is of the mean.
        (
            "kt",
            {
                *("hover_speed", "max_thrust", "thrust_to_weight"),
                *("hover_throttle", "motor_imbalance"),
            },
        ),
        ("kt_2", {"motor_imbalance"}),
        ("max_thrust", {"max_thrust"}),
    ],
)
def test_a_doubt_of_a_number_is_one_of_what_is_made_of_it(doubted, doubtful, assert_text):
    made = with_flight_numbers(tables_of(full=True), BY_LAW)
    because = doubt("made", "words", numbers=(doubted,), doubtful_because="it is made up")
    found = derived(made.found(because))
    assert {name for name, d in found.items() if d.verdict == "doubtful"} == doubtful
    for name in doubtful:
        assert_text(found[name].reason)


def test_verdicts_of_derived_numbers_are_saved_and_sound(tmp_path):
    result = made_result(mark_doubtful(with_flight_numbers(tables_of(full=True), BY_LAW)))
    refuse_unsound(result)
    result.save(tmp_path / "result.json")
    assert IdentificationResult.load(tmp_path / "result.json").derived == result.derived
